"""Recordings in which a sensor does not tell what the machine does: it is frozen, reversed, exchanged, or in other
units."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.columns.problem import looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import BLOCK, RATE_HZ, Viewer
from cylforce.diagnosis.numbers import GAP, HALF
from cylforce.effects.fault import Place, places
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES
from cylforce.signals.units import BAR


class Unreadable(NamedTuple):
    """What is wrong with a sensor in a recording of that name, in a sentence."""

    name: str
    said: str


def unreadable(model: Model, recordings: Sequence[Recorded], beside: Sequence[Recorded] = ()) -> list[Unreadable]:
    """All that is wrong, each once. `beside`: other recordings of the machine, which show how its sensors read."""
    found = [*_strayed(model, recordings), *_weak(model, recordings), *_frozen(model, recordings)]
    return list(dict.fromkeys([*found, *_held(model, recordings, beside), *_exchanged(model, recordings)]))


def _strayed(model: Model, recordings: Sequence[Recorded]) -> Iterator[Unreadable]:
    """Sensors that read most of the time what they cannot, by more than an error of their zero may be."""
    for name, values in _whole(recordings).items():
        for place, zero in ((Place.PRESSURE, PressureOffset()), (Place.ANGLE, AngleOffset())):
            for sensor, k in places(model.machine, place):
                signal, wrong = model.machine.signals[k], zero.about.high
                outside = (values[:, k] < signal.low - wrong) | (values[:, k] > signal.high + wrong)
                if np.mean(outside) > HALF:
                    usual = f"it can read {signal.low:.4g} to {signal.high:.4g}"
                    seen = f"reads {np.nanmin(values[:, k]):.4g} to {np.nanmax(values[:, k]):.4g} in {name}"
                    cure = "is it reversed, or in other units? See [table.signals] in the machine file"
                    yield Unreadable(name, f"{sensor} {seen}, where {usual}: {cure}")


def _weak(model: Model, recordings: Sequence[Recorded]) -> Iterator[Unreadable]:
    """Recordings of a machine that no pressure holds up."""
    sensors = [k for k, s in enumerate(model.machine.signals) if s.kind in SIDES]
    for name, values in _whole(recordings).items():
        read = values[:, sensors][np.isfinite(values[:, sensors])]
        if len(read) and np.max(np.abs(read)) < BAR:
            cure = "are they in other units? See [table.signals] in the machine file (scale_bar = 1)"
            yield Unreadable(name, f"no pressure reaches 1 bar in {name}: {cure}")


def _whole(recordings: Sequence[Recorded]) -> dict[str, Array]:
    """Samples (T, S) of all stretches of each recording."""
    names = dict.fromkeys(each.name for each in recordings)
    return {name: np.concatenate([each.values for each in recordings if each.name == name]) for name in names}


def _frozen(model: Model, recordings: Sequence[Recorded]) -> Iterator[Unreadable]:
    """Pressure sensors that do not change while their cylinder moves: at all, or for three seconds of motion at a value
    between others; at the least or greatest it may be at the end of what it reads."""
    viewer = Viewer(model, np.zeros(len(model.parameters)))
    for each in recordings:
        still = [
            (name, k, *run)
            for name, k in places(model.machine, Place.PRESSURE)
            for run in _runs(each.values[:, k], model.machine.signals[k].standard_error)
        ]
        if not still:
            continue
        rows = looked_at(viewer, [each], ())[0].rows
        for name, k, first, last in still:
            begin, end = (each.begins + x / model.filters.rate_hz for x in (first, last))
            speed = rows.speed[(rows.t >= begin) & (rows.t <= end), model.machine.signals[k].index]
            moving = np.sum(np.abs(speed) > model.filters.direction_speed)
            whole = first == 0 and last == len(each.values) - 1
            if moving and whole:
                said = f"{name} never changes in {each.name} while its cylinder moves: it is frozen"
                yield Unreadable(each.name, said)
            elif moving >= BLOCK:
                at = f"from {begin:.0f} to {end:.0f} s"
                said = f"{name} does not change in {each.name} {at} while its cylinder moves: it is frozen there"
                yield Unreadable(each.name, said)


def _held(model: Model, recordings: Sequence[Recorded], beside: Sequence[Recorded]) -> Iterator[Unreadable]:
    """Angle sensors that do not change for three seconds, and then by more in one sample than at any other moment:
    their joint moved meanwhile. Or that never change in a recording in which another reading does, and hold for so long
    in no other that changes."""
    rate, everything = model.filters.rate_hz, [*recordings, *beside]
    shortest = round(BLOCK / RATE_HZ * rate)
    for sensor, k in places(model.machine, Place.ANGLE):
        each = [_Holding.of(recorded.values[:, k], shortest) for recorded in everything]
        for recorded, own in zip(recordings, each, strict=False):
            others = [other for other in each if not other.whole]
            still = own.whole and np.any(np.diff(recorded.values, axis=0) != 0.0)
            if still and others and not any(other.runs for other in others):
                said = f"{sensor} never changes in {recorded.name}, as it does in the other recordings: it is frozen"
                yield Unreadable(recorded.name, said)
            fastest = max(other.fastest for other in each)
            for first, last, jump in own.runs:
                if jump > fastest > 0.0:
                    at = f"from {recorded.begins + first / rate:.0f} to {recorded.begins + last / rate:.0f} s"
                    said = f"{sensor} does not change in {recorded.name} {at}, and then jumps: it is frozen there"
                    yield Unreadable(recorded.name, said)


class _Holding(NamedTuple):
    """Where a reading stays exactly the same for long: first and last sample of each of these `runs`, and how large the
    step there is; the largest step elsewhere, `fastest`; whether it never changes in the `whole` recording."""

    runs: list[tuple[int, int, float]]
    fastest: float
    whole: bool

    @classmethod
    def of(cls, values: Array, shortest: int) -> "_Holding":
        """Of samples (T,); a run has at least so many."""
        change = np.abs(np.diff(values))
        steps, change = np.flatnonzero(change != 0.0), np.nan_to_num(change)
        first, last = np.concatenate([[0], steps + 1]), np.concatenate([steps, [len(values) - 1]])
        sizes = np.concatenate([[0.0], change[steps], [0.0]])
        long = last - first >= shortest
        jumps = np.maximum(sizes[:-1], sizes[1:])
        beside = long[:-1] | long[1:]
        fastest = float(np.max(change[steps][~beside], initial=0.0))
        runs = [(int(first[k]), int(last[k]), float(jumps[k])) for k in np.flatnonzero(long)]
        return cls(runs, fastest, not len(steps))


def _exchanged(model: Model, recordings: Sequence[Recorded]) -> Iterator[Unreadable]:
    """Head and rod sides of a cylinder whose torque is nearer to none than to the data sheet's, as if weights pulled
    upwards, and with its two pressures exchanged GAP times nearer to it."""
    signals, viewer = model.machine.signals, Viewer(model, model.prior.mean)
    heads, rods = ([k for k, s in enumerate(signals) if s.kind is kind] for kind in SIDES)
    pairs = [(h, r) for h in heads for r in rods if signals[h].index == signals[r].index]
    for each in recordings:
        left, torque = _left(viewer, each), _left(Viewer(model, 0.0 * viewer.tares), each)
        upwards = _energy(left) > _energy(torque)
        for head, rod in pairs if np.any(upwards) else ():
            values = each.values.copy()
            values[:, [head, rod]] = values[:, [rod, head]]
            other = _left(viewer, each._replace(values=values))
            row = int(np.argmax(_energy(other - left)))
            if upwards[row] and GAP**2 * _energy(other)[row] < _energy(left)[row]:
                said = f"{signals[head].name} and {signals[rod].name} are exchanged in {each.name}"
                cure = "as they are, weights would pull upwards; exchange them in the machine file"
                yield Unreadable(each.name, f"{said}: {cure}")


def _left(viewer: Viewer, recorded: Recorded) -> Array:
    """What the viewer's tares leave (T, R) [N m] of a recording."""
    return viewer.rows(recorded, ()).left


def _energy(left: Array) -> Array:
    """Mean squares (R,) of rows (T, R); 0 where there is none."""
    good = np.isfinite(left)
    return np.asarray(np.sum(np.where(good, left, 0.0) ** 2, axis=0) / np.maximum(np.sum(good, axis=0), 1))


def _runs(values: Array, noise: float) -> list[tuple[int, int]]:
    """First and last row of what is longest exactly the same; none where that is the least or the greatest, or where
    the sensor reads in steps coarser than its noise, and may well stay at one."""
    change = np.abs(np.diff(values))
    steps = np.flatnonzero(change != 0.0)
    if len(steps) and np.min(change[steps]) > noise:
        return []
    first, last = np.concatenate([[0], steps + 1]), np.concatenate([steps, [len(values) - 1]])
    if not len(values):
        return []
    longest = int(np.argmax(last - first))
    held, whole = values[first[longest]], not len(steps)
    if not whole and not np.nanmin(values) < held < np.nanmax(values):
        return []
    return [(int(first[longest]), int(last[longest]))]
