"""Input of the monitor from one step of the service."""

from typing import NamedTuple

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.service.adaptation import Drift
from cylforce.service.contact.interaction import Forces
from cylforce.service.loading.lift import Lift
from cylforce.service.pipeline import Instant, Pipe
from cylforce.service.plausibility.changing import NONE
from cylforce.signals.estimate import Quantity


class Samples(NamedTuple):
    """Input of the monitor: all signals (S,), filters, rows, torque `left` by the tares and the drift (R,)
    [N m], forces, the drift so far, gross weight [kg], the lift, signals that `leapt` and stayed there.

    weighed: whether a load is weighed now, whose force that of the soil does not contain
    came:    (S,) times [us] of the frames of all signals"""

    values: Numbers
    pipe: Pipe
    instant: Instant
    left: Numbers
    forces: Forces
    drift: Drift
    gross: Quantity
    lift: Lift
    leapt: tuple[int, ...] = ()
    weighed: bool = False
    came: Numbers = NONE
