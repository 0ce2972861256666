"""The service as a daemon on a bus, beside sensors that answer each of its SYNCs with the next row of a recording."""

import asyncio
from collections.abc import Callable
from itertools import groupby

from cylforce.can.opening import open_bus
from cylforce.files.recording import as_frames
from cylforce.files.tables import Table
from cylforce.mechanics.installation import Service
from cylforce.programs.live.station import serve
from cylforce.programs.run import Daemon
from cylforce.signals.events import Frame

SYNC, EXACT = 0x80, 0x7FF


class Sensors:
    """The sensors of a machine on a bus: rows of frames, again and again. They answer no SDO."""

    def __init__(self, name: str, service: Service, table: Table) -> None:
        pdos = [pdo for node in service.nodes for pdo in node.pdos]
        frames = groupby(as_frames(table, pdos), key=lambda frame: frame.t_us)
        self._rows = [[(frame.can_id, frame.data) for frame in row] for _, row in frames]
        self._bus, self._asked = open_bus(name), 0
        self._bus.accept([(SYNC, EXACT)])

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Answer from now on."""
        self._bus.attach(loop, self._answer)

    def _answer(self, frame: Frame) -> None:
        if frame.can_id == SYNC:
            for can_id, data in self._rows[self._asked % len(self._rows)]:
                self._bus.send(can_id, data)
            self._asked += 1

    def close(self) -> None:
        """Leave the bus."""
        self._bus.close()


async def served(daemon: Daemon, sensors: Sensors, seconds: float, look: Callable[[], None], every_s: float) -> None:
    """Both for so many seconds; meanwhile `look` every so often."""
    loop, until = asyncio.get_running_loop(), asyncio.Event()
    loop.call_later(seconds, until.set)
    sensors.start(loop)
    await serve(daemon, until, look, every_s)
    sensors.close()
