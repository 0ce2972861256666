"""Frames on which the service itself acts.

They are zero, tare, tool and the truck's commands by SDO, NMT commands to our node, and boot-up messages of sensors."""

from dataclasses import dataclass
from typing import Literal

from cylforce.service.loading.truck import (
    DONE,
    LARGEST_TARGET,
    NOT_NOW,
    OUT_OF_RANGE,
    Ruling,
    Truck,
    add_bucket,
    next_part,
    next_truck,
    set_accepted,
    set_product,
    set_target,
    set_trailer_target,
)
from cylforce.signals.estimate import Booking, Quantity, Status
from cylforce.signals.events import Frame
from cylforce.signals.identifiers import HEARTBEAT, SDO_REQUEST

ZERO, TARE = 0x6125, 0x6139  # CiA 404: auto-zero, auto-tare
SIGNATURES = {ZERO: (b"zero",), TARE: (b"tare", b"tara")}  # both spellings of tare are written by existing drivers
LOADING = 0x2190  # ours: the truck that is being loaded
TARGET, PRODUCT, NEXT, CANCEL, ACCEPT = 1, 2, 3, 4, 5  # its sub-indices that are commands
NEXT_WORD = b"next"
TOOL = 12  # the sub-index that chooses a tool by its number
ADD = 13  # the one that adds a bucket by hand
PART, TRAILER = 14, 15  # the sub-indices that begin the next part of the truck (its trailer), and set its target
COMMANDS = (TARGET, PRODUCT, NEXT, CANCEL, ACCEPT, ADD, PART, TRAILER)
KG = 0.1  # kg, of the target's integer
WRONG_VALUE = 0x06090030  # SDO abort code as OUT_OF_RANGE: the written value is not the signature
FOUR_BYTES = (0x22, 0x23, 0x26, 0x2A, 0x2E)  # expedited download without size, or with size 4 (CiA 301)
ZERO_RANGE = 0.02  # times the rated payload: a larger zero would hide a fault; chosen


@dataclass(frozen=True, slots=True)
class ScaleCommand:
    """Zero or tare command.

    what: "zero" or "tare"
    data: the four bytes that were written; valid if they are the signature
    """

    what: Literal["zero", "tare"]
    data: bytes


@dataclass(frozen=True, slots=True)
class LoadingCommand:
    """Command about the truck.

    sub:  sub-index of LOADING
    data: the four bytes that were written
    """

    sub: int
    data: bytes


@dataclass(frozen=True, slots=True)
class ToolCommand:
    """Command that another tool is on the machine.

    number: of the tool
    """

    number: int


Command = ScaleCommand | LoadingCommand | ToolCommand


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to a command.

    verdict: 0: done; else the SDO abort code
    words:   the decision and its reason, for a person
    """

    verdict: int
    words: str


@dataclass(frozen=True, slots=True)
class Scale:
    """The operator's zero and tare.

    zero: [kg]
    tare: [kg]
    """

    zero: float = 0.0
    tare: float = 0.0


NO_SCALE = Scale()


def read(frame: Frame, node_id: int) -> Command | None:
    """Return the command in an SDO download to our node; None for any other frame.

    Commands are expedited downloads of 4 bytes to 6125h:1 (zero), 6139h:1 (tare) or 2190h:1 to 5, 12 to 15 (truck,
    tool). The SDO server itself refuses a download of another length.

    node_id: of our node
    """
    if frame.can_id != SDO_REQUEST + node_id or len(frame.data) != 8 or frame.data[0] & 0xEF not in FOUR_BYTES:
        return None
    index = frame.data[1] | frame.data[2] << 8
    if index == LOADING and frame.data[3] in COMMANDS:
        return LoadingCommand(frame.data[3], frame.data[4:8])
    if index == LOADING and frame.data[3] == TOOL:
        return ToolCommand(int.from_bytes(frame.data[4:8], "little"))
    if index not in SIGNATURES or frame.data[3] != 1:
        return None
    return ScaleCommand("zero" if index == ZERO else "tare", frame.data[4:8])


def obey(command: ScaleCommand, scale: Scale, mass: Quantity, rated: float) -> tuple[Scale, Answer]:
    """Return the operator's zero and tare [kg] after a zero or tare command, and its answer.

    "zero" sets the zero to the present load, and the tare to 0; "tare" sets the tare to the present load less the zero.
    A command is refused unless the status of the weight is OK; a zero also beyond ZERO_RANGE rated payloads. A refused
    command changes neither zero nor tare.

    command: "zero" or "tare", and the four bytes written, which must be the signature
    scale:   before the command
    mass:    present load before zero and tare [kg]
    rated:   rated payload [kg]
    """
    what, limit = command.what, ZERO_RANGE * rated
    if command.data not in SIGNATURES[ZERO if what == "zero" else TARE]:
        words = f"the four bytes written must be the word {what}, not {command.data!r}"
        return scale, Answer(WRONG_VALUE, f"{what} refused: {words}")
    if mass.status is not Status.OK:
        reason = mass.reason.name.lower().replace("_", " ")
        words = f"the weight must be OK, and it is {mass.status.name.lower()} ({reason})"
        return scale, Answer(NOT_NOW, f"{what} refused: {words}")
    if what == "tare":
        tare = mass.value - scale.zero
        return Scale(scale.zero, tare), Answer(DONE, f"tare set to {tare:.1f} kg")
    if abs(mass.value) > limit:
        words = (
            f"the weight is {mass.value:.1f} kg, the limit +-{limit:.1f} kg ({100 * ZERO_RANGE:.0f} % of rated payload)"
        )
        return scale, Answer(OUT_OF_RANGE, f"zero refused: {words}: empty the tool, or find what else is wrong")
    return Scale(mass.value), Answer(DONE, f"zero set to {mass.value:.1f} kg, tare to 0.0 kg")


def obey_loading(command: LoadingCommand, truck: Truck) -> Ruling:
    """Return the truck after a command about it, and the answer. A refused command leaves the truck unchanged.

    All integers are little-endian. By sub-index, the four bytes are:

    TARGET:         target of the present part of the truck, a signed integer of KG = 0.1 kg
    TRAILER:        target of the next part, likewise
    PRODUCT:        unsigned number of the product
    CANCEL, ACCEPT: unsigned number of the booking of the bucket that no longer counts, or counts again
    NEXT:           the word `next`: close this truck, open an empty one
    PART:           the word `next`: begin the next part of this truck, its trailer or its space for another product

    command: with one of these sub-indices; ADD is handled by `book_by_hand`
    truck:   before the command
    """
    number = int.from_bytes(command.data, "little", signed=command.sub in (TARGET, TRAILER))
    if command.sub == TARGET:
        return set_target(truck, KG * number)
    if command.sub == TRAILER:
        return set_trailer_target(truck, KG * number)
    if command.sub == PRODUCT:
        return set_product(truck, number)
    if command.sub in (CANCEL, ACCEPT):
        return set_accepted(truck, number, command.sub == ACCEPT)
    if command.data == NEXT_WORD:
        return next_truck(truck) if command.sub == NEXT else next_part(truck)
    what = "truck" if command.sub == NEXT else "part"
    words = f"next {what} refused: the four bytes written must be the word next, not {command.data!r}"
    return Ruling(truck, WRONG_VALUE, words)


def chosen_tool(number: int, tools: tuple[str, ...], present: str) -> tuple[str, Answer]:
    """Return the name of the tool with a number, and the answer.

    A number without a tool is refused: the name of the present tool is returned. Choosing the present tool again has no
    effect.

    number:  of the tool
    tools:   names of all tools, by number
    present: name of the present tool
    """
    if number >= len(tools):
        known = ", ".join(f"{k} {name}" for k, name in enumerate(tools))
        return present, Answer(OUT_OF_RANGE, f"attachment refused: {number} is none of {known}")
    if tools[number] == present:
        return present, Answer(DONE, f"attachment {present} is chosen already")
    return tools[number], Answer(DONE, f"attachment {tools[number]} chosen: zero and tare are 0")


def book_by_hand(data: bytes, last: Booking | None, t_us: int, truck: Truck) -> tuple[Booking | None, Ruling]:
    """Return the booking by hand of a bucket that was not weighed, and the ruling with the truck after it.

    The whole mass counts as dumped, without standard errors, and no tare is subtracted from it. A mass that is not
    above 0, or exceeds LARGEST_TARGET [kg], is refused: there is no booking (None), and the truck is unchanged.

    data:  the four bytes that were written: the mass as a signed little-endian integer of KG = 0.1 kg
    last:  last booking, after which this one is numbered; None: none yet
    t_us:  time [us]
    truck: before the booking
    """
    mass, most = KG * int.from_bytes(data, "little", signed=True), LARGEST_TARGET
    if not 0.0 < mass <= most:
        return None, Ruling(
            truck, OUT_OF_RANGE, f"bucket by hand refused: {mass:.1f} kg is not above 0 to {most:.0f} kg"
        )
    number = last.number + 1 if last else 1
    made = Booking(
        number,
        t_us,
        mass,
        standard_error=0.0,
        carry_back=0.0,
        carry_back_error=0.0,
        dumped=mass,
        dumped_error=0.0,
        by_hand=True,
    )
    return made, Ruling(add_bucket(truck, made, 0.0), DONE, f"booking {number} by hand: {mass:.1f} kg")


def stopped(frame: Frame, node_id: int) -> bool | None:
    """Return True for an NMT command that stops our node, False for another NMT command to it, None for another frame.

    The other commands start or reset the node, or make it pre-operational. A stopped node answers no SDO, and commands
    have no effect.

    frame:   any frame; an NMT command has the identifier 0 and two bytes: command, and node id or 0 for all nodes
    node_id: of our node
    """
    if frame.can_id != 0 or len(frame.data) != 2 or frame.data[1] not in (0, node_id):
        return None
    return {1: False, 2: True, 128: False, 129: False, 130: False}.get(frame.data[0])


def booted(frame: Frame) -> int | None:
    """Return the id of the node whose boot-up message this is; None for any other frame."""
    if HEARTBEAT < frame.can_id < HEARTBEAT + 0x80 and frame.data == b"\0":
        return frame.can_id - HEARTBEAT
    return None
