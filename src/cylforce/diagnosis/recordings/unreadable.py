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
    """Angle sensors that read exactly the same for three seconds, and then change by more in one sample than at any
    other moment: their joint moved meanwhile. Or that do so until a recording ends, while another reading changes, and
    never in the other recordings, nor read in steps coarser than their noise, as of a joint that stands."""
    rate, everything = model.filters.rate_hz, [*recordings, *beside]
    shortest = round(BLOCK / RATE_HZ * rate)
    for sensor, k in places(model.machine, Place.ANGLE):
        each = [_Holding.of(recorded.values[:, k], shortest) for recorded in everything]
        fastest = max((other.fastest for other in each), default=0.0)
        smooth = min((other.least for other in each), default=np.inf) <= model.machine.signals[k].standard_error
        for recorded, own in zip(recordings, each, strict=False):
            pairs = zip(everything, each, strict=True)
            others = [other for made, other in pairs if made.name != recorded.name and not other.whole]
            noisy = smooth and bool(others) and not any(other.runs for other in others)
            for first, last, jump in own.runs:
                at = f"from {recorded.begins + first / rate:.0f} to {recorded.begins + last / rate:.0f} s"
                told = f"{sensor} does not change in {recorded.name} {at}"
                if jump > fastest > 0.0:
                    yield Unreadable(recorded.name, f"{told}, and then jumps: it is frozen there")
                elif noisy and last == len(recorded.values) - 1 and np.any(np.diff(recorded.values[first:], axis=0)):
                    yield Unreadable(recorded.name, f"{told}, as it does in the other recordings: it is frozen there")


class _Holding(NamedTuple):
    """Where a reading stays exactly the same for long: first and last sample of each of these `runs`, and how large the
    step there is; the largest step elsewhere, `fastest`, and the `least` of all; whether it never changes in the
    `whole` recording."""

    runs: list[tuple[int, int, float]]
    fastest: float
    least: float
    whole: bool

    @classmethod
    def of(cls, values: Array, shortest: int) -> "_Holding":
        """Of samples (T,); a run has at least so many."""
        first, last, change = _equal(values)
        change = np.nan_to_num(change)
        sizes = np.concatenate([[0.0], change, [0.0]])
        long = last - first >= shortest
        jumps = np.maximum(sizes[:-1], sizes[1:])
        beside = long[:-1] | long[1:]
        fastest = float(np.max(change[~beside], initial=0.0))
        runs = [(int(first[k]), int(last[k]), float(jumps[k])) for k in np.flatnonzero(long)]
        return cls(runs, fastest, float(np.min(change, initial=np.inf)), not len(change))


def _exchanged(model: Model, recordings: Sequence[Recorded]) -> Iterator[Unreadable]:
    """Head and rod sides of a cylinder whose torque is nearer to none than to the data sheet's over a whole recording,
    as if weights pulled upwards, and with its two pressures exchanged GAP times nearer to it."""
    signals, viewer = model.machine.signals, Viewer(model, model.prior.mean)
    heads, rods = ([k for k, s in enumerate(signals) if s.kind is kind] for kind in SIDES)
    pairs = [(h, r) for h in heads for r in rods if signals[h].index == signals[r].index]
    for name in dict.fromkeys(each.name for each in recordings):
        own = [each for each in recordings if each.name == name]
        left, torque = _left(viewer, own), _left(Viewer(model, 0.0 * viewer.tares), own)
        upwards = _energy(left) > _energy(torque)
        for head, rod in pairs if np.any(upwards) else ():
            other = _left(viewer, [_with_exchanged(each, head, rod) for each in own])
            row = int(np.argmax(_energy(other - left)))
            if upwards[row] and GAP**2 * _energy(other)[row] < _energy(left)[row]:
                said = f"{signals[head].name} and {signals[rod].name} are exchanged in {name}"
                cure = "as they are, weights would pull upwards; exchange them in the machine file"
                yield Unreadable(name, f"{said}: {cure}")


def _with_exchanged(recorded: Recorded, one: int, other: int) -> Recorded:
    values = recorded.values.copy()
    values[:, [one, other]] = values[:, [other, one]]
    return recorded._replace(values=values)


def _left(viewer: Viewer, recordings: Sequence[Recorded]) -> Array:
    """What the viewer's tares leave (T, R) [N m] of recordings."""
    return np.concatenate([viewer.rows(each, ()).left for each in recordings])


def _energy(left: Array) -> Array:
    """Mean squares (R,) of rows (T, R); 0 where there is none."""
    good = np.isfinite(left)
    return np.asarray(np.sum(np.where(good, left, 0.0) ** 2, axis=0) / np.maximum(np.sum(good, axis=0), 1))


def _runs(values: Array, noise: float) -> list[tuple[int, int]]:
    """First and last row of what is longest exactly the same; none where that is the least or the greatest, or where
    the sensor reads in steps coarser than its noise, and may well stay at one."""
    first, last, change = _equal(values)
    if not len(values) or (len(change) and np.min(change) > noise):
        return []
    longest = int(np.argmax(last - first))
    held, whole = values[first[longest]], not len(change)
    if not whole and not np.nanmin(values) < held < np.nanmax(values):
        return []
    return [(int(first[longest]), int(last[longest]))]


def _equal(values: Array) -> tuple[Array, Array, Array]:
    """First and last sample of every run of exactly equal ones of (T,), and the sizes of the steps between them."""
    change = np.abs(np.diff(values))
    steps = np.flatnonzero(change != 0.0)
    return np.concatenate([[0], steps + 1]), np.concatenate([steps, [len(values) - 1]]), change[steps]
