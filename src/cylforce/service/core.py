"""Settings of a service and its tares, with all constants that are computed from them once."""

from collections.abc import Mapping

from cylforce.estimation.model import Model, Tares
from cylforce.mechanics.installation import STANDARD, Service
from cylforce.service.adaptation import DriftConstants
from cylforce.service.assembler import AssemblerConstants
from cylforce.service.booking import BookingConstants
from cylforce.service.contact.interaction import ForceConstants
from cylforce.service.contact.lateness import force_delay_s
from cylforce.service.contact.rocking import BaseConstants
from cylforce.service.pipeline import PipelineConstants
from cylforce.service.plausibility.detector import MonitoredMachine
from cylforce.service.publication import Encoders
from cylforce.service.published_values import GROSS, MAGNITUDE
from cylforce.service.recognition import RecognizerConstants
from cylforce.service.snapshot import Constants
from cylforce.service.weighing import LoadConstants

TICK_SLACK = 0.5  # periods by which a tick may be early or late


class Core(Constants):
    """Settings of a service and its tares, and the constants of all estimators.

    service:      settings of the machine file
    tares:        parameters of the empty machine
    attached:     tares with each other tool, by its name
    fitted:       the core with each tool, by its name
    model:        of the machine, whose parameters the tares are
    adapts:       whether friction and zeros are adapted. They are not with tares from the data sheet, whose errors the
                  adaptation would follow
    gross_limits: range of the published weight [kg]
    period_us:    fixed step [us]
    longest_step: largest time between two ticks [periods]; after a longer one the filters start again

    The other fields are the constants of one estimator each: of `inputs`, `pipeline`, `base`, `load`, `bookings`,
    `drift`, `recognizer`, `force` and `monitor` of `WeighingService`, and of the published TPDOs (`encoders`).
    """

    def __init__(self, service: Service, tares: Tares, attached: Mapping[str, Tares] | None = None) -> None:
        """Compute the constants of all estimators, and a core of its own for each other tool.

        service:  settings of the machine file: machine, filters, sensor nodes, published PDOs, health limits
        tares:    identified parameters of the empty machine with the standard tool, or those of the data sheet
        attached: tares with each other tool, by its name; None: there is no other tool. The core of another tool
                  contains in `fitted` itself alone, under the name of the standard tool
        """
        self.service, self.tares, self.attached = service, tares, attached or {}
        self.model = model = Model(service.machine, service.filters, tares.friction)
        self.adapts = service.adapt and tares.identified
        # each published field and its period [s], by the name of the value
        fields = {str(f.signal): (f, pdo.period_s) for pdo in service.publication for f in pdo.fields}
        gross, _ = fields[GROSS]
        self.gross_limits = (gross.low, gross.high)
        magnitude, force_period_s = fields[MAGNITUDE]  # the largest force that can be published is the rated one
        self.period_us = round(1e6 / service.filters.rate_hz)
        self.longest_step = service.health.max_step_s * service.filters.rate_hz + TICK_SLACK
        self.inputs = AssemblerConstants(service)
        self.pipeline = PipelineConstants(model, service.health.max_tilt)
        self.base = BaseConstants(model, tares)
        self.load = LoadConstants(model, tares)
        self.bookings = BookingConstants(tares, service.machine.rated_payload, service.filters.rate_hz)
        # without adaptation the drift has the spread between strokes; with it that from day to day, as of cold oil
        self.drift = DriftConstants(model, tares, None if self.adapts else tares.between_strokes)
        self.recognizer = RecognizerConstants(model, tares)
        self.force = ForceConstants(model, tares, magnitude.high, force_delay_s(service.filters, force_period_s))
        self.monitor = MonitoredMachine(model, tares, magnitude.high)
        self.encoders = Encoders(service.publication)
        # no cached property: it would make the look-up of every other field slower
        others = {name: Core(service.fitted(name), own_tares) for name, own_tares in self.attached.items()}
        self.fitted: dict[str, Core] = {STANDARD: self, **others}
