"""The operator's hand on the service: commands by SDO, and what the service says about the truck, read by SDO."""

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

EVERY_S = 1.0
SOON_S = 0.05  # after a command: the service shows its effect at its next step
KEPT = 8  # last buckets that are shown; chosen
KG = commands.KG
FIELDS = (  # of TruckState: sub-index, type
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
    """The truck as the service has it: number, mass and target [kg], buckets, product; numbers of the last booking, of
    the last one on disk; state of the records; number of the tool; mass in the present part (None: as in the truck),
    number of the part, target of the trailer; the torque residual of the first measured joints [N m], None for none."""

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
        """What counts for the target [kg]."""
        return self.total if self.in_part is None else self.in_part


class ListedBucket(NamedTuple):
    """A bucket that was booked while the display ran: number, mass [kg] that the truck got."""

    number: int
    mass: float


class Reply(NamedTuple):
    """Whether a command was done; if not, the SDO abort code, or why in one word."""

    done: bool
    why: str = ""


class Loading:
    """What is known of the truck; None before the service has answered, or when it no longer does."""

    def __init__(self) -> None:
        self.known: TruckState | None = None
        self.buckets: deque[ListedBucket] = deque(maxlen=KEPT)

    def update(self, known: TruckState | None) -> None:
        """What was just read. One more bucket in the same truck is remembered with its mass."""
        before, self.known = self.known, known
        if before is None or known is None or known.number != before.number:
            return
        if known.last != before.last and known.filled == before.filled + 1:
            self.buckets.append(ListedBucket(known.last, known.total - before.total))


class Panel:
    """Speaks with the service of node `node_id`, whose machine has so many measured `joints`; one transfer at a
    time."""

    def __init__(self, network: Network, node_id: int, joints: int = 0) -> None:
        self._client, self._joints = Client(network, node_id), joints
        self.loading = Loading()
        self._soon = asyncio.Event()

    async def follow(self) -> None:
        """Read what the service knows, every second and after each command, until cancelled."""
        while True:
            self._soon.clear()  # before reading: a command that comes meanwhile asks for one more look
            self.loading.update(await self.read())
            try:
                await asyncio.wait_for(self._soon.wait(), EVERY_S)
            except TimeoutError:
                continue

    async def read(self) -> TruckState | None:
        """What the service knows of the truck; None without an answer."""
        try:
            told: list[Any] = [await self._client.read(commands.LOADING, sub, kind) for sub, kind in FIELDS]
            left = [await self._client.read(UNEXPLAINED, k + 1, "i") for k in range(min(self._joints, JOINTS))]
        except SdoError:
            return None
        masses = ("total", "target", "in_part", "trailer")
        unexplained = tuple(None if torque == not_available("i") else float(torque) for torque in left)
        known = TruckState(*told)
        kg = {name: KG * getattr(known, name) for name in masses}
        return known._replace(unexplained=unexplained, **kg)

    async def send_command(self, what: str, value: float | None) -> Reply:
        """Send a command; `value` is its number, None for a command without one."""
        made = command_request(what, value)
        if made is None:
            return Reply(False, NOT_KNOWN)
        try:
            await self._client.download(*made)
        except AbortedError as error:
            return Reply(False, f"{error.code:08X}")
        except SdoError:
            return Reply(False, NO_ANSWER)
        asyncio.get_running_loop().call_later(SOON_S, self._soon.set)
        return Reply(True)


def command_request(what: str, value: float | None) -> tuple[int, int, bytes] | None:
    """Return index, sub-index and data of a command; None for an unknown command, and for one whose number is missing,
    outside its range or, where it names something, not whole."""
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
