"""The whole service as one pure function of events: step(state, event) -> (state, output)."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from cylforce.estimation.model import EXPECTED, Model, Tares
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import Residual, residual
from cylforce.mechanics.installation import Service
from cylforce.service import commands
from cylforce.service.adaptation import Adapter, Drift
from cylforce.service.assembler import Assembler
from cylforce.service.contact.interaction import Forces, Interactor
from cylforce.service.loading.cycle import Cycle, advanced
from cylforce.service.loading.truck import loaded, refined
from cylforce.service.pipeline import Pipe, Pipeline
from cylforce.service.publication import GROSS, MAGNITUDE, frames
from cylforce.service.recognition import Recognizer
from cylforce.service.state import NOTHING, NOTHING_KEPT, Memory, Output, Scale, State
from cylforce.service.weighing import Weigher
from cylforce.signals.estimate import (
    Array,
    Booking,
    Estimate,
    Load,
    Reason,
    Sample,
    degraded,
    each_component,
    held_estimate,
    is_new,
    less,
    no_estimate,
    within,
)
from cylforce.signals.events import Event, Frame, Tick
from cylforce.signals.kinds import Kind

MOVING = 0.005  # m/s of a cylinder, from which on it counts as moving; chosen
LONG_FRAME_US = 1_000_000  # us for which estimates are DEGRADED after a frame longer than its mapping; chosen
TICK_SLACK = 0.5  # periods by which a tick may be early or late


@dataclass(frozen=True)
class Core:
    """The settings of a service and its tares, and the parts of the calculation made from them."""

    service: Service
    tares: Tares

    @cached_property
    def model(self) -> Model:
        """The model whose parameters the tares are."""
        return Model(self.service.machine, self.service.filters, self.tares.friction)

    @cached_property
    def assembler(self) -> Assembler:
        """Frames to samples."""
        return Assembler(self.service)

    @cached_property
    def pipeline(self) -> Pipeline:
        """Samples to rows."""
        return Pipeline(self.model)

    @cached_property
    def weigher(self) -> Weigher:
        """Rows to weight."""
        return Weigher(self.model, self.tares)

    @cached_property
    def adapter(self) -> Adapter:
        """Rows with an empty bucket to drift. Without adaptation strokes differ as they did at commissioning; with it
        friction may follow the oil much farther."""
        return Adapter(self.model, self.tares, EXPECTED if self.adapts else self.tares.between_strokes)

    @cached_property
    def recognizer(self) -> Recognizer:
        """Rows to whether this is the machine that was identified."""
        return Recognizer(self.model, self.tares)

    @cached_property
    def interactor(self) -> Interactor:
        """Rows of an instant to forces and events."""
        return Interactor(self.model, self.tares, self.limits[MAGNITUDE][1])

    @cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """The declared range of every published value."""
        return {str(f.signal): (f.low, f.high) for p in self.service.publication for f in p.fields}

    @cached_property
    def tilts(self) -> tuple[int, ...]:
        """Numbers of the signals that measure the tilt of the chassis."""
        return tuple(k for k, s in enumerate(self.service.machine.signals) if s.kind in (Kind.PITCH, Kind.ROLL))

    @cached_property
    def moved_by(self) -> tuple[int | None, ...]:
        """Per signal the number of the cylinder whose motion changes it; None: that of any cylinder."""
        return tuple(s.index if s.kind in PRESSURES else None for s in self.service.machine.signals)

    @cached_property
    def adapts(self) -> bool:
        """Whether friction and zeros are adapted. Not for tares from the data sheet: the adaptation would follow their
        errors."""
        return self.service.adapt and self.tares.identified

    @cached_property
    def longest_step(self) -> float:
        """Largest time between two ticks [periods]; after a longer one the filters start again."""
        return self.service.health.max_step_s * self.service.filters.rate_hz + TICK_SLACK

    @cached_property
    def period_us(self) -> int:
        """The fixed step [us]."""
        return round(1e6 / self.service.filters.rate_hz)

    def begin(self, kept: Memory = NOTHING_KEPT) -> State:
        """The state of a service before any event, with what was kept from before the restart."""
        nothing = no_estimate(0, Reason.STARTING, kept.booking)
        still = (False,) * len(self.service.machine.signals)
        inputs, known = self.assembler.begin(), self.recognizer.begin()
        drift, contact = self.adapter.begin(), self.interactor.begin()
        weighing = self.weigher.begin()
        weighing = weighing._replace(books=weighing.books._replace(booking=kept.booking))
        return State(inputs, None, weighing, drift, kept.scale, 0, nothing, still, known, contact, kept.truck)


def step(core: Core, state: State, event: Event) -> tuple[State, Output]:
    """The service: from one event the new state and the output to be sent. Does not raise for any frame."""
    if isinstance(event, Tick):
        state = _tick(core, state, event.t_us)
        return state, Output(None, state.estimate, frames(core.service.publication, state.estimate))
    obeyed = None if event.can_id in core.assembler.decoders else _obey(core, state, event)
    if obeyed is not None:
        return obeyed
    return State(core.assembler.receive(state.inputs, event, state.moving), *state[1:]), NOTHING


def _obey(core: Core, state: State, frame: Frame) -> tuple[State, Output] | None:
    """State and output after an operator's or NMT command or a boot-up message; None for any other frame."""
    stopped = commands.stopped(frame, core.service.node_id)
    if stopped is not None:
        return state._replace(stopped=stopped), NOTHING
    command = commands.read(frame, core.service.node_id)
    if command is not None and not state.stopped:
        return _commanded(core, state, command)
    booted = commands.booted(frame)
    if booted is not None:
        return state._replace(inputs=core.assembler.restart(state.inputs, booted)), NOTHING
    return None


def _commanded(core: Core, state: State, command: commands.Command | commands.LoadingCommand) -> tuple[State, Output]:
    if isinstance(command, commands.LoadingCommand):
        truck, verdict, words = commands.obey_loading(command, state.truck)
        return state._replace(truck=truck), Output(verdict, words=words)
    rated = core.service.machine.rated_payload
    scale, verdict, words = commands.obey(command, state.scale, state.estimate.load.mass, rated)
    return state._replace(scale=Scale(*scale)), Output(verdict, words=words)


def _tick(core: Core, state: State, t_us: int) -> State:
    """The state after a tick: sample, channels, filtered rows, load and force; or an estimate with the reason why there
    are none."""
    sample = core.assembler.sample(state.inputs, t_us)
    if sample.late is not Reason.NONE and state.pipe is not None and not any(sample.reasons):
        return state._replace(estimate=held_estimate(state.estimate, t_us, sample.late))
    channels = _channels(core, sample)
    if isinstance(channels, Reason):
        return _lose(core, state, t_us, channels)
    periods = (t_us - state.sampled_us) / core.period_us
    if state.pipe is None or not TICK_SLACK < periods < core.longest_step:
        reason = Reason.STARTING if state.pipe is None else Reason.TIME_JUMP
        return _lose(core, state, t_us, reason)._replace(pipe=core.pipeline.begin(channels), sampled_us=t_us)
    pipe, rows, instant = core.pipeline.advance(state.pipe, channels, round(periods))
    moving = _moving(core, pipe)
    if pipe.steps <= core.model.settle_steps:
        nothing = _nothing(state, t_us, Reason.STARTING)
        return state._replace(pipe=pipe, sampled_us=t_us, moving=moving, estimate=nothing)
    usable = pipe.waiting == 0
    drifting = core.adapter.columns(rows)
    left = residual(core.model, core.tares, rows, drifting @ state.drift.values)
    weighing, load = core.weigher.step(state.weighing, left, usable, t_us, state.drift, drifting)
    drifted = core.adapter.columns(instant.rows) @ state.drift.values
    weighed = (weighing, load)
    interaction, forces = core.interactor.step(state.interaction, instant, drifted, usable, weighed, t_us)
    drift = _drift(core, state.drift, load, rows, left, usable)
    recognition = core.recognizer.step(state.recognition, rows, left, usable)
    before = state.weighing.books.booking
    state = state._replace(
        pipe=pipe,
        sampled_us=t_us,
        moving=moving,
        weighing=weighing,
        drift=drift,
        recognition=recognition,
        interaction=interaction,
    )
    return _booked(state._replace(estimate=_estimate(core, state, load, forces, t_us)), before)


def _booked(state: State, before: Booking | None) -> State:
    """The state with the working cycle advanced; with a new booking it ends, and the truck has one more bucket, whose
    mass follows the booking while that becomes more precise."""
    cycle, booking = advanced(state.cycle, state.estimate), state.weighing.books.booking
    if booking is None or booking is before:
        return state._replace(cycle=cycle)
    if before is not None and not is_new(booking, before):
        truck = refined(state.truck, booking.number, booking.dumped - before.dumped)
        return state._replace(cycle=cycle, truck=truck)
    truck = loaded(state.truck, booking, state.scale.tare)
    return state._replace(truck=truck, ended=cycle, cycle=Cycle(state.estimate.t_us))


def _channels(core: Core, sample: Sample) -> Array | Reason:
    """Joint angles, cylinder forces and attitude (D,) of a sample; or the reason why it is not usable."""
    worst = max(sample.reasons, default=Reason.NONE)
    if worst is not Reason.NONE:
        return worst
    if _tilted(core, sample):
        return Reason.TILT
    channels = core.model.channels.read(sample.values)
    return channels if np.isfinite(channels).all() else Reason.END_STOP


def _lose(core: Core, state: State, t_us: int, reason: Reason) -> State:
    """The state after an interruption: filters and lift start again, no value is shown. At an end stop the bucket is
    still watched."""
    weighing = core.weigher.interrupt(state.weighing)
    if reason is Reason.END_STOP:
        weighing = weighing._replace(seen_us=t_us)
    return state._replace(
        pipe=None,
        moving=(False,) * len(state.moving),
        weighing=weighing,
        recognition=core.recognizer.interrupt(state.recognition),
        interaction=core.interactor.interrupt(state.interaction),
        estimate=_nothing(state, t_us, reason),
    )


def _nothing(state: State, t_us: int, reason: Reason) -> Estimate:
    """No value, and why; the last booking and events stay."""
    return no_estimate(t_us, reason, state.estimate.booking, state.estimate.events)


def _drift(core: Core, drift: Drift, load: Load, rows: Rows, left: Residual, usable: Array) -> Drift:
    """The drift of friction and zeros after this instant; it changes only while the bucket is known to be empty."""
    if not core.adapts:
        return drift
    if not core.weigher.is_empty(load):
        return core.adapter.loaded(drift)
    return core.adapter.step(drift, rows, left.torque, np.where(usable, left.variance, np.inf))


def _estimate(core: Core, state: State, load: Load, forces: Forces, t_us: int) -> Estimate:
    """The published estimate: load, load less zero (gross), less tare (net), and forces. OK becomes DEGRADED for
    LONG_FRAME_US after a frame longer than its mapping, and while another machine is seen; gross and net are INVALID
    outside their declared range."""
    for reason in _doubts(core, state, t_us):
        load = Load(*(degraded(q, reason) for q in load))
        forces = Forces(*(each_component(force, partial(degraded, reason=reason)) for force in forces))
    rated = core.service.machine.rated_payload
    gross = within(less(load.mass, state.scale.zero), core.limits[GROSS], rated)
    net = within(less(gross, state.scale.tare), core.limits[GROSS], rated)
    events = state.interaction.contact.events
    return Estimate(t_us, load, gross, net, forces.resultant, state.weighing.books.booking, forces.soil, events)


def _moving(core: Core, pipe: Pipe) -> tuple[bool, ...]:
    """Per signal whether it should change, so that a repeated value means a frozen sensor: a pressure while its own
    cylinder moves, any other signal while any cylinder moves, because the whole machine then shakes."""
    moves = (np.abs(pipe.speed) > MOVING).tolist()
    shaken = any(moves)
    return tuple([shaken if c is None else moves[c] for c in core.moved_by])


PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)


def _tilted(core: Core, sample: Sample) -> bool:
    limit = core.service.health.max_tilt
    return any(abs(sample.values[k]) > limit for k in core.tilts)


def _doubts(core: Core, state: State, t_us: int) -> Iterator[Reason]:
    """Why nothing that is published now is OK."""
    if state.recognition.another and core.tares.identified:
        yield Reason.NOT_THIS_MACHINE
    if abs(t_us - state.inputs.long_t_us) < LONG_FRAME_US:
        yield Reason.LONG_FRAME
