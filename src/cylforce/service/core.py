"""The settings of a service and its tares, with everything that is computed from them once."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from cylforce.estimation.model import Model, Tares
from cylforce.mechanics.installation import STANDARD, Service
from cylforce.service.adaptation import Adapter
from cylforce.service.assembler import Assembler
from cylforce.service.booking import NONE_MISSED, Books, Missed, unseen
from cylforce.service.contact.interaction import Interactor
from cylforce.service.contact.lateness import force_delay_s
from cylforce.service.contact.rocking import Rocker
from cylforce.service.pipeline import Pipeline
from cylforce.service.plausibility.monitor import Monitor
from cylforce.service.publication import MAGNITUDE, Encoders
from cylforce.service.recognition import Recognizer
from cylforce.service.state import NOTHING_KEPT, Memory, State
from cylforce.service.weighing import Weigher
from cylforce.signals.estimate import Reason, no_estimate
from cylforce.signals.quick import once

TICK_SLACK = 0.5  # periods by which a tick may be early or late


@dataclass(frozen=True)
class Core:
    """The settings of a service and its tares, and the parts of the calculation made from them."""

    service: Service
    tares: Tares
    attached: Mapping[str, Tares] = field(default_factory=dict)  # the tares with each other tool
    model: Model = field(init=False, repr=False, compare=False)  # whose parameters the tares are
    assembler: Assembler = field(init=False, repr=False, compare=False)  # frames to samples
    heard: frozenset[int] = field(init=False, repr=False, compare=False)  # identifiers of the sensors' PDOs
    pipeline: Pipeline = field(init=False, repr=False, compare=False)  # samples to rows
    weigher: Weigher = field(init=False, repr=False, compare=False)  # rows to weight
    rocker: Rocker = field(init=False, repr=False, compare=False)  # rows to how a base without inertial sensor moves
    recognizer: Recognizer = field(init=False, repr=False, compare=False)  # rows to whether it is this machine

    def __post_init__(self) -> None:
        """The parts that are asked in every step: a field is looked up several times as fast as a property."""
        model, assembler = (
            Model(self.service.machine, self.service.filters, self.tares.friction),
            Assembler(self.service),
        )
        parts: dict[str, object] = {"model": model, "assembler": assembler, "heard": frozenset(assembler.decoders)}
        parts |= {"pipeline": Pipeline(model, self.service.health.max_tilt), "weigher": Weigher(model, self.tares)}
        parts |= {"rocker": Rocker(model, self.tares), "recognizer": Recognizer(model, self.tares)}
        for name, part in parts.items():
            object.__setattr__(self, name, part)

    @once
    def fitted(self) -> dict[str, "Core"]:
        """The core with each tool, by its name."""
        others = {name: Core(self.service.fitted(name), tares) for name, tares in self.attached.items()}
        return {STANDARD: self, **others}

    @once
    def adapter(self) -> Adapter:
        """Rows with an empty bucket to drift. Without adaptation strokes differ as they did at commissioning; with it
        friction may follow the oil much farther."""
        return Adapter(self.model, self.tares, None if self.adapts else self.tares.between_strokes)

    @once
    def interactor(self) -> Interactor:
        """Rows of an instant to forces and events."""
        delay_s = force_delay_s(self.service.filters, self._force_period_s)
        return Interactor(self.model, self.tares, self.limits[MAGNITUDE][1], delay_s)

    @once
    def _force_period_s(self) -> float:
        """Time between two messages with the force [s]."""
        return next(p.period_s for p in self.service.publication for f in p.fields if f.signal == MAGNITUDE)

    @once
    def monitor(self) -> Monitor:
        """Samples and rows to whether the sensors agree."""
        return Monitor(self.model, self.tares, self.limits[MAGNITUDE][1])

    @once
    def limits(self) -> dict[str, tuple[float, float]]:
        """The declared range of every published value."""
        return {str(f.signal): (f.low, f.high) for p in self.service.publication for f in p.fields}

    @once
    def encoders(self) -> Encoders:
        """What encodes our TPDOs."""
        return Encoders(self.service.publication)

    @once
    def adapts(self) -> bool:
        """Whether friction and zeros are adapted. Not for tares from the data sheet: the adaptation would follow their
        errors."""
        return self.service.adapt and self.tares.identified

    @once
    def longest_step(self) -> float:
        """Largest time between two ticks [periods]; after a longer one the filters start again."""
        return self.service.health.max_step_s * self.service.filters.rate_hz + TICK_SLACK

    @once
    def period_us(self) -> int:
        """The fixed step [us]."""
        return round(1e6 / self.service.filters.rate_hz)

    def begin(self, kept: Memory = NOTHING_KEPT) -> State:
        """The state of a service before any event, with what was kept from before the restart. A tool that is no longer
        known is the standard one again."""
        if kept.tool not in (STANDARD, *self.attached):
            kept = kept._replace(tool=STANDARD)
        return self.fitted[kept.tool].begin_fitted(kept)

    def begin_fitted(self, kept: Memory) -> State:
        """As `begin`, with this core's tool."""
        nothing = no_estimate(0, Reason.STARTING, kept.booking)
        inputs, known = self.assembler.begin(), self.recognizer.begin()
        drift, contact = self.adapter.begin(), self.interactor.begin()
        weighing = self.weigher.begin()
        hanging, sizes = kept.hanging, (len(self.tares.values), drift.values.size)
        if hanging is not None and (hanging.gain.size, hanging.drifted.size) != sizes:
            hanging, kept = None, kept.emptied()  # it was weighed with other tares
        missed = Missed(1, kept.lost, interrupted=True) if kept.lost else NONE_MISSED
        remembered = hanging is not None
        books = Books(None, hanging, None, kept.booking, missed, remembered, unconfirmed=kept.unconfirmed)
        weighing = weighing._replace(books=books)
        watch = self.monitor.begin()
        still = self.assembler.still
        state = State(inputs, None, weighing, drift, kept.scale, 0, nothing, still, known, contact, watch, kept.truck)
        return state._replace(tool=kept.tool)

    def continued(self, state: State, unconfirmed: bool | None = None) -> State:
        """The state of a service with other tares, with these from now on (`unconfirmed` or not; None: as before):
        estimators start anew, as after a restart. A load that hangs was weighed with the others and is not booked.
        Sensors, the operator's settings, NMT's order and a signal that was rejected stay."""
        begun = self.begin(state.memory._replace(hanging=None))
        books = unseen(state.weighing.books)._replace(probable=None)
        if unconfirmed is not None:
            books = books._replace(unconfirmed=unconfirmed)
        nothing = no_estimate(state.estimate.t_us, Reason.STARTING, books.booking, state.estimate.events)
        suspicion = state.watch.suspicion if state.watch.suspicion.stays else begun.watch.suspicion
        return begun._replace(
            inputs=state.inputs,
            frames=state.frames,
            weighing=begun.weighing._replace(books=books),
            estimate=nothing,
            watch=begun.watch._replace(suspicion=suspicion),
            cycle=state.cycle,
            ended=state.ended,
            stopped=state.stopped,
        )
