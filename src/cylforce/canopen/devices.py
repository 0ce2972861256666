"""Whole devices: our own node and simulated sensors, each with its object dictionary."""

from collections.abc import Callable, Sequence
from functools import partial

from canopen.objectdictionary import ODVariable

from cylforce.canopen.access import Access
from cylforce.canopen.dictionary.object_dictionary import (
    ADD,
    INT16,
    INT32,
    LOADING,
    PART,
    STATUS,
    TARE,
    TARE_VALUE,
    TOOL,
    TRAILER,
    TRUCK,
    ZERO,
    channels,
    own_objects,
    sensor_objects,
)
from cylforce.canopen.dictionary.object_table import dictionary
from cylforce.canopen.heartbeat import OnPeer
from cylforce.canopen.node import Node, OnWritten, ignore_write
from cylforce.canopen.objects import Commands
from cylforce.mechanics.installation import SensorNode, Service
from cylforce.service.published_values import GROSS, NET, PAYLOAD_QUALITY, QUALITY
from cylforce.service.senders.supervision import CONSUMER_FACTOR
from cylforce.signals.estimate import Status
from cylforce.signals.layout import CODES, Field, Pdo, not_available

Address = tuple[int, int]


def own_node(
    service: Service,
    verdict: Callable[[], int | None],
    on_peer: OnPeer,
    access: Access | None = None,
    on_written: OnWritten = ignore_write,
) -> Node:
    """Return our node. It is operational after `boot()`.

    `Node.publish` sends the encoded estimates. The node monitors the heartbeats of the sensors: one counts as silent
    after CONSUMER_FACTOR periods without a heartbeat. Raises ValueError if more sensors have a heartbeat than 1016h has
    entries, or if a published object has no name.

    service: settings of the service
    verdict: returns the service's decision on the last command, see `Commands`
    on_peer: called when a sensor boots, changes its state or becomes silent, see `Heartbeats`
    access: access control; None: everybody may write
    on_written: called after an SDO client has changed an object, see `Node`
    """
    consumers = [
        sensor.node_id << 16 | round(1e3 * CONSUMER_FACTOR * sensor.heartbeat_s)
        for sensor in service.nodes
        if sensor.heartbeat_s > 0.0
    ]
    sync_us = round(1e6 / service.filters.rate_hz) if service.sync_producer else 0
    objects = own_objects(service.publication, round(1e3 * service.heartbeat_s), sync_us, consumers)
    commands = Commands(
        frozenset({(ZERO, 1), (TARE, 1), *((LOADING, sub) for sub in (*range(1, TRUCK), TOOL, ADD, PART, TRAILER))}),
        verdict,
    )
    node = Node(
        service.node_id,
        dictionary(objects, service.node_id),
        service.publication,
        commands=commands,
        autostart=True,
        on_peer=on_peer,
        access=access,
        on_written=on_written,
    )
    node.add_read_callback(Derived(node, service.publication).read)
    return node


def sensor_node(sensor: SensorNode) -> Node:
    """Return a simulated sensor.

    `Node.store` sets the measured values. Once it is configured, SYNC or its event timer sends them.
    """
    return Node(sensor.node_id, dictionary(sensor_objects(sensor), sensor.node_id), sensor.pdos, timers=True)


class Derived:
    """Objects of our node whose values follow from the last published ones.

    They are CiA 404's status and tare, and each process value in the other integer type.

    node: our node
    pdos: TPDOs that it sends
    """

    def __init__(self, node: Node, pdos: Sequence[Pdo]) -> None:
        self._store = node.data_store
        self._fields = {field.signal: field for pdo in pdos for field in pdo.fields}
        self._reads: dict[Address, Callable[[], int]] = {(TARE_VALUE, 1): self._tare}
        for number, field in channels(self._fields.values()).items():
            code, index = ("i", INT32) if field.index == INT16 else ("h", INT16)
            self._reads[index, number] = partial(self._converted, field, code)
            self._reads[STATUS, number] = partial(self._status, field)

    def read(self, index: int, subindex: int, od: ODVariable) -> int | None:
        """Return the value of a derived object; None for any other object."""
        read = self._reads.get((index, subindex))
        return None if read is None else read()

    def _raw(self, field: Field) -> int:
        """Return the published integer of a field."""
        data = self._store[field.index][field.sub]
        return int.from_bytes(data, "little", signed=field.code.islower())

    def _converted(self, field: Field, code: str) -> int:
        """Return the published integer of a field in another type, limited to its range; "no value" stays "no value".

        code: struct code of that type, "h" or "i"
        """
        raw, largest = self._raw(field), (1 << 8 * CODES[code] - 1) - 1
        if raw == not_available(field.code):
            return int(not_available(code))
        return max(-largest, min(largest, raw))

    def _tare(self) -> int:
        """Return gross less net, in the integer steps of both (0.1 kg); "no value" where one of them has none."""
        gross, net = self._fields[GROSS], self._fields[NET]
        if self._raw(gross) == not_available(gross.code) or self._raw(net) == not_available(net.code):
            return int(not_available("i"))
        return self._raw(gross) - self._raw(net)

    def _status(self, field: Field) -> int:
        """Return CiA 404's status byte of a channel: bit 0 not valid, bit 1 positive, bit 2 negative overload.

        Not valid: its quality (of a force its own, else the payload's) is INVALID, or it has no value. Overload: the
        value lies on the upper limit of its range, or on the lower one where that is negative, or beyond.

        field: the published value of the channel
        """
        quality = self._raw(self._fields[QUALITY.get(str(field.signal), PAYLOAD_QUALITY)])
        raw = self._raw(field)
        if quality & 3 == Status.INVALID or raw == not_available(field.code):
            return 1
        value = raw * field.scale + field.offset
        return (value >= field.high) << 1 | (value <= field.low and field.low < 0.0) << 2
