"""Estimate a common scale of all measured forces from the data sheet's masses.

A wrong range, psi for bar, or a decimal digit makes all pressures wrong by one factor. Every identified first moment,
every friction and every load is then wrong by the same factor, and the fit is as good as before. Without a known weight
only the masses of the data sheet show that factor, within their tolerances.
"""

from math import hypot, log
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.emptiness import HEAVY, with_free_parameters
from cylforce.estimation.batch import Fit, least_squares
from cylforce.estimation.blocks import Factors, beside
from cylforce.estimation.model import ABSOLUTE, Model
from cylforce.estimation.priors.prior import Prior
from cylforce.mechanics.machine import TOLERANCE_OVER_ERROR, base_parameter_spread
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

UNKNOWN = 1000.0  # prior standard error of the scale: uninformative
FORCES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)  # signals that have the common scale
CHECKED = "unit (bar, psi, MPa), range and decimal digits (CiA 404: 6132h) of all pressure sensors"
# Measured over true pressure when a unit or a decimal digit is mistaken: 1 bar is 14.504 psi. In "A for B" the sensor
# sends its value in A, and the machine file takes it for B.
MISTAKES = (
    (0.01, "two decimal digits"),
    (0.1, "one decimal digit, or MPa for bar"),
    (1.0 / 14.504, "bar for psi"),
    (10.0, "one decimal digit, or bar for MPa"),
    (14.504, "psi for bar"),
    (100.0, "two decimal digits"),
)


class CommonScale(NamedTuple):
    """Measured forces over those that the data sheet's masses need.

    factor:         the estimate, 1 where the identified masses are those of the data sheet
    standard_error: of the factor, from the data sheet's tolerances and the recording
    limit:          |factor - 1| beyond which the factor counts as wrong: HEAVY standard errors, or what the figures of
                    the links explain when all of them use up their tolerances, if that is more
    """

    factor: float
    standard_error: float
    limit: float

    @property
    def error(self) -> float:
        """Return the relative rms error of a weight that is reported without correction for the factor.

        The true weight is 1/factor times the reported one, with standard error standard_error/factor.
        """
        return hypot(1.0 / self.factor - 1.0, self.standard_error / self.factor)

    @property
    def is_wrong(self) -> bool:
        """Return whether the data sheet excludes the factor 1."""
        return abs(self.factor - 1.0) > self.limit

    @property
    def words(self) -> str:
        """Return the factor in words, with the likely mistake and the check for it."""
        known = f" ({self._mistake})" if self._mistake else ""
        return f"{_rounded(self.factor)} times as large as the data sheet's masses need{known}: check {CHECKED}"

    @property
    def sentence(self) -> str:
        """Return a sentence with the error and its cure."""
        right = "if these are right, correct masses and tolerances in the machine file"
        return f"all pressures are about {self.words}; {right}"

    @property
    def _mistake(self) -> str:
        """Return the words of the one of MISTAKES whose factor is nearest in ratio; "" where none is near enough.

        Near enough: its logarithm differs by less than HEAVY standard errors, which are relative to a factor below 1.
        """
        if self.factor <= 0.0:
            return ""
        distance = {words: abs(log(self.factor / factor)) for factor, words in MISTAKES}
        nearest = min(distance, key=lambda words: distance[words])
        return nearest if distance[nearest] < HEAVY * self.standard_error / min(self.factor, 1.0) else ""


def common_scale(model: Model, data: Factors, noise: Array) -> CommonScale:
    """Return the common scale s of the measured torques, with its limit, from least squares.

    The rows are torque = W (Phi + (s - 1) Phi_sheet). Phi has the data sheet as prior, s has none.

    data: factors of a recording of the empty machine, for the P parameters of the model
    noise: (R,) standard error of each measured torque [N m]
    """
    scaled = model.prior.mean.copy()
    scaled[[p.name.endswith(ABSOLUTE) for p in model.parameters]] = 0.0  # a share of the force, a time: without scale
    columns = np.broadcast_to(scaled[:, None], (data.samples.shape[1], len(scaled), 1))
    prior = with_free_parameters(model.prior, np.array([UNKNOWN]))
    fit = least_squares(beside(data, columns), noise, prior)
    error = float(np.sqrt(fit.covariance[-1, -1]))
    return CommonScale(
        factor=1.0 + float(fit.values[-1]),
        standard_error=error,
        limit=max(HEAVY * error, _worst_tolerances(model, fit, prior)),
    )


def _worst_tolerances(model: Model, fit: Fit, prior: Prior) -> float:
    """Return the |s - 1| that right pressures give when all figures of the links use up their tolerances.

    Each figure is wrong in the direction that makes |s - 1| larger.

    With A the rows and C the prior's covariance, the estimate changes with the prior's mean by (A'A + C^-1)^-1 C^-1.

    fit, prior: of the P parameters and, last, of s - 1
    """
    spread = base_parameter_spread(model.machine.links)
    change = fit.covariance[-1] @ np.linalg.inv(prior.covariance)
    return float(TOLERANCE_OVER_ERROR * np.sum(np.abs(change[: len(spread)] @ spread)))


def rescaled(model: Model, values: Array, factor: float) -> Array:
    """Return samples with all pressures and force pins (FORCES) divided by a factor; the others are unchanged.

    This tries the correction of a common scale.

    values: (T, S) samples [SI], not changed
    factor: measured over true force
    """
    changed = values.copy()
    changed[:, [s.kind in FORCES for s in model.machine.signals]] /= factor
    return changed


def _rounded(factor: float) -> str:
    """Return a factor with two significant digits below 1, two decimals above."""
    return f"{factor:.2g}" if factor < 1.0 else f"{factor:.2f}"
