"""Faults of sensors as edits of samples: from a moment on, some columns are not what the machine does."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.signals.units import DEGREE

BAR = 1e5
BURST_ROWS = 5  # 50 ms at 100 Hz
DRIFT_S = 200.0
SLIDE_S = 3.0
FLICKER = 0.1 * BAR


class Fault(NamedTuple):
    """A fault: its kind, the machine's cylinder, joint or signal that it is `at`, another one, size [SI], and when [s]
    it begins."""

    kind: str
    at: int
    other: int = 0
    size: float = 0.0
    begin: float = 0.0


class Edited(NamedTuple):
    """Samples (T, S), and the numbers of the signals that are wrong."""

    values: Array
    signals: tuple[int, ...]


def place(machine: Machine, kind: Kind, index: int) -> int:
    """Number of the signal of a kind at a cylinder or joint."""
    return next(k for k, s in enumerate(machine.signals) if (s.kind, s.index) == (kind, index))


def _sides(machine: Machine, cylinder: int) -> tuple[int, int]:
    return place(machine, Kind.HEAD_PRESSURE, cylinder), place(machine, Kind.ROD_PRESSURE, cylinder)


def _swapped(values: Array, rows: slice, ones: Sequence[int], others: Sequence[int]) -> tuple[int, ...]:
    here, there = [*ones, *others], [*others, *ones]
    values[rows, here] = values[rows, there]
    return tuple(here)


def edited(values: Array, rate_hz: float, fault: Fault, machine: Machine, seed: int = 0) -> Edited:
    """The samples (T, S) of a machine with a fault."""
    found, rows, at = values.copy(), slice(round(fault.begin * rate_hz), None), fault.at
    count, rng = len(found[rows]), np.random.default_rng((seed, 24))
    match fault.kind:
        case "sides exchanged":
            head, rod = _sides(machine, at)
            return Edited(found, _swapped(found, rows, (head,), (rod,)))
        case "nodes exchanged":
            return Edited(found, _swapped(found, rows, _sides(machine, at), _sides(machine, fault.other)))
        case "burst":
            found[rows, at] *= np.clip(1.0 - np.arange(count) / BURST_ROWS, 0.0, 1.0)
        case "dead":
            found[rows, at] = rng.normal(0.0, machine.signals[at].standard_error, count)
        case "frozen":
            found[rows, at] = found[rows.start, at] + rng.uniform(-FLICKER, FLICKER, count)
        case "drift":
            found[rows, at] += fault.size * np.arange(count) / (rate_hz * DRIFT_S)
        case "sliding":
            found[rows, at] += fault.size * np.minimum(np.arange(count) / (rate_hz * SLIDE_S), 1.0)
        case "step" | "slipped":
            found[rows, at] += fault.size
        case _:
            raise ValueError(f"{fault.kind}: is no fault")
    return Edited(found, (at,))


def named(machine: Machine, begin: float) -> dict[str, Fault]:
    """The faults of the project's table, beginning at a time [s]: boom, stick and bucket are cylinders 0 to 2."""
    (head, rod), stick = _sides(machine, 0), place(machine, Kind.JOINT_ANGLE, 1)
    return {
        "boom head and rod exchanged": Fault("sides exchanged", 0, begin=begin),
        "boom and stick nodes exchanged": Fault("nodes exchanged", 0, 1, begin=begin),
        "boom hose burst": Fault("burst", head, begin=begin),
        "boom rod side dead": Fault("dead", rod, begin=begin),
        "boom rod side frozen": Fault("frozen", rod, begin=begin),
        "boom head drifts 5 bar in 200 s": Fault("drift", head, size=5.0 * BAR, begin=begin),
        "boom head steps 5 bar": Fault("step", head, size=5.0 * BAR, begin=begin),
        "stick angle slipped 3 deg": Fault("slipped", stick, size=3 * DEGREE, begin=begin),
    }
