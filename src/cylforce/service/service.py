"""Weighing service: one object that receives frames and ticks, and returns estimates."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from math import hypot
from typing import Any, Self

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.mechanics.installation import STANDARD
from cylforce.service import commands
from cylforce.service.adaptation import DriftFilter
from cylforce.service.assembler import Assembler
from cylforce.service.booking import Bookings, Missed, MissedReason, weighed
from cylforce.service.commands import NO_SCALE, Answer, Scale
from cylforce.service.contact.interaction import ForceEstimator, Forces
from cylforce.service.contact.rocking import BaseFilter
from cylforce.service.core import TICK_SLACK, Core
from cylforce.service.loading.cycle import Cycle
from cylforce.service.loading.lift import Weight
from cylforce.service.loading.truck import NO_TRUCK, Truck, add_bucket, correct_bucket
from cylforce.service.memory import NOTHING_KEPT, Memory
from cylforce.service.pipeline import Pipeline
from cylforce.service.plausibility.monitor import Monitor
from cylforce.service.plausibility.sample import MonitorSample
from cylforce.service.plausibility.suspicion import Level
from cylforce.service.recognition import Recognizer
from cylforce.service.residual import InstantResidual
from cylforce.service.snapshot import Estimator
from cylforce.service.tool_check import ToolCheck
from cylforce.service.weighing import LiftEvent, LoadEstimator
from cylforce.signals.estimate import (
    Booking,
    Estimate,
    Load,
    Quantity,
    Reason,
    Sample,
    Status,
    degraded,
    held_estimate,
    invalid_force,
    invalid_load,
    is_new,
    less,
    no_estimate,
    within,
)
from cylforce.signals.events import Event, Frame

MOST_FRAMES = 64  # frames that wait for a tick, so that memory and time stay bounded without ticks; chosen
LONG_FRAME_US = 1_000_000  # us for which estimates are DEGRADED after a frame longer than its mapping; chosen


@dataclass(slots=True)
class WeighingService(Estimator):
    """Running service.

    It reads no clock, socket, file or random number. Time is an argument, so that live operation, replay and simulation
    differ only in the caller.

    core:        constants with the standard tool
    fitted:      constants with the present tool
    inputs:      last values of the sensors
    pipeline:    filters, from samples to rows
    base:        motion of the base
    load:        recursive estimate of the load
    bookings:    state of the booking
    tool_check:  test for another tool than the chosen one
    drift:       of friction and pressure zeros
    recognizer:  test for another machine than the identified one
    force:       forces at the tool, contact, events
    monitor:     tests for sensor faults
    estimate:    the last one
    moving:      (S,) 1 where a signal should change because the machine moves
    scale:       the operator's zero and tare
    truck:       that is being loaded
    cycle:       present working cycle
    ended:       working cycle that the last booking ended
    sampled_us:  time of the last sample in the filters [us]
    stopped:     whether NMT has stopped our node
    tool:        name of the present tool
    unexplained: residual torque of each measured joint after tares and drift, which a load, a force at the tool and
                 errors cause [N m]; empty: not measured
    frames:      received since the last tick, to be decoded together at the next one
    """

    core: Core
    fitted: Core
    inputs: Assembler
    pipeline: Pipeline
    base: BaseFilter
    load: LoadEstimator
    bookings: Bookings
    tool_check: ToolCheck
    drift: DriftFilter
    recognizer: Recognizer
    force: ForceEstimator
    monitor: Monitor
    estimate: Estimate
    moving: Numbers
    scale: Scale = NO_SCALE
    truck: Truck = NO_TRUCK
    cycle: Cycle = field(default_factory=Cycle)
    ended: Cycle = field(default_factory=Cycle)
    sampled_us: int = 0
    stopped: bool = False
    tool: str = STANDARD
    unexplained: tuple[float, ...] = ()
    frames: list[Frame] = field(default_factory=list)

    @classmethod
    def start(cls, core: Core, kept: Memory = NOTHING_KEPT) -> Self:
        """Return a service before any event: every estimator in its first state, no estimate yet (STARTING).

        Zero, tare, truck, tool and bookings are those of the memory. The standard tool replaces a tool that the core
        does not contain any more.

        core: settings, identified parameters, and constants of all estimators with each tool
        kept: memory from before a restart
        """
        tool = kept.tool if kept.tool in core.attached else STANDARD
        fitted = core.fitted[tool]
        service = cls(
            core,
            fitted,
            inputs=Assembler.start(fitted.inputs),
            pipeline=Pipeline.start(fitted.pipeline),
            base=BaseFilter.start(fitted.base),
            load=LoadEstimator.start(fitted.load),
            bookings=Bookings.start(fitted.bookings),
            tool_check=ToolCheck(),
            drift=DriftFilter.start(fitted.drift),
            recognizer=Recognizer.start(fitted.recognizer),
            force=ForceEstimator.start(fitted.force),
            monitor=Monitor.start(fitted.monitor),
            estimate=no_estimate(0, Reason.STARTING, kept.booking),
            moving=fitted.inputs.still,
            scale=kept.scale,
            truck=kept.truck,
            tool=tool,
        )
        service._remember(kept)
        return service

    def _remember(self, kept: Memory) -> None:
        """Take over the bookings of a memory from before a restart.

        The weight of a loaded bucket that was not booked yet (`kept.hanging`) is still booked when the bucket is empty,
        unless it was weighed with another number of tares or drifts. Then it is reported as missed, as is a load that
        was lost in the interruption (`kept.lost` [kg]).

        kept: memory of the service before the restart
        """
        hanging, sizes = kept.hanging, (len(self.fitted.tares.values), self.drift.values.size)
        if hanging is not None and (hanging.gain.size, hanging.drifted.size) != sizes:
            kept, hanging = kept.emptied(), None
        books = self.bookings
        books.candidate, books.booking, books.unconfirmed = hanging, kept.booking, kept.unconfirmed
        books.remembered = hanging is not None
        if kept.lost:
            books.missed = Missed(1, kept.lost, MissedReason.INTERRUPTED)

    @property
    def memory(self) -> Memory:
        """State that is kept over a restart: zero and tare, truck, last booking, tool, weight to be booked."""
        books = self.bookings
        return Memory(
            scale=self.scale,
            truck=self.truck,
            booking=books.booking,
            tool=self.tool,
            hanging=books.candidate,
            unconfirmed=books.unconfirmed,
        )

    def restore(self, state: Mapping[str, Any]) -> None:
        """Replace the state by a copy of a `snapshot`, and the constants by those of its tool."""
        self._fit(state["tool"])
        Estimator.restore(self, state)

    def copied(self, core: Core | None = None) -> "WeighingService":
        """Return another service in the same state, which shares no state with this one.

        core: constants of the other service; None: those of this one
        """
        other = WeighingService.start(self.core if core is None else core)
        other.restore(self.snapshot())
        return other

    def _fit(self, tool: str) -> None:
        """Replace the constants (tares, filters, limits) by those of a tool; the state of all estimators stays.

        tool: name of the tool; the standard tool replaces one that the core does not contain
        """
        if tool == self.tool:
            return
        other = WeighingService.start(self.core, Memory(tool=tool))
        for name in ("inputs", "pipeline", "base", "load", "bookings", "drift", "recognizer", "force", "monitor"):
            estimator = getattr(other, name)
            estimator.restore(getattr(self, name).snapshot())
            setattr(self, name, estimator)
        self.fitted, self.tool = other.fitted, other.tool

    def with_core(self, core: Core, unconfirmed: bool | None = None) -> "WeighingService":
        """Return a service that continues with other tares.

        Estimators start anew, as after a restart. A load in the bucket was weighed with the old tares: it is not
        booked, but reported as missed. The values of the sensors, the operator's settings (zero, tare, tool, truck),
        the last booking, the working cycle, the NMT state, and a suspicion of a sensor fault that `stays` are kept.

        core:        constants with the other tares
        unconfirmed: whether the parameters may be another machine's; None: as before
        """
        other = WeighingService.start(core, replace(self.memory, hanging=None))
        other.bookings.restore(self.bookings.snapshot())
        other.bookings.discard_candidate()
        other.bookings.probable, other.bookings.measured_us = None, None
        if unconfirmed is not None:
            other.bookings.unconfirmed = unconfirmed
        last = self.estimate
        other.estimate = no_estimate(last.t_us, Reason.STARTING, other.bookings.booking, last.events)
        other.inputs.restore(self.inputs.snapshot())
        other.frames = [*self.frames]
        other.cycle.restore(self.cycle.snapshot())
        other.ended.restore(self.ended.snapshot())
        other.stopped = self.stopped
        other.monitor.keep_rejection(self.monitor)
        return other

    def on_frame(self, frame: Frame) -> Answer | None:
        """Handle a frame, and return the answer to a command; None for any other frame.

        A command to our node is executed at once, unless NMT has stopped it. A boot-up message discards the values of
        the node that booted. All other frames wait to be decoded at the next tick, or when MOST_FRAMES wait. No frame
        raises an exception."""
        if frame.can_id not in self.core.inputs.decoders:
            own = self.core.service.node_id
            stopped = commands.stopped(frame, own)
            if stopped is not None:
                self.stopped = stopped
                return None
            command = commands.read(frame, own)
            if command is not None and not self.stopped:
                return self._obey(command)
            booted = commands.booted(frame)
            if booted is not None:
                self.receive()
                self.inputs.restart(booted)
                return None
        self.frames.append(frame)
        if len(self.frames) >= MOST_FRAMES:
            self.receive()
        return None

    def on_event(self, event: Event) -> Estimate | None:
        """Handle one event, a frame or a tick; return the estimate of a tick, None for a frame.

        The answer to a command in a frame is not returned (`on_frame`)."""
        if isinstance(event, Frame):
            self.on_frame(event)
            return None
        return self.on_tick(event.t_us)

    def receive(self) -> None:
        """Decode and check the frames received since the last tick."""
        self.inputs.receive(self.frames, self.moving)
        self.frames.clear()

    def _obey(self, command: commands.Command) -> Answer:
        """Execute a command, and return its answer: verdict (0: done, else the SDO abort code) and words for a person.

        A tool command changes the tool; a scale command sets zero or tare to the present load; a loading command with
        the sub-index ADD books a bucket by hand, any other one changes the truck that is being loaded."""
        if isinstance(command, commands.ToolCommand):
            return self._change_tool(command.number)
        if isinstance(command, commands.ScaleCommand):
            rated = self.fitted.service.machine.rated_payload
            self.scale, answer = commands.obey(command, self.scale, self.estimate.load.mass, rated)
            return answer
        if command.sub == commands.ADD:
            return self._book_by_hand(command.data)
        decision = commands.obey_loading(command, self.truck)
        self.truck = decision.truck
        return Answer(decision.verdict, decision.words)

    def _book_by_hand(self, data: bytes) -> Answer:
        """Book a bucket that was not weighed, and return the answer to the operator's command.

        The booking before it does not become more precise any more.

        data: the four bytes that were written, the mass as a signed integer of 0.1 kg
        """
        made, ruling = commands.book_by_hand(data, self.bookings.booking, self.estimate.t_us, self.truck)
        if made is not None:
            self.bookings.booking, self.bookings.dumped, self.truck = made, None, ruling.truck
        return Answer(ruling.verdict, ruling.words)

    def _change_tool(self, number: int) -> Answer:
        """Choose a tool, and return the answer: the weighing begins anew, and a load in the bucket is not booked.

        Zero and tare become 0. The drift stays, because friction and pressure zeros are the arm's. The frames that were
        received before the command are decoded first, with the constants of the old tool. If the command is refused
        (verdict not 0), or the tool is the present one, nothing changes.

        number: of the tool
        """
        tool, answer = commands.chosen_tool(number, self.core.service.tools, self.tool)
        if answer.verdict or tool == self.tool:
            return answer
        self.receive()
        self._fit(tool)
        self.bookings.discard_candidate()
        self.bookings.measured_us = None
        self.load.interrupt()
        self.tool_check = ToolCheck()
        self.recognizer = Recognizer.start(self.fitted.recognizer)
        self.scale = Scale()
        self._interrupt(self.estimate.t_us, Reason.STARTING)
        return answer

    def on_tick(self, t_us: int) -> Estimate:
        """Return the estimate of a tick at the time `t_us` [us]: one step of the whole service.

        The frames received since the last tick become a sample, the sample becomes filtered rows (measured joint
        torques and their columns), and the rows less the empty machine's torque the residual torque of each joint [N
        m]. The residual torque gives the load, the bookings and the force at the tool. The monitor then tests for
        sensor faults, and friction and pressure zeros are adapted while the bucket is empty. Without a usable sample,
        or at a tick that is too early or too late, the last estimate is held or the filters start again. While the
        filters settle, the estimate has no values (STARTING).
        """
        core = self.fitted
        self.receive()
        sample = self.inputs.sample(t_us)
        channels = max(sample.reasons) if any(sample.reasons) else core.pipeline.read(sample.plain)
        periods = (t_us - self.sampled_us) / core.period_us
        follows = sample.late is Reason.NONE and TICK_SLACK < periods < core.longest_step
        if not follows or self.pipeline.state is None or isinstance(channels, Reason):
            self._hold_or_restart(sample, channels)
            return self.estimate
        instant = self.pipeline.update(channels, round(periods))
        self.sampled_us = t_us
        self.moving = core.pipeline.moving(instant.speed)
        if self.pipeline.steps <= core.load.settle_steps:
            self.estimate = self._no_estimate(t_us, Reason.STARTING)
            return self.estimate
        usable = instant.usable
        residual = core.load.residual(instant.numbers, self.drift.values)
        self.base.update(residual, channels, self.load.lift, usable)
        tilt = None if core.service.machine.opens else sum(channels[: core.service.machine.size])
        weight = self.load.update(residual, usable, self.drift, tilt)
        curled = self._is_curled(channels)
        load = self.load.load(weight, curled=curled)
        before = self.bookings.booking
        self.note_weight(weight, t_us, tilt, curled=curled)
        lift = None if load.mass.status is Status.INVALID else self.load.lift
        undetected = self.monitor.undetected.torques
        forces = self.force.update(instant, usable, self.drift.values, lift, t_us, undetected)
        gross = less(load.mass, self.scale.zero)
        self.monitor.update(
            MonitorSample(
                values=sample.plain,
                arrivals=self.inputs.arrivals_us,
                stepped=sample.stepped,
                pipeline=self.pipeline,
                instant=instant,
                residual=residual.torque,
                forces=forces,
                drift=self.drift,
                gross=gross,
                lift=self.load.lift,
                weighed=self.force.carried.known,
            )
        )
        self._withhold()
        self._adapt(load, residual, usable)
        self.recognizer.update(residual, usable)
        self.unexplained = tuple(residual.torque)
        self.estimate = self._estimate(load, forces, t_us)
        self.cycle.update(self.estimate)
        self._load_truck(before)
        return self.estimate

    def _hold_or_restart(self, sample: Sample, channels: Numbers | Reason) -> None:
        """Hold the last estimate, or interrupt the measurement, at a tick whose sample cannot follow the last one.

        The estimate is held where values are late, but all of them still usable. Otherwise it has no values. Where
        there are no channels (`channels` is a reason), the filters stop. Where the tick is too early or too late, and
        at the first sample, they begin anew with this sample.

        sample:   of the tick
        channels: (D,) joint angles [rad], cylinder forces [N] and attitude from the sample, or the reason why there are
                  none
        """
        begun = self.pipeline.state is not None
        if sample.late is not Reason.NONE and begun and not any(sample.reasons):
            self.estimate = held_estimate(self.estimate, sample.t_us, sample.late)
        elif isinstance(channels, Reason):
            out_of_range = tuple(k for k, reason in enumerate(sample.reasons) if reason is Reason.OUT_OF_RANGE)
            self._interrupt(sample.t_us, channels, out_of_range)
        else:
            self._interrupt(sample.t_us, Reason.TIME_JUMP if begun else Reason.STARTING)
            self.pipeline.begin(channels)
            self.sampled_us = sample.t_us

    def _interrupt(self, t_us: int, reason: Reason, out_of_range: tuple[int, ...] = ()) -> None:
        """Reset filters, lift and tests after an interruption of the measurement, with an estimate without values.

        The candidate for booking remains. If the bucket is not observed for too long, it may have been emptied and
        filled again; at an end stop it still counts as observed.

        t_us:         time [us]
        reason:       of the interruption, that of the estimate
        out_of_range: numbers of the signals outside their range; the monitor suspects them when they return
        """
        self.pipeline.stop()
        self.moving = self.fitted.inputs.still
        self.load.interrupt()
        self.bookings.end_lift()
        if reason is Reason.END_STOP:
            self.bookings.measured_us = t_us
        self.recognizer.interrupt()
        self.force.interrupt()
        self.base.interrupt()
        self.monitor.interrupt(frozen=reason is Reason.FROZEN, out_of_range=out_of_range)
        self.estimate = self._no_estimate(t_us, reason)
        self.unexplained = ()

    def _no_estimate(self, t_us: int, reason: Reason) -> Estimate:
        """Return an estimate without values; the last booking and events stay."""
        return no_estimate(t_us, reason, self.estimate.booking, self.estimate.events)

    def _is_curled(self, channels: Numbers) -> bool:
        """Return whether the bucket is curled as far as the machine file requires for a booking; True without a limit.

        channels: (D,) of the step, the joint angles first [rad]; the last joint is the bucket's
        """
        machine = self.fitted.service.machine
        return machine.curled is None or machine.curled[0] <= channels[machine.size - 1] <= machine.curled[1]

    def note_weight(self, weight: Weight, t_us: int, tilt: float | None, *, curled: bool) -> None:
        """Update tool check and bookings with the weight of the lift, if the bucket is curled or the weight is light.

        Only every `bookings.constants.every`-th sample of a lift does so. The tool check gets any weight, the bookings
        a valid one only (`LoadEstimator.refusal`). At each sample the time, and the end of a lift or a change of its
        load in the air, are passed to the bookings.

        weight: mass and centre of the load, as concluded from the lift
        t_us:   time [us]
        tilt:   angle of the tool to the house [rad]; None where the tool does not empty by tilting
        curled: whether the bucket is curled far enough for a booking
        """
        bookings, lift = self.bookings, self.load.lift
        bookings.note_measurement(t_us)
        if self.load.event is LiftEvent.ENDED:
            bookings.end_lift()
        elif self.load.event is LiftEvent.CHANGED:
            bookings.change_load()
        if lift.taken % bookings.constants.every or not (curled or self.load.is_light(weight)):
            return
        self.tool_check.update(self.load, weight)
        if self.load.refusal(weight) is None:
            slopes = self.monitor.undetected.slopes
            bookings.update(weighed(lift, bookings.constants.parameters, tilt, slopes), t_us, self.drift)

    def _withhold(self) -> None:
        """Pass the result of the sensors' monitor on to the bookings.

        Bookings wait while there is evidence, but too weak for a suspicion, or a suspicion that the next motion in the
        air will decide (`waits`). Any other suspicion discards the candidate, the load that is not booked yet, and
        reports it as missed. The probable errors of the signals [bar over the head area, rad] widen the errors of
        bookings."""
        suspicion = self.monitor.suspicion
        if suspicion.level is not Level.FINE and not suspicion.waits:
            self.bookings.discard_candidate()
        self.bookings.withheld = self.monitor.unsure
        self.bookings.probable = self.monitor.undetected.probable

    def _adapt(self, load: Load, residual: InstantResidual, usable: Numbers) -> None:
        """Update the drift of friction and pressure zeros while the bucket is known to be empty.

        With a loaded bucket the adaptation pauses: the next return may have another carry-back. Nothing changes while a
        sensor fault is suspected that prevents it, with tares from the data sheet, or where the machine file switches
        the adaptation off.

        load:     in the bucket, before zero and tare
        residual: measured joint torques less those of the empty machine and the drift [N m]
        usable:   (R,) 1 where the row of a measured joint torque can be used, else 0
        """
        if not self.fitted.adapts or not self.monitor.suspicion.follows:
            return
        if self.fitted.load.is_empty(load):
            self.drift.update(residual, usable)
        else:
            self.drift.pause()

    def _load_truck(self, before: Booking | None) -> None:
        """Add a bucket to the truck after a booking, which also ends the working cycle.

        The bucket's mass is the dumped mass less the tare. It follows the booking while that becomes more precise.

        before: booking before this tick; None: none yet
        """
        booking = self.bookings.booking
        if booking is None or booking is before:
            return
        if before is not None and not is_new(booking, before):
            self.truck = correct_bucket(self.truck, booking.number, booking.dumped - before.dumped)
            return
        self.truck = add_bucket(self.truck, booking, self.scale.tare)
        self.ended, self.cycle = self.cycle, Cycle(self.estimate.t_us)

    def _estimate(self, load: Load, forces: Forces, t_us: int) -> Estimate:
        """Return the published estimate: load, load less zero (gross), less tare (net), and forces.

        Load and forces are INVALID while a signal is rejected, because of NOT_THIS_MACHINE if this seems to be another
        machine, else of SENSORS_DISAGREE. They are DEGRADED for the reasons of `_reservations`. Forces are DEGRADED
        while the house slews fast and the tool seems to be in contact. The first reason that degrades a quantity
        remains, and an INVALID one stays so. A mass and centre that no load can have (NOT_A_LOAD) are INVALID because
        of OTHER_TOOL while another tool is suspected. The standard error of the mass includes that by undetected sensor
        faults. Gross and net are INVALID outside their declared range, or with a standard error of the rated payload or
        more.

        load:   mass [kg] and its centre x, z [m] before zero and tare
        forces: resultant at the tool, and the soil's part of it [N]
        t_us:   of the tick [us]
        """
        resultant, soil = forces.resultant, forces.soil
        if self.monitor.suspicion.level is Level.REJECTED:
            reason = Reason.NOT_THIS_MACHINE if self.recognizer.another else Reason.SENSORS_DISAGREE
            load, resultant = invalid_load(reason), invalid_force(reason)
            soil = resultant
        elif self.force.contact.in_contact and self.monitor.slews_fast:
            change = partial(degraded, reason=Reason.SLEWING)
            resultant, soil = resultant.changed(change), soil.changed(change)
        for reason in self._reservations(t_us):
            change = partial(degraded, reason=reason)
            load, resultant, soil = load.changed(change), resultant.changed(change), soil.changed(change)
        if self.tool_check.empty_weight is not None and load.mass.reason is Reason.NOT_A_LOAD:
            load = invalid_load(Reason.OTHER_TOOL)
        mass = load.mass
        if mass.status is not Status.INVALID:
            error = hypot(mass.standard_error, self.monitor.undetected.mass)
            mass = Quantity(mass.value, error, mass.status, mass.reason)
            load = Load(mass, load.centre_x, load.centre_z)
        limits, rated = self.core.gross_limits, self.fitted.service.machine.rated_payload
        gross = within(less(mass, self.scale.zero), limits, rated)
        net = within(less(gross, self.scale.tare), limits, rated) if self.scale.tare else gross
        return Estimate(
            t_us,
            load=load,
            gross=gross,
            net=net,
            force=resultant,
            booking=self.bookings.booking,
            soil=soil,
            events=self.force.contact.events,
        )

    def _reservations(self, t_us: int) -> list[Reason]:
        """Return the reasons why no published quantity is OK, the most important first.

        NOT_THIS_MACHINE:  the motion is that of another machine than the identified one (only with identified tares)
        OTHER_TOOL:        another tool than the chosen one is suspected
        NOT_CONFIRMED:     the identified parameters were sealed on another controller: they may be another machine's
        SENSORS_DISAGREE:  a sensor fault is suspected, or bookings wait because there is evidence of one
        LONG_FRAME:        a frame longer than its mapping was received in the last LONG_FRAME_US
        OWN_IDENTIFIER:    another node sends with one of our identifiers

        t_us: of the tick [us]
        """
        reasons = list[Reason]()
        if self.recognizer.another and self.fitted.tares.identified:
            reasons.append(Reason.NOT_THIS_MACHINE)
        if self.tool_check.empty_weight is not None:
            reasons.append(Reason.OTHER_TOOL)
        if self.bookings.unconfirmed:
            reasons.append(Reason.NOT_CONFIRMED)
        if self.monitor.suspicion.level is Level.SUSPECTED or self.bookings.withheld:
            reasons.append(Reason.SENSORS_DISAGREE)
        if abs(t_us - self.inputs.long_us) < LONG_FRAME_US:
            reasons.append(Reason.LONG_FRAME)
        if self.inputs.spoofed(t_us):
            reasons.append(Reason.OWN_IDENTIFIER)
        return reasons
