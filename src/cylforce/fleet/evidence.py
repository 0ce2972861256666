"""Statistics of one recording as those of a linear problem.

Whatever is computed later, of this recording alone or of a machine's years, the recording need not be read again.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.explained import row_noise
from cylforce.commissioning.wiring import MISFIT, misfit
from cylforce.diagnosis.regressors import Regressors, TorqueRows
from cylforce.effects.library import Proposal
from cylforce.estimation.batch import converged, least_squares
from cylforce.estimation.blocks import Factors, factors, joined, of_row, stacked_triangle
from cylforce.estimation.model import Model
from cylforce.estimation.priors.prior import Prior
from cylforce.fleet.coordinates import coordinates, data_sheet, sensor_errors
from cylforce.readings.constants import ROWS_HZ
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array

BLOCK_S = 2.0  # s in a block, as in an identification
PART_S = 60.0  # s in a part, so that differences within a day appear; chosen
MOST_PARTS = 4  # parts of a recording at most: it bounds what is stored of it; chosen
MOST_BLOCKS = 1024  # blocks, half an hour; beyond, neighbours are merged; chosen


class Evidence(NamedTuple):
    """Statistics of one recording with K quantities (see `coordinates`).

    parts: (S, K+1, K+1) products of the columns and the torque, in units of their noise, for each minute
    joints: (R, K+1, K+1) products of the columns and the torque of each joint, over the whole recording [N^2 m^2]
    samples: (R,) number of samples of each joint
    misfit: share of the torque that remains unexplained
    seconds: time of motion [s]
    """

    parts: Array
    joints: Array
    samples: Array
    misfit: float
    seconds: float

    @property
    def size(self) -> int:
        """Return the number of quantities K."""
        return int(self.parts.shape[-1]) - 1

    @property
    def information(self) -> Array:
        """Return the information (S, K, K) of each part."""
        return self.parts[:, :-1, :-1]

    @property
    def pull(self) -> Array:
        """Return the pull (S, K): information times the value that the part alone would give."""
        return self.parts[:, :-1, -1]

    @property
    def at_work(self) -> bool:
        """Return whether loads or forces at the teeth are in the torque.

        Then the residual of the best parameters is larger than that of a machine with a wrong sensor.
        """
        return self.misfit > MISFIT

    def residual(self, values: Array) -> Array:
        """Return the rms residual torque (R, W) [N m] of several values (W, K) at each joint; NaN at one that never
        moved.
        """
        with_torque = np.column_stack([values, np.full(len(values), -1.0)]).T
        squares = np.sum(with_torque * (self.joints @ with_torque), axis=1)
        count = np.where(self.samples > 0, self.samples, np.nan)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0) / count[:, None]))


def evidence(model: Model, recorded: Sequence[Recording]) -> Evidence:
    """Return the statistics of a recording's gapless stretches, as those of the empty machine.

    A recording `at_work` gives no information about the machine. Raises ValueError, in a sentence, where nothing moves.
    """
    first = _factors(Regressors(model, model.prior.mean), recorded, ())
    tares = converged(first, row_noise(first, model.prior), model.prior).values
    data = _factors(Regressors(model, tares), recorded, sensor_errors(model.machine))
    prior = prior_of(model)
    noise = row_noise(data, prior)
    fit = least_squares(data, noise, prior)
    weight = fit.trust / np.maximum(fit.row_error, 1e-3 * noise) / np.sqrt(fit.memory)
    groups = np.array_split(np.arange(len(weight)), _parts(len(weight)))
    parts = [_squared(stacked_triangle(_some(data, group), weight[group])) for group in groups]
    joints = [_squared(stacked_triangle(of_row(data, r), fit.trust[:, [r]])) for r in range(weight.shape[1])]
    samples = np.sum(data.samples * fit.trust**2, axis=0)
    seconds = float(np.max(np.sum(data.samples, axis=0)) / ROWS_HZ)
    return Evidence(
        parts=np.array(parts),
        joints=np.array(joints),
        samples=samples,
        misfit=misfit(data, fit.row_error),
        seconds=seconds,
    )


def prior_of(model: Model) -> Prior:
    """Return the prior of all followed quantities from the data sheet."""
    size, spread = len(model.parameters), np.array([c.constant for c in coordinates(model)])
    covariance = np.diag(spread**2)
    covariance[:size, :size] = model.prior.covariance
    return Prior(data_sheet(model), covariance)


def _parts(blocks: int) -> int:
    """Return the number of parts of a recording."""
    return int(np.clip(blocks * BLOCK_S / PART_S, 1, MOST_PARTS))


def _some(data: Factors, blocks: NDArray[np.intp]) -> Factors:
    """Return some of the blocks."""
    return Factors(*(part[blocks] for part in data))


def _squared(triangle: Array) -> Array:
    """Return R'R of a triangular factor."""
    return np.asarray(triangle.T @ triangle)


def _factors(regressors: Regressors, recorded: Sequence[Recording], wanted: Sequence[Proposal]) -> Factors:
    """Return the factors of the recording in blocks of BLOCK_S. Raises ValueError where nothing moves."""
    parts = [_blocked(regressors, regressors.rows(stretch, wanted)) for stretch in recorded]
    data = joined(parts, MOST_BLOCKS)
    if not np.any(data.samples):
        raise ValueError("no cylinder moves, so that the recording shows nothing of the machine")
    return data


def _blocked(regressors: Regressors, rows: TorqueRows) -> Factors:
    """Return the factors of one stretch."""
    columns = np.concatenate([rows.base, rows.effects], axis=-1, dtype=np.float64)
    torque = rows.residual + rows.base @ regressors.parameters
    return factors(columns, torque, np.zeros_like(torque), round(BLOCK_S * ROWS_HZ))
