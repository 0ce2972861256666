"""Random faults of sensors in the middle of work: what is wrong and shown as OK, what is noticed, and how often work in
order is doubted."""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.suspicion import Level
from cylforce.signals.kinds import Kind
from cylforce.signals.units import DEGREE

from .edits import BAR, Fault, edited, place
from .order import EVERY_S, Order, in_order
from .runs import SAME_S, Wrong, ended, followed, wrong
from .works import ROOT, Case, events, foreign_case, reference_case, simulated_case

SHARED = ROOT.parent / "shared" / "data" / "foreign_machines"
KINDS = ("sides exchanged", "nodes exchanged", "burst", "dead", "frozen", "drift", "step", "slipped", "sliding")
FOLLOWED_S = 60.0  # after the beginning of a fault
DRIFTED_S = 140.0  # after that of a drift
HEADWAY_S = 40.0  # of work in order before


class Found(NamedTuple):
    """A scenario: machine, fault, and what it did."""

    machine: str
    fault: Fault
    wrong: Wrong


def cases(seed: int) -> Iterator[Case]:
    """A machine of each source that can be had."""
    yield reference_case(31 + seed)
    yield simulated_case(7 + seed)
    if SHARED.exists():
        yield foreign_case(SHARED, f"machine_{6 + seed % 5}")


def drawn(machine: Machine, rng: np.random.Generator, last_s: float) -> Fault:
    """A fault at random: kind, sensor, size, time [s]."""
    kind, begin = str(rng.choice(KINDS)), float(rng.uniform(HEADWAY_S, last_s - FOLLOWED_S))
    cylinder, other = (int(x) for x in rng.choice(len(machine.cylinders), 2, replace=False))
    side = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)[int(rng.integers(2))]
    sign = float(rng.choice((-1.0, 1.0)))
    if kind in ("sides exchanged", "nodes exchanged"):
        return Fault(kind, cylinder, other, begin=begin)
    if kind in ("slipped", "sliding"):
        return Fault(kind, place(machine, Kind.JOINT_ANGLE, cylinder), 0, sign * rng.uniform(2.0, 8.0) * DEGREE, begin)
    size = sign * float(rng.uniform(3.0, 20.0)) * BAR
    side = Kind.HEAD_PRESSURE if kind == "burst" else side
    return Fault(kind, place(machine, side, cylinder), 0, size, begin)


def scenario(case: Case, order: Order, fault: Fault, seed: int) -> Found:
    """The service over a case with a fault, from the last state before it on."""
    machine = case.loaded.service.machine
    state, k = order.before(fault.begin)
    values = edited(case.table.values, case.rate_hz, fault, machine, seed).values
    end = fault.begin + (DRIFTED_S if fault.kind == "drift" else FOLLOWED_S)
    rows = slice(round(k * EVERY_S * case.rate_hz), round(end * case.rate_hz))
    begin = float(case.table.t_s[0]) + fault.begin
    beside, whole = (order.course.since(begin, begin + end - fault.begin + more) for more in (0.0, SAME_S))
    beside = beside._replace(bookings=whole.bookings)  # one that is booked a little sooner than in order has its bucket
    course = ended(followed(case.core, events(case, values, rows), state, whole=False).since(begin), beside.t_s)
    size = min(len(course.t_s), len(beside.t_s))
    return Found(case.name, fault, wrong(course.first(size), beside.first(size)))


def alarms(order: Order) -> int:
    """How often a signal is doubted or rejected."""
    return sum(s.level is not Level.FINE for _, s in order.course.suspicions)


def main() -> int:
    """Measure and print."""
    asked = _arguments()
    begun, rng, hours, false = time.monotonic(), np.random.default_rng(asked.seed), 0.0, 0
    found: list[Found] = []
    orders = [(case, in_order(case)) for case in cases(asked.seed)]
    for case, order in orders:
        hours += len(order.course.t_s) / case.rate_hz / 3600.0
        false += alarms(order)
    while (len(found) < asked.scenarios) and (time.monotonic() - begun < 60.0 * asked.minutes):
        case, order = orders[len(found) % len(orders)]
        fault = drawn(case.loaded.service.machine, rng, len(case.table.values) / case.rate_hz)
        found.append(scenario(case, order, fault, asked.seed + len(found)))
        if asked.verbose:
            print(told(found[-1], case), flush=True)
        if asked.json:  # after each one: what ran counts, also when it is stopped
            asked.json.write_text(written(found, hours, false) + "\n", encoding="utf-8")
    Console().print(table(found))
    print(written(found, hours, false))
    return 0


def written(found: list[Found], hours: float, false: int) -> str:
    """The figures so far, with false alarms in hours of work in order."""
    order = {"false_per_hour": false / hours, "hours_in_order": hours, "false_alarms": false}
    return json.dumps(summary(found) | order, indent=1)


def told(one: Found, case: Case) -> str:
    """A scenario in a line."""
    w, signals = one.wrong, case.loaded.service.machine.signals
    names = ", ".join(signals[k].name for k in w.suspicion.signals) or "none"
    return (
        f"{one.machine}, {one.fault.kind} at {one.fault.at} ({one.fault.size:.3g}): "
        f"wrong {w.share:.3f}, longest {w.longest_s:.1f} s, weight {w.weight:.0f} kg, force {w.force / 1e3:.1f} kN, "
        f"bookings {w.wrong_bookings}/{len(w.bookings)}, doubted {w.doubted_s:.1f} s, rejected {w.rejected_s:.1f} s: "
        f"{w.suspicion.cause.name} {names}"
    )


def summary(found: list[Found]) -> dict[str, Any]:
    """The figures of all scenarios."""
    each = [f.wrong for f in found]
    return {
        "scenarios": len(each),
        "wrong_bookings": sum(w.wrong_bookings for w in each),
        "bookings": sum(len(w.bookings) for w in each),
        "wrong_ok_share": float(np.mean([w.share for w in each])) if each else 0.0,
        "wrong_weight_share": float(np.mean([w.weight_share for w in each])) if each else 0.0,
        "wrong_for_longer_share": float(np.mean([w.longer for w in each])) if each else 0.0,
        "detected_share": float(np.mean([np.isfinite(w.doubted_s) for w in each])) if each else 0.0,
    }


def table(found: list[Found]) -> Table:
    """By kind of fault."""
    shown = Table(title="faults in the middle of work")
    for name in (
        "fault",
        "scenarios",
        "doubted",
        "median s",
        "wrong and OK",
        "of it weight",
        "for over 1 s",
        "longest s",
        "bookings wrong",
    ):
        shown.add_column(name, justify="left" if name == "fault" else "right")
    for kind in KINDS:
        own = [f.wrong for f in found if f.fault.kind == kind]
        if own:
            seen = [w.doubted_s for w in own if np.isfinite(w.doubted_s)]
            shown.add_row(
                kind,
                str(len(own)),
                f"{len(seen)}",
                f"{np.median(seen):.0f}" if seen else "-",
                *(
                    f"{100 * np.mean(x):.1f} %"
                    for x in zip(*((w.share, w.weight_share, w.longer) for w in own), strict=True)
                ),
                f"{max(w.longest_s for w in own):.1f}",
                f"{sum(w.wrong_bookings for w in own)} of {sum(len(w.bookings) for w in own)}",
            )
    return shown


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="torture", description=__doc__)
    parser.add_argument("--scenarios", type=int, default=24)
    parser.add_argument("--minutes", type=float, default=1e9, help="end after so many minutes")
    parser.add_argument("--seed", type=int, default=0, help="which machines, which faults")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--verbose", action="store_true", help="a line for each scenario")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
