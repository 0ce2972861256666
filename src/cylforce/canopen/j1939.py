"""The same values for displays that speak SAE J1939: Vehicle Weight (PGN 65258, cargo weight SPN 181), and a message of
our own (Proprietary B, PGN 65280) with standard error, force and qualities; totals as ISO 11783 names them (process
data, PGN 51968, DDI 428 to 431). 29-bit identifiers, so that it goes beside CANopen on one bus.

The totals go to everybody: this is no task controller's client, which would first send a description of its device.

Only a fixed address is claimed (J1939-81): whoever has the lower NAME keeps it, and the loser sends nothing more."""

from collections.abc import Callable
from math import isfinite
from struct import Struct
from typing import NamedTuple

from cylforce.service.publication import quality
from cylforce.signals.estimate import Estimate
from cylforce.signals.events import EXTENDED, REMOTE, Frame
from cylforce.signals.units import DEGREE

REQUEST, CLAIMED = 0xEA00, 0xEE00
VEHICLE_WEIGHT, OURS, PROCESS_DATA = 0xFEEA, 0xFF00, 0xCB00
# DDIs of ISO 11783-11, each a mass in kg: of a task, which is the truck here, and of the machine's life. What a bucket
# has taken up and what has left it is one number here: what is booked is what left it
LOADED, UNLOADED, LIFETIME_LOADED, LIFETIME_UNLOADED = 428, 429, 430, 431
LARGEST_TOTAL = 0x7FFFFFFF  # kg
VALUE = 0x3  # command of process data: a value, here of the device as a whole (element 0)
GLOBAL, NOBODY = 0xFF, 0xFE  # addresses: everybody; of whom that lost its own
PRIORITY = 6
SETTLE_US = 250_000  # after claiming an address, before anything else is sent (J1939-81)
LARGEST, NOT_AVAILABLE = 0xFAFF, 0xFFFF  # of two bytes
CARGO_KG, ERROR_KG, FORCE_N, ANGLE = 2.0, 0.1, 10.0, 0.01 * DEGREE
HALF_TURN = 18_000  # digits: -180 degrees are 0
CONSTRUCTION = 3  # industry group: construction equipment
_WEIGHT, _OURS, _TOTAL = Struct("<BHHHB"), Struct("<HHHBB"), Struct("<HHi")


class Claim(NamedTuple):
    """Our address: which one, our NAME, when it was claimed [us] (None: not yet), whether another node has taken it."""

    address: int
    name: int
    since_us: int | None = None
    lost: bool = False


def name_of(identity: int) -> int:
    """The NAME of J1939-81: no manufacturer code of SAE (0), function not available (FFh), `identity` of 21 bits."""
    return CONSTRUCTION << 60 | 0xFF << 40 | identity & 0x1FFFFF


def identifier(pgn: int, source: int, destination: int = GLOBAL) -> int:
    """The 29-bit identifier with SocketCAN's flag."""
    peer = destination if pgn >> 8 < 0xF0 else 0
    return EXTENDED | PRIORITY << 26 | pgn << 8 | peer << 8 | source


def filters() -> tuple[tuple[int, int], ...]:
    """Which frames `J1939.take` looks at: identifier and mask, with SocketCAN's flags; whoever is meant by them."""
    return tuple((EXTENDED | pgn << 8, EXTENDED | REMOTE | 0x3FF0000) for pgn in (REQUEST, CLAIMED))


def vehicle_weight(estimate: Estimate) -> bytes:
    """PGN 65258: axle, trailer not available; the load, net, in steps of 2 kg; a negative one is 0."""
    cargo = _digits(estimate.net.value, CARGO_KG)
    return _WEIGHT.pack(0xFF, NOT_AVAILABLE, NOT_AVAILABLE, cargo, 0xFF)


def error_and_force(estimate: Estimate) -> bytes:
    """PGN 65280: standard error of the load [0.1 kg], magnitude [10 N] and direction [0.01 deg, from -180] of the soil
    force, qualities of load and force."""
    magnitude, direction = estimate.soil.magnitude, estimate.soil.direction
    turned = _digits(direction.value, ANGLE, HALF_TURN)
    error = _digits(estimate.net.standard_error, ERROR_KG)
    return _OURS.pack(error, _digits(magnitude.value, FORCE_N), turned, quality(estimate.net), quality(magnitude))


def totals(truck: float, lifetime: float | None) -> tuple[bytes, ...]:
    """PGN 51968, a message for each DDI: mass in the open truck, and all that was ever loaded [kg] (None: not known,
    nothing is said). A negative total is 0."""
    known = {LOADED: truck, UNLOADED: truck}
    if lifetime is not None:
        known |= {LIFETIME_LOADED: lifetime, LIFETIME_UNLOADED: lifetime}
    return tuple(_TOTAL.pack(VALUE, ddi, min(max(0, round(kg)), LARGEST_TOTAL)) for ddi, kg in known.items())


def _digits(value: float, step: float, offset: int = 0) -> int:
    """Two bytes; "not available" where there is no value or too large a one."""
    if not isfinite(value):
        return NOT_AVAILABLE
    found = max(0, round(value / step) + offset)
    return found if found <= LARGEST else NOT_AVAILABLE


class J1939:
    """Our node on J1939. `send(can_id, data)` is the way out; `tell` is given a sentence when the address is lost."""

    def __init__(self, send: Callable[[int, bytes], bool], claim: Claim, tell: Callable[[str], None]) -> None:
        self._send, self._claim, self._tell = send, claim, tell

    def claim(self, t_us: int) -> None:
        """Say whose the address is; before anything else is sent."""
        self._claim = self._claim._replace(since_us=t_us)
        self._say_claim()

    def _say_claim(self) -> None:
        source = NOBODY if self._claim.lost else self._claim.address
        self._send(identifier(CLAIMED, source), self._claim.name.to_bytes(8, "little"))

    def take(self, frame: Frame) -> None:
        """A frame from the bus: a request for our address, or another node that claims it."""
        if not frame.can_id & EXTENDED or self._claim.since_us is None:
            return
        pgn, peer, source = frame.can_id >> 8 & 0x3FF00, frame.can_id >> 8 & 0xFF, frame.can_id & 0xFF
        wanted = int.from_bytes(frame.data[:3], "little")
        if pgn == REQUEST and peer in (GLOBAL, self._claim.address) and wanted == CLAIMED:
            self._say_claim()
        elif pgn == CLAIMED and source == self._claim.address and len(frame.data) == 8 and not self._claim.lost:
            self._contend(int.from_bytes(frame.data, "little"))

    def _contend(self, other: int) -> None:
        if other <= self._claim.name:
            self._claim = self._claim._replace(lost=True)
            self._tell(f"J1939 address {self._claim.address} belongs to another node: choose another j1939_address")
        self._say_claim()

    def publish(self, estimate: Estimate) -> None:
        """Send an estimate, if the address is ours."""
        if self._ours(estimate.t_us):
            self._send(identifier(VEHICLE_WEIGHT, self._claim.address), vehicle_weight(estimate))
            self._send(identifier(OURS, self._claim.address), error_and_force(estimate))

    def publish_totals(self, t_us: int, truck: float, lifetime: float | None) -> None:
        """Send the totals [kg], if the address is ours."""
        if self._ours(t_us):
            for data in totals(truck, lifetime):
                self._send(identifier(PROCESS_DATA, self._claim.address), data)

    def _ours(self, t_us: int) -> bool:
        _, _, since, lost = self._claim
        return not lost and since is not None and t_us - since >= SETTLE_US
