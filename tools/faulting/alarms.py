"""How often the service suspects a sensor in order: over recordings of a foreign generator, and as much digging of the
project's own simulator, and digging and empty motion of reference machines, as a time of this processor allows."""

import argparse
import json
import os
import sys
import time
from collections.abc import Iterator
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from cylforce.service.plausibility.suspicion import Level, SensorSuspicion
from weighing.bucket import reference

from .leaps import AIR, CONTACT, WORK
from .runs import followed
from .works import ROOT, Case, events, foreign_case, opened, reference_case, simulated_case

EMPTY = "commissioning"  # recording of the empty machine, from which a reference machine was identified
NAMES = {"excavator": "reference", "loader": "reference, wheel loader"}
SOURCES = (("foreign, digging", (WORK,)), ("foreign, contact", (CONTACT,)), ("foreign, in the air", AIR))


class Alarms(NamedTuple):
    """A recording in order: its source and name, hours, share of the time in which the weight and the force were OK;
    the suspicions, with their times [s] after its beginning."""

    source: str
    name: str
    hours: float
    ok: tuple[float, float]
    suspicions: list[tuple[float, SensorSuspicion]]


def judged(source: str, name: str, case: Case) -> Alarms:
    """What the service says to a recording."""
    course = followed(case.core, events(case, case.table.values, slice(None)))
    begun, ok = float(case.table.t_s[0]), course.ok.mean(axis=0)
    suspicions = [(t - begun, s) for t, s in course.suspicions if s.level is not Level.FINE]
    return Alarms(source, name, len(course.t_s) / case.rate_hz / 3600.0, (float(ok[0]), float(ok[1])), suspicions)


def foreign(folder: Path, numbers: list[int]) -> Iterator[Alarms]:
    """Those of machines of the foreign generator, if they can be had."""
    for number in numbers if folder.exists() else []:
        for source, recordings in SOURCES:
            for recording in recordings:
                name = f"machine_{number}"
                yield judged(source, f"{name}, {recording}", foreign_case(folder, name, recording))


def simulated(first: int, reference: int, minutes: float) -> Iterator[Alarms]:
    """Those of simulated and reference machines in turn, from these seeds on, for so many minutes of this process."""
    begun = time.process_time()
    for seed in count():
        for source, machine, number in (
            ("simulated, digging", simulated_case, first + seed),
            ("reference, digging", reference_case, reference + seed),
            ("reference, in the air", partial(reference_case, recording=EMPTY), reference + seed),
        ):
            if time.process_time() - begun > 60.0 * minutes:
                return
            yield judged(source, f"{source} {number}", machine(number))


def recorded(folders: list[Path]) -> Iterator[Alarms]:
    """Those of the reference machines of folders, standing ones: KIND_SEED, as this tool and `weighing` leave them."""
    for place in sorted(place for folder in folders for place in folder.glob("*_*/truth/work.json")):
        machine = place.parents[1]
        kind, *numbers = machine.name.split("_")
        for source, recording in (("digging", None), ("in the air", EMPTY)) if len(numbers) == 1 else ():
            case = opened(reference(kind, int(numbers[0]), 0, machine.parent, lift=True), recording)
            yield judged(f"{NAMES[kind]}, {source}", f"{kind} {numbers[0]}, {source}", case)


def summary(found: list[Alarms]) -> dict[str, dict[str, float]]:
    """By source."""
    each = {}
    for source in dict.fromkeys(one.source for one in found):
        own = [one for one in found if one.source == source]
        hours, alarms = sum(one.hours for one in own), sum(len(one.suspicions) for one in own)
        shares = [sum(one.ok[k] * one.hours for one in own) / hours for k in (0, 1)]
        each[source] = {"recordings": len(own), "hours": hours, "alarms": alarms, "weight_ok": shares[0]}
        each[source] |= {"force_ok": shares[1], "per_hour": alarms / hours}
    return each


def table(figures: dict[str, dict[str, float]]) -> Table:
    """By source."""
    shown = Table(title="machines in order that are doubted")
    for name in ("source", "recordings", "hours", "suspicions", "weight OK", "force OK"):
        shown.add_column(name, justify="left" if name == "source" else "right")
    for source, f in figures.items():
        shares = (f"{100.0 * f[key]:.1f} %" for key in ("weight_ok", "force_ok"))
        shown.add_row(source, str(f["recordings"]), f"{f['hours']:.2f}", str(f["alarms"]), *shares)
    return shown


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy alarms", description=__doc__)
    parser.add_argument("--foreign", type=int, nargs="*", default=list(range(1, 11)), help="machines of the generator")
    parser.add_argument("--recorded", type=Path, nargs="*", default=[], help="folders of recorded reference machines")
    parser.add_argument("--simulated", type=int, default=100, help="first seed of the own simulator")
    parser.add_argument("--reference", type=int, default=100, help="first seed of the reference machines")
    parser.add_argument("--minutes", type=float, default=5.0, help="of this processor, for simulated digging")
    parser.add_argument("--hours", type=float, default=float("inf"), help="of work in order, after which it ends, too")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--verbose", action="store_true", help="a line for each recording")
    asked, found = parser.parse_args(), list[Alarms]()
    folder = Path(os.environ.get("CYLFORCE_SHARED", ROOT.parent / "shared")) / "data" / "foreign_machines"
    made = simulated(asked.simulated, asked.reference, asked.minutes)
    for one in chain(foreign(folder, asked.foreign), recorded(asked.recorded), made):
        found.append(one)
        if asked.verbose:
            print(f"{one.name}: {one.hours:.3f} h, {len(one.suspicions)} suspicions", flush=True)
        for t, suspicion in one.suspicions:
            print(f"{one.name}: {t:.2f} s {suspicion.cause.name} {suspicion.signals} {suspicion.size:.4g}", flush=True)
        if sum(each.hours for each in found) >= asked.hours:
            break
    figures = summary(found)
    Console().print(table(figures))
    if asked.json:
        asked.json.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
