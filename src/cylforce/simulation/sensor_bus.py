"""Events of a simulated run, sensor frames and ticks, as the daemon would receive them, without a bus or a clock."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.installation import SensorNode, Service
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Array
from cylforce.signals.events import Event, Frame, Tick
from cylforce.signals.identifiers import HEARTBEAT
from cylforce.signals.layout import Pdo
from cylforce.simulation.sensing import Record, Sensors, as_sent

ANSWER_US = 300  # us from SYNC to the first synchronous PDO; chosen
FRAME_US = 250  # us between two answers: a frame with 8 bytes of data at 500 kbit/s
JITTER = 0.02  # standard deviation of an event timer, times its period; chosen
OPERATIONAL = 5  # state byte of a heartbeat (CiA 301)


class Window(NamedTuple):
    """A part of the run. Its frames are sent after `begin`, up to its last instant.

    t:      (T,) instants from the start of the run [s]; the first is the last one of the part before, so that values
            between both can be interpolated
    analog: (T, S) sensor values before zero error, noise and resolution [SI]
    begin:  time after which its frames are sent, from the start of the run [s]
    """

    t: Array
    analog: Array
    begin: float


def bus_events(
    service: Service, properties: Sensors, records: Iterable[Record], start_us: int, rng: np.random.Generator
) -> Iterator[Event]:
    """Yield ticks at the service's rate and the sensors' boot-up messages, heartbeats and PDOs in order of time.

    The tick at t is the time of the SYNC to which synchronous PDOs answer: they carry the values of that time and
    arrive before the next tick. Event-timer PDOs are not synchronised and have jitter.

    properties: properties of the sensors
    records: the run, part by part, sampled at the service's rate
    start_us: time of the start of the run [us]
    rng: generator of jitter and noise
    """
    for node in service.nodes:
        yield Frame(start_us, HEARTBEAT + node.node_id, b"\x00")
    timers = [_timer(pdo, rng) for node in service.nodes for pdo in node.pdos if not pdo.synchronous]
    pending: list[Event] = []
    window: Window | None = None
    for record in records:
        window = _window(window, record)
        pending += _clocked(service, record, start_us)
        pending += _heartbeats(service.nodes, window, start_us)
        for timer in timers:
            pending += _free_running(service, properties, timer, window, start_us=start_us, rng=rng)
        pending.sort(key=lambda event: event.t_us)
        end_us = start_us + round(1e6 * float(window.t[-1]))
        yield from (event for event in pending if event.t_us <= end_us)
        pending = [event for event in pending if event.t_us > end_us]
    yield from pending


def _window(before: Window | None, record: Record) -> Window:
    """Return the part of the run that ends with a record, and begins where the part before ended; None: the first."""
    if before is None:
        return Window(t=record.t, analog=record.analog, begin=float(record.t[0]) - 1e-9)
    return Window(
        t=np.concatenate([before.t[-1:], record.t]),
        analog=np.concatenate([before.analog[-1:], record.analog]),
        begin=float(before.t[-1]),
    )


def _clocked(service: Service, record: Record, start_us: int) -> Iterator[Event]:
    """Yield ticks, each followed by the synchronous PDOs that answer its SYNC.

    record: part of the run, with times from the start of the run [s] and the values that are sent [SI]
    start_us: time of the start of the run [us]
    """
    names = [signal.name for signal in service.machine.signals]
    pdos = [pdo for node in service.nodes for pdo in node.pdos if pdo.synchronous]
    for t, row in zip(record.t.tolist(), record.values.tolist(), strict=True):
        t_us = start_us + round(1e6 * t)
        yield Tick(t_us)
        values, count = dict(zip(names, row, strict=True)), round(t * service.filters.rate_hz)
        answering = (pdo for pdo in pdos if count % max(pdo.sync, 1) == 0)
        for k, pdo in enumerate(answering):
            yield Frame(t_us + ANSWER_US + k * FRAME_US, pdo.can_id, encode(pdo, values))


def _heartbeats(nodes: tuple[SensorNode, ...], window: Window, start_us: int) -> Iterator[Event]:
    """Yield the heartbeats of all nodes in a part of the run, at whole multiples of each node's period.

    window: part of the run, with times from the start of the run [s]
    start_us: time of the start of the run [us]
    """
    for node in nodes:
        if node.heartbeat_s > 0:
            first = int(np.floor(window.begin / node.heartbeat_s)) + 1
            for k in range(first, int(np.floor(window.t[-1] / node.heartbeat_s)) + 1):
                t_us = start_us + round(1e6 * k * node.heartbeat_s)
                yield Frame(t_us, HEARTBEAT + node.node_id, bytes([OPERATIONAL]))


class _Timer:
    """An event timer that is not synchronised.

    pdo: the PDO that it sends
    due: time at which it is sent next, from the start of the run [s]
    """

    def __init__(self, pdo: Pdo, first: float) -> None:
        self.pdo, self.due = pdo, first

    def until(self, end: float, rng: np.random.Generator) -> Array:
        """Return the times (n,) [s] up to `end` [s] at which the PDO is sent, and set `due` to the next one.

        All count from the start of the run. The next call continues from there.
        """
        count = int((end - self.due) / self.pdo.period_s * 1.5) + 8
        steps = self.pdo.period_s * (1.0 + JITTER * np.clip(rng.standard_normal(count), -5.0, 5.0))
        times = self.due + np.concatenate([[0.0], np.cumsum(steps)])
        fired = times[times <= end]
        self.due = float(times[fired.size])
        return fired


def _timer(pdo: Pdo, rng: np.random.Generator) -> _Timer:
    """Return a timer with a random phase."""
    return _Timer(pdo, float(rng.uniform(0.0, pdo.period_s)))


def _free_running(
    service: Service, properties: Sensors, timer: _Timer, window: Window, *, start_us: int, rng: np.random.Generator
) -> Iterator[Event]:
    """Yield the frames of a PDO at the times of its own timer, with the sensors' values at those times.

    The timer goes on to its first time after this part of the run.

    properties: noise and resolution of the sensors
    window: part of the run, with times from the start of the run [s] and values before noise [SI]
    start_us: time of the start of the run [us]
    rng: generator of jitter and noise
    """
    times = timer.until(float(window.t[-1]), rng)
    analog = [np.interp(times, window.t, column) for column in window.analog.T]
    names = [signal.name for signal in service.machine.signals]
    for t, row in zip(times.tolist(), as_sent(properties, np.stack(analog, axis=-1), rng).tolist(), strict=True):
        yield Frame(start_us + round(1e6 * t), timer.pdo.can_id, encode(timer.pdo, dict(zip(names, row, strict=True))))
