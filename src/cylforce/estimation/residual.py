"""Residual torque of the identified empty machine (load, force at the tool, errors), and the limits above which a load
counts as a weight."""

from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

MIN_SECONDS = 1.0  # s of consistent samples before a weight is shown; chosen
GOOD_ENOUGH = 0.01  # times the rated payload: largest standard error to be shown as OK and to be booked; chosen
EMPTY_BELOW = 0.05  # times the rated payload: a bucket with a smaller mass counts as empty; chosen
RELATIVE = 0.01  # times the residual: model error that grows with the load (friction, elasticity); chosen
# s: a rest of this length counts as one sample, because friction at rest does not average out; longer rest is not used;
# chosen.
REST_SECONDS = 10.0


class Residual(NamedTuple):
    """Residual torque of the tares at one instant; of several (..., R).

    torque:   (R,) residual [N m]
    variance: (R,) of the torque by the model's errors, without those of the tares and of friction at rest [N^2 m^2]
    rest:     (R,) variance of the unknown friction at rest [N^2 m^2]
    columns:  (R, P) of the tares
    """

    torque: Array
    variance: Array
    rest: Array
    columns: Array


def residual(model: Model, tares: Tares, rows: Rows, drift: Array) -> Residual:
    """Return the residual torque r = scale (torque - W Phi - drift) of one instant [N m], with its variances.

    It is zero, but for errors, for the empty machine; else it is the torque of a load or of a force at the tool.
    Several instants may be computed at once, with leading axes.

    tares: Phi (P,), of the model's parameters
    rows:  of the instant: columns (R, K), which begin with W (R, P), and measured torques (R,) [N m]
    drift: (R,) torque of the adapted friction and zeros [N m]
    """
    size = len(model.parameters)
    columns = rows.columns[..., :size]
    torque = tares.scale * (rows.torque - columns @ tares.values - drift)  # r = scale (torque - W Phi - drift)
    rest = _at_rest(model, tares, rows) ** 2 if len(model.coulomb) else np.zeros_like(torque)
    return Residual(torque, tares.row_error**2 + (RELATIVE * torque) ** 2, rest, columns)


def _at_rest(model: Model, tares: Tares, rows: Rows) -> Array:
    """Return the standard error (..., R) [N m] of the measured torques by friction at rest, whose direction is unknown.

    A cylinder at rest adds its lever times two errors: its Coulomb friction, and the part of friction that grows with
    its force (`by_load`). For the second, its force times its lever is taken as the row's whole torque.

    tares: identified parameters, Coulomb friction [N] among them
    rows:  columns (..., R, K) and torques (..., R) [N m]
    """
    unknown = rows.columns[..., model.at_rest]
    share = unknown / np.maximum(np.abs(rows.columns[..., model.coulomb]) + np.abs(unknown), 1e-300)
    more = np.abs(rows.torque) * (share @ by_load(model, tares.values))
    return np.asarray(unknown @ np.abs(tares.values[model.coulomb]) + more)


def by_load(model: Model, values: Array) -> Array:
    """Return the share (C,) of each cylinder's force by which its dry friction increases; 0 without such a law.

    values: (P,) parameters of the empty machine
    """
    names = {p.name: k for k, p in enumerate(model.parameters)}
    places = [names.get(f"{c.name}.load_dependent") for c in model.machine.cylinders]
    return np.array([0.0 if k is None else max(float(values[k]), 0.0) for k in places])


def correlated_samples(filters: Filters, seconds: float = 0.0) -> float:
    """Return the number of consecutive samples that count as one independent sample.

    It is the correlation time of the filters, or the longer one that was measured of the residual.

    seconds: measured correlation time [s]; 0: not measured
    """
    return max(
        1.0, filters.rate_hz / (np.pi * min(filters.smoothing_hz, filters.regressor_hz)), seconds * filters.rate_hz
    )


def load_spread(machine: Machine) -> Array:
    """Return the prior standard errors (4,) of a load's mass, first moments and inertia about the last pin.

    They are two rated payloads [kg], one rated payload at its reach [kg m, kg m], and the same at its square [kg m^2].
    """
    moment = machine.rated_payload * machine.payload_reach
    return np.array([2.0 * machine.rated_payload, moment, moment, moment * machine.payload_reach])
