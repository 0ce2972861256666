"""Send the estimates to displays that use SAE J1939.

Messages: Vehicle Weight (PGN 65258, cargo weight SPN 181); a proprietary message (Proprietary B, PGN 65280) with
    standard error, force and qualities; totals as ISO 11783 names them (process data, PGN 51968, DDI 428 to 431). Their
    identifiers have 29 bits, so that they share one bus with CANopen. The totals are broadcast: this is no client of a
    task controller, which would first send a description of its device.

Only a fixed address is claimed (J1939-81): the node with the lower NAME keeps it, and the other one sends nothing more.
"""

from collections.abc import Callable
from math import isfinite
from struct import Struct
from typing import NamedTuple

from cylforce.service.published_values import quality
from cylforce.signals.estimate import Estimate
from cylforce.signals.events import EXTENDED, REMOTE, Frame
from cylforce.signals.units import DEGREE

REQUEST, CLAIMED = 0xEA00, 0xEE00  # PGNs: request, address claimed
VEHICLE_WEIGHT, OURS, PROCESS_DATA = 0xFEEA, 0xFF00, 0xCB00  # PGNs of the messages that are sent
# DDIs of ISO 11783-11, each a mass in kg: of a task, which is the truck here, and of the machine's life. Loaded and
# unloaded mass are equal here: a booking is the mass that left the bucket.
LOADED, UNLOADED, LIFETIME_LOADED, LIFETIME_UNLOADED = 428, 429, 430, 431
LARGEST_TOTAL = 0x7FFFFFFF  # kg, largest INTEGER32
VALUE = 0x3  # command of process data: a value, here of the device as a whole (element 0)
GLOBAL, NOBODY = 0xFF, 0xFE  # addresses: everybody; a node that lost its own
PRIORITY = 6  # of J1939-71 for such messages
SETTLE_US = 250_000  # us after claiming an address before anything else is sent (J1939-81)
LARGEST, NOT_AVAILABLE = 0xFAFF, 0xFFFF  # largest value of two bytes, and "not available" (J1939-71)
CARGO_KG, ERROR_KG, FORCE_N, ANGLE = 2.0, 0.1, 10.0, 0.01 * DEGREE  # resolutions, angle in rad
HALF_TURN = 18_000  # offset of the direction: -180 degrees are sent as 0
CONSTRUCTION = 3  # industry group: construction equipment
_WEIGHT, _OURS, _TOTAL = Struct("<BHHHB"), Struct("<HHHBB"), Struct("<HHi")


class Claim(NamedTuple):
    """Our claim of an address.

    address: our address
    name: our NAME, a number of 64 bits
    since_us: time at which it was claimed [us]; None: not yet
    lost: whether another node has taken it
    """

    address: int
    name: int
    since_us: int | None = None
    lost: bool = False


def name_of(identity: int) -> int:
    """Return the NAME of J1939-81 for an identity of 21 bits.

    Manufacturer code 0 (none of SAE), function FFh (not available).
    """
    return CONSTRUCTION << 60 | 0xFF << 40 | identity & 0x1FFFFF


def identifier(pgn: int, source: int, destination: int = GLOBAL) -> int:
    """Return the 29-bit identifier of a message, with SocketCAN's flag.

    source: address of the sender
    destination: address of the receiver; without effect for PGNs of F000h and more, which are always broadcast
    """
    peer = destination if pgn >> 8 < 0xF0 else 0
    return EXTENDED | PRIORITY << 26 | pgn << 8 | peer << 8 | source


def filters() -> tuple[tuple[int, int], ...]:
    """Return identifier and mask, with SocketCAN's flags, of the frames that `J1939.on_frame` processes."""
    return tuple((EXTENDED | pgn << 8, EXTENDED | REMOTE | 0x3FF0000) for pgn in (REQUEST, CLAIMED))


def vehicle_weight(estimate: Estimate) -> bytes:
    """Return the data (8 bytes) of PGN 65258: the net load in steps of 2 kg, a negative one as 0.

    Axle and trailer are not available.
    """
    cargo = _digits(estimate.net.value, CARGO_KG)
    return _WEIGHT.pack(0xFF, NOT_AVAILABLE, NOT_AVAILABLE, cargo, 0xFF)


def error_and_force(estimate: Estimate) -> bytes:
    """Return the data (8 bytes) of PGN 65280.

    It contains, in this order, the standard error of the net load [0.1 kg], the soil force's magnitude [10 N] and
    direction [0.01 deg, from -180], and the quality bytes of net load and magnitude.
    """
    magnitude, direction = estimate.soil.magnitude, estimate.soil.direction
    turned = _digits(direction.value, ANGLE, HALF_TURN)
    error = _digits(estimate.net.standard_error, ERROR_KG)
    return _OURS.pack(error, _digits(magnitude.value, FORCE_N), turned, quality(estimate.net), quality(magnitude))


def totals(truck: float, lifetime: float | None) -> tuple[bytes, ...]:
    """Return the data (8 bytes) of PGN 51968, a message for each DDI; a negative total is sent as 0.

    Each total is sent twice, as loaded and as unloaded mass.

    truck: mass in the open truck [kg]
    lifetime: mass of all loads ever [kg]; None: unknown, nothing is sent
    """
    known = {LOADED: truck, UNLOADED: truck}
    if lifetime is not None:
        known |= {LIFETIME_LOADED: lifetime, LIFETIME_UNLOADED: lifetime}
    return tuple(_TOTAL.pack(VALUE, ddi, min(max(0, round(kg)), LARGEST_TOTAL)) for ddi, kg in known.items())


def _digits(value: float, step: float, offset: int = 0) -> int:
    """Return a value in steps, as two bytes carry it: round(value / step) + offset, at least 0.

    NaN, infinity and too large a value give "not available".

    value: in the unit of `step`
    offset: added number of steps
    """
    if not isfinite(value):
        return NOT_AVAILABLE
    digits = max(0, round(value / step) + offset)
    return digits if digits <= LARGEST else NOT_AVAILABLE


class J1939:
    """Our node on J1939.

    send: sends a frame (identifier, data)
    claim: address and NAME to claim
    report: called with a sentence when the address is lost
    """

    def __init__(self, send: Callable[[int, bytes], bool], claim: Claim, report: Callable[[str], None]) -> None:
        self._send, self._claim, self._report = send, claim, report

    def claim(self, t_us: int) -> None:
        """Claim the address at the time `t_us` [us], before anything else is sent."""
        self._claim = self._claim._replace(since_us=t_us)
        self._send_claim()

    def _send_claim(self) -> None:
        """Send "address claimed", or "cannot claim" once the address is lost."""
        source = NOBODY if self._claim.lost else self._claim.address
        self._send(identifier(CLAIMED, source), self._claim.name.to_bytes(8, "little"))

    def on_frame(self, frame: Frame) -> None:
        """Answer a request for our address, and contend with another node that claims it.

        Any other frame is ignored, and every frame before `claim`.
        """
        if not frame.can_id & EXTENDED or self._claim.since_us is None:
            return
        pgn, peer, source = frame.can_id >> 8 & 0x3FF00, frame.can_id >> 8 & 0xFF, frame.can_id & 0xFF
        wanted = int.from_bytes(frame.data[:3], "little")
        if pgn == REQUEST and peer in (GLOBAL, self._claim.address) and wanted == CLAIMED:
            self._send_claim()
        elif pgn == CLAIMED and source == self._claim.address and len(frame.data) == 8 and not self._claim.lost:
            self._contend(int.from_bytes(frame.data, "little"))

    def _contend(self, other: int) -> None:
        """Keep the address, or lose it to a node whose NAME `other` is not higher than ours; send the result."""
        if other <= self._claim.name:
            self._claim = self._claim._replace(lost=True)
            self._report(f"J1939 address {self._claim.address} belongs to another node: choose another j1939_address")
        self._send_claim()

    def publish(self, estimate: Estimate) -> None:
        """Send an estimate, if the address is ours."""
        if self._ours(estimate.t_us):
            self._send(identifier(VEHICLE_WEIGHT, self._claim.address), vehicle_weight(estimate))
            self._send(identifier(OURS, self._claim.address), error_and_force(estimate))

    def publish_totals(self, t_us: int, truck: float, lifetime: float | None) -> None:
        """Send the totals of truck and lifetime [kg] (`totals`), if the address is ours at the time `t_us` [us]."""
        if self._ours(t_us):
            for data in totals(truck, lifetime):
                self._send(identifier(PROCESS_DATA, self._claim.address), data)

    def _ours(self, t_us: int) -> bool:
        """Return whether at the time `t_us` [us] the address was claimed SETTLE_US ago or more, and not lost."""
        since_us = self._claim.since_us
        return not self._claim.lost and since_us is not None and t_us - since_us >= SETTLE_US
