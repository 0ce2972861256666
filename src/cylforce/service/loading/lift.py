"""A lift, and what is concluded from it."""

from typing import NamedTuple

from cylforce.estimation.recursive import Root
from cylforce.signals.estimate import Array


class Lift(NamedTuple):
    """A lift: the recursive estimate of the load's (m, m x, m z, J about the last pin) without drift, as information
    `root`, `values` (4,) and `covariance` (4, 4); `gram` (4, P + D), with which its sensitivity to tares and drift is
    covariance @ gram; numbers of samples `taken`, `refused` in a row, and `moving`; `rested` (R,): number of samples
    for which each row has been at rest; `marks` (2, 4, 5 + P + D): information about the load at the last two looks for
    a spill; `mixed`: whether the filters still hold what was before the lift."""

    root: Root
    values: Array
    covariance: Array
    gram: Array
    taken: int
    refused: int
    moving: int
    rested: Array
    marks: Array
    mixed: bool


class Weight(NamedTuple):
    """Mass [kg] with standard error [kg]; centre x + i z [m] of the load in the last link's frame with the standard
    errors (x, z) [m]; `drifted` [kg m]: standard error of the first moment by a drift that is not known yet."""

    mass: float
    standard_error: float
    centre: complex
    centre_error: tuple[float, float]
    drifted: float
