"""Our node on a bus, with one event loop and one clock. Every event is logged, then passed to its handler; meanwhile
the sensors are commissioned by tasks of the same loop."""

import asyncio
import gc
import signal
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import structlog

from cylforce.can.bus import Bus
from cylforce.can.clock import Timer, now_us
from cylforce.canopen.access import Access
from cylforce.canopen.devices import own_node
from cylforce.canopen.dictionary.object_dictionary import CODE, PROTECTION
from cylforce.canopen.network import Network
from cylforce.canopen.startup import Commissioner, Outcome, Stage
from cylforce.files.candump import Sent
from cylforce.files.logfile import LogWriter
from cylforce.mechanics.installation import Service
from cylforce.programs.live.edge import Edge
from cylforce.programs.live.notify import Manager
from cylforce.service.commands import Answer
from cylforce.service.publication import Encoders, timetable
from cylforce.signals.estimate import Estimate
from cylforce.signals.events import Event, Frame, Tick
from cylforce.signals.identifiers import SDO_REQUEST

_CODE = PROTECTION.to_bytes(2, "little") + bytes([CODE])
OVERRUN = 0xFF31  # EMCY code (manufacturer's): the loop was late
SOFTWARE = 0x6100  # EMCY code: internal software
ON_TIME = 100  # steps; at each such count a step without overrun repairs the emergency
OVERRUN_MESSAGES_US = 1_000_000  # so that a busy controller does not log a line at every tick


class Counts(NamedTuple):
    """Counts of ticks.

    steps:    ticks that were processed
    overruns: ticks missed because the loop was too slow
    """

    steps: int = 0
    overruns: int = 0


class Handler(Protocol):
    """Receiver of a station's events."""

    def on_frame(self, frame: Frame) -> Answer | None:
        """Process a frame; return the answer to a command, None for any other frame."""

    def on_tick(self, t_us: int) -> Estimate | None:
        """Process a tick at a time [us]; return the estimate to publish, None: nothing is published."""


class Station:
    """Service on a bus: a handler processes frames and ticks, and returns the estimates to publish.

    handler: receiver of frames and ticks
    bus:     on which frames are received and sent
    log:     of all events; None: no log
    counts:  ticks processed, and missed
    timer:   of the ticks
    """

    def __init__(
        self, service: Service, handler: Handler, bus: Bus, log: LogWriter | None, code: int | None = None
    ) -> None:
        """Make our node, its timer, and the commissioner of the sensors; nothing is sent before `start`.

        service: settings of the machine file
        code:    that unlocks writes to our node; None: nothing is locked
        """
        self.handler, self._encoders = handler, Encoders(service.publication)
        self._timetable = timetable(service.publication, service.filters.rate_hz)
        self.bus, self.log = bus, log
        self.counts = Counts()
        self._missed = self._said_us = 0
        self.outcomes: dict[int, Outcome] = {}
        self._tell = structlog.get_logger("cylforce")
        self._verdict: int | None = None
        self.network = Network(bus.send)
        taken = {pdo.can_id for node in service.nodes for pdo in node.pdos}
        access = Access(code, taken, self.protected)
        self.node = own_node(service, self._last_verdict, self._on_peer, access, self._written)
        self.network.add_node(self.node)
        heard = self.node.heartbeats.state
        self.commissioner = Commissioner(service.nodes, self.network, heard, self._commissioned)
        self.edge = Edge(service, bus, self.node, self.commissioner.begin, self._bus_fault)
        self.timer = Timer(1.0 / service.filters.rate_hz)
        self.manager = Manager({})

    @property
    def due(self) -> tuple[int, ...]:
        """Numbers of our PDOs that are sent at this step."""
        return self._timetable[self.counts.steps % len(self._timetable)]

    def before_tick(self, t_us: int) -> None:
        """Do nothing before a tick is logged; subclasses override it."""
        return

    def after_sync(self) -> None:
        """Do nothing after a tick, when SYNC has been sent; subclasses override it."""
        return

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Join the bus and begin to step; the sensors are commissioned in parallel."""
        self.network.poll(now_us())
        self.edge.filter(frozenset(self.network.subscribers))
        self.bus.attach(loop, self.on_frame, self.on_sent)
        self.node.boot()
        self.commissioner.start()
        loop.add_reader(self.timer.fileno(), self.on_timer)

    def give_up(self, loop: asyncio.AbstractEventLoop) -> None:
        """End the steps after an error in one, and send an emergency."""
        loop.remove_reader(self.timer.fileno())
        self.node.emergencies.occur(SOFTWARE)

    async def stop(self, loop: asyncio.AbstractEventLoop) -> None:
        """Leave the bus and complete the log."""
        loop.remove_reader(self.timer.fileno())
        await self.commissioner.close()
        self.timer.close()
        self.bus.close()
        if self.log is not None:
            self.log.close()

    def on_frame(self, frame: Frame) -> None:
        """Log a frame, pass it to the handler, then to our node, which answers a command with the handler's verdict."""
        self._keep(without_code(frame, self.node.node_id))
        answer = self.handler.on_frame(frame)
        if answer is not None:
            self._verdict = answer.verdict
            say = self._tell.warning if answer.verdict else self._tell.info
            say("command", words=answer.words, abort=hex(answer.verdict))
        self.edge.on_frame(frame)
        self.network.on_frame(frame)
        self._verdict = None
        self.after_frame(frame)

    def protected(self, words: str) -> None:
        """Log an event of the lock, or a write that it refused."""
        self._tell.warning("protection", words=words)

    def _written(self, index: int, sub: int, before: bytes, after: bytes) -> None:
        """Log the change of an object by an SDO client."""
        self.protected(f"{index:04X}h:{sub} from {before[::-1].hex()}h to {after[::-1].hex()}h")

    def after_frame(self, frame: Frame) -> None:
        """Do nothing after a frame; subclasses override it."""

    def on_timer(self) -> None:
        """Log a tick, pass it to the handler and send its results; then SYNC requests the next samples.

        Missed ticks are skipped and counted.
        """
        due = self.timer.read()
        if due == 0:
            return
        late = due - 1
        self.counts = Counts(self.counts.steps + 1, self.counts.overruns + late)
        tick = Tick(self.timer.deadline_us)
        self.before_tick(tick.t_us)
        self._keep(tick)
        estimate = self.handler.on_tick(tick.t_us)
        if estimate is not None:
            for number, data in self._encoders.due(estimate, self.due):
                self.node.publish(number, data)
        self.node.produce_sync()
        self.network.poll(tick.t_us)
        self._say_overruns(late, tick.t_us)
        self._look_around(tick.t_us)
        self.after_sync()
        self._tell_manager(late)

    def _look_around(self, t_us: int) -> None:
        self.edge.look(t_us)
        if self.counts.steps % ON_TIME == 0:
            self.edge.filter(frozenset(self.network.subscribers))
            self.edge.wake(self.outcomes, t_us)

    def _bus_fault(self, words: str) -> None:
        self._tell.warning("bus", why=words)

    def _tell_manager(self, late: int) -> None:
        """Notify the watchdog of a step that was on time and whose values were sent."""
        if self.counts.steps == 1:
            self.manager.ready()
        elif not late:
            self.manager.alive()

    def _say_overruns(self, late: int, t_us: int) -> None:
        """Send an emergency at once, and a message at most once a second with all ticks missed since the last one."""
        self._missed += late
        if self._missed and not 0 <= t_us - self._said_us < OVERRUN_MESSAGES_US:
            self._tell.warning("overrun", missed=self._missed, overruns=self.counts.overruns)
            self._missed, self._said_us = 0, t_us
        if late:
            self.node.emergencies.occur(OVERRUN)
        elif self.counts.steps % ON_TIME == 0:
            self.node.emergencies.repair(OVERRUN)

    def _keep(self, event: Event | Sent) -> None:
        if self.log is not None:
            self.log.log(event)

    def on_sent(self, can_id: int, data: bytes) -> None:
        """Log a frame that was sent."""
        self._keep(Sent(now_us(), can_id, bytes(data)))

    def _last_verdict(self) -> int | None:
        return self._verdict

    def _on_peer(self, node_id: int, state: int | None) -> None:
        self._tell.info("node", node=node_id, state="silent" if state is None else state)
        self.commissioner.on_peer(node_id, state)

    def _commissioned(self, outcome: Outcome) -> None:
        self.outcomes[outcome.node.node_id] = outcome
        say = self._tell.info if outcome.stage is Stage.OPERATIONAL else self._tell.warning
        say("sensor", name=outcome.node.name, node=outcome.node.node_id, stage=outcome.stage, why=outcome.reason)


def without_code(frame: Frame, node_id: int) -> Frame:
    """Return the frame for the log, in which an unlocking code is replaced by 0."""
    if frame.can_id != SDO_REQUEST + node_id or frame.data[1:4] != _CODE or frame.data[0] & 0xE0 != 0x20:
        return frame
    return frame._replace(data=frame.data[:4] + bytes(len(frame.data) - 4))


async def serve(
    station: Station,
    until: asyncio.Event,
    look: Callable[[], None],
    every_s: float = 1.0,
    manager: Manager | None = None,
) -> bool:
    """Run until `until` is set or SIGTERM or SIGINT comes; return whether a signal came.

    An error in the step ends the run: an emergency is sent, then the error is raised here.
    look: is called every `every_s` seconds
    """
    loop, came = asyncio.get_running_loop(), asyncio.Event()
    failed: list[BaseException] = []
    station.manager = manager or station.manager

    def on_error(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        error = context.get("exception")
        if "handle" not in context or error is None:  # of a task, not of the step
            loop.default_exception_handler(context)
        elif not failed:
            failed.append(error)
            station.give_up(loop)
            until.set()

    def on_signal() -> None:
        came.set()
        until.set()

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, on_signal)
    loop.set_exception_handler(on_error)
    station.start(loop)
    gc.collect()
    gc.freeze()  # objects of the start are not collected again: this avoids pauses of tens of milliseconds
    try:
        while not until.is_set():
            try:
                await asyncio.wait_for(until.wait(), every_s)
            except TimeoutError:
                look()
    finally:
        station.manager.stopping()
        await station.stop(loop)
    if failed:
        raise failed[0]
    return came.is_set()
