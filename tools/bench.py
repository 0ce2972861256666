"""Microseconds of one step, part by part, on a simulated digging cycle; the share of one core that it takes; how many
times as long as a fixed piece of work on the same core, which tells a slow step from a slow core; and the memory of
identification from an hour."""

import argparse
import contextlib
import io
import json
import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterator, Sequence
from itertools import repeat
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.commissioning.identification import identify
from cylforce.files.recording import Events, open_recording
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.programs.sim import run_sim
from cylforce.service.assembler import Assembler
from cylforce.service.contact.interaction import ForceEstimator
from cylforce.service.core import Core
from cylforce.service.pipeline import Pipeline, PipelineConstants
from cylforce.service.publication import Encoder, timetable
from cylforce.service.service import WeighingService
from cylforce.service.weighing import LoadConstants, LoadEstimator
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.events import Event, Frame, Tick

ROOT = Path(__file__).resolve().parents[1]
CONFIGS = ("excavator_20t.toml", "excavator_stick_bucket.toml")
# Each part of a step is what these functions take; none of them calls another.
PARTS: dict[str, tuple[tuple[Any, str], ...]] = {
    "decode": ((Assembler, "receive"),),
    "sample": ((Assembler, "sample"),),
    "regressor": ((PipelineConstants, "read"), (Pipeline, "update")),
    "recursion": ((LoadConstants, "residual"), (LoadEstimator, "update")),
    "force": ((ForceEstimator, "update"),),
    "encode": ((Encoder, "data"),),
}
WORDS = {
    "decode": "frames to signals",
    "sample": "signals to a sample",
    "regressor": "channels, columns, filters",
    "recursion": "residual, weight",
    "force": "forces at the tool, events",
    "encode": "our PDOs",
    "rest": "everything else",
}
HOUR_S = 3600
STEPS_A_YARDSTICK = 10
Clock = Callable[[], float]


class Measured(NamedTuple):
    """What was measured for a machine file: microseconds by part, of a whole step and of the yardstick, the step's over
    the yardstick's, the rate of steps, the largest memory [bytes] that identification from an hour took."""

    parts_us: dict[str, float]
    step_us: float
    yardstick_us: float
    yardsticks: float
    rate_hz: float
    identify_bytes: int | None


def measure(config: Path, rounds: int, memory: bool) -> Measured:
    """Simulate, identify, then step through the same digging cycle again and again."""
    loaded = load(config)
    with TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        moves, cycle = Path(folder) / "moves.log", Path(folder) / "cycle.log"
        run_sim(config, scenario="moves", seed=1, log=moves)
        run_sim(config, scenario="cycles", cycles=1, seed=1, log=cycle)
        segments = list(recorded_segments(loaded, moves))
        events = list(recorded_events(loaded, cycle))
    core = Core(loaded.service, identify(model_of(loaded), segments).tares)
    timed = [step_us(core, events) for _ in range(rounds)]
    total, yard = (statistics.median(us) for us in zip(*timed, strict=True))
    over = statistics.median(step / yard for step, yard in timed)
    shares = [part_shares(core, events) for _ in range(rounds)]
    parts = {name: total * statistics.median(share[name] for share in shares) for name in PARTS}
    peak = identify_peak(loaded, segments) if memory else None
    rest = {"rest": total - sum(parts.values())}
    return Measured(parts | rest, total, yard, over, loaded.service.filters.rate_hz, peak)


def recorded_events(loaded: Loaded, log: Path) -> Iterator[Event]:
    """The log's frames and ticks."""
    recording = open_recording(log, loaded.service)
    assert isinstance(recording, Events)
    return (event for event in recording.events if isinstance(event, Frame | Tick))


def step_us(core: Core, events: Sequence[Event], now: Clock = time.process_time) -> tuple[float, float]:
    """Time of a step with its frames, and of the yardstick, one after every few steps: what slows the core for one (its
    clock, neighbours in its caches) slows it for the other."""
    weighing, yard, ticks, due = WeighingService.start(core), 0.0, 0, due_at(core)
    start = now()
    for event in events:
        estimate = weighing.on_event(event)
        if estimate is not None:
            ticks += 1
            core.encoders.due(estimate, due[ticks % len(due)])
        if isinstance(event, Tick) and ticks % STEPS_A_YARDSTICK == 0:
            before = now()
            yardstick()
            yard += now() - before
    return (now() - start - yard) / ticks * 1e6, yard / (ticks // STEPS_A_YARDSTICK) * 1e6


def due_at(core: Core) -> tuple[tuple[int, ...], ...]:
    """Numbers of our PDOs that are sent at a step, by its number modulo the length."""
    return timetable(core.service.publication, core.service.filters.rate_hz)


def yardstick() -> None:
    """A fixed piece of work that is like a step, small arrays and interpreted lines, and that no change of ours makes
    faster or slower."""
    square = np.eye(13) + np.arange(169.0).reshape(13, 13) % 7.0 * 0.05
    rows, right, words = np.stack([square] * 4), np.ones((4, 13, 1)), {"kept": 0.0}
    for _ in range(4):
        words["kept"] += float(np.linalg.solve(rows, right).sum())
        np.linalg.qr(square)
        np.concatenate((square, right[0]), axis=1).cumsum(axis=0)
        np.einsum("kij,kjl->kil", rows, right)
        for k in range(50):
            words["kept"] = max(words["kept"] - k, 0.0)


def part_shares(core: Core, events: Sequence[Event]) -> dict[str, float]:
    """The share of each part in a step."""
    with stopwatches() as took:
        whole, _ = step_us(core, events, time.perf_counter)
    ticks = sum(isinstance(event, Tick) for event in events)
    return {name: ns / (1e3 * whole * ticks) for name, ns in took.items()}


@contextlib.contextmanager
def stopwatches() -> Iterator[dict[str, int]]:
    """Nanoseconds spent in each part while this context lasts: real time, which is cheaper to ask for than the
    processor's, but good for shares only where other programs run beside."""
    took, kept = dict.fromkeys(PARTS, 0), []
    for part, functions in PARTS.items():
        for owner, name in functions:
            kept.append((owner, name, getattr(owner, name)))
            setattr(owner, name, watched(kept[-1][2], part, took))
    try:
        yield took
    finally:
        for owner, name, function in kept:
            setattr(owner, name, function)


def watched(function: Callable[..., Any], part: str, took: dict[str, int]) -> Callable[..., Any]:
    """The function; its time is added to its part's."""
    now = time.perf_counter_ns

    def timed(*arguments: Any, **named: Any) -> Any:  # noqa: ANN401 - whatever the function takes and gives
        start = now()
        result = function(*arguments, **named)
        took[part] += now() - start
        return result

    return timed


def identify_peak(loaded: Loaded, segments: Sequence[np.ndarray]) -> int:
    """Largest memory [bytes] in use while an hour, the same minutes again and again, is identified piece by piece."""
    seconds = sum(len(segment) for segment in segments) / loaded.service.filters.rate_hz
    hour = (segment.copy() for again in repeat(segments, round(HOUR_S / seconds)) for segment in again)
    tracemalloc.start()
    try:
        identify(model_of(loaded), hour)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def parts_table(found: dict[str, Measured]) -> Table:
    """Parts by row, machine files by column."""
    text = Table(title="One step, in microseconds")
    text.add_column("")
    for name in found:
        text.add_column(name, justify="right")
    for part, words in WORDS.items():
        text.add_row(f"{part}: {words}", *(f"{m.parts_us[part]:.0f}" for m in found.values()))
    text.add_section()
    text.add_row("step, all in all", *(f"{m.step_us:.0f}" for m in found.values()))
    text.add_row("steps per second", *(f"{1e6 / m.step_us:.0f}" for m in found.values()))
    text.add_row("share of this core", *(f"{share(m):.1%} at {m.rate_hz:.0f} Hz" for m in found.values()))
    text.add_row("a yardstick: fixed work on the same core", *(f"{m.yardstick_us:.0f}" for m in found.values()))
    text.add_row("step over yardstick", *(f"{m.yardsticks:.1f}" for m in found.values()))
    if any(m.identify_bytes for m in found.values()):
        peaks = (f"{m.identify_bytes / 1e6:.0f} MB" if m.identify_bytes else "-" for m in found.values())
        text.add_row("identification from an hour, memory", *peaks)
    return text


def share(measured: Measured) -> float:
    """Of one core."""
    return measured.step_us * measured.rate_hz * 1e-6


def compare(config: Path, rounds: int, output: Path | None) -> None:
    """`--against`: the table of one machine file."""
    import against  # it needs the rivals

    found = against.measure(config, rounds)
    Console(highlight=False).print(against.table(found))
    if output:
        output.write_text(json.dumps(against.ratios(found)._asdict(), indent=1) + "\n")


def replay(config: Path, rounds: int, output: Path | None, minutes: float) -> None:
    """`--replay`: the table of one machine file, the quickest of `rounds`."""
    import replayed  # it needs bench

    found = replayed.measure(config, minutes, rounds)
    Console(highlight=False).print(replayed.table(found))
    if output:
        figures = [each._asdict() | {"times": each.times} for each in found]
        output.write_text(json.dumps(figures, indent=1) + "\n")


def by_function(config: Path, rounds: int, output: Path | None) -> None:
    """`--functions`: the table of one machine file."""
    import profiled  # it needs the rivals

    found, step_us = profiled.measure(config, rounds)
    Console(highlight=False).print(profiled.table(found, step_us))
    if output:
        output.write_text(json.dumps({name: share._asdict() for name, share in found.items()}, indent=1) + "\n")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="bench", description=__doc__)
    parser.add_argument("configs", nargs="*", type=Path, metavar="MACHINE.toml", help="default: those in config/")
    parser.add_argument("--rounds", type=int, default=5, help="of which the median is taken")
    parser.add_argument("--memory", action="store_true", help="identify from an hour, too")
    parser.add_argument("--against", action="store_true", help="beside filterpy, padasip, canopen, a loop of C")
    parser.add_argument("--functions", action="store_true", help="where the time goes, by function")
    parser.add_argument("--replay", action="store_true", help="how fast a log is replayed")
    parser.add_argument("--minutes", type=float, default=60.0, help="length of that log")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures there, too")
    options = parser.parse_args()
    if options.replay:
        first = options.configs[0] if options.configs else ROOT / "config" / CONFIGS[0]
        replay(first, options.rounds, options.json, options.minutes)
        return
    if options.against or options.functions:
        table_of = compare if options.against else by_function
        table_of(options.configs[0] if options.configs else ROOT / "config" / CONFIGS[0], options.rounds, options.json)
        return
    configs = options.configs or [ROOT / "config" / name for name in CONFIGS]
    found = {config.stem: measure(config, options.rounds, options.memory) for config in configs}
    Console(highlight=False).print(parts_table(found))
    if options.json:
        figures = {name: m._asdict() | {"share_of_core": share(m)} for name, m in found.items()}
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
