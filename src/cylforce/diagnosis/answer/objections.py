"""Reasons not to name a cause, whatever its evidence: its magnitude, or what its simulation leaves of the recordings.

The rules hold with references and without. Each one speaks of a cause that the recordings do not determine, or that
makes the model worse somewhere: such a cause stands for something else."""

from collections.abc import Sequence

import numpy as np

from cylforce.diagnosis.answer.causes import Cause, interval
from cylforce.diagnosis.answer.verdict import Search
from cylforce.diagnosis.columns.problem import Problem
from cylforce.diagnosis.inference.residuals import rms, weighed
from cylforce.diagnosis.numbers import SAME
from cylforce.effects.fault import BEYOND, INCIDENTAL
from cylforce.signals.estimate import Array

ROUNDING = 1e-6  # of the largest plausible magnitude: a magnitude is limited to just below it
AT_BOUND = "{}: its magnitude is at the largest plausible one, so that it stands for something else: not named"
NO_MAGNITUDE = "{}: the 90 % interval of its magnitude contains zero: not named"
HARDLY = "simulated with {}, the machine hardly comes nearer to the recordings: not named"
WORSE_JOINT = "simulated with {}, the {} differs more from the recordings than before: not named"
WORSE_WEIGHT = "simulated with {}, weights are more wrong than before: not named"


def names_of(causes: Sequence[Cause]) -> str:
    """Return the names of causes, as options and files write them."""
    return " and ".join("{}@{}".format(*cause.key) for cause in causes)


def of_magnitude(search: Search, causes: Sequence[Cause]) -> str:
    """Return what the magnitude of a cause says against it, in a sentence; empty if nothing does."""
    for cause in causes:
        if _at_bound(search, cause):
            return AT_BOUND.format(names_of([cause]))
        _, low, high = interval(cause)
        if low <= 0.0 <= high:
            return NO_MAGNITUDE.format(names_of([cause]))
    return ""


def _at_bound(search: Search, cause: Cause) -> bool:
    """Return whether a cause that lasts has the largest magnitude that is plausible on this machine."""
    if cause.form is None:  # every block has a magnitude of its own
        return False
    column = search.question.forms[cause.form][1]
    magnitude = float(np.linalg.norm(cause.sizes.ravel()[: column.measured]))
    return magnitude >= BEYOND * column.high * (1.0 - ROUNDING)


def of_simulation(search: Search, causes: Sequence[Cause], before: Sequence[Array], after: Sequence[Array]) -> str:
    """Return which joint, or whether the weight, the simulation of some causes makes worse; empty if none.

    Worse is by more than two recordings of a healthy machine differ (SAME, of the noise floor's energy).
    before, after: residuals (T, R) of the faulty recordings [N m], without the causes and with them
    """
    floor, machine = search.question.floor.rms, search.viewer.model.machine
    worse = rms(after) ** 2 - rms(before) ** 2 > SAME * floor**2
    if np.any(worse):
        joint = machine.links[machine.rows[int(np.argmax(worse))]].name
        return WORSE_JOINT.format(names_of(causes), joint)
    unit = weight_floor(search.original, floor)
    weights = [weighed(search.question, left) / unit for left in (before, after)]
    return WORSE_WEIGHT.format(names_of(causes)) if weights[1] ** 2 - weights[0] ** 2 > SAME else ""


def weight_floor(problem: Problem, floor: Array) -> float:
    """Return the weight [kg] whose torque along the faulty recordings is the noise floor (mean square of joints)."""
    mass = INCIDENTAL.index("load.mass")
    torque = rms([np.where(np.isfinite(s.rows.left), s.rows.incidental[..., mass], np.nan) for s in problem.faulty])
    return float(1.0 / np.sqrt(np.mean((torque / floor) ** 2)))
