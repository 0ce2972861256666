"""A library for change points, ruptures, on the courses that `cylforce fleet` finds: Pelt with squared deviations, of
all quantities of a machine at once, and of each by itself. Each is in units of what it usually differs between two
recordings of a machine."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import ruptures

from cylforce.fleet.fleet import Fleet
from cylforce.signals.estimate import Array
from studies._fleets import Faulty

NORMAL = 0.6745 * np.sqrt(2.0)  # median of |x - y| of two normal numbers, in standard deviations
QUANTITIES = {
    "friction_level_change": ("coulomb", "viscous", "stribeck"),
    "pressure_offset": ("pressure_zero",),
    "angle_offset": ("angle_offset",),
    "extra_mass": ("J", "X", "Z"),
}


class Rival(NamedTuple):
    """A way with its penalty: machines that change and are `found`, within one recording of their `day`, with the right
    `cause`, by the quantity that changes most; machines in order that are `reported`."""

    way: str
    penalty: float
    found: int
    day: int
    cause: int
    reported: int


def rivals(fleet: Fleet, truth: Mapping[str, Faulty]) -> list[Rival]:
    """Both ways with the penalty of the information criterion (BIC), then with others."""
    own = np.stack([said.course.own for said in fleet.machines.values()])
    usually = np.median(np.abs(np.diff(own, axis=1)), axis=(0, 1)) / NORMAL
    courses = dict(zip(fleet.machines, own / usually, strict=True))
    count, size = own.shape[1:]
    together = [(size + 1) * np.log(count) * factor for factor in (1.0, 1.5, 2.0)]
    alone = [2.0 * np.log(count), 10.0, 20.0, 30.0, 40.0]
    found = [_scored("together", p, {n: _together(z, p) for n, z in courses.items()}, fleet, truth) for p in together]
    return [
        *found,
        *(_scored("each alone", p, {n: _alone(z, p) for n, z in courses.items()}, fleet, truth) for p in alone),
    ]


def _breaks(course: Array, penalty: float) -> list[int]:
    """First recordings after a change, of a course (n, K)."""
    found = ruptures.Pelt(model="l2", min_size=1, jump=1).fit(course).predict(pen=penalty)
    return [int(k) for k in found[:-1]]


def _together(course: Array, penalty: float) -> tuple[int, int] | None:
    """First change, and the quantity that changes most."""
    at = _breaks(course, penalty)
    if not at:
        return None
    step = course[at[0] :].mean(axis=0) - course[: at[0]].mean(axis=0)
    return at[0], int(np.argmax(np.abs(step)))


def _alone(course: Array, penalty: float) -> tuple[int, int] | None:
    """The same of the quantity that is explained best by its changes."""
    found = [(at, k) for k in range(course.shape[1]) if (at := _breaks(course[:, [k]], penalty))]
    if not found:
        return None
    at, k = max(found, key=lambda each: _gain(course[:, each[1]], each[0]))
    return at[0], k


def _gain(values: Array, at: list[int]) -> float:
    left = sum(part.var() * len(part) for part in np.split(values, at))
    return float(values.var() * len(values) - left)


def _scored(
    way: str,
    penalty: float,
    said: Mapping[str, tuple[int, int] | None],
    fleet: Fleet,
    truth: Mapping[str, Faulty],
) -> Rival:
    told = {name: each for name, each in said.items() if each is not None}
    near = [name for name in truth if name in told and abs(told[name][0] - truth[name].first) <= 1]
    right = [name for name in near if _is(fleet, told[name][1], truth[name])]
    return Rival(way, penalty, len(set(told) & set(truth)), len(near), len(right), len(set(told) - set(truth)))


def _is(fleet: Fleet, quantity: int, fault: Faulty) -> bool:
    at = fault.at.partition("_")[0] if fault.name == "pressure_offset" else fault.at
    told = fleet.quantities[quantity]
    return told.at == at and told.quantity in QUANTITIES[fault.name]
