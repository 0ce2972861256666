"""The load in the bucket at each step of a recording, by the weighing of the service."""

from array import array

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import MIN_SECONDS, residual
from cylforce.service.weighing import Weigher
from cylforce.signals.estimate import Array


def hanging(model: Model, tares: Tares, values: Array) -> Array:
    """Estimated load (T-1,) [kg] at each step of samples (T, S); 0 where the weighing has no consistent estimate."""
    weigher = Weigher(model, tares)
    moved = model.channels.run(values)
    rows, state = model.filtered.run(moved.motion), weigher.begin()
    usable = np.stack([np.all(moved.usable[:, acting], axis=1) for acting in model.acting], axis=-1)
    usable[: model.settle_steps] = False
    nothing, enough = np.zeros(len(model.machine.rows)), MIN_SECONDS * model.filters.rate_hz
    hanging = np.zeros(len(usable))
    for k, good in enumerate(usable):
        left = residual(model, tares, Rows(rows.columns[k], rows.torque[k]), nothing)
        state, _ = weigher.step(state, weigher.of_arrays(left), array("d", good), k)
        if state.lift.taken > enough and not state.lift.refused:
            hanging[k] = state.lift.values[0]
    return hanging
