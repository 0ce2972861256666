"""Load in the bucket at each step of a recording, by the weighing of the service."""

from array import array

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import MIN_SECONDS, residual
from cylforce.service.weighing import LoadConstants, LoadEstimator
from cylforce.signals.estimate import Array


def hanging(model: Model, tares: Tares, values: Array) -> Array:
    """Return the estimated load (T-1,) [kg] in each of the T-1 intervals between samples.

    It is 0 while the filters settle, and where the weighing has no consistent estimate. The drift of friction and
    pressure zeros is not corrected.

    tares:  identified parameters of the empty machine
    values: (T, S) samples of all signals [SI], without gaps
    """
    constants = LoadConstants(model, tares)
    load = LoadEstimator.start(constants)
    moved = model.channels.run(values)
    rows = model.filtered.run(moved.motion)
    usable = np.stack([np.all(moved.usable[:, acting], axis=1) for acting in model.acting], axis=-1)
    usable[: model.settle_steps] = False
    nothing, enough = np.zeros(len(model.machine.rows)), MIN_SECONDS * model.filters.rate_hz
    masses = np.zeros(len(usable))
    for k, good in enumerate(usable):
        instant = residual(model, tares, Rows(rows.columns[k], rows.torque[k]), nothing)
        load.update(constants.residual_of_arrays(instant), array("d", good))
        if load.lift.taken > enough and not load.lift.refused:
            masses[k] = load.lift.values[0]
    return masses
