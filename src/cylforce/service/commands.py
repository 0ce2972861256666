"""Frames that the service acts on itself: zero and tare by SDO, NMT commands to our node, boot-up messages of
sensors."""

from typing import Literal, NamedTuple

from cylforce.signals.estimate import Quantity, Status
from cylforce.signals.events import Frame

ZERO, TARE = 0x6125, 0x6139  # CiA 404: auto-zero, auto-tare
SIGNATURES = {ZERO: (b"zero",), TARE: (b"tare", b"tara")}  # both spellings of tare are written by existing drivers
NOT_NOW = 0x08000022  # SDO abort code (CiA 301): refused because of the present device state
TOO_FAR = 0x06090030  # SDO abort code (CiA 301): value range exceeded
WRONG_VALUE = 0x06090030  # the same code: the written value is not the signature
FOUR_BYTES = (0x22, 0x23, 0x26, 0x2A, 0x2E)  # expedited download without size, or with size 4 (CiA 301)
ZERO_RANGE = 0.02  # times the rated payload: a larger zero would hide a fault; chosen


class Command(NamedTuple):
    """A zero or tare command, and the four bytes that were written: the signature, if it is right."""

    what: Literal["zero", "tare"]
    data: bytes


class Answer(NamedTuple):
    """The new (zero, tare) [kg]; the verdict: 0, or the SDO abort code; what was decided and why, in words."""

    scale: tuple[float, float]
    verdict: int
    words: str


def read(frame: Frame, node_id: int) -> Command | None:
    """The command in an expedited SDO download of 4 bytes to 6125h:1 or 6139h:1 of our node; None for any other frame.
    A download of another length is refused by the SDO server itself."""
    if frame.can_id != 0x600 + node_id or len(frame.data) != 8 or frame.data[0] & 0xEF not in FOUR_BYTES:
        return None
    index = frame.data[1] | frame.data[2] << 8
    if index not in SIGNATURES or frame.data[3] != 1:
        return None
    return Command("zero" if index == ZERO else "tare", frame.data[4:8])


def obey(command: Command, scale: tuple[float, float], mass: Quantity, rated: float) -> Answer:
    """What a command does: `scale` is (zero, tare) [kg] so far, `mass` the present load before zero and tare, `rated`
    the rated payload [kg]. Refused unless the status of the weight is OK; a zero also if it is too large."""
    zero, _ = scale
    what, limit = command.what, ZERO_RANGE * rated
    if command.data not in SIGNATURES[ZERO if what == "zero" else TARE]:
        words = f"the four bytes written must be the word {what}, not {command.data!r}"
        return Answer(scale, WRONG_VALUE, f"{what} refused: {words}")
    if mass.status is not Status.OK:
        reason = mass.reason.name.lower().replace("_", " ")
        words = f"the weight must be OK, and it is {mass.status.name.lower()} ({reason})"
        return Answer(scale, NOT_NOW, f"{what} refused: {words}")
    if what == "tare":
        return Answer((zero, mass.value - zero), 0, f"tare set to {mass.value - zero:.1f} kg")
    if abs(mass.value) > limit:
        words = (
            f"the weight is {mass.value:.1f} kg, the limit +-{limit:.1f} kg ({100 * ZERO_RANGE:.0f} % of rated payload)"
        )
        return Answer(scale, TOO_FAR, f"zero refused: {words}: empty the tool, or find what else is wrong")
    return Answer((mass.value, 0.0), 0, f"zero set to {mass.value:.1f} kg, tare to 0.0 kg")


def stopped(frame: Frame, node_id: int) -> bool | None:
    """True for an NMT command that stops our node (it then answers no SDO, and commands have no effect), False for one
    that starts or resets it, None for any other frame."""
    if frame.can_id != 0 or len(frame.data) != 2 or frame.data[1] not in (0, node_id):
        return None
    return {1: False, 2: True, 128: False, 129: False, 130: False}.get(frame.data[0])


def booted(frame: Frame) -> int | None:
    """Id of the node whose boot-up message this is; None for any other frame."""
    if 0x700 < frame.can_id < 0x780 and frame.data == b"\0":
        return frame.can_id - 0x700
    return None
