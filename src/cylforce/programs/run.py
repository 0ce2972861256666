"""`cylforce run`: the service as a daemon, with one event loop, one clock and one bus. All results come from
`service.service.WeighingService`."""

import asyncio
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from math import degrees
from pathlib import Path
from typing import NamedTuple

import structlog

from cylforce.can.bus import Bus
from cylforce.can.clock import now_us
from cylforce.can.opening import open_shared_bus
from cylforce.canopen.dictionary.object_dictionary import ADAPTATION, FOLLOWING, FROZEN, JOINTS, UNEXPLAINED
from cylforce.canopen.j1939 import J1939, Claim, name_of
from cylforce.files.atomic import RecordingError, is_stream, warn
from cylforce.files.logfile import Header, LogWriter
from cylforce.files.rotation import Rotation
from cylforce.mechanics.installation import Service
from cylforce.programs.common.addresses import read_code
from cylforce.programs.common.readings import continued, header_of, make_core
from cylforce.programs.live.books import Ledger, kept_by, open_recorder, sealed_as, show_identity
from cylforce.programs.live.messages import configure_messages
from cylforce.programs.live.notify import Manager
from cylforce.programs.live.reloading import Parameters, Reloading
from cylforce.programs.live.sensor_messages import SensorMessages
from cylforce.programs.live.station import Counts, Station, serve
from cylforce.records.recorder import Recorder
from cylforce.service.booking import Missed, MissedReason
from cylforce.service.core import Core
from cylforce.service.memory import Memory
from cylforce.service.publication import frames
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Booking, Estimate, Quantity, Reason, Status, no_estimate
from cylforce.signals.events import Frame
from cylforce.signals.layout import not_available

MISSING = 0x8250  # a sensor's PDOs stopped

OnEstimate = Callable[[Estimate], None]
OTHER_TOOL = "the empty tool is off zero: other bucket? dirt? clean it, or choose the attachment"
WHY_MISSED = {
    MissedReason.INTERRUPTED: "the measurement was interrupted before the empty bucket was weighed",
    MissedReason.EMPTY_INACCURATE: "the empty bucket was not weighed accurately enough before the next load",
    MissedReason.DUMP_NOT_WEIGHED: "the bucket turned as for a dump and back, and was not weighed while it was empty",
}


class LastLogged(NamedTuple):
    """State that was logged last: only changes are logged.

    reason:     why the weight is lost; NONE if it is not
    status:     INVALID if it is lost, else OK
    booked:     number of the last booking
    missed:     number of the last load that was not booked
    other_tool: whether the tool seems to be another one
    """

    reason: Reason
    status: Status
    booked: int
    missed: int = 0
    other_tool: bool = False


class Daemon(Station):
    """The service on a bus. `on_estimate` is called with every estimate after it was sent."""

    def __init__(
        self,
        loaded: Loaded,
        core: Core,
        bus: Bus,
        log: LogWriter | None,
        kept: Memory,
        recorder: Recorder | None = None,
        code: int | None = None,
        identified: Path | None = None,
    ) -> None:
        self.weighing = WeighingService.start(core, kept)
        super().__init__(core.service, self.weighing, bus, log, code)
        self.core = core
        self.on_estimate: OnEstimate = _ignore
        self._j1939 = _j1939_of(core.service, bus)
        self._second = round(core.service.filters.rate_hz)  # steps
        self.books = Ledger(self.node, recorder, kept, core.service.tools)
        self._show_identity = partial(show_identity, self.node, loaded, identified)
        self._show_identity()
        self.reloading, self._sealed = Reloading(loaded, identified, self._take), sealed_as(identified)
        self._sensor_messages = SensorMessages(core.service.machine, self.node.emergencies, self._tell)
        self._logged = LastLogged(Reason.STARTING, Status.INVALID, kept.booking.number if kept.booking else 0)

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Join the bus. SIGHUP reads the identified file anew, except at a terminal: there it ends the service."""
        super().start(loop)
        if not sys.stdin or not sys.stdin.isatty():
            loop.add_signal_handler(signal.SIGHUP, lambda: self.reloading.ask(self.manager))
        if self._j1939 is not None:
            self._j1939.claim(now_us())

    def _take(self, new: Parameters) -> None:
        """Use other parameters from the next event on; the log continues in a new file, which begins with them."""
        self.core = new.core
        self.weighing = self.weighing.with_core(new.core, None if new.seal == self._sealed else new.elsewhere)
        self.handler = self.weighing
        self._sealed = new.seal
        self._show_identity()
        if self.log is not None:
            self.log.header = self.log.header.model_copy(update={"identified_sha256": new.sha256})
            self._turn_log(self.log, now_us())
        for sentence in new.warnings:
            self._tell.warning("parameters", why=sentence)
        self._tell.info("reloaded", parameters=new.seal)
        self.books.reloaded(now_us(), new.seal)

    def give_up(self, loop: asyncio.AbstractEventLoop) -> None:
        """End the steps after an error in one: publish invalid values, and send an emergency."""
        super().give_up(loop)
        nothing = no_estimate(self.weighing.estimate.t_us, Reason.STARTING, self.weighing.estimate.booking)
        for number, data in frames(self.core.service.publication, nothing):
            self.node.publish(number, data)

    def protected(self, words: str) -> None:
        """Enter an event of the lock into the journal and the audit trail."""
        super().protected(words)
        self.books.audit(now_us(), "SDO client", words)

    def after_frame(self, frame: Frame) -> None:
        """Check a frame for a claim of our J1939 address by another node."""
        if self._j1939 is not None:
            self._j1939.on_frame(frame)

    def before_tick(self, t_us: int) -> None:
        """Begin a new log file when the log is full, was renamed, or failed before.

        It begins with the service's present memory.
        """
        if self.log is not None and self.log.needs_new_file:
            self._turn_log(self.log, t_us)

    def _turn_log(self, log: LogWriter, t_us: int) -> None:
        """Go on in another file, which begins with the present state; it is encoded beside the loop."""
        log.begin_file(partial(continued, log.header, self.weighing.memory, self.weighing.snapshot()), t_us)

    def after_sync(self) -> None:
        """Publish the adaptation's state, log changes."""
        self._say_collisions(self.weighing.estimate.t_us)
        if 1 in self.due:
            self._show_drift()
            self._show_unexplained()
            if self._j1939 is not None:
                self._j1939.publish(self.weighing.estimate)
        if self._j1939 is not None and self.counts.steps % self._second == 0:
            self._j1939.publish_totals(self.weighing.estimate.t_us, self.weighing.truck.total, self.books.lifetime)
        self.books.look(self.weighing)
        self._sensor_messages.report(self.weighing.monitor.suspicion)
        self._say_changes(self.weighing.estimate)
        self.on_estimate(self.weighing.estimate)

    def _say_collisions(self, t_us: int) -> None:
        """Send an emergency while another node uses a sensor's identifiers, or ours."""
        inputs = self.weighing.inputs
        for pdo in inputs.doubled(t_us):
            self.edge.health.doubled(pdo.node_id, t_us)
        if inputs.spoofed(t_us):
            self.edge.health.doubled(self.core.service.node_id, t_us)

    def _show_drift(self) -> None:
        """Show the adaptation's state in the object dictionary."""
        if self.core.adapts:
            drift = self.weighing.drift
            self.node.set_value(ADAPTATION, 1, round(10.0 * drift.mass))
            self.node.set_value(ADAPTATION, 2, FOLLOWING if drift.following else FROZEN)

    def _show_unexplained(self) -> None:
        """Show the residual torque of the empty machine in the object dictionary."""
        shown = [round(torque) for torque in self.weighing.unexplained[:JOINTS]]
        for k, torque in enumerate(shown + [not_available("i")] * (JOINTS - len(shown)), 1):
            self.node.set_value(UNEXPLAINED, k, torque)

    def _say_changes(self, estimate: Estimate) -> None:
        """Log one line when the measurement is lost or back, and one for every booking."""
        lost = self.weighing.pipeline.state is None
        reason = estimate.gross.reason if lost else Reason.NONE
        booked = estimate.booking.number if estimate.booking else 0
        missed = self.weighing.bookings.missed.number
        off = self.weighing.tool_check.empty_weight
        now = LastLogged(reason, Status.INVALID if lost else Status.OK, booked, missed, off is not None)
        if now[:2] != self._logged[:2]:
            self._say_measurement(reason)
        if estimate.booking is not None and now.booked != self._logged.booked:
            self._say_booking(estimate.booking)
        if now.missed != self._logged.missed:
            self._say_missed(self.weighing.bookings.missed)
        if now.other_tool != self._logged.other_tool:
            self._say_tool(off)
        self._logged = now

    def _say_tool(self, off: float | None) -> None:
        if off is None:
            self._tell.info("the empty tool is at zero again", attachment=self.weighing.tool)
        else:
            self._tell.warning("nothing is booked", attachment=self.weighing.tool, off_kg=round(off, 1), why=OTHER_TOOL)

    def _say_measurement(self, reason: Reason) -> None:
        if reason is Reason.NONE:
            self._tell.info("measuring")
            self.node.emergencies.repair(MISSING)
            return
        signals = self.core.service.machine.signals
        sample = self.weighing.inputs.sample(self.weighing.estimate.t_us)
        bad = {s.name: r.name for s, r in zip(signals, sample.reasons, strict=True) if r is not Reason.NONE}
        self._tell.warning("not measuring", reason=reason.name, signals=bad)
        self.node.emergencies.occur(MISSING)

    def _say_booking(self, booking: Booking) -> None:
        kg = {"mass_kg": round(booking.mass, 1), "standard_error_kg": round(booking.standard_error, 1)}
        drift = {"drift_kg": round(self.weighing.drift.mass, 1)} if self.core.adapts else {}
        self._tell.info("booked", number=booking.number, **kg, **drift)

    def _say_missed(self, missed: Missed) -> None:
        self._tell.warning("not booked", mass_kg=round(missed.mass, 1), why=words_of(missed))


def words_of(missed: Missed) -> str:
    """Return why the last load that was missed is not booked; empty if none was missed."""
    return "" if missed.reason is None else WHY_MISSED[missed.reason]


def _j1939_of(service: Service, bus: Bus) -> J1939 | None:
    """Return our node on J1939; None where the machine file has none."""
    if service.j1939_address is None:
        return None
    return J1939(bus.send, Claim(service.j1939_address, name_of(service.node_id)), warn)


def _ignore(estimate: Estimate) -> None:
    """Ignore an estimate."""


def status_line(estimate: Estimate, counts: Counts, bus: Bus) -> str:
    """Return one line for a terminal."""
    force = estimate.force
    turn = "" if force.direction.status is Status.INVALID else f" at {degrees(force.direction.value):.0f} deg"
    return (
        f"load {_text(estimate.gross, 'kg', 1.0)}   force {_text(force.magnitude, 'kN', 1e-3)}{turn}   "
        f"{counts.steps} steps, {counts.overruns} overruns, {bus.counters.dropped} dropped"
    )


def _text(q: Quantity, unit: str, scale: float) -> str:
    if q.status is Status.INVALID:
        return f"-- ({q.reason.name.lower().replace('_', ' ')})"
    mark = "" if q.status is Status.OK else f" ({q.status.name.lower()})"
    return f"{q.value * scale:.1f} +- {q.standard_error * scale:.1f} {unit}{mark}"


def show_status(daemon: Daemon) -> None:
    """Print the status line, where there is a terminal."""
    if sys.stdout.isatty():
        line = status_line(daemon.weighing.estimate, daemon.counts, daemon.bus)
        sys.stdout.write(f"\r\x1b[K{line}")
        sys.stdout.flush()


def check_log(log: Path, inputs: Sequence[Path | None]) -> None:
    """Check the name of the log; a file that cannot be written now does not prevent measuring."""
    if log.suffix.lower() != ".log":
        raise RecordingError(f"--log {log}: must end in .log: by that ending it is read again")
    if log.is_dir() or is_stream(log):
        raise RecordingError(f"--log {log}: is no ordinary file: choose a file to write")
    if log.resolve() in {path.resolve() for path in inputs if path is not None}:
        raise RecordingError(f"--log {log}: would replace another file that this command names: choose another")


def _writer(header: Header, log: Path, rotation: Rotation) -> LogWriter:
    return LogWriter(log, header, now_us(), header.bus.partition(":")[2], rotation=rotation)


def run_daemon(
    loaded: Loaded,
    bus_name: str,
    identified: Path | None,
    log: Path | None,
    rotation: Rotation,
    records: Path | None,
    lock_file: Path | None = None,
) -> Counts:
    """Run the daemon until a signal. Raises BusError, SettingsError, RecordingError or ValueError with a sentence."""
    configure_messages()
    code = None if lock_file is None else read_code(lock_file)
    if log is not None:
        check_log(log, (loaded.path, identified, records))
    warnings: list[str] = []
    core = make_core(loaded, identified, warnings.append)
    bus = open_shared_bus(bus_name)
    for sentence in warnings:
        warn(sentence)
    recorder = open_recorder(records, loaded, identified)
    kept = kept_by(recorder, identified)
    writer = _writer(header_of(loaded, identified, bus_name, kept), log, rotation) if log else None

    async def main() -> Counts:
        daemon = Daemon(loaded, core, bus, writer, kept, recorder, code, identified)
        await serve(daemon, asyncio.Event(), lambda: show_status(daemon), manager=Manager())
        structlog.get_logger("cylforce").info("stopped", **daemon.counts._asdict())
        return daemon.counts

    try:
        counts = asyncio.run(main())
    finally:
        if recorder is not None:
            recorder.close()
    return counts
