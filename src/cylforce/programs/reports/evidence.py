"""Samples of a recording against identified tares, thinned for drawing: pure, and in constant memory."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.coverage import Plan, coverage, plan, planes
from cylforce.estimation.channels import MIN_LEVER
from cylforce.estimation.filters import first_order, second_order
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import chunks, observe
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.motion import Motion
from cylforce.mechanics.workspace import drive_angles
from cylforce.signals.estimate import Array

MOST_POINTS = 8000
STRETCH_HZ = 25.0
REST = 3.0  # times the speed that rounds the friction's direction: from there on it is known to 1 %


class DrawnSamples(NamedTuple):
    """Samples of a stretch, all passed through the same filters.

    measured:  (T, R) torque [N m], NaN where a row is not usable
    predicted: (T, R) torque [N m]
    posture:   (T, N) angles of `drive` [rad]
    speed:     (T, C) of the cylinders [m/s]
    force:     (T, C) of the cylinders [N]
    lever:     (T, C) of each cylinder about the joint that it moves [m/rad]
    """

    measured: Array
    predicted: Array
    posture: Array
    speed: Array
    force: Array
    lever: Array


class DrawnMinute(NamedTuple):
    """Minute with the most motion.

    recording: its name
    t:         (T,) time from the recording's start [s]
    seen:      samples
    """

    recording: str
    t: Array
    seen: DrawnSamples


class Drawn(NamedTuple):
    """Data of a recording for all figures.

    points:   some thousand samples, evenly spread
    stretch:  minute with the most motion
    plan:     plan of the coverage
    seconds:  (M, BINS, 2, 2) coverage of the plan [s]
    planes:   (M-1, BINS, BINS) coverage of pairs of joints [s]
    duration: of the recording [s]
    """

    points: DrawnSamples
    stretch: DrawnMinute
    plan: Plan
    seconds: Array
    planes: Array
    duration: float


class _Sum(NamedTuple):
    """Sums over the pieces, as in `Drawn`.

    seconds:  coverage of the plan [s]
    planes:   coverage of pairs of joints [s]
    duration: [s]
    """

    seconds: Array
    planes: Array
    duration: float


def evidence(model: Model, tares: Tares, segments: Iterable[tuple[str, Array]]) -> Drawn:
    """Return the data for figures from pairs of recording name and gapless samples (T, S).

    Raises ValueError when no stretch is long enough.
    """
    wanted = plan(model.machine, REST * model.filters.direction_speed)
    kept: list[DrawnSamples] = []
    total: _Sum | None = None
    best: DrawnMinute | None = None
    step, most = 1, 0.0
    for name, values in _pieces(model, segments):
        part = seen(model, tares, wanted, values)
        total = _added(total, wanted, part, model.channels.dt)
        kept, step = _thinned([*kept, _every(part, step)], step)
        if best is None or _worth(wanted, part) > most:
            most, best = _worth(wanted, part), _stretch(name, part, model.filters)
    if best is None or total is None:
        raise ValueError("the recording has no stretch that is long enough to be shown")
    points = DrawnSamples(*(np.concatenate(column) for column in zip(*kept, strict=True)))
    return Drawn(points, best, wanted, *total)


def _pieces(model: Model, segments: Iterable[tuple[str, Array]]) -> Iterator[tuple[str, Array]]:
    return ((name, piece) for name, values in segments for piece in chunks(model, [values]))


def seen(model: Model, tares: Tares, wanted: Plan, values: Array) -> DrawnSamples:
    """Return the samples of a gapless stretch (T, S), without the filters' start."""
    rows = observe(model, values)
    moved = drives(model, wanted.joints, wanted.cylinders, values)
    posture = drive_angles(model.machine, rows.posture)
    return DrawnSamples(rows.torque, rows.columns @ tares.values, posture, *moved)


def drives(model: Model, joints: Sequence[int], cylinders: Sequence[int], values: Array) -> tuple[Array, Array, Array]:
    """Return speed (T, C) [m/s], force (T, C) [N] and lever (T, C) [m/rad] of the cylinders.

    Each lever is about the joint that the cylinder moves. The filters' start is excluded.
    values: (T, S) samples
    """
    motion = model.channels.run(values).motion
    own = np.zeros(motion.speed.shape)
    for j, c in zip(joints, cylinders, strict=True):
        own[:, c] = motion.lever[:, c, j]
    speed, force, lever = (_through(model.filters, x)[model.settle_steps :] for x in (motion.speed, motion.force, own))
    return speed, force, lever


def _through(filters: Filters, x: Array) -> Array:
    """Return x delayed and smoothed like torque and columns."""
    dt = 1.0 / filters.rate_hz
    for made in (first_order(filters.regressor_hz, dt), second_order(filters.smoothing_hz, dt)):
        _, x = made.run(made.steady(x[0]), x)
    return x


def _added(total: _Sum | None, wanted: Plan, part: DrawnSamples, dt: float) -> _Sum:
    seconds, together = (f(wanted, part.posture, part.speed, dt) for f in (coverage, planes))
    if total is None:
        return _Sum(seconds, together, len(part.speed) * dt)
    return _Sum(total.seconds + seconds, total.planes + together, total.duration + len(part.speed) * dt)


def _every(part: DrawnSamples, step: int) -> DrawnSamples:
    return DrawnSamples(*(column[::step] for column in part))


def _thinned(kept: list[DrawnSamples], step: int) -> tuple[list[DrawnSamples], int]:
    """Return at most MOST_POINTS samples, evenly spread over the recording."""
    while sum(len(part.speed) for part in kept) > MOST_POINTS:
        kept, step = [_every(part, 2) for part in kept], 2 * step
    return kept, step


def _worth(wanted: Plan, part: DrawnSamples) -> float:
    """Return the share of the joints' ranges in a stretch, times its usable rows."""
    swing = np.std(part.posture[:, list(wanted.joints)], axis=0) / (wanted.edges[:, -1] - wanted.edges[:, 0])
    return float(np.sum(swing) * np.sum(np.isfinite(part.measured)))


def _stretch(name: str, part: DrawnSamples, filters: Filters) -> DrawnMinute:
    step = max(round(filters.rate_hz / STRETCH_HZ), 1)
    return DrawnMinute(name, np.arange(0, len(part.speed), step) / filters.rate_hz, _every(part, step))


def push(model: Model, part: DrawnSamples, joint: int, cylinder: int) -> Array:
    """Return the residual of a joint's torque as force (T,) [N] of its cylinder; NaN where its lever is too short."""
    if joint not in model.machine.rows:
        return np.full(len(part.speed), np.nan)
    row, lever = model.machine.rows.index(joint), part.lever[:, cylinder]
    left = part.measured[:, row] - part.predicted[:, row]
    return np.asarray(np.where(np.abs(lever) > MIN_LEVER, left / np.where(lever == 0.0, 1.0, lever), np.nan))


def friction(model: Model, tares: Tares, cylinder: int, speed: Array, force: Array) -> tuple[Array, Array]:
    """Return the friction (T,) [N] of a cylinder at speeds [m/s] and forces [N], and its standard error (T,) [N].

    It is computed from the model's own laws on a lever of 1 m.
    """
    size = len(model.machine.cylinders)
    still, level = np.zeros((len(speed), size)), np.zeros(len(speed))
    lever = np.broadcast_to(np.eye(size), (len(speed), size, size))
    speeds, forces = (np.broadcast_to(x[:, None], still.shape) for x in (speed, force))
    moving = Motion(still, still, still, level, level, still, lever, still, speeds, forces, still)
    name = model.machine.cylinders[cylinder].name
    each = {p[cylinder].name: e for e in model.empty.effects if len(p := e.parameters(model.machine)) == size}
    names = [which for which in model.friction if f"{name}.{which}" in each]
    laws = [each[f"{name}.{which}"] for which in names]
    columns = np.stack([law.halves(model.machine, moving).static[:, cylinder, cylinder] for law in laws], axis=-1)
    places = [tares.names.index(f"{name}.{which}") for which in names]
    spread = np.sum((columns @ tares.covariance[np.ix_(places, places)]) * columns, axis=-1)
    return columns @ tares.values[places], np.sqrt(np.maximum(spread, 0.0))
