"""canopen's Network without threads: its owner passes frames and the time to it; what is due is sent at once."""

from collections.abc import Callable, Sequence

import canopen
from canopen.network import PeriodicMessageTask

from cylforce.signals.events import EXTENDED, REMOTE, Frame

Send = Callable[[int, bytes], bool]


class Periodic(PeriodicMessageTask):
    """A message that is sent every `period` seconds; missed periods are skipped."""

    def __init__(self, network: "Network", can_id: int, data: bytes, period: float) -> None:
        self._network, self._can_id, self._data = network, can_id, bytes(data)
        self._period_us = max(1, round(period * 1e6))
        self._due_us = network.t_us + self._period_us

    def poll(self, t_us: int) -> None:
        """Send if due at `t_us`."""
        if t_us >= self._due_us:
            self._due_us += self._period_us * ((t_us - self._due_us) // self._period_us + 1)
            self._network.send_message(self._can_id, self._data)

    def update(self, data: bytes) -> None:
        """Other data from the next message on."""
        self._data = bytes(data)

    def stop(self) -> None:
        """No more messages."""
        self._network.periodic.discard(self)


class Network(canopen.Network):
    """A CANopen network on any bus: `send(can_id, data)` is the way out, `on_frame` the way in, `poll` the
    clock.

    `t_us` is the time of the last frame or poll. Nothing here waits, and nothing reads a clock."""

    def __init__(self, send: Send) -> None:
        super().__init__()
        self.unsubscribe(self.lss.LSS_RX_COBID)  # its queue, which nothing reads, would grow without limit
        self.t_us = 0
        self.periodic: set[Periodic] = set()
        self.send = send
        self._pollers: list[Callable[[int], None]] = []

    def on_frame(self, frame: Frame) -> None:
        """Pass a frame to its subscribers; extended, remote and error frames carry flag bits, so they have none."""
        self.t_us = frame.t_us
        callbacks = self.subscribers.get(frame.can_id)
        if callbacks:
            for callback in tuple(callbacks):
                callback(frame.can_id, bytearray(frame.data), frame.t_us * 1e-6)

    def notify(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """See canopen.Network; `timestamp` in seconds."""
        self.on_frame(Frame(round(timestamp * 1e6), can_id, bytes(data)))

    def poll(self, t_us: int) -> None:
        """Do all that is due at `t_us`. Pass the deadline of a tick rather than the later time at which it is
        served."""
        self.t_us = t_us
        for task in tuple(self.periodic):
            task.poll(t_us)
        for poll in self._pollers:
            poll(t_us)

    def every_poll(self, poll: Callable[[int], None]) -> None:
        """Call `poll(t_us)` at each poll."""
        self._pollers.append(poll)

    def send_message(self, can_id: int, data: bytes | bytearray | Sequence[int], remote: bool = False) -> None:
        """See canopen.Network; a message that the bus cannot take now is dropped and counted there."""
        flags = (EXTENDED if can_id > 0x7FF else 0) | (REMOTE if remote else 0)
        self.send(can_id | flags, bytes(data))

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> Periodic:
        """See canopen.Network; the first message goes out after one period."""
        task = Periodic(self, can_id | (REMOTE if remote else 0), data, period)
        self.periodic.add(task)
        return task
