"""What the identified parameters of the empty machine leave of the measured torque: the load, the force at the tool,
and errors. And the conventions by which that is called a weight."""

from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.signals.estimate import Array

MIN_SECONDS = 1.0  # of consistent samples before a weight is shown
GOOD_ENOUGH = 0.01  # standard error, as a share of rated payload, to be shown as OK and to be booked
SMALLEST = 0.05  # share of rated payload below which the bucket counts as empty
RELATIVE = 0.01  # what the model leaves unexplained grows with the load: friction, elasticity
REST_SECONDS = 10.0  # friction at rest does not average out: so long a rest tells what one sample would, then nothing


class Residual(NamedTuple):
    """What the tares do not explain: `torque` (R,) [N m] and its `variance` (R,); `columns` (R, P) of the tares; `rest`
    (R,): variance of the friction that is unknown at rest."""

    torque: Array
    variance: Array
    rest: Array
    columns: Array


def residual(model: Model, tares: Tares, rows: Rows, drift: Array) -> Residual:
    """r = torque - W Phi - drift of one instant, and how well it is known; `drift` (R,) [N m]."""
    size = len(model.parameters)
    columns = rows.columns[..., :size]
    torque = tares.scale * (rows.torque - columns @ tares.values - drift)
    coulomb = np.abs(tares.values[model.coulomb])
    rest = (rows.columns[..., model.at_rest] @ coulomb) ** 2 if coulomb.size else np.zeros_like(torque)
    return Residual(torque, tares.row_error**2 + (RELATIVE * torque) ** 2, rest, columns)
