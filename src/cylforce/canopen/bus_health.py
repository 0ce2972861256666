"""The health of the bus itself as emergencies: error frames of the controller, frames lost on the way in or out, a bus
that was opened again."""

from collections.abc import Callable
from enum import IntFlag
from typing import NamedTuple

from cylforce.canopen.emergency import Emergencies
from cylforce.signals.events import ERROR, Frame

COMMUNICATION = 0x10  # bit of 1001h
REOPENED, OVERRUN, PASSIVE, RECOVERED, COLLISION = 0x8100, 0x8110, 0x8120, 0x8140, 0x8150  # EMCY codes (CiA 301)
CLEAN_US = 1_000_000  # without the same fault, after which it counts as repaired; chosen

WORDS = {
    REOPENED: "the CAN interface was away and is back",
    OVERRUN: "frames were lost: a queue was full",
    PASSIVE: "the CAN controller is error passive: check cable, termination and bit rate",
    RECOVERED: "the CAN controller was bus-off and is back",
    COLLISION: "another node sends with an identifier that is not its own",
}


class Kind(IntFlag):
    """Classes of SocketCAN's error frames (linux/can/error.h)."""

    CONTROLLER = 0x4
    BUS_OFF = 0x40
    RESTARTED = 0x100


_OVERFLOW, _PASSIVE, _ACTIVE = 0x03, 0x30, 0x40  # bits of byte 1: queue full either way, error passive, active again


class Tally(NamedTuple):
    """Totals since the start: frames lost on the way in and out, times that the bus was opened again."""

    lost: int = 0
    dropped: int = 0
    reopened: int = 0


class BusHealth:
    """Turns what happens to the bus into emergencies. `tell(words)` is called once for each that occurs."""

    def __init__(self, emergencies: Emergencies, tell: Callable[[str], None]) -> None:
        self._emergencies, self._tell = emergencies, tell
        self._tally = Tally()
        self._last_us: dict[int, int] = {}
        self._passive = False

    def on_frame(self, frame: Frame) -> None:
        """An error frame; any other is ignored."""
        if not frame.can_id & ERROR:
            return
        kinds = Kind(frame.can_id & (Kind.CONTROLLER | Kind.BUS_OFF | Kind.RESTARTED))
        if Kind.RESTARTED in kinds:
            self._passive = False
            self._occurred(RECOVERED, frame.t_us)
        if Kind.CONTROLLER in kinds and len(frame.data) > 1:
            self._controller(frame.data[1], frame.t_us)

    def _controller(self, bits: int, t_us: int) -> None:
        if bits & _OVERFLOW:
            self._occurred(OVERRUN, t_us)
        self._passive = bool(bits & _PASSIVE) or (self._passive and not bits & _ACTIVE)
        if self._passive:
            self._occurred(PASSIVE, t_us)

    def doubled(self, node_id: int, t_us: int) -> None:
        """Node `node_id`'s identifier is sent by another one, too."""
        self._occurred(COLLISION, t_us, bytes([node_id]))

    def look(self, tally: Tally, t_us: int) -> None:
        """The totals now: what grew is an emergency; what has not come for a second is repaired."""
        if tally.reopened > self._tally.reopened:
            self._occurred(REOPENED, t_us)
        if tally.lost > self._tally.lost or tally.dropped > self._tally.dropped:
            self._occurred(OVERRUN, t_us)
        self._tally = tally
        if self._passive:
            self._last_us[PASSIVE] = t_us
        for code, last_us in tuple(self._last_us.items()):
            if not 0 <= t_us - last_us < CLEAN_US:
                del self._last_us[code]
                self._emergencies.repair(code)

    def _occurred(self, code: int, t_us: int, info: bytes = b"") -> None:
        self._last_us[code] = t_us
        if self._emergencies.occur(code, COMMUNICATION, info):
            self._tell(WORDS[code])
