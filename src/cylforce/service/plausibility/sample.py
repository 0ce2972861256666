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
    """One step as the detectors see it.

    values:   (S,) of all signals [SI]
    arrivals: (S,) times of the frames that the values are of [us]; empty: not known
    leapt:    numbers of the signals that leapt and stayed there
    pipeline: filters
    instant:  rows of this step
    residual: (R,) residual torque of tares and drift [N m]
    forces:   at the tool
    drift:    so far
    gross:    weight less zero [kg]
    lift:     the present one
    weighed:  whether a load is weighed now, whose force that of the soil does not contain
    """

    values: Numbers
    arrivals: Numbers
    leapt: tuple[int, ...]
    pipeline: Pipeline
    instant: Instant
    residual: Numbers
    forces: Forces
    drift: DriftFilter
    gross: Quantity
    lift: Lift
    weighed: bool
