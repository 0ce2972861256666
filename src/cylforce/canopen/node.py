"""A CANopen device on our own event loop: NMT states, PDOs, SYNC, heartbeats and emergencies around canopen's
LocalNode.

The daemon's node and the simulated sensors are both such nodes. Time is an argument of `Network.poll` and of the
frames.
"""

from collections.abc import Callable, Iterable

import canopen.network
from canopen.nmt import NmtSlave
from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.exceptions import SdoAbortedError

from cylforce.canopen.access import INCOMPATIBLE, Access
from cylforce.canopen.dictionary.object_dictionary import CODE, PROTECTION
from cylforce.canopen.emergency import Emergencies
from cylforce.canopen.heartbeat import OPERATIONAL, PRE_OPERATIONAL, STOPPED, Heartbeats, OnPeer
from cylforce.canopen.network import Network, Send
from cylforce.canopen.objects import NO_COMMANDS, RANGE, Commands, Objects
from cylforce.canopen.sdo_server import NOT_STORED, SdoServer
from cylforce.canopen.tpdo import Tpdo
from cylforce.signals.identifiers import EMCY, HEARTBEAT, SYNC
from cylforce.signals.layout import CODES, Pdo

OnWritten = Callable[[int, int, bytes, bytes], None]  # (index, sub-index, value before, value after)

SILENT = 0x8130  # EMCY: heartbeat of another node lost
COMMUNICATION = 0x10  # bit of 1001h: communication error

_STATES = {1: OPERATIONAL, 2: STOPPED, 128: PRE_OPERATIONAL}  # state after an NMT command
_NAMES = {OPERATIONAL: "OPERATIONAL", STOPPED: "STOPPED", PRE_OPERATIONAL: "PRE-OPERATIONAL"}
_RESET_NODE, _RESET_COMMUNICATION = 129, 130


class _Nmt(NmtSlave):
    """NMT slave that boots again after each reset and ignores malformed commands."""

    def __init__(self, node: "Node") -> None:
        super().__init__(node.node_id, node)
        self._node = node

    def on_command(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Execute an NMT command for this node or all nodes; ignore a malformed one."""
        if len(data) != 2 or data[1] not in (0, self.id):
            return
        if data[0] in (_RESET_NODE, _RESET_COMMUNICATION):
            self._node.reset(application=data[0] == _RESET_NODE)
        elif data[0] in _STATES:
            self._node.change_state(_STATES[data[0]])

    def on_write(self, index: int, data: bytes, **kwargs: object) -> None:
        """Change the heartbeat with 1017h, once the node has booted."""
        if self._node.state:  # before boot-up there is no heartbeat
            super().on_write(index, data, **kwargs)


def _nobody(node_id: int, state: int | None) -> None:
    """Ignore heartbeats of other nodes."""


def ignore_write(index: int, sub: int, before: bytes, after: bytes) -> None:
    """Ignore changes by SDO clients."""


def _no_network(can_id: int, data: bytes) -> bool:  # noqa: ARG001  # as every way to send
    """Send nothing, until the node is in a network."""
    return False


class Node(Objects):
    """A CANopen node.

    state: NMT state: 0 before boot-up, 4 stopped, 5 operational, 127 pre-operational
    send: sends a frame (identifier, data) into the node's network; returns False when it was dropped
    heartbeats: monitor of the other nodes that 1016h lists
    emergencies: present and past errors of this node

    node_id: CANopen node number
    dictionary: description of every object
    pdos: layout of each of its TPDOs, needed for `publish` and `store` only
    commands: objects that are commands: writing them stores nothing
    timers: whether it sends its event-driven TPDOs by itself; otherwise `publish` sends them
    autostart: whether it is operational right after boot-up
    on_peer: called when another node boots, changes its state or becomes silent, see `Heartbeats`
    access: access control; None: everybody may write
    on_written: called with index, sub-index, value before and after, when an SDO client has changed an object
    """

    def __init__(
        self,
        node_id: int,
        dictionary: ObjectDictionary,
        pdos: Iterable[Pdo] = (),
        *,
        commands: Commands = NO_COMMANDS,
        timers: bool = False,
        autostart: bool = False,
        on_peer: OnPeer = _nobody,
        access: Access | None = None,
        on_written: OnWritten = ignore_write,
    ) -> None:
        self.state = 0
        self._access, self._on_written = access, on_written
        super().__init__(node_id, dictionary, commands)
        self._network: Network | None = None  # None: in no network yet
        self.send: Send = _no_network
        self.sdo = SdoServer(self)
        self._write_callbacks.clear()  # that of canopen's own NMT slave, which is replaced
        self.nmt = _Nmt(self)
        self.add_write_callback(self.nmt.on_write)
        if access is not None:
            self.add_read_callback(self._read_access)
        self._timers, self._autostart, self._on_peer = timers, autostart, on_peer
        self._fields = {pdo.number: tuple(_fields(pdo)) for pdo in pdos}  # by TPDO: objects and their bytes in its data
        self.heartbeats = Heartbeats(self._peer)
        self.emergencies = Emergencies(self._send_emergency, self.set_value)
        # TPDO n has its communication parameters at 1800h + n - 1
        numbers = [index - 0x17FF for index in dictionary if 0x1800 <= index < 0x1A00]
        self._tpdos = {number: Tpdo(self, number) for number in numbers}

    @property
    def operational(self) -> bool:
        """Return whether it may send PDOs."""
        return self.state == OPERATIONAL

    @property
    def answers(self) -> bool:
        """Return whether SDO, SYNC and EMCY work: it has booted and is not stopped."""
        return self.state in (OPERATIONAL, PRE_OPERATIONAL)

    @property
    def t_us(self) -> int:
        """Return the network's time [us]; 0 without a network."""
        return 0 if self._network is None else self._network.t_us

    def associate_network(self, network: canopen.network.Network) -> None:
        """Join a network, as canopen's nodes do; it must be a cylforce.canopen.network.Network."""
        if not isinstance(network, Network):
            raise TypeError("a Node needs a cylforce.canopen.network.Network, which feeds it frames and time")
        super().associate_network(network)
        self._network, self.send = network, network.send
        network.subscribe(SYNC, self._on_sync)
        network.every_poll(self._poll)

    def boot(self) -> None:
        """Send the boot-up message, then enter pre-operational or, with `autostart`, operational.

        From then on the nodes of 1016h are monitored.
        """
        self.state = 0
        self.nmt.state = "INITIALISING"  # sends the boot-up message
        self.change_state(PRE_OPERATIONAL)
        self._watch()
        if self._autostart:
            self.change_state(OPERATIONAL)

    def reset(self, application: bool = True) -> None:
        """Set default values again, then boot; the lock closes.

        application: reset the node; otherwise its communication parameters only
        """
        if self._access is not None:
            self._access.close()
        self.nmt.stop_heartbeat()
        self.restore(0x1000, 0x10000 if application else 0x2000)
        for tpdo in self._tpdos.values():
            tpdo.reload()
        self.boot()

    def change_state(self, state: int) -> None:
        """Enter an NMT state: 4 stopped, 5 operational, 127 pre-operational."""
        self.state = state
        self.nmt.state = _NAMES[state]

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """Set an object as canopen's nodes do; changed parameters of PDOs and heartbeats take effect at once.

        data: its bytes, little-endian
        check_writable: raise SdoAbortedError for a read-only object
        """
        super().set_data(index, subindex, data, check_writable)
        if 0x1800 <= index < 0x1C00:  # communication (1800h to 19FFh) or mapping (1A00h to 1BFFh) of a TPDO
            self._tpdos[(index & 0x1FF) + 1].reload()
        elif index == 0x1016:
            self._watch()

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Store the bytes that an SDO client has written to an object. Raises SdoAbortedError where it may not.

        With access control a code for the lock (21A0h:1) goes to `Access.enter` and is not stored, and protected
        objects must pass `Access.check`. PDO parameters must pass `Tpdo.check`, and no two TPDOs of this node may have
        the same identifier. 0 written to 1003h clears the list of errors, which takes no other value. `on_written` is
        called where the bytes have changed.

        data: its bytes, little-endian
        """
        if self._access is not None:
            if (index, sub) == (PROTECTION, CODE):
                self._access.enter(int.from_bytes(data, "little"), self.t_us)
                return
            self._access.check(index, sub, int.from_bytes(data, "little"), self.state, self.t_us)
        if 0x1800 <= index < 0x1C00:
            self._tpdos[(index & 0x1FF) + 1].check(index, sub, int.from_bytes(data, "little"))
        if 0x1800 <= index < 0x1A00 and sub == 1:
            self._check_unique(index, int.from_bytes(data, "little"))
        if index != 0x1003:
            before = self.data_store[index][sub]
            super().write(index, sub, data)
            if data != before:
                self._on_written(index, sub, before, data)
        elif data == b"\0":
            self.emergencies.clear()
        else:
            raise SdoAbortedError(RANGE)

    def check_segmented(self, index: int, sub: int) -> None:
        """Raise SdoAbortedError for a segmented download that must not begin.

        The code of the lock must come in one frame: the event log replaces the code of such a frame by zeros.
        """
        super().check_segmented(index, sub)
        if (index, sub) == (PROTECTION, CODE):
            raise SdoAbortedError(NOT_STORED)

    def _check_unique(self, index: int, value: int) -> None:
        """Raise SdoAbortedError if another TPDO of this node has the same identifier.

        index: of the communication parameters of the TPDO that is written
        value: COB-ID to be written
        """
        others = (0x17FF + number for number in self._tpdos if 0x17FF + number != index)
        if any(self.raw(other, 1) & 0x7FF == value & 0x7FF for other in others):
            raise SdoAbortedError(INCOMPATIBLE)

    def _read_access(self, index: int, subindex: int, od: object) -> int | None:
        """Return the value of an object of the access control, for canopen's read callback; None for other objects."""
        return None if self._access is None else self._access.read(index, subindex, self.t_us)

    def store(self, number: int, data: bytes) -> None:
        """Write the data of TPDO `number` into the objects of its layout; nothing is sent."""
        for (index, sub), part in self._fields[number]:
            self.data_store[index][sub] = data[part]

    def publish(self, number: int, data: bytes) -> bool:
        """Store new data of TPDO `number`, and send them if it is event-driven, operational and enabled; return whether
        sent.
        """
        self.store(number, data)
        tpdo = self._tpdos[number]
        return tpdo.event_driven and tpdo.send()

    def transmit(self, number: int) -> bool:
        """Send TPDO `number` now, whatever its trigger, if operational and enabled; return whether it was sent."""
        return self._tpdos[number].send()

    def produce_sync(self) -> None:
        """Send SYNC, if this node is its producer (1005h) and not stopped, and the synchronous PDOs after it."""
        if self.answers and self.raw(0x1005, 0) & 1 << 30:
            self.send(SYNC, b"")
            self._on_sync(SYNC, b"", 0.0)

    def _on_sync(self, can_id: int, data: bytes | bytearray, timestamp: float) -> None:
        """Send the synchronous PDOs, if operational."""
        if self.operational:
            for tpdo in self._tpdos.values():
                tpdo.on_sync()

    def _poll(self, t_us: int) -> None:
        """Check heartbeats, repeat emergencies, run event timers."""
        self.heartbeats.poll(t_us)
        self.emergencies.flush()
        if self._timers:
            for tpdo in self._tpdos.values():
                tpdo.poll(t_us)

    def _send_emergency(self, data: bytes) -> bool:
        """Send an emergency message; return False if the bus dropped it, so that it must be sent again later.

        In a state without EMCY nothing is sent, nor will be: that returns True.
        """
        return not self.answers or self.send(EMCY + self.node_id, data)

    def _watch(self) -> None:
        """Monitor the heartbeats that 1016h lists: node number in bits 16 to 22, time in ms in bits 0 to 15."""
        if 0x1016 not in self.data_store or self._network is None:
            return
        entries = [self.raw(0x1016, sub) for sub in self.data_store[0x1016] if sub]
        self.heartbeats.watch((entry >> 16 & 0x7F, 1000 * (entry & 0xFFFF)) for entry in entries)
        for entry in entries:
            if entry:
                self._network.subscribe(HEARTBEAT + (entry >> 16 & 0x7F), self._on_heartbeat)

    def _on_heartbeat(self, can_id: int, data: bytearray, timestamp: float) -> None:
        """Pass a heartbeat of another node on."""
        self.heartbeats.on_heartbeat(can_id, data, self.t_us)

    def _peer(self, node_id: int, state: int | None) -> None:
        """Report a silent node as an emergency, and as repaired when no node is silent any more.

        state: NMT state of the other node; None: silent
        """
        if state is None:
            self.emergencies.occur(SILENT, COMMUNICATION, bytes([node_id]))
        elif not self.heartbeats.silent:
            self.emergencies.repair(SILENT)
        self._on_peer(node_id, state)


def _fields(pdo: Pdo) -> Iterable[tuple[tuple[int, int], slice]]:
    """Yield address (index, sub-index) and place of the bytes of each field of a PDO in the PDO's data."""
    at = 0
    for field in pdo.fields:
        yield (field.index, field.sub), slice(at, at + CODES[field.code])
        at += CODES[field.code]
