"""The whole service as one pure function of events: step(state, event) -> (state, output)."""

from functools import partial
from math import hypot

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.service import commands
from cylforce.service.adaptation import Drift
from cylforce.service.booking import Beside, unseen
from cylforce.service.contact.interaction import Forces
from cylforce.service.core import TICK_SLACK, Core
from cylforce.service.loading.cycle import Cycle, advanced
from cylforce.service.loading.truck import loaded, refined
from cylforce.service.pipeline import Unexplained
from cylforce.service.plausibility.monitor import Watch
from cylforce.service.plausibility.samples import Samples
from cylforce.service.plausibility.suspicion import Level
from cylforce.service.plausibility.unnoticed import Unnoticed
from cylforce.service.publication import GROSS
from cylforce.service.state import NOTHING, Output, Scale, State
from cylforce.service.weighing import Weighing
from cylforce.signals.estimate import (
    Booking,
    Estimate,
    Load,
    Quantity,
    Reason,
    Sample,
    Status,
    degraded,
    each_component,
    held_estimate,
    invalid_force,
    invalid_load,
    is_new,
    less,
    no_estimate,
    within,
)
from cylforce.signals.events import Event, Frame
from cylforce.signals.quick import new

__all__ = ["Core", "judged", "step"]

MOST_FRAMES = 64  # that wait for a tick, so that memory and time stay bounded without one; chosen
LONG_FRAME_US = 1_000_000  # us for which estimates are DEGRADED after a frame longer than its mapping; chosen

# a member of an enumeration takes longer to look up than a name
FINE, DOUBTED, REJECTED = Level.FINE, Level.DOUBTED, Level.REJECTED
INVALID, NONE = Status.INVALID, Reason.NONE


def step(core: Core, state: State, event: Event) -> tuple[State, Output]:
    """The service: from one event the new state and the output to be sent. Does not raise for any frame."""
    if not isinstance(event, Frame):
        state = _tick(core.fitted[state.tool], state, event.t_us)
        return state, new(Output, (None, state.estimate, core.encoders, ""))
    if event.can_id not in core.heard:
        obeyed = _obey(core, state, event)
        if obeyed is not None:
            return obeyed
    frames = state.frames + (event,)  # noqa: RUF005 - for every frame: a sum of tuples is quicker
    state = new(State, state[:-1] + (frames,))  # noqa: RUF005
    return state if len(frames) < MOST_FRAMES else judged(core, state), NOTHING


def judged(core: Core, state: State) -> State:
    """The state with the frames that have come since the last tick judged."""
    inputs = core.assembler.receive(state.inputs, state.frames, state.moving)
    return state._replace(inputs=inputs, frames=())


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
        state = judged(core, state)
        return state._replace(inputs=core.assembler.restart(state.inputs, booted)), NOTHING
    return None


def _commanded(core: Core, state: State, command: commands.AnyCommand) -> tuple[State, Output]:
    if isinstance(command, commands.ToolCommand):
        return _with_tool(core, state, command.number)
    if isinstance(command, commands.LoadingCommand) and command.sub == commands.ADD:
        return _by_hand(state, command.data)
    if isinstance(command, commands.LoadingCommand):
        truck, verdict, words = commands.obey_loading(command, state.truck)
        return state._replace(truck=truck), Output(verdict, words=words)
    rated = core.fitted[state.tool].service.machine.rated_payload
    scale, verdict, words = commands.obey(command, state.scale, state.estimate.load.mass, rated)
    return state._replace(scale=Scale(*scale)), Output(verdict, words=words)


def _by_hand(state: State, data: bytes) -> tuple[State, Output]:
    """The state with a bucket that was not weighed. A booking that was still becoming more precise is left as it is."""
    books = state.weighing.books
    made, (truck, verdict, words) = commands.added(data, books.booking, state.estimate.t_us, state.truck)
    if made is not None:
        weighing = state.weighing._replace(books=books._replace(booking=made, dumped=None))
        state = state._replace(weighing=weighing, truck=truck)
    return state, Output(verdict, words=words)


def _with_tool(core: Core, state: State, number: int) -> tuple[State, Output]:
    """The state with another tool: the weighing begins anew, zero and tare are 0. Friction and pressure zeros are the
    arm's, so the drift stays. A load that hangs is not booked."""
    ruling = commands.fitted(number, core.service.tools, state.tool)
    if ruling.verdict or ruling.tool == state.tool:
        return state, Output(ruling.verdict, words=ruling.words)
    state, other = judged(core, state), core.fitted[ruling.tool]
    weighing = other.weigher.begin()._replace(books=unseen(state.weighing.books))
    known = other.recognizer.begin()
    state = state._replace(weighing=weighing, recognition=known, scale=Scale(), tool=ruling.tool)
    return _lose(other, state, state.estimate.t_us, Reason.STARTING), Output(0, words=ruling.words)


def _tick(core: Core, state: State, t_us: int) -> State:
    """The state after a tick: sample, channels, filtered rows, load and force; or an estimate with the reason why there
    are none."""
    inputs = core.assembler.receive(state.inputs, state.frames, state.moving)
    sample = core.assembler.sample(inputs, t_us)
    channels, periods = _channels(core, sample), (t_us - state.sampled_us) / core.period_us
    fits = sample.late is NONE and TICK_SLACK < periods < core.longest_step
    if not fits or state.pipe is None or isinstance(channels, Reason):
        return _unsteady(core, new(State, (inputs, *state[1:-1], ())), sample, channels)
    pipe, instant = core.pipeline.advance(state.pipe, channels, round(periods))
    usable, moving = instant.usable, core.pipeline.moving(instant.speed)
    if pipe.steps <= core.model.settle_steps:
        nothing = _nothing(state, t_us, Reason.STARTING)
        begun = state._replace(inputs=inputs, pipe=pipe, sampled_us=t_us, moving=moving, frames=())
        return begun._replace(estimate=nothing)
    plain = core.weigher.left(instant.kept, state.drift)
    rocking, left = core.rocker.step(state.rocking, plain, channels, state.weighing.lift, usable)
    parts, beside = (state.weighing, left, usable, t_us, state.drift), partial(_beside, core, state, channels)
    lifted = core.weigher.step(*parts, curled=_curled(core, channels), beside=beside)
    (weighing, load), wrong = lifted, state.watch.unnoticed.torques
    pressed = core.interactor.step(state.interaction, instant, state.drift.values, usable, lifted, t_us, wrong)
    (interaction, forces), torque = pressed, left.torque
    told = (state.drift, less(load.mass, state.scale.zero), weighing.lift, sample.leapt, interaction.carried.known)
    seen = new(Samples, (sample.kept, pipe, instant, torque, forces, *told, core.assembler.came(inputs)))
    watch, weighing = _watched(core, state, seen, weighing)
    drift = _drift(core, state.drift, watch, load, left, usable)
    known = core.recognizer.step(state.recognition, plain, usable)
    moved = (inputs, pipe, weighing, drift, state.scale, t_us, state.estimate, moving, known, interaction, watch)
    after = new(State, moved + state[11:16] + (tuple(torque), rocking, ()))
    return _booked(after, _estimate(core, after, load, forces, t_us), state.weighing.books.booking)


def _unsteady(core: Core, state: State, sample: Sample, channels: Numbers | Reason) -> State:
    """The state after a tick that does not go on from the one before: signals are late or not usable, or it comes too
    early or too late."""
    if sample.late is not NONE and state.pipe is not None and not any(sample.reasons):
        return state._replace(estimate=held_estimate(state.estimate, sample.t_us, sample.late))
    if isinstance(channels, Reason):
        strayed = tuple(k for k, reason in enumerate(sample.reasons) if reason is Reason.OUT_OF_RANGE)
        return _lose(core, state, sample.t_us, channels, strayed)
    reason = Reason.STARTING if state.pipe is None else Reason.TIME_JUMP
    state = _lose(core, state, sample.t_us, reason)
    return state._replace(pipe=core.pipeline.begin(channels), sampled_us=sample.t_us)


def _beside(core: Core, state: State, channels: Numbers) -> Beside:
    """What a weight is to remember: the tool's angle to the house, and what errors of signals would do to it."""
    tilt = None if core.service.machine.opens else sum(channels[: core.service.machine.size])
    return new(Beside, (tilt, state.watch.unnoticed.slopes))


def _curled(core: Core, channels: Numbers) -> bool:
    """Whether the bucket is curled as far as the machine file wants it for a booking."""
    machine = core.service.machine
    return machine.curled is None or machine.curled[0] <= channels[machine.size - 1] <= machine.curled[1]


def _booked(state: State, estimate: Estimate, before: Booking | None) -> State:
    """The state with its estimate and the working cycle advanced; with a new booking it ends, and the truck has one
    more bucket, whose mass follows the booking while that becomes more precise."""
    cycle, booking = advanced(state.cycle, estimate), state.weighing.books.booking
    state = state._replace(estimate=estimate, cycle=cycle)
    if booking is None or booking is before:
        return state
    if before is not None and not is_new(booking, before):
        return state._replace(truck=refined(state.truck, booking.number, booking.dumped - before.dumped))
    truck = loaded(state.truck, booking, state.scale.tare)
    return state._replace(truck=truck, ended=cycle, cycle=Cycle(state.estimate.t_us))


def _channels(core: Core, sample: Sample) -> Numbers | Reason:
    """Joint angles, cylinder forces and attitude (D,) of a sample; or the reason why it is not usable."""
    return max(sample.reasons) if any(sample.reasons) else core.pipeline.read(sample.kept)


def _lose(core: Core, state: State, t_us: int, reason: Reason, strayed: tuple[int, ...] = ()) -> State:
    """The state after an interruption: filters and lift start again, no value is shown. At an end stop the bucket is
    still watched. `strayed`: signals outside their range."""
    weighing = core.weigher.interrupt(state.weighing)
    if reason is Reason.END_STOP:
        weighing = weighing._replace(seen_us=t_us)
    return state._replace(
        pipe=None,
        moving=core.assembler.still,
        weighing=weighing,
        recognition=core.recognizer.interrupt(state.recognition),
        interaction=core.interactor.interrupt(state.interaction),
        rocking=state.rocking.interrupted(),
        watch=core.monitor.interrupt(state.watch, frozen=reason is Reason.FROZEN, strayed=strayed),
        estimate=_nothing(state, t_us, reason),
        unexplained=(),
    )


def _nothing(state: State, t_us: int, reason: Reason) -> Estimate:
    """No value, and why; the last booking and events stay."""
    return no_estimate(t_us, reason, state.estimate.booking, state.estimate.events)


def _watched(core: Core, state: State, seen: Samples, weighing: Weighing) -> tuple[Watch, Weighing]:
    """Whether the sensors agree after this instant; while they do not, nothing is booked; while that is not sure,
    bookings wait."""
    watch, books = core.monitor.step(state.watch, seen), weighing.books
    if watch.suspicion.level is not FINE and not watch.suspicion.waits:
        books = unseen(books)
    probable, unsure = watch.unnoticed.probable, watch.unsure
    if books.withheld is not unsure or books.probable is not probable:
        books = books._replace(withheld=unsure, probable=probable)
    return watch, weighing if books is weighing.books else weighing._replace(books=books)


def _drift(core: Core, drift: Drift, watch: Watch, load: Load, left: Unexplained, usable: Numbers) -> Drift:
    """The drift of friction and zeros after this instant; it changes only while the bucket is known to be empty and
    the sensors agree."""
    if not core.adapts or not watch.suspicion.follows:
        return drift
    if not core.weigher.is_empty(load):
        return core.adapter.loaded(drift)
    return core.adapter.step(drift, left, usable)


def _estimate(core: Core, state: State, load: Load, forces: Forces, t_us: int) -> Estimate:
    """The published estimate: load, load less zero (gross), less tare (net), and forces. OK becomes DEGRADED for
    LONG_FRAME_US after a frame longer than its mapping, while another machine is seen, and of a force while something
    seems to touch the tool that is swung; gross and net are INVALID outside their declared range."""
    if state.watch.suspicion.level is REJECTED:
        reason = Reason.NOT_THIS_MACHINE if state.recognition.another else Reason.SENSORS_DISAGREE
        nothing = invalid_force(reason)
        load, forces = invalid_load(reason), Forces(nothing, nothing)
    elif state.interaction.contact.touching and state.watch.swept.fast:
        forces = _less_sure(forces, Reason.SLEWING)
    for reason in _doubts(core, state, t_us):
        load = Load(*(degraded(q, reason) for q in load))
        forces = _less_sure(forces, reason)
    if state.weighing.tool.off is not None and load.mass.reason is Reason.NOT_A_LOAD:
        load = invalid_load(Reason.OTHER_TOOL)
    rated = core.service.machine.rated_payload
    if load.mass.status is not INVALID:
        mass = _with_unnoticed(load.mass, state.watch.unnoticed)
        load = new(Load, (mass, load.centre_x, load.centre_z))
    (zero, tare), limits = state.scale, core.limits[GROSS]
    gross = within(less(load.mass, zero), limits, rated)
    net = within(less(gross, tare), limits, rated) if tare else gross
    events = state.interaction.contact.events
    booking = state.weighing.books.booking
    return new(Estimate, (t_us, load, gross, net, forces.resultant, booking, forces.soil, events))


def _with_unnoticed(mass: Quantity, unnoticed: Unnoticed) -> Quantity:
    """The mass [kg] with what errors of signals add to its standard error."""
    return new(Quantity, (mass.value, hypot(mass.standard_error, unnoticed.mass), mass.status, mass.reason))


def _less_sure(forces: Forces, reason: Reason) -> Forces:
    return Forces(*(each_component(force, partial(degraded, reason=reason)) for force in forces))


def _doubts(core: Core, state: State, t_us: int) -> list[Reason]:
    """Why nothing that is published now is OK."""
    found = list[Reason]()
    if state.recognition.another and core.tares.identified:
        found.append(Reason.NOT_THIS_MACHINE)
    if state.weighing.tool.off is not None:
        found.append(Reason.OTHER_TOOL)
    if state.weighing.books.unconfirmed:
        found.append(Reason.NOT_CONFIRMED)
    if state.watch.suspicion.level is DOUBTED or state.weighing.books.withheld:
        found.append(Reason.SENSORS_DISAGREE)
    inputs = state.inputs
    if abs(t_us - inputs.long_us) < LONG_FRAME_US:
        found.append(Reason.LONG_FRAME)
    if inputs.spoofed(t_us):
        found.append(Reason.OWN_IDENTIFIER)
    return found
