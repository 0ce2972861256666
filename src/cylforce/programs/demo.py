"""`cylforce demo`: the main job from end to end.

The empty simulated machine moves and is identified. Then it digs on a bus with the real clock; booked weights and tip
forces are compared with the simulator's truth.
"""

import asyncio
import json
import secrets
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

import cylforce
from cylforce.can.opening import open_bus
from cylforce.files.atomic import check_outputs, replacing
from cylforce.files.truth import read_truth
from cylforce.programs.common.machine_file import load_machine
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import make_core
from cylforce.programs.common.score import CycleScore, ForceScore, score_cycles, score_force
from cylforce.programs.live.messages import configure_messages
from cylforce.programs.live.shown import show
from cylforce.programs.live.sim_bus import play_until
from cylforce.programs.live.station import Counts, serve
from cylforce.programs.run import Daemon, show_status, words_of
from cylforce.service.booking import Missed
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Booking, Estimate

MOVES_S = 120.0
LIFT_S = 40.0
KNOWN = 2.0 / 3.0  # times the rated payload: the known weight that is lifted; chosen
NOT_WEIGHED_EMPTY = "the run ended before the empty bucket was weighed accurately enough"
MASS_ERROR = 0.1  # of the true masses, as a fraction; the default of `cylforce sim`
RELAY = "remote:127.0.0.1"


class Watched(NamedTuple):
    """Results of the daemon while it ran.

    estimates: one for each step
    bookings:  booked loads
    missed:    loads that were not booked
    counts:    steps and overruns
    """

    estimates: list[Estimate]
    bookings: list[Booking]
    missed: list[Missed]
    counts: Counts


class Files(NamedTuple):
    """The demo's folder."""

    folder: Path

    @property
    def moves(self) -> Path:
        """Events of the empty machine's moves."""
        return self.folder / "moves.log"

    @property
    def lift(self) -> Path:
        """Events of the lift of a known weight."""
        return self.folder / "lift.log"

    @property
    def identified(self) -> Path:
        """The tares."""
        return self.folder / "identified.toml"

    @property
    def truth(self) -> Path:
        """The truth, which the daemon never reads."""
        return self.folder / "truth.csv"


def run_demo(
    machine: Path, bus: str, clock: str, cycles: int, seed: int | None, output: Path | None, listen: str | None = None
) -> bool:
    """Show the main job, then the display at the address `listen` until a signal; whether every load was booked. Raises
    the programs' own errors, and KeyboardInterrupt when a signal ended it: figures of some cycles are not shown."""
    seed = secrets.randbits(32) if seed is None else seed
    bus = RELAY if listen and bus.startswith("virtual:") else bus
    check_outputs((output,), (machine,), (".json",))
    loaded, console = load_machine(machine), Console(highlight=False)
    with TemporaryDirectory(prefix="cylforce-demo-") as folder:
        files = Files(Path(folder))
        with _relay(bus) as named, (files.folder / "daemon.jsonl").open("w") as messages:
            open_bus(named).close()  # a bus that is not there is noticed before minutes of work
            console.print(f"seed {seed}, bus {bus}, {clock} clock, {loaded.service.machine.name}")
            _prepare(loaded, files, seed, console)
            configure_messages(messages)
            watched = asyncio.run(_work(loaded, files, named, cycles, seed, console))
            truth = read_truth(files.truth)
            weights = score_cycles(truth, watched.bookings)
            force = score_force(truth, watched.estimates)
            _show(console, loaded, weights, force, watched.counts)
            if output is not None:
                run = {"bus": bus, "clock": clock, "seed": seed}
                _write(output, _summary(loaded, weights, force, watched.counts, run))
            if listen is not None:
                console.print("4. the machine goes on; the page in the cab, until Ctrl-C:")
                asyncio.run(show(machine, files.identified, named, seed, listen))
    return all(w.estimated_kg is not None for w in weights)


def _prepare(loaded: Loaded, files: Files, seed: int, console: Console) -> None:
    """Move the empty machine and lift a known weight, faster than real time; identify tares and scale from both."""
    machine, known_kg = loaded.path, round(KNOWN * loaded.service.machine.rated_payload)
    moves = ("sim", machine, "--scenario", "moves", "--seed", seed)
    console.print(f"1. the empty machine moves for {MOVES_S:.0f} s (masses 10 % off the machine file's)")
    _cylforce(*moves, "--duration", MOVES_S, "--log", files.moves)
    console.print(f"   and lifts a known weight of {known_kg} kg")
    _cylforce(*moves, "--duration", LIFT_S, "--payload-kg", known_kg, "--log", files.lift)
    console.print("2. its tares and the scale are identified from these recordings")
    lift = ("--lift", files.lift, "--known-kg", known_kg)
    # The folder vanishes with the demo, and nothing here diagnoses: the statistics would take most of the time.
    _cylforce("identify", machine, files.moves, *lift, "-o", files.identified, "--no-statistics")


def _cylforce(*arguments: object) -> None:
    words = [sys.executable, "-m", "cylforce", *(str(a) for a in arguments)]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)  # noqa: S603  # our own program


@contextmanager
def _relay(bus: str) -> Iterator[str]:
    """Yield the bus to open: for a relay without a port, a new one on a free port of 127.0.0.1."""
    if bus != RELAY:
        yield bus
        return
    from cylforce.can.python_can import Relay

    with Relay() as relay:
        yield relay.name


async def _work(loaded: Loaded, files: Files, bus: str, cycles: int, seed: int, console: Console) -> Watched:
    """Run daemon and simulated machine on one bus, until the machine's run is over."""
    console.print(f"3. {cycles} digging cycles of at most 15 s on the bus")
    daemon = Daemon(loaded, make_core(loaded, files.identified), open_bus(bus), None, NOTHING_KEPT)
    watched = Watched([], [], [], Counts())

    def watch(estimate: Estimate) -> None:
        watched.estimates.append(estimate)
        booking = estimate.booking
        if booking is not None and booking.number > len(watched.bookings):
            watched.bookings.append(booking)
            console.print(f"   booked {booking.mass:7.1f} kg +- {booking.standard_error:.1f} kg")
        missed = daemon.weighing.bookings.missed
        if missed.number > len(watched.missed):
            watched.missed.append(missed)
            console.print(f"   not booked {missed.mass:7.1f} kg: {words_of(missed)}")

    daemon.on_estimate = watch
    until = asyncio.Event()
    dig = _dig_here if bus.startswith("virtual:") else _dig_beside
    digging = asyncio.create_task(dig(loaded, files, bus, cycles, seed, until))
    try:
        stopped = await serve(daemon, until, lambda: show_status(daemon))
    finally:
        until.set()
        await digging
    if stopped:
        raise KeyboardInterrupt
    waiting = daemon.weighing.bookings.candidate
    if waiting is not None:
        console.print(f"   not booked {waiting.mass:7.1f} kg: {NOT_WEIGHED_EMPTY}")
    return watched._replace(counts=daemon.counts)


async def _dig_here(loaded: Loaded, files: Files, bus: str, cycles: int, seed: int, until: asyncio.Event) -> None:
    """Run the simulated machine in this process; other processes do not see a virtual bus."""
    opened = open_bus(bus)
    try:
        await play_until(prepare(loaded, "cycles", seed, MASS_ERROR, amount=cycles), opened, files.truth, until)
    finally:
        until.set()
        opened.close()


async def _dig_beside(loaded: Loaded, files: Files, bus: str, cycles: int, seed: int, until: asyncio.Event) -> None:
    """Run the simulated machine in a process of its own."""
    words = ("sim", str(loaded.path), "--scenario", "cycles", "--cycles", str(cycles), "--seed", str(seed))
    machine = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "cylforce", *words, "--bus", bus, "--truth", str(files.truth)),
        stdout=asyncio.subprocess.DEVNULL,
    )
    ended = asyncio.create_task(_set_when_ended(machine, until))
    await until.wait()
    if machine.returncode is None:
        machine.terminate()
    await ended
    if machine.returncode != 0:
        raise RuntimeError(f"the simulated machine ended with status {machine.returncode}")


async def _set_when_ended(machine: asyncio.subprocess.Process, until: asyncio.Event) -> None:
    await machine.wait()
    until.set()


def _show(console: Console, loaded: Loaded, weights: list[CycleScore], force: ForceScore, counts: Counts) -> None:
    rated = loaded.service.machine.rated_payload
    table = Table(title=f"booked weights, rated payload {rated:.0f} kg (on our own simulator)")
    for name in ("cycle", "true kg", "booked kg", "standard error kg", "error kg", "error % of rated"):
        table.add_column(name, justify="right")
    for k, w in enumerate(weights, 1):
        if w.estimated_kg is None or w.standard_error_kg is None:
            table.add_row(str(k), f"{w.true_kg:.1f}", "not booked", "", "", "")
            continue
        error = w.estimated_kg - w.true_kg
        numbers = (w.true_kg, w.estimated_kg, w.standard_error_kg, error)
        table.add_row(str(k), *(f"{x:z.1f}" for x in numbers), f"{100 * error / rated:z.2f}")
    console.print(table)
    console.print(
        f"tip force while digging, above 10 kN ({force.samples} samples, {100 * force.published:.1f} % published): "
        f"error {force.rms_n:.0f} N rms, p95 {100 * force.p95_relative:.1f} % of the force, "
        f"p95 {force.p95_direction_deg:.1f} deg"
    )
    console.print(f"{counts.steps} steps, {counts.overruns} overruns ({100 * _overruns(counts):.2f} %)")


def _overruns(counts: Counts) -> float:
    return counts.overruns / max(1, counts.steps + counts.overruns)


def _summary(
    loaded: Loaded, weights: list[CycleScore], force: ForceScore, counts: Counts, run: dict[str, Any]
) -> dict[str, Any]:
    return {
        "rated_payload_kg": loaded.service.machine.rated_payload,
        "cycles": [w._asdict() for w in weights],
        "force": {k: v if np.isfinite(v) else None for k, v in force._asdict().items()},
        "overruns": _overruns(counts),
        **run,
        "version": cylforce.__version__,
    }


def _write(path: Path, summary: dict[str, Any]) -> None:
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n")
