"""Sensors whose readings cannot be those of the machine: frozen, reversed, exchanged, or in other units."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cylforce.effects.fault import Place, places
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.estimation.model import Model
from cylforce.readings.constants import BLOCK_ROWS, CLEAR_GAP, HALF, ROWS_HZ
from cylforce.readings.recording import Recording, SlowRows, names_of, samples_of
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES
from cylforce.signals.units import BAR


@dataclass(frozen=True)
class FaultySensor:
    """A sensor whose readings are not those of the machine.

    name:     of the recording
    sentence: what is wrong, and the cure
    """

    name: str
    sentence: str


def faulty_sensors(
    model: Model, recordings: Sequence[Recording], others: Sequence[Recording] = ()
) -> list[FaultySensor]:
    """Return all faulty sensors of recordings, each once.

    others: recordings of the machine that show how its sensors read usually
    """
    found = [*_out_of_range(model, recordings), *_without_pressure(model, recordings)]
    found += [*_frozen_pressures(model, recordings), *_frozen_angles(model, recordings, others)]
    return list(dict.fromkeys([*found, *_exchanged(model, recordings)]))


def _out_of_range(model: Model, recordings: Sequence[Recording]) -> Iterator[FaultySensor]:
    """Yield sensors that read mostly outside of their range, by more than an error of their zero may be."""
    for name in names_of(recordings):
        values = samples_of(recordings, name)
        for place, zero in ((Place.PRESSURE, PressureOffset()), (Place.ANGLE, AngleOffset())):
            for sensor, k in places(model.machine, place):
                signal, error = model.machine.signals[k], zero.about.high
                outside = (values[:, k] < signal.low - error) | (values[:, k] > signal.high + error)
                if np.mean(outside) > HALF:
                    usual = f"it can read {signal.low:.4g} to {signal.high:.4g}"
                    seen = f"reads {np.nanmin(values[:, k]):.4g} to {np.nanmax(values[:, k]):.4g} in {name}"
                    cure = "is it reversed, or in other units? See [table.signals] in the machine file"
                    yield FaultySensor(name, f"{sensor} {seen}, where {usual}: {cure}")


def _without_pressure(model: Model, recordings: Sequence[Recording]) -> Iterator[FaultySensor]:
    """Yield recordings of a machine that no pressure holds up."""
    sensors = [k for k, s in enumerate(model.machine.signals) if s.kind in SIDES]
    for name in names_of(recordings):
        values = samples_of(recordings, name)[:, sensors]
        read = values[np.isfinite(values)]
        if len(read) and np.max(np.abs(read)) < BAR:
            cure = "are they in other units? See [table.signals] in the machine file (scale_bar = 1)"
            yield FaultySensor(name, f"no pressure reaches 1 bar in {name}: {cure}")


def _frozen_pressures(model: Model, recordings: Sequence[Recording]) -> Iterator[FaultySensor]:
    """Yield pressure sensors that do not change while their cylinder moves.

    Either they never change, or not for three seconds of motion at a value between others. At the least or greatest
    value the sensor may be at the end of its range.
    """
    rows = SlowRows(model)
    for recording in recordings:
        frozen = [
            (sensor, k, *run)
            for sensor, k in places(model.machine, Place.PRESSURE)
            for run in _longest_run(recording.values[:, k], model.machine.signals[k].standard_error)
        ]
        if not frozen:
            continue
        speed = rows.moved(recording).motion.speed
        t, settled = rows.times(recording, len(speed)), slice(rows.slow.settle_steps, None)
        speed, t = speed[settled], t[settled]
        for sensor, k, first, last in frozen:
            begin, end = (recording.begins_s + x / model.filters.rate_hz for x in (first, last))
            own = speed[(t >= begin) & (t <= end), model.machine.signals[k].index]
            moving = np.sum(np.abs(own) > model.filters.direction_speed)
            whole = first == 0 and last == len(recording.values) - 1
            if moving and whole:
                said = f"{sensor} never changes in {recording.name} while its cylinder moves: it is frozen"
                yield FaultySensor(recording.name, said)
            elif moving >= BLOCK_ROWS:
                at = f"from {begin:.0f} to {end:.0f} s"
                said = f"{sensor} does not change in {recording.name} {at} while its cylinder moves: it is frozen there"
                yield FaultySensor(recording.name, said)


def _frozen_angles(
    model: Model, recordings: Sequence[Recording], others: Sequence[Recording]
) -> Iterator[FaultySensor]:
    """Yield angle sensors that are frozen although their joint moves.

    Either they read exactly the same for three seconds and then change by more in one sample than at any other moment.
    Or they do so until a recording ends while another reading changes, never in the other recordings, and without
    steps that are coarser than their noise, which a joint that stands would show.
    """
    rate, everything = model.filters.rate_hz, [*recordings, *others]
    shortest = round(BLOCK_ROWS / ROWS_HZ * rate)
    for sensor, k in places(model.machine, Place.ANGLE):
        each = [_Holding.of(recording.values[:, k], shortest) for recording in everything]
        fastest = max((holding.fastest for holding in each), default=0.0)
        smooth = min((holding.least for holding in each), default=np.inf) <= model.machine.signals[k].standard_error
        for recording, own in zip(recordings, each, strict=False):
            pairs = zip(everything, each, strict=True)
            elsewhere = [holding for made, holding in pairs if made.name != recording.name and not holding.whole]
            noisy = smooth and bool(elsewhere) and not any(holding.runs for holding in elsewhere)
            for run in own.runs:
                at = f"from {recording.begins_s + run.first / rate:.0f} to {recording.begins_s + run.last / rate:.0f} s"
                said = f"{sensor} does not change in {recording.name} {at}"
                ends = run.last == len(recording.values) - 1
                if run.jump > fastest > 0.0:
                    yield FaultySensor(recording.name, f"{said}, and then jumps: it is frozen there")
                elif noisy and ends and np.any(np.diff(recording.values[run.first :], axis=0)):
                    told = f"{said}, as it does in the other recordings: it is frozen there"
                    yield FaultySensor(recording.name, told)


@dataclass(frozen=True)
class _Run:
    """A run of exactly equal samples.

    first, last: samples
    jump:        the larger of the steps before and after it
    """

    first: int
    last: int
    jump: float


@dataclass(frozen=True)
class _Holding:
    """Where a reading stays exactly the same for long.

    runs:    long runs of equal samples
    fastest: the largest step elsewhere
    least:   the least step of all
    whole:   whether it never changes
    """

    runs: list[_Run]
    fastest: float
    least: float
    whole: bool

    @classmethod
    def of(cls, values: Array, shortest: int) -> "_Holding":
        """Return it of samples (T,); a run has at least `shortest` of them."""
        first, last, change = _equal_runs(values)
        change = np.nan_to_num(change)
        sizes = np.concatenate([[0.0], change, [0.0]])
        long = last - first >= shortest
        jumps = np.maximum(sizes[:-1], sizes[1:])
        beside = long[:-1] | long[1:]
        fastest = float(np.max(change[~beside], initial=0.0))
        runs = [_Run(int(first[k]), int(last[k]), float(jumps[k])) for k in np.flatnonzero(long)]
        return cls(runs, fastest, float(np.min(change, initial=np.inf)), not len(change))


def _exchanged(model: Model, recordings: Sequence[Recording]) -> Iterator[FaultySensor]:
    """Yield head and rod sides that are exchanged.

    Over a whole recording the cylinder's torque is nearer to none than to the data sheet's, as if weights pulled
    upwards. With its two pressures exchanged it is CLEAR_GAP times nearer to the data sheet's.
    """
    signals, rows, sheet = model.machine.signals, SlowRows(model), model.prior.mean
    heads, rods = ([k for k, s in enumerate(signals) if s.kind is kind] for kind in SIDES)
    pairs = [(h, r) for h in heads for r in rods if signals[h].index == signals[r].index]
    for name in names_of(recordings):
        own = [recording for recording in recordings if recording.name == name]
        residual, torque = _residual(rows, own, sheet), _residual(rows, own, 0.0 * sheet)
        upwards = _mean_squares(residual) > _mean_squares(torque)
        for head, rod in pairs if np.any(upwards) else ():
            other = _residual(rows, [_with_exchanged(each, head, rod) for each in own], sheet)
            row = int(np.argmax(_mean_squares(other - residual)))
            if upwards[row] and CLEAR_GAP**2 * _mean_squares(other)[row] < _mean_squares(residual)[row]:
                said = f"{signals[head].name} and {signals[rod].name} are exchanged in {name}"
                cure = "as they are, weights would pull upwards; exchange them in the machine file"
                yield FaultySensor(name, f"{said}: {cure}")


def _with_exchanged(recording: Recording, one: int, other: int) -> Recording:
    values = recording.values.copy()
    values[:, [one, other]] = values[:, [other, one]]
    return replace(recording, values=values)


def _residual(rows: SlowRows, recordings: Sequence[Recording], parameters: Array) -> Array:
    return np.concatenate([rows.residual(each, parameters) for each in recordings])


def _mean_squares(residual: Array) -> Array:
    """Return the mean squares (R,) of a residual (T, R); 0 where no row is usable."""
    good = np.isfinite(residual)
    return np.asarray(np.sum(np.where(good, residual, 0.0) ** 2, axis=0) / np.maximum(np.sum(good, axis=0), 1))


def _longest_run(values: Array, noise: float) -> list[tuple[int, int]]:
    """Return first and last sample of the longest run of equal samples, if the sensor may be frozen there.

    It may not at the least or greatest value, nor where it reads in steps coarser than its noise.
    """
    first, last, change = _equal_runs(values)
    if not len(values) or (len(change) and np.min(change) > noise):
        return []
    longest = int(np.argmax(last - first))
    held, whole = values[first[longest]], not len(change)
    if not whole and not np.nanmin(values) < held < np.nanmax(values):
        return []
    return [(int(first[longest]), int(last[longest]))]


def _equal_runs(values: Array) -> tuple[Array, Array, Array]:
    """Return first and last sample of every run of equal samples of (T,), and the sizes of the steps between them."""
    change = np.abs(np.diff(values))
    steps = np.flatnonzero(change != 0.0)
    return np.concatenate([[0], steps + 1]), np.concatenate([steps, [len(values) - 1]]), change[steps]
