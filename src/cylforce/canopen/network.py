"""canopen's Network without threads: its owner passes frames and the time to it; due messages are sent at once."""

from collections.abc import Callable, Sequence

import canopen
from canopen.network import PeriodicMessageTask

from cylforce.signals.events import EXTENDED, REMOTE, Frame

Send = Callable[[int, bytes], bool]  # (identifier, data) -> whether it was sent


class Periodic(PeriodicMessageTask):
    """A message that is sent periodically; missed periods are skipped.

    network: network on which it is sent
    can_id: identifier
    data: its data
    period: [s]
    """

    def __init__(self, network: "Network", can_id: int, data: bytes, period: float) -> None:
        self._network, self._can_id, self._data = network, can_id, bytes(data)
        self._period_us = max(1, round(period * 1e6))
        self._due_us = network.t_us + self._period_us

    def poll(self, t_us: int) -> None:
        """Send if it is due at `t_us` [us]."""
        if t_us >= self._due_us:
            self._due_us += self._period_us * ((t_us - self._due_us) // self._period_us + 1)
            self._network.send_message(self._can_id, self._data)

    def update(self, data: bytes) -> None:
        """Use other data from the next message on."""
        self._data = bytes(data)

    def stop(self) -> None:
        """Send no more messages."""
        self._network.periodic.discard(self)


class Network(canopen.Network):
    """A CANopen network on any bus, which neither waits nor reads a clock.

    Its owner passes every frame to `on_frame`, and calls `poll` at every tick.

    send: sends a frame (identifier, data); returns False when it was dropped
    t_us: time of the last frame or poll [us]
    periodic: messages that are sent periodically
    """

    def __init__(self, send: Send) -> None:
        super().__init__()
        self.unsubscribe(self.lss.LSS_RX_COBID)  # nobody reads its queue, so that it would grow without limit
        self.t_us = 0
        self.periodic: set[Periodic] = set()
        self.send = send
        self._pollers: list[Callable[[int], None]] = []  # called at each poll with its time [us]

    def on_frame(self, frame: Frame) -> None:
        """Pass identifier, data and time [s] of a frame to the subscribers of its identifier.

        Extended, remote and error frames carry flag bits in their identifier, so they have no subscribers.
        """
        self.t_us = frame.t_us
        callbacks = self.subscribers.get(frame.can_id)
        if callbacks:
            for callback in tuple(callbacks):
                callback(frame.can_id, bytearray(frame.data), frame.t_us * 1e-6)

    def notify(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Pass a frame to its subscribers, as canopen.Network; `timestamp` in seconds."""
        self.on_frame(Frame(round(timestamp * 1e6), can_id, bytes(data)))

    def poll(self, t_us: int) -> None:
        """Send the periodic messages that are due at `t_us` [us], then call the functions of `every_poll`.

        Pass the deadline of a tick rather than the later time at which it is served.
        """
        self.t_us = t_us
        for task in tuple(self.periodic):
            task.poll(t_us)
        for poll in self._pollers:
            poll(t_us)

    def every_poll(self, poll: Callable[[int], None]) -> None:
        """Call `poll(t_us)` at each poll."""
        self._pollers.append(poll)

    def send_message(self, can_id: int, data: bytes | bytearray | Sequence[int], remote: bool = False) -> None:
        """Send a message, as canopen.Network; the bus drops and counts a message that it cannot take now."""
        flags = (EXTENDED if can_id > 0x7FF else 0) | (REMOTE if remote else 0)
        self.send(can_id | flags, bytes(data))

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> Periodic:
        """Send a message with a period [s], as canopen.Network; the first one after one period."""
        task = Periodic(self, can_id | (REMOTE if remote else 0), data, period)
        self.periodic.add(task)
        return task
