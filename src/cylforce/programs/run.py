"""`cylforce run`: the daemon. One loop, one clock, one bus; everything that it concludes comes from `core.step`."""

import asyncio
import gc
import signal
import sys
from collections.abc import Callable
from math import degrees
from pathlib import Path
from typing import NamedTuple, TextIO

import structlog

from cylforce.core.step import Core, Output, Scale, State, step
from cylforce.edges.bus import Bus, open_bus
from cylforce.edges.candump import Sent
from cylforce.edges.clock import Timer, now_us
from cylforce.edges.commissioning import Commissioner, Outcome, Stage
from cylforce.edges.devices import own_node
from cylforce.edges.logfile import LogWriter
from cylforce.edges.network import Network
from cylforce.edges.settings import Loaded
from cylforce.programs.replay import header_of, make_core
from cylforce.words.estimate import Booking, Estimate, Quantity, Reason, Status
from cylforce.words.events import Event, Frame, Tick

OVERRUN = 0xFF31  # EMCY codes (manufacturer's): the loop was late
MISSING = 0x8250  # a sensor's PDOs stopped

OnEstimate = Callable[[Estimate], None]


class Told(NamedTuple):
    """What was said last: only changes are logged."""

    reason: Reason
    status: Status
    booked: int


class Counts(NamedTuple):
    """Ticks served, ticks missed because the loop was late."""

    steps: int = 0
    overruns: int = 0


class Daemon:
    """The service on a bus. `on_estimate` sees every estimate after it was sent."""

    def __init__(self, loaded: Loaded, core: Core, bus: Bus, log: LogWriter | None, scale: Scale) -> None:
        self.core, self.bus, self.log = core, bus, log
        self.state: State = core.begin(scale)
        self.counts = Counts()
        self.on_estimate: OnEstimate = _ignore
        self._tell = structlog.get_logger("cylforce")
        self._told = Told(Reason.STARTING, Status.INVALID, 0)
        self._verdict: int | None = None
        self._every = max(1, round(core.service.publication[0].period_s * core.service.filters.rate_hz))
        self.network = Network(self._send)
        self.node = own_node(core.service, self._last_verdict, self._on_peer)
        self.network.add_node(self.node)
        heard = self.node.heartbeats.state
        self.commissioner = Commissioner(core.service.nodes, self.network, heard, self._commissioned)
        self._timer = Timer(1.0 / core.service.filters.rate_hz)

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Join the bus and begin to step; the sensors are commissioned beside the loop."""
        self.network.poll(now_us())
        self.bus.attach(loop, self.on_frame)
        self.node.boot()
        self.commissioner.start()
        loop.add_reader(self._timer.fileno(), self.on_timer)

    async def stop(self, loop: asyncio.AbstractEventLoop) -> None:
        """Leave the bus; the log is complete afterwards."""
        loop.remove_reader(self._timer.fileno())
        await self.commissioner.close()
        self._timer.close()
        self.bus.close()
        if self.log is not None:
            self.log.close()

    def on_frame(self, frame: Frame) -> None:
        """A frame: logged, into the core, then to our node, which answers with the core's verdict."""
        self._verdict = self._enter(frame).verdict
        self.network.on_frame(frame)
        self._verdict = None

    def on_timer(self) -> None:
        """A tick: logged, into the core; what it concludes goes out, then SYNC asks for the next samples. Missed ticks
        are skipped, counted and told."""
        due = self._timer.read()
        if due == 0:
            return
        late = due - 1
        self.counts = Counts(self.counts.steps + 1, self.counts.overruns + late)
        tick = Tick(self._timer.deadline_us)
        out = self._enter(tick)
        if self.counts.steps % self._every == 0:
            for number, data in out.frames:
                self.node.publish(number, data)
        self.node.produce_sync()
        self.network.poll(tick.t_us)
        if late:
            self._tell.warning("overrun", missed=late, overruns=self.counts.overruns)
            self.node.emergencies.occur(OVERRUN)
        elif self.counts.steps % ON_TIME == 0:
            self.node.emergencies.repair(OVERRUN)
        if out.estimate is not None:
            self._say_changes(out.estimate)
            self.on_estimate(out.estimate)

    def _enter(self, event: Event) -> Output:
        if self.log is not None:
            self.log.log(event)
        self.state, out = step(self.core, self.state, event)
        if out.verdict is not None:
            self._tell.info("zero or tare", abort=hex(out.verdict), **self.state.scale._asdict())
        return out

    def _send(self, can_id: int, data: bytes) -> bool:
        sent = self.bus.send(can_id, data)
        if sent and self.log is not None:
            self.log.log(Sent(now_us(), can_id, bytes(data)))
        return sent

    def _last_verdict(self) -> int | None:
        return self._verdict

    def _on_peer(self, node_id: int, state: int | None) -> None:
        self._tell.info("node", node=node_id, state="silent" if state is None else state)
        self.commissioner.on_peer(node_id, state)

    def _commissioned(self, outcome: Outcome) -> None:
        say = self._tell.info if outcome.stage is Stage.OPERATIONAL else self._tell.warning
        say("sensor", name=outcome.node.name, node=outcome.node.node_id, stage=outcome.stage, why=outcome.reason)

    def _say_changes(self, estimate: Estimate) -> None:
        """One line when the measurement is lost or back, one for every booking."""
        lost = self.state.pipe is None
        reason = estimate.gross.reason if lost else Reason.NONE
        booked = estimate.booking.number if estimate.booking else 0
        told = Told(reason, Status.INVALID if lost else Status.OK, booked)
        if told[:2] != self._told[:2]:
            self._say_measurement(reason)
        if estimate.booking is not None and told.booked != self._told.booked:
            self._say_booking(estimate.booking)
        self._told = told

    def _say_measurement(self, reason: Reason) -> None:
        if reason is Reason.NONE:
            self._tell.info("measuring")
            self.node.emergencies.repair(MISSING)
            return
        signals = self.core.service.machine.signals
        sample = self.core.assembler.sample(self.state.inputs, self.state.estimate.t_us)
        bad = {s.name: r.name for s, r in zip(signals, sample.reasons, strict=True) if r is not Reason.NONE}
        self._tell.warning("not measuring", reason=reason.name, signals=bad)
        self.node.emergencies.occur(MISSING)

    def _say_booking(self, booking: Booking) -> None:
        kg = {"mass_kg": round(booking.mass, 1), "standard_error_kg": round(booking.standard_error, 1)}
        self._tell.info("booked", number=booking.number, **kg)


ON_TIME = 100  # steps without an overrun after which it counts as over


def _ignore(estimate: Estimate) -> None:
    """Nobody watches."""


def status_line(estimate: Estimate, counts: Counts, bus: Bus) -> str:
    """One line for a terminal."""
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


def configure_messages(stream: TextIO = sys.stderr) -> None:
    """JSON lines on standard error, or wherever they shall go."""
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.JSONRenderer(default=str),
        ],
        logger_factory=structlog.PrintLoggerFactory(stream),
        cache_logger_on_first_use=True,
    )


async def serve(daemon: Daemon, until: asyncio.Event) -> None:
    """Run until `until` is set or SIGTERM or SIGINT comes; once a second a status line on a terminal."""
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, until.set)
    daemon.start(loop)
    gc.collect()
    gc.freeze()  # the start's objects are not searched again: removes pauses of tens of milliseconds
    try:
        while not until.is_set():
            try:
                await asyncio.wait_for(until.wait(), 1.0)
            except TimeoutError:
                if sys.stdout.isatty():
                    line = status_line(daemon.state.estimate, daemon.counts, daemon.bus)
                    sys.stdout.write(f"\r\x1b[K{line}")
                    sys.stdout.flush()
    finally:
        await daemon.stop(loop)


def run_daemon(loaded: Loaded, bus_name: str, identified: Path | None, log: Path | None) -> Counts:
    """The daemon until a signal. Raises BusError, SettingsError or RecordingError with a sentence."""
    configure_messages()
    core = make_core(loaded, identified)
    bus = open_bus(bus_name)
    header = header_of(loaded, identified, bus_name, 0.0, 0.0)
    writer = LogWriter(log, header, now_us(), bus_name.partition(":")[2]) if log else None

    async def main() -> Counts:
        daemon = Daemon(loaded, core, bus, writer, Scale())
        await serve(daemon, asyncio.Event())
        return daemon.counts

    counts = asyncio.run(main())
    structlog.get_logger("cylforce").info("stopped", **counts._asdict())
    return counts
