"""Everything for which a recording of the empty machine is refused, in the order in which one error hides another."""

from cylforce.commissioning import emptiness, wiring
from cylforce.commissioning.wiring import SignalHistory
from cylforce.estimation.batch import Fit
from cylforce.estimation.blocks import Factors, chosen
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array


def doubt(model: Model, whole: Factors, noise: Array, fit: Fit, evidence: SignalHistory) -> str | None:
    """A sentence that says what is wrong and what to do, or None: a dead or misplaced sensor, a wrong piston area, a
    touching tool, a load. `whole`: factors, the tool's columns last; `noise` (R,) and `fit` of the model's columns."""
    sentence = wiring.frozen_pressure(model, evidence)
    data = chosen(whole, list(range(len(model.parameters))))
    left = wiring.misfit(data, fit.row_error)
    if sentence is None and left > wiring.MISFIT:
        load = emptiness.hanging(model, data, noise, fit)
        explained = load.is_there and load.left < wiring.BETTER * left  # a short recording fits by many exchanges
        sentence = None if explained else wiring.miswired(model, evidence)
    return sentence or emptiness.not_empty(model, whole, noise, fit)
