"""Drift of friction (Coulomb, viscous) and pressure zeros: its spread between strokes and from day to day."""

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import BetweenStrokes, Model
from cylforce.signals.estimate import Array

# Prior spread of dry and viscous friction between commissioning and another day, as shares. Dry: the difference between
# strokes of a real crane. Viscous: 7 K of the oil; viscosity (ISO VG 46, 40 degC) changes by 5 % per kelvin, viscous
# friction with its power of 0.5 (film under a seal, inverse theory, Blok 1963) to 1 (shear in a gap).
DRY, VISCOUS = 0.05, 0.25
# Correlation of viscous frictions, or of dry ones: all cylinders have the same oil. At 0 degC, 13 times as viscous,
# these powers add 2.5 to 12 times the friction, with a correlation of 0.85; small changes correlate by 0.96.
ONE_OIL = 0.9
DRY_AND_VISCOUS = 0.5  # correlation of both: seals follow less; chosen: 0.3 to 0.9 give the same weights
ZERO = 1e4  # Pa, zeros as between strokes of that crane: 0.09 bar. Returns estimate any larger shift
SMALLEST_FRICTION = 100.0  # Pa: least standard error of a friction, as a pressure on the head side; chosen


def kinds(model: Model) -> NDArray[np.int_]:
    """Return the kind of each of the D drifts: 0 a friction, 1 a zero."""
    return np.repeat([0, 1], (len(model.changing_friction), len(model.machine.cylinders)))


def drift_spread(model: Model, values: Array, differs: BetweenStrokes) -> Array:
    """Return the standard errors (D,) of the drift (change since the identification): friction [N, N s/m], zeros [N].

    A friction changes by a share of its value, at least as much as SMALLEST_FRICTION [Pa] on the first cylinder's head
    side. A pressure zero [Pa] counts as a force on the head side.

    values:  (P,) parameters of the empty machine, the frictions among them
    differs: standard errors of the differences: share of the friction, pressure [Pa]
    """
    least = SMALLEST_FRICTION * model.machine.cylinders[0].area_head
    friction = np.maximum(differs.friction * np.abs(values[model.changing_friction]), least)
    zero = [differs.zero * c.area_head for c in model.machine.cylinders]
    return np.concatenate([friction, zero])


def daily_spread(model: Model, values: Array) -> Array:
    """Return the standard errors (D,) of the drift from one day to another: friction [N, N s/m], zeros [N].

    values: (P,) parameters
    """
    dry, viscous = (drift_spread(model, values, BetweenStrokes(share, ZERO)) for share in (DRY, VISCOUS))
    return np.where(_viscous(model), viscous, dry)


def daily_correlation(model: Model) -> Array:
    """Return the prior correlation (D, D) of the drifts from day to day, frictions first, then pressure zeros.

    All frictions follow the same oil, dry and viscous ones less with each other; a zero drifts by itself.
    """
    viscous, friction = _viscous(model), kinds(model) == 0
    alike = np.where(np.equal.outer(viscous, viscous), ONE_OIL, DRY_AND_VISCOUS) * np.outer(friction, friction)
    np.fill_diagonal(alike, 1.0)
    return np.asarray(alike)


def _viscous(model: Model) -> NDArray[np.bool_]:
    """Return which of the D drifts are viscous frictions, (D,)."""
    names = [model.parameters[k].name for k in model.changing_friction]
    return np.array([n.endswith(".viscous") for n in names] + [False] * len(model.machine.cylinders))
