"""The gate of the weighing: which samples fit one hanging load, as far as friction and zeros are known."""

from math import inf
from typing import Any, NamedTuple

from cylforce.estimation.kernel.solving import Limits, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import REST_SECONDS

GATE = 9.0  # mean squared innovation in standard errors (3 squared), above which a sample does not fit the load; chosen
BREAK_AWAY = 3.0  # times the unknown friction at rest: break-away friction, for which the gate allows; chosen
COLD = 5.0  # times the drift's standard error, for which the gate allows; chosen
# The same before empty motion told of the drift, however uncertain it is: oil of 0 degC adds 2.5 to 12 times a viscous
# friction to it, of which 0.25 are expected (estimation/drift.py). With three standard errors (GATE) up to 7.5 times
# pass. A gate that kept such oil out would keep out the empty motion that tells of it, all day
FROST = 10.0
DRIFTED = 4.0  # times its variance, by which the gate at most allows for a drift not known yet; chosen: twice its error


class Gates(NamedTuple):
    """The kernel's solvers: at `first`, before empty motion told of the drift, and `later`."""

    first: Any
    later: Any


def gates(model: Model, tares: Tares, kernel: Any, memory: float) -> Gates:  # noqa: ANN401 - of either form
    """Those of a machine; `memory`: consecutive samples that count as an independent one."""
    patience = REST_SECONDS * model.filters.rate_hz

    def limited(cold: float, drifted: float) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return solver(model, tares, kernel, Limits(GATE, BREAK_AWAY, cold, drifted, memory, patience))

    return Gates(limited(FROST, inf), limited(COLD, DRIFTED))
