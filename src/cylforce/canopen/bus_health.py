"""Report the health of the bus as emergencies: error frames of the controller, lost frames, a bus that was reopened."""

from collections.abc import Callable
from enum import IntFlag
from typing import NamedTuple

from cylforce.canopen.emergency import Emergencies
from cylforce.signals.events import ERROR, Frame

COMMUNICATION = 0x10  # bit of 1001h: communication error
REOPENED, OVERRUN, PASSIVE, RECOVERED, COLLISION = 0x8100, 0x8110, 0x8120, 0x8140, 0x8150  # EMCY codes (CiA 301)
CLEAN_US = 1_000_000  # us without the same fault after which it counts as repaired; chosen

WORDS = {
    REOPENED: "the CAN interface was away and is back",
    OVERRUN: "frames were lost: a queue was full",
    PASSIVE: "the CAN controller is error passive: check cable, termination and bit rate",
    RECOVERED: "the CAN controller was bus-off and is back",
    COLLISION: "another node sends with an identifier that is not its own",
}


class ErrorClass(IntFlag):
    """Classes of SocketCAN's error frames (linux/can/error.h), as bits of their identifier.

    CONTROLLER: state of the CAN controller; byte 1 of the data describes it
    RESTARTED:  the controller was bus-off and takes part again. Bus-off itself (0x40) is not evaluated: until the
                restart no emergency could be sent
    """

    CONTROLLER = 0x4
    RESTARTED = 0x100


# Bits of byte 1 of an error frame of class CONTROLLER: a reception or transmission queue is full; too many errors on
# reception or transmission (error passive); error active again.
_OVERFLOW, _PASSIVE, _ACTIVE = 0x03, 0x30, 0x40


class Tally(NamedTuple):
    """Totals since the start.

    lost: frames lost on reception
    dropped: frames lost on transmission
    reopened: times that the bus was opened again
    """

    lost: int = 0
    dropped: int = 0
    reopened: int = 0


class BusHealth:
    """Converts faults of the bus into emergencies.

    emergencies: emergencies of our node
    report: called with a sentence, once for each fault that occurs
    """

    def __init__(self, emergencies: Emergencies, report: Callable[[str], None]) -> None:
        self._emergencies, self._report = emergencies, report
        self._tally = Tally()  # losses and reopenings that have been reported
        self._last_us: dict[int, int] = {}  # by EMCY code the time at which the fault occurred last
        self._passive = False  # whether the controller is error passive

    def on_frame(self, frame: Frame) -> None:
        """Report the fault in an error frame; ignore any other frame."""
        if not frame.can_id & ERROR:
            return
        if frame.can_id & ErrorClass.RESTARTED:
            self._passive = False
            self._occurred(RECOVERED, frame.t_us)
        if frame.can_id & ErrorClass.CONTROLLER and len(frame.data) > 1:
            self._controller(frame.data[1], frame.t_us)

    def _controller(self, bits: int, t_us: int) -> None:
        """Report full queues and the state error passive, which lasts until the controller is error active again.

        bits: byte 1 of an error frame of class CONTROLLER
        t_us: time of the frame [us]
        """
        if bits & _OVERFLOW:
            self._occurred(OVERRUN, t_us)
        self._passive = bool(bits & _PASSIVE) or (self._passive and not bits & _ACTIVE)
        if self._passive:
            self._occurred(PASSIVE, t_us)

    def doubled(self, node_id: int, t_us: int) -> None:
        """Report at the time `t_us` [us] that another node sends with an identifier of node `node_id`."""
        self._occurred(COLLISION, t_us, bytes([node_id]))

    def update(self, tally: Tally, t_us: int) -> None:
        """Report faults by the totals that grew, and as repaired those that did not occur for CLEAN_US.

        The fault error passive is repaired CLEAN_US after that state has ended.

        tally: totals since the start
        t_us: present time [us]
        """
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
        """Store the time of a fault, and report the fault unless it is present already.

        code: EMCY code of the fault
        t_us: time at which it occurred [us]
        info: up to 5 bytes of information for the EMCY message
        """
        self._last_us[code] = t_us
        if self._emergencies.occur(code, COMMUNICATION, info):
            self._report(WORDS[code])
