"""Configure the sensors over SDO as the machine file describes them: identity, PDO mapping, heartbeat and start.

Each node has a task of its own, so that a silent or refusing node does not delay the others. A node that boots again is
configured again.
"""

import asyncio
from collections.abc import Callable, Iterable
from enum import StrEnum
from typing import NamedTuple

from cylforce.canopen.heartbeat import BOOTED, OPERATIONAL, PRE_OPERATIONAL, STOPPED
from cylforce.canopen.network import Network
from cylforce.canopen.sdo_client import TIMEOUT_S, AbortedError, Client, NoAnswerError, SdoError
from cylforce.mechanics.installation import SensorNode
from cylforce.signals.layout import CODES, Pdo

FIRST_DELAY_S, LAST_DELAY_S = 0.25, 5.0  # s between attempts, doubled from the first to the last; chosen
STARTS = 3  # NMT start commands to a node that stays pre-operational; chosen

_START, _ENTER_PRE_OPERATIONAL = 1, 128  # NMT commands
_IDENTITY = ("vendor", "product", "revision", "serial number")  # sub-indices 1 to 4 of 1018h
_NO_SUB = 0x06090011  # abort code: sub-index does not exist
_DISABLED, _NO_REMOTE = 1 << 31, 1 << 30  # bits of a COB-ID: PDO does not exist, no remote frames
_EVENT_DRIVEN = (254, 255)  # transmission types
_CYCLIC_TIMER = (0x6200, 0)  # CiA 406: older encoders have this instead of the event timer


class Stage(StrEnum):
    """State of a node's configuration."""

    OPERATIONAL = "operational"
    SILENT = "silent"
    REFUSED = "refused"  # another device than the one described; it sends nothing until it boots again
    FAILED = "failed"  # will be repeated


class Outcome(NamedTuple):
    """Result of a node's configuration.

    node: the sensor node
    stage: state of its configuration
    reason: a sentence; "" for an operational node
    """

    node: SensorNode
    stage: Stage
    reason: str


class ForeignNodeError(Exception):
    """Another device than the one described; the text is a sentence."""


Report = Callable[[Outcome], None]
StateOf = Callable[[int], int | None]


class Commissioner:
    """Configures nodes as tasks on the running event loop.

    nodes: the nodes of the machine file
    network: network through which they are configured
    state_of: function of the node number that returns the NMT state of its last heartbeat (`Heartbeats.state`)
    report: called when a node's outcome changes
    """

    def __init__(self, nodes: Iterable[SensorNode], network: Network, state_of: StateOf, report: Report) -> None:
        self._nodes = {node.node_id: node for node in nodes}
        self._network, self._state_of, self._report = network, state_of, report
        self._tasks: dict[int, asyncio.Task[None]] = {}
        self._outcomes: dict[int, Outcome] = {}
        self._lost: set[int] = set()  # numbers of the nodes that stopped sending and have not come back

    def start(self) -> None:
        """Begin to configure all nodes."""
        for node_id in self._nodes:
            self.begin(node_id)

    def begin(self, node_id: int) -> None:
        """Begin to configure a node, from the start if its configuration is running already.

        A node that is not in the machine file is ignored.
        """
        node = self._nodes.get(node_id)
        if node is None:
            return
        running = self._tasks.pop(node_id, None)
        if running is not None:
            running.cancel()
        self._tasks[node_id] = asyncio.get_running_loop().create_task(self._until_done(node))

    def on_peer(self, node_id: int, state: int | None) -> None:
        """Configure a node again that has booted, or whose boot-up message may have been missed.

        The message may have been missed if the node was silent, or is pre-operational or stopped although it is not
        being configured and was not refused. `Heartbeats` calls this.

        state: NMT state of the node; None: it stopped sending
        """
        outcome, task = self._outcomes.get(node_id), self._tasks.get(node_id)
        if state is None:
            self._lost.add(node_id)
            return
        idle = (task is None or task.done()) and (outcome is None or outcome.stage is not Stage.REFUSED)
        fell_back = state in (PRE_OPERATIONAL, STOPPED) and idle
        if state == BOOTED or node_id in self._lost or fell_back:
            self._lost.discard(node_id)
            self._outcomes.pop(node_id, None)
            self.begin(node_id)

    async def close(self) -> None:
        """Stop all tasks."""
        for task in self._tasks.values():
            task.cancel()
        await asyncio.gather(*self._tasks.values(), return_exceptions=True)
        self._tasks.clear()

    async def _until_done(self, node: SensorNode) -> None:
        """Repeat the configuration, with growing delays, until the node is operational or refused.

        An outcome that differs from the one before is reported.
        """
        delay_s = FIRST_DELAY_S
        while True:
            outcome = await self._attempt(node)
            if outcome != self._outcomes.get(node.node_id):
                self._outcomes[node.node_id] = outcome
                self._report(outcome)
            if outcome.stage in (Stage.OPERATIONAL, Stage.REFUSED):
                return
            await asyncio.sleep(delay_s)
            delay_s = min(2.0 * delay_s, LAST_DELAY_S)

    async def _attempt(self, node: SensorNode) -> Outcome:
        """Configure and start a node once, and return the outcome.

        Another device than the one described is commanded pre-operational; so is a stopped node, which does not answer
        over SDO, for the next attempt.
        """
        client = Client(self._network, node.node_id, TIMEOUT_S)
        try:
            await commission(node, client)
            return await self._started(node)
        except ForeignNodeError as error:
            self._command(_ENTER_PRE_OPERATIONAL, node)  # otherwise the values that it sends would be used
            return Outcome(node, Stage.REFUSED, str(error))
        except NoAnswerError as error:
            if self._state_of(node.node_id) == STOPPED:
                self._command(_ENTER_PRE_OPERATIONAL, node)
            return Outcome(node, Stage.SILENT, f"{node.name}: {error}")
        except SdoError as error:
            return Outcome(node, Stage.FAILED, f"{node.name}: {error}")
        finally:
            client.close()

    def _command(self, command: int, node: SensorNode) -> None:
        """Send an NMT command to a node."""
        self._network.send(0, bytes([command, node.node_id]))

    async def _started(self, node: SensorNode) -> Outcome:
        """Send NMT start until the node's heartbeat shows operational; return the outcome.

        After STARTS commands, each followed by 2.5 heartbeat periods of waiting, the outcome is FAILED. A node without
        heartbeat is assumed to have started.
        """
        for _ in range(STARTS):
            self._command(_START, node)
            if node.heartbeat_s <= 0.0:
                return Outcome(node, Stage.OPERATIONAL, "")
            deadline = asyncio.get_running_loop().time() + 2.5 * node.heartbeat_s
            while asyncio.get_running_loop().time() < deadline:
                if self._state_of(node.node_id) == OPERATIONAL:
                    return Outcome(node, Stage.OPERATIONAL, "")
                await asyncio.sleep(min(0.02, node.heartbeat_s))
        return Outcome(
            node,
            Stage.FAILED,
            f"{node.name}: node {node.node_id} does not start: its heartbeat does not show operational",
        )


async def commission(node: SensorNode, client: Client) -> None:
    """Check the identity of a node and write the parameters that differ: heartbeat, TPDO parameters, mappings.

    The node is not started. Raises ForeignNodeError if it is another device or its mapping is fixed and differs,
    SdoError if a transfer fails.
    """
    await client.upload(0x1000, 0)  # mandatory in every device: shows whether the node answers
    await _check_identity(node, client)
    await _write_if_different(client, 0x1017, 0, "H", round(1e3 * node.heartbeat_s))
    for pdo in node.pdos:
        await _configure_pdo(node, pdo, client)


async def _check_identity(node: SensorNode, client: Client) -> None:
    """Raise ForeignNodeError if a number of 1018h differs from the machine file's; None there is not checked."""
    for sub, (name, wanted) in enumerate(zip(_IDENTITY, node.identity, strict=True), 1):
        if wanted is None:
            continue
        actual = await client.read(0x1018, sub, "I")
        if actual != wanted:
            raise ForeignNodeError(
                f"{node.name}: node {node.node_id} has {name} {actual:#x}, not {wanted:#x}: it is another device "
                "(swapped node ids?), or correct its identity in the machine file"
            )


async def _write_if_different(client: Client, index: int, sub: int, code: str, value: int) -> bool:
    """Write an integer of a struct code unless the node has it already; return whether it was written."""
    if await client.read(index, sub, code) == value:
        return False
    await client.write(index, sub, code, value)
    return True


async def _configure_pdo(node: SensorNode, pdo: Pdo, client: Client) -> None:
    """Write identifier, mapping and trigger of a TPDO where they differ: disable, write, enable (CiA 301).

    Raises ForeignNodeError if the mapping differs and cannot be written.
    """
    index = 0x17FF + pdo.number
    cob_id = await client.read(index, 1, "I")
    mapped = await _mapping(pdo, client)
    wanted = [field.index << 16 | field.sub << 8 | 8 * CODES[field.code] for field in pdo.fields]
    if mapped != wanted and not node.writable_mapping:
        raise ForeignNodeError(
            f"{node.name}: TPDO {pdo.number} of node {node.node_id} maps {_shown(mapped)} and cannot be changed to "
            f"{_shown(wanted)}: list its sensors in the order that it maps"
        )
    trigger = await _trigger(pdo, client)
    if cob_id & ~_NO_REMOTE == pdo.can_id and mapped == wanted and not trigger:
        return
    await client.write(index, 1, "I", cob_id | _DISABLED)
    if mapped != wanted:
        await _map(pdo, wanted, client)
    for address, code, value in trigger:
        await client.write(*address, code, value)
    await client.write(index, 1, "I", cob_id & _NO_REMOTE | pdo.can_id)


async def _mapping(pdo: Pdo, client: Client) -> list[int]:
    """Read the mapping entries of a TPDO from the node: index, sub-index and length [bits] in one number (1A00h)."""
    index = 0x19FF + pdo.number
    count = await client.read(index, 0, "B")
    return [await client.read(index, sub, "I") for sub in range(1, min(count, 64) + 1)]


async def _map(pdo: Pdo, wanted: list[int], client: Client) -> None:
    """Write the mapping entries of a disabled TPDO. Raises SdoError if they read back otherwise.

    wanted: the entries, as in 1A00h
    """
    index = 0x19FF + pdo.number
    await client.write(index, 0, "B", 0)
    for sub, entry in enumerate(wanted, 1):
        await client.write(index, sub, "I", entry)
    await client.write(index, 0, "B", len(wanted))
    if await _mapping(pdo, client) != wanted:
        raise SdoError(f"the mapping of TPDO {pdo.number} was taken, but is not what was written")


async def _trigger(pdo: Pdo, client: Client) -> list[tuple[tuple[int, int], str, int]]:
    """Return the parameters that differ from the wanted trigger: transmission type, event timer [ms].

    Each is (address, struct code, value to write); the address is (index, sub-index).
    """
    index = 0x17FF + pdo.number
    kind = await client.read(index, 2, "B")
    if pdo.synchronous:
        wanted = max(pdo.sync, 1)
        return [] if kind == wanted else [((index, 2), "B", wanted)]
    writes: list[tuple[tuple[int, int], str, int]] = []
    if kind not in _EVENT_DRIVEN:
        writes.append(((index, 2), "B", _EVENT_DRIVEN[0]))
    address, period_ms = await _event_timer(index, client)
    if period_ms != round(1e3 * pdo.period_s):
        writes.append((address, "H", round(1e3 * pdo.period_s)))
    return writes


async def _event_timer(index: int, client: Client) -> tuple[tuple[int, int], int]:
    """Return the address (index, sub-index) of a TPDO's event timer in this node, and its value [ms].

    index: of the TPDO's communication parameters
    """
    try:
        return (index, 5), await client.read(index, 5, "H")
    except AbortedError as error:
        if error.code != _NO_SUB:
            raise
        return _CYCLIC_TIMER, await client.read(*_CYCLIC_TIMER, "H")


def _shown(mapped: list[int]) -> str:
    """Return mapping entries as text: index and sub-index of each object."""
    return ", ".join(f"{entry >> 16:04X}h:{entry >> 8 & 0xFF}" for entry in mapped) or "nothing"
