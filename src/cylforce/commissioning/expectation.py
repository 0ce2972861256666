"""Expected accuracy of the weighing, before anything is weighed.

The standard error of a rated payload is computed over the postures of the arm, by the same least squares as in
service/weighing.py, on columns computed from the model.
"""

from typing import NamedTuple

import numpy as np

from cylforce.estimation.channels import Moved
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import REST_SECONDS, Residual, correlated_samples, load_spread, residual
from cylforce.mechanics.chain import Complex
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven, joint_angles, working_range
from cylforce.signals.estimate import Array

WEIGHED_S = 3.0  # s of motion over which a payload is weighed; chosen: a short lift
CROSSING_S = 15.0  # s in which a cylinder would travel its whole stroke at the assumed speed; chosen
POINTS = 7  # instants of that motion at which the columns are computed; chosen
CURLED = 0.15  # angle of the tool while it carries the load, from its lower limit, times its range; chosen
GRID = 16  # postures along a joint's range; chosen
FILLED = 0.6  # assumed distance of the load's centre from the last pin, times the payload's reach; chosen


class Expected(NamedTuple):
    """Expected accuracy of a weight at postures (...).

    standard_error: (...) of the weight [kg]; NaN where weighing is impossible
    noise: (...) contribution to it that decreases with longer weighing [kg]
    gain: (..., P) kg by which the weight is too large, per unit by which a tare is too small
    """

    standard_error: Array
    noise: Array
    gain: Array


class PostureGrid(NamedTuple):
    """A grid of postures over the ranges of two joints.

    theta: (A, B, N) joint angles [rad]
    tool: (A, B) place x + i z of the tool from the first pin [m]
    """

    theta: Array
    tool: Complex


def postures(machine: Machine) -> PostureGrid:
    """Return GRID x GRID postures over the working range.

    The two innermost driven joints pass through their ranges, the first along axis A, the second along axis B. The tool
    is curled, the other joints are in mid-range.
    """
    ranges = working_range(machine)
    low, high = ranges.T
    theta = np.tile((low + high) / 2.0, (GRID, GRID, 1))
    theta[..., -1] = low[-1] + CURLED * (high[-1] - low[-1])
    for axis, j in enumerate(driven(machine)[:2]):
        theta[..., j] = np.expand_dims(np.linspace(low[j], high[j], GRID), 1 - axis)
    theta = joint_angles(machine, theta)
    return PostureGrid(theta, machine.tool_point(theta).place)


def expected_error(model: Model, tares: Tares, theta: Array) -> Expected:
    """Return the expected accuracy of a rated payload that is weighed during WEIGHED_S of motion about postures.

    The scale of the forces (bores, levers, gains), which a recording of the empty machine cannot determine, enters with
    the tares' `scale_error`.

    theta: (..., N) joint angles [rad]
    """
    rows = posture_residual(model, tares, theta)
    columns = rows.columns @ model.load
    weight = _weight(model, rows, tares.correlation)
    weighted = np.swapaxes(columns * weight[..., None], -1, -2)
    # P = (X' V^-1 X + P0^-1)^-1; an error d of the tares changes the weight by the gain (P X' V^-1 W) d
    covariance = np.linalg.inv(np.sum(weighted @ columns, axis=0) + np.diag(load_spread(model.machine) ** -2.0))
    gain = (covariance[..., :1, :] @ np.sum(weighted @ rows.columns, axis=0))[..., 0, :]
    noise, by_tares = covariance[..., 0, 0], np.sum((gain @ tares.covariance) * gain, axis=-1)
    by_tares = by_tares + (tares.scale_error * model.machine.rated_payload) ** 2
    weighable = np.sqrt(noise) < model.machine.rated_payload
    return Expected(
        standard_error=np.where(weighable, np.sqrt(noise + by_tares), np.nan),
        noise=np.where(weighable, np.sqrt(noise), np.nan),
        gain=gain,
    )


def cost(tares: Tares, expected: Expected) -> Array:
    """Return the contribution (P,) [kg] of each tare to the weight's standard error; median over the postures.

    It is the root of the variance that would disappear if this tare were exact, correlations included. Postures in
    which weighing is impossible do not count; where all are such, the result is NaN.
    """
    weighable = np.isfinite(expected.standard_error)
    part = expected.gain[weighable] @ tares.covariance / np.sqrt(np.diag(tares.covariance))
    return np.asarray(np.median(np.abs(part), axis=0)) if np.any(weighable) else np.full(len(tares.names), np.nan)


def _weight(model: Model, rows: Residual, correlation: float) -> Array:
    """Return the weight (POINTS, ..., R) [1/(N m)^2] of each row: number of independent samples over their variance.

    A point represents WEIGHED_S / POINTS of motion. An unusable row has the weight 0.

    correlation: measured correlation time of the residual [s]; 0: not measured
    """
    f = model.filters
    variance = correlated_samples(f, correlation) * rows.variance + REST_SECONDS * f.rate_hz * rows.rest
    return np.asarray(np.where(np.isfinite(variance), WEIGHED_S * f.rate_hz / POINTS / variance, 0.0))


def posture_residual(model: Model, tares: Tares, theta: Array) -> Residual:
    """Return the residual of a rated payload at POINTS instants (POINTS, ..., R) about each posture.

    The variance is infinite where a row is unusable.

    theta: (..., N) joint angles of the postures [rad]
    """
    path, rate = _path(model.machine, theta)
    load = model.load @ _payload(model.machine)
    moved = _moved(model, path, rate, np.zeros((*path.shape[:-1], len(model.machine.cylinders))))
    torque = _columns(model, moved) @ (tares.values + load)
    lever = moved.motion.lever[..., model.machine.rows]
    force = (np.linalg.pinv(np.swapaxes(lever, -1, -2)) @ torque[..., None])[..., 0]
    moved = _moved(model, path, rate, force)  # again, because friction depends on the cylinder forces just computed
    columns = model.filtered.regressor.both_halves(moved.motion)[1]
    torque = columns[..., : len(model.parameters)] @ (tares.values + load)
    rows = residual(model, tares, Rows(columns, torque), np.zeros(len(model.machine.rows)))
    usable = np.stack([np.all(moved.usable[..., acting], axis=-1) for acting in model.acting], axis=-1)
    return rows._replace(variance=np.where(usable, rows.variance, np.inf))


def _columns(model: Model, moved: Moved) -> Array:
    """Return the static columns (..., R, P) of the empty machine."""
    return model.empty.both_halves(moved.motion)[1]


def _payload(machine: Machine) -> Array:
    """Return the load (m, m x, m z, J) [kg, kg m, kg m, kg m^2] of a rated payload, its centre towards the tool.

    Moments and inertia are about the last pin, in the frame of the last link.
    """
    centre = FILLED * machine.payload_reach * machine.tool / abs(machine.tool)
    return machine.rated_payload * np.array([1.0, centre.real, centre.imag, abs(centre) ** 2])


def _path(machine: Machine, theta: Array) -> tuple[Array, Array]:
    """Return angles [rad] and rates [rad/s] (POINTS, ..., N) during WEIGHED_S about postures.

    The arm lifts and reaches out, the tool curls, each joint as fast as its slowest cylinder allows. Angles end at the
    limits of their joints; the rates do not.

    theta: (..., N) joint angles of the postures [rad]
    """
    rate = np.zeros_like(theta)
    lever = np.abs(machine.geometry(theta).lever)
    for j in driven(machine):
        speeds = [_speed(machine, c) / np.maximum(lever[..., c, j], 0.1) for c in _acting(machine, j)]
        rate[..., j] = np.min(speeds, axis=0) * (-1.0 if 0 < j == machine.size - 1 else 1.0)
    t = np.linspace(-0.5, 0.5, POINTS).reshape(-1, *[1] * theta.ndim) * WEIGHED_S
    low, high = (np.array([getattr(link, key) for link in machine.links]) for key in ("angle_low", "angle_high"))
    return np.clip(theta + rate * t, low, high), np.broadcast_to(rate, (POINTS, *theta.shape))


def _acting(machine: Machine, j: int) -> list[int]:
    """Return the cylinders that act on joint j."""
    return [c for c, span in enumerate(machine.spans) if j in span]


def _speed(machine: Machine, c: int) -> float:
    """Return the assumed speed of cylinder c [m/s]."""
    return (machine.cylinders[c].length_high - machine.cylinders[c].length_low) / CROSSING_S


def _moved(model: Model, theta: Array, rate: Array, force: Array) -> Moved:
    """Return the motion on level ground, from four samples as `Channels` computes it.

    theta: (..., N) joint angles [rad]
    rate:  (..., N) joint rates [rad/s]
    force: (..., C) cylinder forces [N]
    """
    half, level = rate * (model.channels.dt / 2.0), np.zeros((*theta.shape[:-1], 3))
    samples = [np.concatenate([theta + place * half, force, level], axis=-1) for place in (-3.0, -1.0, 1.0, 3.0)]
    return model.channels.between(np.stack(samples))
