"""Are buckets booked once each? Shifts of reference machines with foreign friction: plain cycles, spill, tip-off over
the heap, dumps in two parts, double dips, swings without digging, and restarts of the service in mid-cycle.

A bucket is missed if nothing is booked from its dump on until the next one is clear of the ground; doubled if more
than one is; a booking after a swing without digging is a phantom. A booked weight is wrong if it is off by more than
2 % of rated and by three of its standard errors."""

import argparse
import json
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.commissioning.identification import identify
from cylforce.estimation.residual import EMPTY_BELOW
from cylforce.programs.common.readings import calibrated, model_of, recorded_segments
from cylforce.programs.live.books import changed
from cylforce.records.writing import SHORTEST_CYCLE_US
from cylforce.service.booking import MissedReason
from cylforce.service.core import Core
from cylforce.service.memory import NOTHING_KEPT
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Array, Booking, Status, is_new
from reference_machine.machine import Machine, draw
from reference_machine.shift import COURSES, Job

from ._quick import served

KNOWN_KG = 1000.0
SHARES = {"plain": 0.4, "spill": 0.1, "tip_off": 0.1, "two_parts": 0.1, "double_dip": 0.1, "swing": 0.2}
LOADS, CARRY_BACK = (0.15, 1.0), 0.02  # of rated: dug; largest that stays in the bucket
PACE, SLEW, JERK = (0.8, 1.15), (0.3, 1.0), 0.012  # rad/s; m, of every second machine
SHIFT = 20  # cycles that are simulated at once
DOWN_S = 2.0  # s for which a restarted service is away
WRONG, CERTAIN = 0.02, 3.0  # of rated; standard errors


class Bucket(NamedTuple):
    """A cycle as it was: kind, weight that left the bucket [kg] (0: nothing), whether the service was restarted after
    the bucket was free of the ground and before the next one; the bookings; why there is none."""

    kind: str
    mass: float
    restarted: bool
    bookings: tuple[Booking, ...]
    why: str


class Work(NamedTuple):
    """`restarts`: share of the cycles in which the service is restarted; `shares` of the kinds of cycles."""

    restarts: float = 0.1
    shares: Mapping[str, float] = SHARES


USUAL = Work()


class Shift(NamedTuple):
    """What the service did: bookings as they ended, times [s] of the restarts, every state's time, told losses and
    status of the weight, for the reasons."""

    bookings: list[Booking]
    restarts: list[float]
    told: list[tuple[float, bool]]
    weights: list[tuple[float, str]]


def jobs_of(
    rng: np.random.Generator, count: int, rated: float, shares: Mapping[str, float] = SHARES
) -> tuple[Job, ...]:
    """A shift's cycles, drawn; `shares`: how many there are of each kind."""
    kinds = rng.choice(list(shares), count, p=np.array(list(shares.values())) / sum(shares.values()))
    loads, stays = rated * rng.uniform(*LOADS, count), rated * CARRY_BACK * rng.beta(1.0, 2.0, count)
    pace = rng.uniform(*PACE, count)
    return tuple(Job(str(k), *map(float, rest)) for k, *rest in zip(kinds, loads, stays, pace, strict=True))


def core_of(machine: Machine, folder: Path) -> Core:
    """The service after five minutes of empty motion and one known lift."""
    empty = machine.run("commissioning", seed=0).write(folder)
    lift = machine.run("known_lift", seed=3, weight_kg=KNOWN_KG).write(folder)
    loaded = load(folder / "machine.toml")
    found = identify(model_of(loaded), recorded_segments(loaded, empty), refuse=False)
    return Core(loaded.service, calibrated(loaded, found, lift, KNOWN_KG).tares)


def worked(core: Core, values: Array, restarts: list[int]) -> Shift:
    """The service through samples (T, S), restarted at some of them with what its records keep."""
    done, kept, begin, kept_us = Shift([], [], [], []), NOTHING_KEPT, 0, 0
    away = round(1e6 * DOWN_S) // core.period_us
    for end in (*restarts, len(values)):
        if end - begin > core.model.settle_steps:
            told = 0  # a start counts anew
            for service in served(core, values[begin:end], begin + 1, kept):
                told = _note(done, service, core, told)
                now = service.memory
                if changed(kept, now) or is_new(now.booking, kept.booking):
                    kept, kept_us = now, service.estimate.t_us
        begin = end + away
        if begin * core.period_us - kept_us > SHORTEST_CYCLE_US:
            kept = kept.emptied()
        done.restarts.append(end * 1e-6 * core.period_us)
    return done._replace(restarts=done.restarts[:-1])


def _note(done: Shift, service: WeighingService, core: Core, told: int) -> int:
    """Notes one instant; `told`: losses that this start had told before. How many it has told now."""
    t, books = service.estimate.t_us * 1e-6, service.bookings
    booking = books.booking
    if booking is not None:
        same = bool(done.bookings) and done.bookings[-1].number == booking.number
        done.bookings[len(done.bookings) - same :] = [booking]
    if books.missed.number > told:
        done.told.append((t, books.missed.reason is MissedReason.INTERRUPTED))
    mass = service.estimate.load.mass
    error = 100.0 * mass.standard_error / core.service.machine.rated_payload
    known = f"{mass.reason.name} (+- {error:.1f} %)" if mass.status is Status.DEGRADED else mass.reason.name
    done.weights.append((t, known))
    return books.missed.number


def buckets(notes: list[dict[str, Any]], done: Shift, rated: float) -> Iterator[Bucket]:
    """Each cycle beside what was booked of it: from the beginning of its dump to the moment when the next bucket
    is free of the ground."""
    nexts = [n["free_s"][0] for n in notes[1:]] + [float("inf")]
    for note, until in zip(notes, nexts, strict=True):
        free, falls = note["free_s"]
        own = tuple(b for b in done.bookings if falls <= b.t_us * 1e-6 < until)
        if note is notes[0]:
            own = tuple(b for b in done.bookings if b.t_us * 1e-6 < until)
        mass = note["payload_kg"] - note["carry_back_kg"]
        mass = mass if mass >= EMPTY_BELOW * rated else 0.0
        again = any(free - DOWN_S <= t < until for t in done.restarts)
        yield Bucket(note["kind"], mass, again, own, "" if own or not mass else _why(done, note, until))


def _why(done: Shift, note: dict[str, Any], until: float) -> str:
    """What the service says of a bucket that it did not book, and of the weights that it had."""
    (free, falls), (empty, _) = note["free_s"], note["empty_s"]
    told = [interrupted for t, interrupted in done.told if falls <= t < until + 20.0]
    said = "not told" if not told else "interrupted" if told[0] else "not seen empty"
    spans = {"lifted": (free, falls), "empty": (empty, until)}
    words = [f"{name}: {_mostly(done, *span)}" for name, span in spans.items()]
    return f"{said}; {'; '.join(words)}"


def _mostly(done: Shift, begin: float, end: float) -> str:
    found = Counter(reason.partition(" ")[0] for t, reason in done.weights if begin <= t < end)
    return ", ".join(f"{reason} {100 * n / found.total():.0f} %" for reason, n in found.most_common(3))


def shift_of(machine: Machine, core: Core, seed: int, count: int, work: Work) -> list[Bucket]:
    """One shift of a machine."""
    rng, rated = np.random.default_rng((machine.seed, seed)), core.service.machine.rated_payload
    jobs, slew, jerk = jobs_of(rng, count, rated, work.shares), float(rng.uniform(*SLEW)), JERK * (machine.seed % 2)
    made = machine.run("shift", seed=seed, jobs=jobs, slew_rate=slew, jerk=jerk)
    notes = made.header["pieces"][0]["cycles"]  # type: ignore[index]
    chosen = [n for n in notes if rng.random() < work.restarts]
    begins = [n["free_s"][0] - 7.4 for n in chosen]
    at = sorted(int(100 * rng.uniform(b, n["empty_s"][1])) for b, n in zip(begins, chosen, strict=True))
    names = [signal.name for signal in core.service.machine.signals]
    values = made.values[:, [made.signals.index(str(name)) for name in names]]
    return list(buckets(notes, worked(core, values, at), rated))


def machine_of(seed: int, cycles: int, tell: Console, work: Work = USUAL) -> list[Bucket]:
    """All shifts of one machine."""
    machine, found = draw(seed, friction="foreign"), []
    with TemporaryDirectory() as folder:
        core = core_of(machine, Path(folder))
        for k in range(0, cycles, SHIFT):
            found += shift_of(machine, core, 20 + k, min(SHIFT, cycles - k), work)
            rated = core.service.machine.rated_payload
            tell.print(seed, scored(found, rated), *[_said(b) for b in found[k:] if _faulty(b, rated)], sep="\n  ")
    return found


def scored(found: list[Bucket], rated: float) -> dict[str, int]:
    """The figures."""
    loads, swings = [b for b in found if b.mass], [b for b in found if not b.mass]
    return {
        "cycles": len(found),
        "buckets": len(loads),
        "missed": sum(not b.bookings for b in loads),
        "doubled": sum(len(b.bookings) > 1 for b in loads),
        "phantom": sum(len(b.bookings) for b in swings),
        "wrong": sum(_wrong(b, rated) for b in loads),
        "untold": sum(b.why.startswith("not told") for b in loads),
        "restarts": sum(b.restarted for b in found),
    }


def _wrong(bucket: Bucket, rated: float) -> bool:
    last = bucket.bookings[-1] if bucket.bookings else None
    return last is not None and abs(last.dumped - bucket.mass) > max(WRONG * rated, CERTAIN * last.dumped_error)


def _faulty(bucket: Bucket, rated: float) -> bool:
    return len(bucket.bookings) != bool(bucket.mass) or _wrong(bucket, rated)


def _said(bucket: Bucket) -> dict[str, Any]:
    return {**bucket._asdict(), "bookings": [round(booking.dumped, 1) for booking in bucket.bookings]}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy cycles", description=__doc__)
    parser.add_argument("--machines", type=int, default=10)
    parser.add_argument("--cycles", type=int, default=100, help="of each machine")
    parser.add_argument("--seed", type=int, default=4400, help="of the first machine")
    parser.add_argument("--restarts", type=float, default=0.1, help="share of the cycles with a restart of the service")
    parser.add_argument("--kinds", nargs="+", choices=tuple(SHARES), default=list(SHARES), help="of cycles: only these")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    work = Work(options.restarts, {kind: SHARES[kind] for kind in options.kinds})
    console, found, rated = Console(highlight=False, width=200), [], 1500.0
    for seed in range(options.seed, options.seed + options.machines):
        found += [(seed, bucket) for bucket in machine_of(seed, options.cycles, console, work)]
        if options.json:
            options.json.write_text(json.dumps(figures(found, rated), indent=1) + "\n")
    console.print(table([bucket for _, bucket in found], rated))


def figures(found: list[tuple[int, Bucket]], rated: float) -> dict[str, Any]:
    """The keys of the JSON file."""
    all_buckets = [bucket for _, bucket in found]
    faults = [{"machine": seed, **_said(bucket)} for seed, bucket in found if _faulty(bucket, rated)]
    kinds = {kind: scored([b for b in all_buckets if b.kind == kind], rated) for kind in COURSES}
    return {**scored(all_buckets, rated), "kinds": kinds, "misses": faults}


def table(found: list[Bucket], rated: float) -> Table:
    """A row for each kind of cycle."""
    shown = Table(title="bookings")
    for column in ("kind", *scored([], rated)):
        shown.add_column(column, justify="left" if column == "kind" else "right")
    for kind in COURSES:
        shown.add_row(kind, *map(str, scored([b for b in found if b.kind == kind], rated).values()))
    shown.add_row("all", *map(str, scored(found, rated).values()))
    return shown


if __name__ == "__main__":
    main()
