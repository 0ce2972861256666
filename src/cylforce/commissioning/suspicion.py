"""All checks for which a recording of the empty machine is refused, in an order in which no error hides another."""

from cylforce.commissioning import emptiness, wiring
from cylforce.commissioning.wiring import SignalHistory
from cylforce.estimation.batch import Fit
from cylforce.estimation.blocks import Factors, chosen
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array


def doubt(model: Model, whole: Factors, noise: Array, fit: Fit, evidence: SignalHistory) -> str | None:
    """One sentence that says what is wrong and what to do, or None. Found are: a frozen or exchanged sensor, a wrong
    piston area, contact of the tool, a load. `whole`: factors with the tool's columns last; `noise` (R,) [N m] and
    `fit`: of the model's columns alone; `evidence`: the raw samples."""
    sentence = wiring.frozen_pressure(model, evidence)
    data = chosen(whole, list(range(len(model.parameters))))
    left = wiring.misfit(data, fit.row_error)
    if sentence is None and left > wiring.MISFIT:
        load = emptiness.hanging(model, data, noise, fit)
        # with a load that explains the misfit, exchanges are not tried: in a short recording many of them would fit
        explained = load.is_there and load.left < wiring.BETTER * left
        sentence = None if explained else wiring.miswired(model, evidence)
    return sentence or emptiness.not_empty(model, whole, noise, fit)
