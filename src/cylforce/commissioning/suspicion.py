"""All checks for which a recording of the empty machine is refused, in an order in which no error hides another. Before
a refusal is said, what it names is compared with every single correction of the machine file and of the wiring: the
sentence that is said is that of the better explanation."""

import numpy as np

from cylforce.commissioning import emptiness, wiring
from cylforce.commissioning.common_scale import common_scale
from cylforce.commissioning.explained import criterion, row_noise
from cylforce.commissioning.repairs import DECISIVE, SCALE, Case, Repair, repairs, typical_error
from cylforce.commissioning.wiring import SignalHistory, Suspicion
from cylforce.estimation.batch import Fit, least_squares
from cylforce.estimation.blocks import Factors, chosen, residual_squares
from cylforce.estimation.model import BARS, Model
from cylforce.estimation.observation import observed_factors
from cylforce.signals.estimate import Array


def doubt(model: Model, whole: Factors, evidence: SignalHistory) -> str | None:
    """One sentence that says what is wrong and what to do, or None. Found are: a frozen or exchanged sensor, an
    inertial sensor on another axis, a wrong piston area, contact of the tool, a load, a wrong scale of all pressures,
    and what is wrong in the machine file when one of these is suspected. `whole`: factors with the tool's columns last;
    `evidence`: the raw samples. The bars of a linkage are not free here: their weight would explain a wrong length
    (tests/test_unexplained.py)."""
    broken = wiring.frozen_pressure(model, evidence) or wiring.misplaced(model, evidence.kept)
    if broken is not None:
        return broken
    model, whole = without_bars(model, whole)
    data = chosen(whole, list(range(len(model.parameters))))
    noise = row_noise(data, model.prior)
    fit = least_squares(data, noise, model.prior)
    suspected = _suspected(model, whole, noise, fit, evidence)
    if suspected is None or suspected.cause == wiring.FROZEN:
        return None if suspected is None else suspected.sentence
    return compared(Case(model, evidence.kept), suspected)


def without_bars(model: Model, whole: Factors) -> tuple[Model, Factors]:
    """The model without the bars of its linkages, and the factors without their columns."""
    bare = model.with_laws(tuple(law for law in model.friction if law != BARS))
    kept = [k for k, p in enumerate(model.parameters) if p in bare.parameters]
    tool = range(len(model.parameters), whole.triangle.shape[-1] - 1)
    return bare, chosen(whole, [*kept, *tool])


def _suspected(model: Model, whole: Factors, noise: Array, fit: Fit, evidence: SignalHistory) -> Suspicion | None:
    data = chosen(whole, list(range(len(model.parameters))))
    left, found = wiring.misfit(data, fit.row_error), None
    if left > wiring.MISFIT:
        load = emptiness.hanging(model, data, noise, fit)
        # with a load that explains the misfit, exchanges are not tried: in a short recording many of them would fit
        explained = load.is_there and load.left < wiring.BETTER * left
        found = None if explained else wiring.miswired(model, evidence)
    return found or emptiness.not_empty(model, whole, noise, fit) or _misscaled(model, data, noise)


def _misscaled(model: Model, data: Factors, noise: Array) -> Suspicion | None:
    """All pressures too large or too small by one factor."""
    scale = common_scale(model, data, noise)
    return Suspicion(SCALE, scale.sentence) if scale.is_wrong else None


def compared(case: Case, suspected: Suspicion) -> str:
    """The sentence of the better explanation of `case`: of what is `suspected`, or of a correction with which the case
    is in order; both when neither is decisively better (`repairs.DECISIVE`)."""
    good = repairs(case, range(len(case.model.machine.cylinders)))
    others = tuple(repair for repair in good if repair.cause != suspected.cause)
    if not others:
        return suspected.sentence
    own = score_of_suspicion(case, suspected, good)
    if own < others[0].score - DECISIVE:
        return suspected.sentence
    words = f"the recording fits with {', or with '.join(repair.words for repair in others)}"
    return f"{words}: check that first" if own > others[0].score + DECISIVE else f"{suspected.sentence}; or {words}"


def score_of_suspicion(case: Case, suspected: Suspicion, good: tuple[Repair, ...]) -> float:
    """The criterion (`explained.criterion`) of what is suspected; infinite when it does not explain the case."""
    if suspected.cause == "load":
        return _score_with_load(case)
    if suspected.cause == "contact":
        return _score_with_contact(case)
    return min((repair.score for repair in good if repair.cause == suspected.cause), default=np.inf)


def _score_with_load(case: Case) -> float:
    model = case.model
    data = chosen(observed_factors(model, [case.values], noisy=False), list(range(len(model.parameters))))
    if not np.any(data.samples):
        return np.inf
    wider, prior = emptiness.with_load(model, data)
    found = least_squares(wider, typical_error(data), prior).values
    squares = np.sum(residual_squares(wider, found), axis=0)
    return criterion(model, wider, squares, found, len(found) - len(model.parameters))


def _score_with_contact(case: Case) -> float:
    """With a force at the tool in every block that shows contact."""
    model = case.model
    whole = observed_factors(model, [case.values], noisy=False)
    data = chosen(whole, list(range(len(model.parameters))))
    if not np.any(data.samples):
        return np.inf
    error = typical_error(data)
    found = emptiness.contact(model, whole, error, least_squares(data, error, model.prior))
    touched = found.certain | found.disturbed
    clear = Factors(*(part[~touched] for part in data))
    if not np.any(clear.samples):
        return np.inf
    values = least_squares(clear, error, model.prior).values
    squares = residual_squares(data, values)
    squares[touched] = emptiness.left_by_force(model, Factors(*(part[touched] for part in whole)), error, values)
    return criterion(model, data, np.sum(squares, axis=0), values, 2 * int(np.count_nonzero(touched)))
