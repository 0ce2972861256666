"""Input of the monitor from one step of the service."""

from dataclasses import dataclass

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.service.adaptation import DriftFilter
from cylforce.service.contact.interaction import Forces
from cylforce.service.loading.lift import Lift
from cylforce.service.pipeline import Instant, Pipeline
from cylforce.signals.estimate import Quantity


@dataclass(slots=True)
class MonitorSample:
    """Input of the detectors from one step.

    values:   (S,) of all signals [SI]
    arrivals: (S,) receive times of the frames that carried the values [us]; empty: not known
    stepped:  numbers of the signals that have stepped
    pipeline: filters
    instant:  rows of this step
    residual: (R,) residual torque after tares and drift [N m]
    forces:   at the tool
    drift:    present drift of friction and zeros
    gross:    weight less zero [kg]
    lift:     present lift
    weighed:  whether a load is weighed now and its force is subtracted in the soil force
    """

    values: Numbers
    arrivals: Numbers
    stepped: tuple[int, ...]
    pipeline: Pipeline
    instant: Instant
    residual: Numbers
    forces: Forces
    drift: DriftFilter
    gross: Quantity
    lift: Lift
    weighed: bool
