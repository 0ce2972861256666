"""The operator's panel: sends commands to the service by SDO, and reads the state of the truck by SDO."""

import asyncio
from collections import deque
from struct import pack
from typing import Any, NamedTuple

from cylforce.canopen.dictionary.object_dictionary import (
    COUNT,
    IN_PART,
    JOINTS,
    LAST,
    PART_NUMBER,
    RECORDED,
    RECORDS,
    TOTAL,
    TRUCK,
    UNEXPLAINED,
)
from cylforce.canopen.network import Network
from cylforce.canopen.sdo_client import AbortedError, Client, SdoError
from cylforce.service import commands
from cylforce.signals.layout import not_available

EVERY_S = 1.0  # s between two readings; chosen
SOON_S = 0.05  # s from a command to the next reading: the service shows its effect at its next step; chosen
KEPT = 8  # last buckets that are shown; chosen
KG = commands.KG
FIELDS = (  # sub-index and type of the fields of TruckState, in their order
    (TRUCK, "I"),
    (TOTAL, "i"),
    (COUNT, "I"),
    (LAST, "I"),
    (RECORDED, "I"),
    (commands.PRODUCT, "I"),
    (commands.TARGET, "i"),
    (RECORDS, "B"),
    (commands.TOOL, "I"),
    (IN_PART, "i"),
    (PART_NUMBER, "I"),
    (commands.TRAILER, "i"),
)
NOT_KNOWN, NO_ANSWER = "unknown", "no answer"


class TruckState(NamedTuple):
    """The truck in the service.

    number: number of the truck
    total: mass in it [kg]
    filled: number of buckets in it
    last: number of the last booking
    recorded: number of the last booking on disk
    product: number of the product
    target: target of the truck, or of its part [kg]
    records: state of the records
    tool: number of the tool
    in_part: mass in the present part [kg]; None: as in the truck
    part: number of the part
    trailer: target of the trailer [kg]
    unexplained: residual torque of the first measured joints [N m]; None: unknown
    """

    number: int
    total: float
    filled: int
    last: int
    recorded: int
    product: int
    target: float
    records: int
    tool: int = 0
    in_part: float | None = None
    part: int = 1
    trailer: float = 0.0
    unexplained: tuple[float | None, ...] = ()

    @property
    def loaded(self) -> float:
        """Return the mass that counts for the target [kg]."""
        return self.total if self.in_part is None else self.in_part


class ListedBucket(NamedTuple):
    """A bucket that was booked while the display ran.

    number: number of the booking
    mass: mass that the truck got [kg]
    """

    number: int
    mass: float


class Reply(NamedTuple):
    """The answer to a command.

    done: whether it was done
    why: otherwise the SDO abort code, or the reason in one word
    """

    done: bool
    why: str = ""


class Loading:
    """State of the truck at the last reading.

    known: its state; None before the service has answered, or when it no longer does
    buckets: the last buckets
    """

    def __init__(self) -> None:
        self.known: TruckState | None = None
        self.buckets: deque[ListedBucket] = deque(maxlen=KEPT)

    def update(self, known: TruckState | None) -> None:
        """Store a new state; one more bucket in the same truck is listed with its mass."""
        before, self.known = self.known, known
        if before is None or known is None or known.number != before.number:
            return
        if known.last != before.last and known.filled == before.filled + 1:
            self.buckets.append(ListedBucket(known.last, known.total - before.total))


class Panel:
    """Communicates with the service, one transfer at a time.

    network: network on which the service is
    node_id: number of its node
    joints: number of measured joints of the machine
    loading: the truck as it was read last
    """

    def __init__(self, network: Network, node_id: int, joints: int = 0) -> None:
        self._client, self._joints = Client(network, node_id), joints
        self.loading = Loading()
        self._soon = asyncio.Event()

    async def follow(self) -> None:
        """Read the state of the truck, every second and after each command, until cancelled."""
        while True:
            self._soon.clear()  # before reading: a command that comes meanwhile causes one more reading
            self.loading.update(await self.read())
            try:
                await asyncio.wait_for(self._soon.wait(), EVERY_S)
            except TimeoutError:
                continue

    async def read(self) -> TruckState | None:
        """Return the state of the truck; None without an answer."""
        try:
            fields: list[Any] = [await self._client.read(commands.LOADING, sub, kind) for sub, kind in FIELDS]
            torques = [await self._client.read(UNEXPLAINED, k + 1, "i") for k in range(min(self._joints, JOINTS))]
        except SdoError:
            return None
        masses = ("total", "target", "in_part", "trailer")
        unexplained = tuple(None if torque == not_available("i") else float(torque) for torque in torques)
        state = TruckState(*fields)
        kg = {name: KG * getattr(state, name) for name in masses}
        return state._replace(unexplained=unexplained, **kg)

    async def send_command(self, what: str, value: float | None) -> Reply:
        """Send a command; return whether it was done.

        what: name of the command
        value: its number; None for a command without one
        """
        request = command_request(what, value)
        if request is None:
            return Reply(done=False, why=NOT_KNOWN)
        index, sub, data = request
        try:
            await self._client.download(index, sub, data)
        except AbortedError as error:
            return Reply(done=False, why=f"{error.code:08X}")
        except SdoError:
            return Reply(done=False, why=NO_ANSWER)
        asyncio.get_running_loop().call_later(SOON_S, self._soon.set)
        return Reply(done=True)


def command_request(what: str, value: float | None) -> tuple[int, int, bytes] | None:
    """Return index, sub-index and data of a command; None where it is invalid.

    It is invalid if its name is unknown, or if its number is missing, outside its range or, where it names something,
    not whole.
    """
    fixed = {
        "zero": (commands.ZERO, 1, b"zero"),
        "tare": (commands.TARE, 1, b"tare"),
        "next": (commands.LOADING, commands.NEXT, commands.NEXT_WORD),
        "part": (commands.LOADING, commands.PART, commands.NEXT_WORD),
    }
    numbers = {"product": commands.PRODUCT, "cancel": commands.CANCEL, "accept": commands.ACCEPT}
    numbers["attachment"] = commands.TOOL
    if what in fixed:
        return fixed[what]
    if value is None:
        return None
    masses = {"target": commands.TARGET, "trailer": commands.TRAILER, "add": commands.ADD}
    if what in masses and abs(value) < 1e8:
        return commands.LOADING, masses[what], pack("<i", round(value / KG))
    if what in numbers and 0 <= value < 1 << 32 and float(value).is_integer():
        return commands.LOADING, numbers[what], pack("<I", int(value))
    return None
