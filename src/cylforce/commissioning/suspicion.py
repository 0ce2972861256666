"""Checks for which a recording of the empty machine is refused, in an order in which no error hides another.

Before a recording is refused, the suspected cause is compared with every single correction of the machine file and of
the wiring. The refusal names the better explanation.
"""

import numpy as np

from cylforce.commissioning import emptiness, wiring
from cylforce.commissioning.common_scale import common_scale
from cylforce.commissioning.explained import criterion, row_noise
from cylforce.commissioning.repairs import DECISIVE, SCALE, Case, Repair, repairs, typical_error
from cylforce.commissioning.wiring import SignalHistory, Suspicion
from cylforce.estimation.batch import Fit, converged, least_squares
from cylforce.estimation.blocks import Factors, chosen, residual_squares
from cylforce.estimation.model import BARS, Model
from cylforce.estimation.observation import observed_factors
from cylforce.signals.estimate import Array


def refusal_sentence(model: Model, whole: Factors, evidence: SignalHistory) -> str | None:
    """Return one sentence with the fault and its cure; None for a healthy, empty machine.

    It detects a frozen or exchanged sensor, an inertial sensor on another axis, a wrong piston area, contact of the
    tool, a load, and a wrong scale of all pressures. When one of these is suspected, errors of the machine file are
    tested, too. The bars of a linkage are not free parameters here: their weight would explain a wrong length
    (tests/commissioning/test_unexplained_torque.py).

    whole: factors of the P parameters, and after them of the tool (`Model.tool`)
    evidence: history of the raw signals
    """
    sensor_fault = wiring.frozen_pressure(model, evidence) or wiring.misplaced_inertial_sensor(model, evidence.kept)
    if sensor_fault is not None:
        return sensor_fault
    model, whole = without_bars(model, whole)
    data = chosen(whole, list(range(len(model.parameters))))
    noise = row_noise(data, model.prior)
    fit = least_squares(data, noise, model.prior)
    suspected = _suspected(model, whole, noise, fit, evidence)
    if suspected is None or suspected.cause == wiring.FROZEN:
        return None if suspected is None else suspected.sentence
    return better_explanation(Case(model, evidence.kept), suspected)


def without_bars(model: Model, whole: Factors) -> tuple[Model, Factors]:
    """Return the model without the bars of its linkages, and the factors without their columns.

    whole: factors of the P parameters, and after them of further columns, which are kept
    """
    bare = model.with_laws(tuple(law for law in model.friction if law != BARS))
    kept = [k for k, p in enumerate(model.parameters) if p in bare.parameters]
    tool = range(len(model.parameters), whole.triangle.shape[-1] - 1)
    return bare, chosen(whole, [*kept, *tool])


def _suspected(model: Model, whole: Factors, noise: Array, fit: Fit, evidence: SignalHistory) -> Suspicion | None:
    """Return the first cause that the checks suspect: wiring, then load, contact and piston area, then the scale.

    whole: factors of the P parameters, and after them of the tool (`Model.tool`)
    noise: (R,) rms residual of each torque fitted alone [N m]
    fit: fit of the model's columns alone
    evidence: history of the raw signals
    """
    data = chosen(whole, list(range(len(model.parameters))))
    misfit, fault = wiring.misfit(data, fit.row_error), None
    if misfit > wiring.MISFIT:
        load = emptiness.carried_weight(model, data, noise, fit)
        # with a load that explains the misfit, exchanges are not tried: in a short recording many of them would fit
        explained = load.is_significant and load.unexplained < wiring.BETTER * misfit
        fault = None if explained else wiring.wiring_fault(model, evidence)
    return fault or emptiness.load_or_contact(model, whole, noise, fit) or _misscaled(model, data, noise)


def _misscaled(model: Model, data: Factors, noise: Array) -> Suspicion | None:
    """Return a suspicion when all pressures are too large or too small by one factor, else None.

    data: factors of the empty machine
    noise: (R,) standard error of each measured torque [N m]
    """
    scale = common_scale(model, data, noise)
    return Suspicion(SCALE, scale.sentence) if scale.is_wrong else None


def better_explanation(case: Case, suspected: Suspicion) -> str:
    """Return the sentence of the better explanation of a case; both when neither is decisively better (DECISIVE).

    One explanation is the suspicion, the other a correction with which the case is healthy.
    """
    good = repairs(case, range(len(case.model.machine.cylinders)))
    others = tuple(repair for repair in good if repair.cause != suspected.cause)
    if not others:
        return suspected.sentence
    return better_sentence(suspected, suspicion_score(case, suspected, good), others)


def better_sentence(suspected: Suspicion, score: float, others: tuple[Repair, ...]) -> str:
    """Return the sentence of the better explanation; both when neither is decisively better (DECISIVE).

    score:  information criterion of the suspicion (`explained.criterion`); the smaller, the better
    others: corrections with which the recording fits, the best one first
    """
    if score < others[0].score - DECISIVE:
        return suspected.sentence
    words = f"the recording fits with {', or with '.join(repair.words for repair in others)}"
    return f"{words}: check that first" if score > others[0].score + DECISIVE else f"{suspected.sentence}; or {words}"


def suspicion_score(case: Case, suspected: Suspicion, good: tuple[Repair, ...]) -> float:
    """Return the information criterion of a suspicion; infinite when it does not explain the case.

    The smaller the criterion (`explained.criterion`), the better the explanation.

    good: corrections with which the case is healthy, among them that of the suspected cause
    """
    if suspected.cause == "load":
        return _score_with_load(case)
    if suspected.cause == "contact":
        return _score_with_contact(case)
    return min((repair.score for repair in good if repair.cause == suspected.cause), default=np.inf)


def _score_with_load(case: Case) -> float:
    """Return the information criterion (`explained.criterion`) of a fit with a load of free mass, moments and inertia.

    It is infinite without a usable sample.
    """
    model = case.model
    data = chosen(observed_factors(model, [case.values], noisy=False), list(range(len(model.parameters))))
    if not np.any(data.samples):
        return np.inf
    wider, prior = emptiness.with_load(model, data)
    values = converged(wider, typical_error(data), prior).values
    squares = np.sum(residual_squares(wider, values), axis=0)
    return criterion(model, wider, squares, values, len(values) - len(model.parameters))


def _score_with_contact(case: Case) -> float:
    """Return the information criterion of a fit with a free force at the tool in every block that shows contact.

    The parameters are fitted to the other blocks; without a usable sample there the criterion is infinite. Each such
    force adds two parameters to it.
    """
    model = case.model
    whole = observed_factors(model, [case.values], noisy=False)
    data = chosen(whole, list(range(len(model.parameters))))
    if not np.any(data.samples):
        return np.inf
    error = typical_error(data)
    contact = emptiness.contact(model, whole, error, least_squares(data, error, model.prior))
    touched = contact.certain | contact.disturbed
    clear = Factors(*(part[~touched] for part in data))
    if not np.any(clear.samples):
        return np.inf
    values = converged(clear, error, model.prior).values
    squares = residual_squares(data, values)
    squares[touched] = emptiness.residual_with_tip_force(
        model, Factors(*(part[touched] for part in whole)), error, values
    )
    return criterion(model, data, np.sum(squares, axis=0), values, 2 * int(np.count_nonzero(touched)))
