"""Bus section of the file: sensor nodes with their PDO layouts, our own publication, no identifier used twice."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from cylforce.canopen.dictionary import vendor_eds
from cylforce.mechanics.installation import Filters, SensorNode
from cylforce.service.publication import publication
from cylforce.settings.error import FaultError, Inspection, Key
from cylforce.settings.model import MachineFile, NodeTable, PdoTable, SensorTable, Skipped
from cylforce.signals.identifiers import TPDOS, is_of_a_pdo
from cylforce.signals.kinds import UNIT
from cylforce.signals.layout import CODES, TYPE_NAMES, Field, Pdo
from cylforce.signals.units import MILLISECOND

TYPES = {"i8": "b", "u8": "B", "i16": "h", "u16": "H", "i32": "i", "u32": "I", "f32": "f"}  # struct codes
Entry = tuple[int, SensorTable]  # number of the sensor in the file


def own_pdos(file: MachineFile, filters: Filters, findings: Inspection) -> tuple[Pdo, ...]:
    """Return the TPDOs that cylforce sends.

    Their weights range up to the largest rated payload of all tools. The forces' period is at least one step. A
    `period_ms` below one step, and rated values too large for their objects, go to `findings` as errors.

    filters: rate and cut-offs, for the notes about bandwidth and delay
    """
    table = file.publication
    if table.period_ms * file.filter.rate_hz < 1000.0:
        problem = f"is {table.period_ms}, shorter than a step of filter.rate_hz ({1e3 / file.filter.rate_hz:g} ms)"
        findings.errors.append(FaultError(("publication", "period_ms"), f"{problem}: publish no faster than that"))
    often = max(table.force_period_ms * MILLISECOND, 1.0 / file.filter.rate_hz)
    rated = max([file.machine.rated_payload_kg, *(other.rated_payload_kg for other in file.attachments)])
    pdos = publication(table.node_id, table.period_ms * MILLISECOND, rated, table.rated_force_n, often, filters)
    limits: tuple[tuple[str, Key], ...] = (
        ("N", ("publication", "rated_force_n")),
        ("kg", ("machine", "rated_payload_kg")),
    )
    for unit, key in limits:
        large = [field for pdo in pdos for field in pdo.fields if field.unit == unit and not _fits(field)]
        if large:
            problem = f"is too large for {large[0].signal} ({TYPE_NAMES[large[0].code]}): make it smaller"
            findings.refuse(key, problem)
    return pdos


def nodes(file: MachineFile, folder: Path, published: Iterable[Pdo], findings: Inspection) -> tuple[SensorNode, ...]:
    """Return the sensor nodes that have no error of their own; every error goes to `findings`.

    COB-IDs that two TPDOs have, or that CiA 301 reserves, are errors, too.

    folder: folder of the EDS files
    published: PDOs that we send
    """
    described = [findings.attempt(_node, file, k, folder) for k in range(len(file.nodes))]
    published = tuple(published)
    findings.errors.extend(_own_cob_ids(published))
    findings.errors.extend(_same_cob_ids(described, published))
    return tuple(node for node in described if node is not None)


def _own_cob_ids(published: Iterable[Pdo]) -> Iterator[FaultError]:
    """Yield a fault for each TPDO of ours whose COB-ID no PDO may have, or another of our TPDOs has."""
    owner: dict[int, int] = {}
    for pdo in published:
        given = f"is {pdo.node_id}, which gives TPDO {pdo.number} of cylforce the COB-ID {pdo.can_id:03X}h"
        if not is_of_a_pdo(pdo.can_id):
            problem = f"{given}: CiA 301 reserves it for other messages; choose another node_id, 1 to 127"
            yield FaultError(("publication", "node_id"), problem)
        elif owner.setdefault(pdo.can_id, pdo.number) != pdo.number:
            problem = f"{given} of its TPDO {owner[pdo.can_id]}: choose another node_id, 1 to 127"
            yield FaultError(("publication", "node_id"), problem)


def _same_cob_ids(described: Iterable[SensorNode | None], published: Iterable[Pdo]) -> Iterator[FaultError]:
    """Yield a fault for each TPDO of a sensor node whose COB-ID a TPDO of ours, or an earlier one of a node, has.

    described: nodes in the order of the file; None: one with errors
    published: PDOs that we send
    """
    owner: dict[int, str] = {pdo.can_id: "cylforce's own publication" for pdo in published}
    for k, node in enumerate(described):
        for pdo in node.pdos if node else ():
            if pdo.can_id in owner:
                used = f"TPDO {pdo.number} has the COB-ID {pdo.can_id:03X}h of {owner[pdo.can_id]}"
                yield FaultError(("nodes", k), f"cannot be identified: {used}; give it another cob_id in nodes.pdos")
            owner.setdefault(pdo.can_id, node.name if node else "")


def period_s(file: MachineFile, sensor: SensorTable) -> float:
    """Return the period of a sensor's value [s]: that of the TPDO that carries it. Raises FaultError as `_timing`."""
    node = next(node for node in file.nodes if node.name == sensor.node)
    return _timing(file, node, sensor.pdo).period_s


def _node(file: MachineFile, k: int, folder: Path) -> SensorNode:
    """Return node k of the file, with the TPDOs that carry its sensors.

    Raises FaultError for an EDS file that cannot be used or contradicts the file, an object that two sensors use, a
    TPDO in nodes.pdos without a sensor, or a TPDO that cannot be made (`_pdo`).

    folder: folder of the EDS files
    """
    table = file.nodes[k]
    sensors = [(n, sensor) for n, sensor in enumerate(file.sensors) if sensor.node == table.name]
    eds = _eds(table, k, folder)
    _check_twice((n, s.object) for n, s in sensors)
    numbers = sorted({sensor.pdo for _, sensor in sensors})
    for special in table.pdos:
        if special.number not in numbers:
            raise FaultError(("nodes", k, "pdos"), f"describe TPDO {special.number}, which no sensor uses: remove it")
    pdos = tuple(_pdo(file, k, number, sensors, eds) for number in numbers)
    if eds is not None and not table.writable_mapping:
        for pdo in pdos:
            _check_fixed(eds, pdo, ("nodes", k, "eds"))
    return SensorNode(
        name=table.name,
        node_id=table.node_id,
        profile=table.profile if table.profile is not None else vendor_eds.profile(eds) if eds else 0,
        identity=(
            table.identity.vendor,
            table.identity.product,
            table.identity.revision,
            table.identity.serial,
        ),
        heartbeat_s=table.heartbeat_ms * MILLISECOND,
        pdos=pdos,
        writable_mapping=table.writable_mapping,
    )


def _eds(table: NodeTable, k: int, folder: Path) -> vendor_eds.Eds | None:
    """Return the EDS file of node k; None without one.

    Raises FaultError if it cannot be used, or gives another device profile than the machine file. A profile of 0, in
    either of them, means none and agrees with any.

    folder: folder of the EDS files
    """
    if table.eds is None:
        return None
    try:
        eds = vendor_eds.read(folder / table.eds)
    except vendor_eds.EdsError as error:
        raise FaultError(("nodes", k, "eds"), f"cannot be used: {error}") from None
    by_eds = vendor_eds.profile(eds)
    if by_eds and table.profile and by_eds != table.profile:
        raise FaultError(("nodes", k, "profile"), f"is {table.profile}, its EDS says {by_eds}: correct one")
    return eds


def _check_twice(objects: Iterable[tuple[int, tuple[int, int]]]) -> None:
    """Raise FaultError for an object that two sensors of a node use; `objects`: (number of the sensor, object)."""
    used: set[tuple[int, int]] = set()
    for n, address in objects:
        if address in used:
            raise FaultError(("sensors", n, "object"), "is mapped twice from this node: correct index or sub-index")
        used.add(address)


class Timing(NamedTuple):
    """Timing of a TPDO.

    synchronous: whether it is sent after SYNC, else by its event timer
    sync: after every n-th SYNC; 0: by its event timer
    period_s: period [s]
    """

    synchronous: bool
    sync: int
    period_s: float


def _timing(file: MachineFile, node: NodeTable, number: int) -> Timing:
    """Return when TPDO `number` of a node is sent: by its own table in nodes.pdos, else by that of the node.

    The period of a synchronous TPDO is by default that of the SYNC at filter.rate_hz. Raises FaultError for an event
    timer without a period, or for a period that contradicts the SYNC that cylforce sends.
    """
    special = next((pdo for pdo in node.pdos if pdo.number == number), PdoTable(number=number))
    key: Key = ("nodes", file.nodes.index(node))
    period_ms = special.period_ms or node.period_ms
    if (special.transmission or node.transmission) == "event_timer":
        if period_ms is None:
            raise FaultError(key, "sends by its event timer: add period_ms")
        return Timing(synchronous=False, sync=0, period_s=period_ms * MILLISECOND)
    sync = special.sync_every or node.sync_every
    by_our_sync = sync / file.filter.rate_hz
    if period_ms is None:
        return Timing(synchronous=True, sync=sync, period_s=by_our_sync)
    if file.publication.sync_producer and abs(period_ms * MILLISECOND - by_our_sync) > 1e-6:
        raise FaultError(
            key,
            f"follows the SYNC of cylforce every {1e3 * by_our_sync:g} ms, not every {period_ms} ms: remove period_ms",
        )
    return Timing(synchronous=True, sync=sync, period_s=period_ms * MILLISECOND)


def _pdo(file: MachineFile, k: int, number: int, sensors: list[Entry], eds: vendor_eds.Eds | None) -> Pdo:
    """Return TPDO `number` of node k with the fields of its sensors.

    Raises FaultError if it has no COB-ID or no period, if a field is wrong (`_fields`), or if its fields take more than
    8 bytes.

    sensors: all sensors of the node, each with its number in the file
    eds: EDS file of the node; None: without one
    """
    node = file.nodes[k]
    chosen = [(n, sensor) for n, sensor in sensors if sensor.pdo == number]
    timing = _timing(file, node, number)
    cob_id = next((pdo.cob_id for pdo in node.pdos if pdo.number == number), None)
    if cob_id is None and number > len(TPDOS):
        raise FaultError(
            ("nodes", k),
            f"has TPDO {number}, which has no default COB-ID: add it to nodes.pdos with a cob_id",
        )
    fields = tuple(field for n, sensor in chosen for field in _fields(n, sensor, eds))
    can_id = cob_id if cob_id is not None else TPDOS[number - 1] + node.node_id
    pdo = Pdo(
        can_id=can_id,
        node_id=node.node_id,
        number=number,
        synchronous=timing.synchronous,
        sync=timing.sync,
        period_s=timing.period_s,
        fields=fields,
    )
    if pdo.length > 8:
        raise FaultError(
            ("sensors", chosen[-1][0], "pdo"), f"would hold {pdo.length} bytes, 8 at most: use another pdo"
        )
    return pdo


def _fields(n: int, sensor: SensorTable, eds: vendor_eds.Eds | None) -> list[Field]:
    """Return the field of sensor n, between the gaps (objects that are mapped, but not used) before and after it.

    Raises FaultError if its type is not known or cannot express the range of the sensor.
    """
    field = Field(
        signal=sensor.name,
        index=sensor.object[0],
        sub=sensor.object[1],
        code=_code(n, sensor, eds),
        scale=sensor.scale,
        offset=sensor.offset,
        unit=UNIT[sensor.kind],
        low=sensor.range[0],
        high=sensor.range[1],
    )
    if not _fits(field):
        name = TYPE_NAMES[field.code]
        raise FaultError(
            ("sensors", n, "range"),
            f"exceeds what {name} with this scale can express: use a wider type or a larger scale",
        )
    before = [_gap(n, skipped, eds) for skipped in sensor.skip_before]
    after = [_gap(n, skipped, eds) for skipped in sensor.skip_after]
    return [*before, field, *after]


def _gap(n: int, skipped: Skipped, eds: vendor_eds.Eds | None) -> Field:
    """Return the field of an object that is mapped, but not used. Raises FaultError as `_code`.

    n: number of the sensor beside it in the TPDO, at which a fault is reported
    """
    index, sub = skipped.object
    return Field(
        signal=None,
        index=index,
        sub=sub,
        code=_code(n, skipped, eds),
        scale=1.0,
        offset=0.0,
        unit="1",
        low=0.0,
        high=0.0,
    )


def _code(n: int, mapped: SensorTable | Skipped, eds: vendor_eds.Eds | None) -> str:
    """Return the struct code of a mapped object from the file or the EDS file.

    Raises FaultError where neither gives one, where both differ, or where the EDS file has no such object for a PDO.

    n: number of the sensor at which a fault is reported
    mapped: table of the object, with its address and perhaps its type
    """
    by_file = TYPES[mapped.type] if mapped.type else None
    if eds is None:
        if by_file is None:
            raise FaultError(("sensors", n), f"lacks the key type: write one of {', '.join(TYPES)}")
        return by_file
    try:
        by_eds = vendor_eds.mapped_code(eds, *mapped.object)
    except vendor_eds.EdsError as error:
        raise FaultError(("sensors", n, "object"), f"does not agree with its node's EDS: {error}") from None
    if by_file not in (None, by_eds):
        raise FaultError(
            ("sensors", n, "type"), f"is {mapped.type}, its node's EDS says {TYPE_NAMES[by_eds]}: correct it"
        )
    return by_eds


def _check_fixed(eds: vendor_eds.Eds, pdo: Pdo, key: Key) -> None:
    """Raise FaultError unless a node whose mapping cannot be written already maps the objects of the file, in order.

    eds: EDS file of the node, whose default mapping counts
    pdo: the TPDO as the file wants it
    key: key of the file at which the fault is reported
    """
    mapped = vendor_eds.default_mapping(eds, pdo.number)
    wanted = tuple((f.index, f.sub, 8 * CODES[f.code]) for f in pdo.fields)
    if mapped != wanted:
        shown = ", ".join(f"{index:04X}h:{sub}" for index, sub, bits in mapped) or "nothing"
        raise FaultError(
            key,
            f"maps {shown} into TPDO {pdo.number} and cannot be changed: list the sensors in that order",
        )


def _fits(field: Field) -> bool:
    """Return whether the object's type covers the field's whole range, to half a digit.

    The one raw value that means "no value" is not available for it. A floating-point number covers every range.
    """
    if field.code == "f":
        return True
    bits = 8 * CODES[field.code]
    low, high = (0, (1 << bits) - 2) if field.code.isupper() else (1 - (1 << (bits - 1)), (1 << (bits - 1)) - 1)
    raw = sorted((value - field.offset) / field.scale for value in (field.low, field.high))
    return low - 0.5 <= raw[0] and raw[1] <= high + 0.5
