"""The torque that the identified empty machine does not explain: load, force at the tool, and errors; and the limits
from which on a load counts as a weight."""

from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

MIN_SECONDS = 1.0  # s of consistent samples before a weight is shown; chosen
GOOD_ENOUGH = 0.01  # times the rated payload: largest standard error to be shown as OK and to be booked; chosen
SMALLEST = 0.05  # times the rated payload: below it the bucket counts as empty; chosen
RELATIVE = 0.01  # times the residual: model error that grows with the load (friction, elasticity); chosen
# s: a rest of this length counts as one sample, because friction at rest does not average out; longer rest is not used;
# chosen.
REST_SECONDS = 10.0


class Residual(NamedTuple):
    """The torque that the tares do not explain: `torque` (R,) [N m] and its `variance` (R,) [N^2 m^2] without friction
    at rest; `rest` (R,) [N^2 m^2]: variance of the unknown friction at rest; `columns` (R, P) of the tares."""

    torque: Array
    variance: Array
    rest: Array
    columns: Array


def residual(model: Model, tares: Tares, rows: Rows, drift: Array) -> Residual:
    """Residual r = scale (torque - W Phi - drift) of one instant with its variances; `drift` (R,) [N m]: torque of the
    adapted friction and zeros."""
    size = len(model.parameters)
    columns = rows.columns[..., :size]
    torque = tares.scale * (rows.torque - columns @ tares.values - drift)
    coulomb = np.abs(tares.values[model.coulomb])
    rest = (rows.columns[..., model.at_rest] @ coulomb) ** 2 if coulomb.size else np.zeros_like(torque)
    return Residual(torque, tares.row_error**2 + (RELATIVE * torque) ** 2, rest, columns)


def correlated(filters: Filters, seconds: float = 0.0) -> float:
    """Number of consecutive samples that count as one independent sample: the correlation time of the filters, or the
    longer one [s] that was measured of the residual."""
    return max(
        1.0, filters.rate_hz / (np.pi * min(filters.smoothing_hz, filters.regressor_hz)), seconds * filters.rate_hz
    )


def load_spread(machine: Machine) -> Array:
    """Standard errors (4,) of a load's (m, m x, m z, J) before anything is seen of it."""
    moment = machine.rated_payload * machine.payload_reach
    return np.array([2.0 * machine.rated_payload, moment, moment, moment * machine.payload_reach])
