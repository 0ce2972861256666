"""How much of a gap goes when the model's own parameters are fitted to the recordings anew, masses and friction: the
first explanation of a model that is a data sheet, or somebody else's simulation."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.answer.shrinkage import Gap
from cylforce.diagnosis.columns.floor import fitted_tares
from cylforce.diagnosis.columns.problem import Seen
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.residuals import rms
from cylforce.diagnosis.numbers import HALF, IN_ORDER, ODD
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array


class Change(NamedTuple):
    """A parameter of the model: value before and after the fit [`unit`], and the torque that the change makes along the
    recordings [N m, rms over all joints]."""

    name: str
    unit: str
    before: float
    after: float
    torque: float


class Refit(NamedTuple):
    """The gap before and after the model's parameters are fitted to it.

    before:  (R,) residual torque with the parameters as they were [N m, rms]
    after:   (R,) the same with the fitted ones
    share:   share of the gap's energy beyond the noise floor that goes
    changes: the parameters, the one that makes most torque first
    """

    before: Array
    after: Array
    share: float
    changes: tuple[Change, ...]


def of_a_data_sheet(sheet: Viewer, friction: Sequence[str], faulty: Sequence[Recorded], size: Gap) -> Refit:
    """Return what fitting masses and friction to the recordings does to the gap of a data sheet, which knows no
    friction."""
    model = Model(sheet.model.machine, sheet.model.filters, tuple(friction))
    fitted = Viewer(model, fitted_tares(model, faulty))
    rows = [fitted.rows(each, ()) for each in faulty]
    before = np.zeros(len(model.parameters))
    names = [p.name for p in model.parameters]
    for parameter, value in zip(sheet.model.parameters, sheet.tares.tolist(), strict=True):
        before[names.index(parameter.name)] = value
    changes = _changes(model, before, fitted.tares, [each.base for each in rows])
    after = rms([each.left for each in rows])
    return Refit(size.fixed, after, _share(size.fixed, after, size.floor), changes)


def of_references(found: Found, faulty: Sequence[Seen], size: Gap) -> Refit:
    """Return what fitting the parameters to the recordings does to the gap against the references."""
    viewer, known = found.question.viewer, found.question.problem.known
    changed = viewer.tares + size.shift * known
    changes = _changes(viewer.model, viewer.tares, changed, [each.rows.base for each in faulty])
    return Refit(size.fixed, size.refit, _share(size.fixed, size.refit, size.floor), changes)


def is_likelier(found: Found, refit: Refit) -> bool:
    """Return whether other parameters than the references' are the likeliest explanation, and remove most of the gap.

    They compete as one more name with all hypotheses. Their prior is the data sheet's, so that many free parameters
    cost evidence: one effect that does the same is likelier.
    """
    told, case = found.asked, found.case
    if refit.share <= HALF or found.working:
        return False
    free = np.zeros(len(case.mean))
    free[: len(found.question.viewer.tares)] = 1.0  # variance of a parameter in units of its prior spread
    anew = replace(case, covariance=case.covariance + np.diag(free)).likeliest((), case.usual)
    names = {form.name for form in told.forms}
    prior = float(np.log((1.0 - IN_ORDER - ODD) / len(names)))
    others = [told.counts * (h.log - told.none.log) + told.prior_of(h) for h in told.hypotheses]
    others += [told.counts * (h.log - told.none.log) + told.prior_at_moments(h) for h in told.happened]
    return told.counts * (anew.log - told.none.log) + prior > max(others)


def _share(before: Array, after: Array, floor: Array) -> float:
    """Return the share of the energy beyond the floor that goes, every joint in units of its floor."""
    known = floor > 0.0
    excess, left = (float(np.mean((each[known] / floor[known]) ** 2)) - 1.0 for each in (before, after))
    return min(1.0 - left / excess, 1.0) if excess > 0.0 else 0.0


def _changes(model: Model, before: Array, after: Array, base: Sequence[Array]) -> tuple[Change, ...]:
    """Return all parameters, the one whose change makes most torque first; base: their columns (T, R, P)."""
    columns = np.concatenate([each[..., : len(before)] for each in base])
    torque = np.sqrt(np.nanmean(np.nansum((columns * (after - before)) ** 2, axis=1), axis=0))
    each = zip(model.parameters, before.tolist(), after.tolist(), torque.tolist(), strict=True)
    changes = [Change(p.name, p.unit, old, new, moved) for p, old, new, moved in each]
    return tuple(sorted(changes, key=lambda change: -change.torque))
