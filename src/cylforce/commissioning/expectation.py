"""Expected accuracy of the weighing, before anything is weighed: the standard error of a rated payload over the
postures of the arm, by the same least squares as in service/weighing.py, on columns computed from the model."""

from typing import NamedTuple

import numpy as np

from cylforce.estimation.channels import Moved
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import REST_SECONDS, Residual, correlated, residual
from cylforce.mechanics.chain import Complex
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven, joint_angles, working_range
from cylforce.signals.estimate import Array

WEIGHED_S = 3.0  # s of motion over which a payload is weighed; chosen: a short lift
CROSSING_S = 15.0  # s in which a cylinder would travel its whole stroke at the assumed speed; chosen
POINTS = 7  # instants of that motion at which the columns are computed; chosen
CURLED = 0.15  # times its range: angle of the tool while it carries the load; chosen
GRID = 16  # postures along a joint's range; chosen
FILLED = 0.6  # times the payload's reach: assumed distance of the load's centre from the last pin; chosen


class Expected(NamedTuple):
    """At postures (...): expected `standard_error` (...) of the weight [kg], NaN where weighing is impossible; `noise`
    (...) [kg]: the part of it that decreases with longer weighing; `gain` (..., P): change of the weight [kg] per unit
    of each tare."""

    standard_error: Array
    noise: Array
    gain: Array


class PostureGrid(NamedTuple):
    """A grid (A, B) over the ranges of two joints: joint angles `theta` (A, B, N) [rad]; `tool` (A, B): place x + i z
    of the tool [m] from the first pin."""

    theta: Array
    tool: Complex


def postures(machine: Machine) -> PostureGrid:
    """Postures over the working range: the two innermost driven joints over their ranges, the tool curled, the other
    joints in mid-range."""
    ranges = working_range(machine)
    low, high = ranges.T
    theta = np.tile((low + high) / 2.0, (GRID, GRID, 1))
    theta[..., -1] = low[-1] + CURLED * (high[-1] - low[-1])
    for axis, j in enumerate(driven(machine)[:2]):
        theta[..., j] = np.expand_dims(np.linspace(low[j], high[j], GRID), 1 - axis)
    theta = joint_angles(machine, theta)
    return PostureGrid(theta, machine.tool_point(theta).place)


def expected_error(model: Model, tares: Tares, theta: Array) -> Expected:
    """Expected accuracy when a rated payload is weighed during WEIGHED_S of motion about postures `theta` (..., N)
    [rad]. The scale of the forces (bores, levers, gains), which a recording of the empty machine cannot determine,
    enters with the tares' `scale_error`."""
    left = _residual(model, tares, theta)
    columns = left.columns @ model.load
    weight = _weight(model, left, tares.correlation)
    weighed = np.swapaxes(columns * weight[..., None], -1, -2)
    information = np.sum(weighed @ columns, axis=0) + np.diag(_prior(model.machine) ** -2.0)
    covariance = np.linalg.inv(information)
    gain = (covariance[..., :1, :] @ np.sum(weighed @ left.columns, axis=0))[..., 0, :]
    noise, tared = covariance[..., 0, 0], np.sum((gain @ tares.covariance) * gain, axis=-1)
    tared = tared + (tares.scale_error * model.machine.rated_payload) ** 2
    weighable = np.sqrt(noise) < model.machine.rated_payload
    total, own = (np.where(weighable, np.sqrt(square), np.nan) for square in (noise + tared, noise))
    return Expected(total, own, gain)


def cost(tares: Tares, expected: Expected) -> Array:
    """Part of the weight's standard error (P,) [kg] that each tare causes, correlations included: the root of the
    variance that would disappear if this tare were known exactly; median over the postures."""
    weighable = np.isfinite(expected.standard_error)
    pull = expected.gain[weighable] @ tares.covariance / np.sqrt(np.diag(tares.covariance))
    return np.asarray(np.median(np.abs(pull), axis=0)) if np.any(weighable) else np.full(len(tares.names), np.nan)


def _prior(machine: Machine) -> Array:
    """Prior standard errors (4,) of m [kg], m x, m z [kg m], J [kg m^2], as in service/weighing.py."""
    moment = machine.rated_payload * machine.payload_reach
    return np.array([2.0 * machine.rated_payload, moment, moment, moment * machine.payload_reach])


def _weight(model: Model, left: Residual, correlation: float) -> Array:
    """Weight of each row (POINTS, ..., R): number of samples that a point represents, divided by their variance, as in
    service/weighing.py."""
    f = model.filters
    variance = correlated(f, correlation) * left.variance + REST_SECONDS * f.rate_hz * left.rest
    return np.asarray(np.where(np.isfinite(variance), WEIGHED_S * f.rate_hz / POINTS / variance, 0.0))


def _residual(model: Model, tares: Tares, theta: Array) -> Residual:
    """Residual of a rated payload at POINTS instants (POINTS, ..., R) about each posture; infinite variance where a row
    is unusable."""
    path, rate = _path(model.machine, theta)
    load = model.load @ _payload(model.machine)
    moved = _moved(model, path, rate, np.zeros((*path.shape[:-1], len(model.machine.cylinders))))
    torque = _columns(model, moved) @ (tares.values + load)
    lever = moved.motion.lever[..., model.machine.rows]
    force = (np.linalg.pinv(np.swapaxes(lever, -1, -2)) @ torque[..., None])[..., 0]
    moved = _moved(model, path, rate, force)  # again, because friction depends on the cylinder forces just computed
    columns = model.filtered.regressor.both_halves(moved.motion)[1]
    own = columns[..., : len(model.parameters)]
    left = residual(model, tares, Rows(columns, own @ (tares.values + load)), np.zeros(len(model.machine.rows)))
    lost = np.stack([np.logical_not(np.all(moved.usable[..., acting], axis=-1)) for acting in model.acting], axis=-1)
    return left._replace(variance=np.where(lost, np.inf, left.variance))


def _columns(model: Model, moved: Moved) -> Array:
    return model.empty.both_halves(moved.motion)[1]


def _payload(machine: Machine) -> Array:
    """(m, m x, m z, J) of a rated payload in the last link's frame, its centre towards the tool."""
    centre = FILLED * machine.payload_reach * machine.tool / abs(machine.tool)
    return machine.rated_payload * np.array([1.0, centre.real, centre.imag, abs(centre) ** 2])


def _path(machine: Machine, theta: Array) -> tuple[Array, Array]:
    """Angles [rad] and rates [rad/s] (POINTS, ..., N) during WEIGHED_S about `theta`: the arm lifts and reaches out,
    the tool curls."""
    rate = np.zeros_like(theta)
    lever = np.abs(machine.geometry(theta).lever)
    for j in driven(machine):
        speeds = [_speed(machine, c) / np.maximum(lever[..., c, j], 0.1) for c in _acting(machine, j)]
        rate[..., j] = np.min(speeds, axis=0) * (-1.0 if 0 < j == machine.size - 1 else 1.0)
    t = np.linspace(-0.5, 0.5, POINTS).reshape(-1, *[1] * theta.ndim) * WEIGHED_S
    low, high = (np.array([getattr(link, key) for link in machine.links]) for key in ("angle_low", "angle_high"))
    return np.clip(theta + rate * t, low, high), np.broadcast_to(rate, (POINTS, *theta.shape))


def _acting(machine: Machine, j: int) -> list[int]:
    return [c for c, span in enumerate(machine.spans) if j in span]


def _speed(machine: Machine, c: int) -> float:
    return (machine.cylinders[c].length_high - machine.cylinders[c].length_low) / CROSSING_S


def _moved(model: Model, theta: Array, rate: Array, force: Array) -> Moved:
    """The motion on level ground with cylinder forces (..., C) [N], computed from four samples as by the channels."""
    half, level = rate * (model.channels.dt / 2.0), np.zeros((*theta.shape[:-1], 3))
    four = [np.concatenate([theta + place * half, force, level], axis=-1) for place in (-3.0, -1.0, 1.0, 3.0)]
    return model.channels.between(np.stack(four))
