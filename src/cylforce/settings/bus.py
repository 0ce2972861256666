"""The bus part of the file: sensor nodes with their PDO layouts, our own publication, no identifier used
twice."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from cylforce.canopen.dictionary import vendor_eds
from cylforce.mechanics.installation import Filters, SensorNode
from cylforce.service.publication import publication
from cylforce.settings.error import FaultError, Inspection, Key
from cylforce.settings.model import MachineFile, NodeTable, PdoTable, SensorTable, Skipped
from cylforce.signals.kinds import UNIT
from cylforce.signals.layout import CODES, TYPE_NAMES, Field, Pdo
from cylforce.signals.units import MILLISECOND

TYPES = {"i8": "b", "u8": "B", "i16": "h", "u16": "H", "i32": "i", "u32": "I", "f32": "f"}
Entry = tuple[int, SensorTable]  # number of the sensor in the file


def own_pdos(file: MachineFile, filters: Filters, findings: Inspection) -> tuple[Pdo, ...]:
    """The TPDOs that cylforce sends. A period below one step, and rated values too large for their objects, go to
    `findings`."""
    own = file.publication
    if own.period_ms * file.filter.rate_hz < 1000.0:
        problem = f"is {own.period_ms}, shorter than a step of filter.rate_hz ({1e3 / file.filter.rate_hz:g} ms)"
        findings.errors.append(FaultError(("publication", "period_ms"), f"{problem}: publish no faster than that"))
    often = max(own.force_period_ms * MILLISECOND, 1.0 / file.filter.rate_hz)
    rated = max([file.machine.rated_payload_kg, *(other.rated_payload_kg for other in file.attachments)])
    pdos = publication(own.node_id, own.period_ms * MILLISECOND, rated, own.rated_force_n, often, filters)
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


def nodes(file: MachineFile, folder: Path, own: Iterable[Pdo], findings: Inspection) -> tuple[SensorNode, ...]:
    """The sensor nodes; EDS files are looked for in `folder`, `own` are the PDOs that we send. Every error goes to
    `findings`."""
    made = [findings.attempt(_node, file, k, folder) for k in range(len(file.nodes))]
    findings.errors.extend(_same_cob_ids(made, own))
    return tuple(node for node in made if node is not None)


def _same_cob_ids(made: Iterable[SensorNode | None], own: Iterable[Pdo]) -> Iterator[FaultError]:
    owner: dict[int, str] = {pdo.can_id: "cylforce's own publication" for pdo in own}
    for k, node in enumerate(made):
        for pdo in node.pdos if node else ():
            if pdo.can_id in owner:
                used = f"TPDO {pdo.number} has the COB-ID {pdo.can_id:03X}h of {owner[pdo.can_id]}"
                yield FaultError(("nodes", k), f"cannot be identified: {used}; give it another cob_id in nodes.pdos")
            owner.setdefault(pdo.can_id, node.name if node else "")


def period_s(file: MachineFile, sensor: SensorTable) -> float:
    """How often a sensor's value comes [s]."""
    node = next(node for node in file.nodes if node.name == sensor.node)
    return _timing(file, node, sensor.pdo)[2]


def _node(file: MachineFile, k: int, folder: Path) -> SensorNode:
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
    if table.eds is None:
        return None
    try:
        eds = vendor_eds.read(folder / table.eds)
    except vendor_eds.EdsError as error:
        raise FaultError(("nodes", k, "eds"), f"cannot be used: {error}") from None
    if vendor_eds.profile(eds) not in (0, table.profile or vendor_eds.profile(eds)):
        raise FaultError(
            ("nodes", k, "profile"),
            f"is {table.profile}, its EDS says {vendor_eds.profile(eds)}: correct one",
        )
    return eds


def _check_twice(objects: Iterable[tuple[int, tuple[int, int]]]) -> None:
    seen: set[tuple[int, int]] = set()
    for n, place in objects:
        if place in seen:
            raise FaultError(("sensors", n, "object"), "is mapped twice from this node: correct index or sub-index")
        seen.add(place)


def _timing(file: MachineFile, node: NodeTable, number: int) -> tuple[bool, int, float]:
    """(synchronous, every n-th SYNC, period [s]) of a TPDO."""
    special = next((pdo for pdo in node.pdos if pdo.number == number), PdoTable(number=number))
    key: Key = ("nodes", file.nodes.index(node))
    period_ms = special.period_ms or node.period_ms
    if (special.transmission or node.transmission) == "event_timer":
        if period_ms is None:
            raise FaultError(key, "sends by its event timer: add period_ms")
        return False, 0, period_ms * MILLISECOND
    every = special.sync_every or node.sync_every
    own = every / file.filter.rate_hz
    if period_ms is None:
        return True, every, own
    if file.publication.sync_producer and abs(period_ms * MILLISECOND - own) > 1e-6:
        raise FaultError(
            key, f"follows the SYNC of cylforce every {1e3 * own:g} ms, not every {period_ms} ms: remove period_ms"
        )
    return True, every, period_ms * MILLISECOND


def _pdo(file: MachineFile, k: int, number: int, sensors: list[Entry], eds: vendor_eds.Eds | None) -> Pdo:
    node = file.nodes[k]
    chosen = [(n, sensor) for n, sensor in sensors if sensor.pdo == number]
    synchronous, sync, period = _timing(file, node, number)
    cob_id = next((pdo.cob_id for pdo in node.pdos if pdo.number == number), None)
    if cob_id is None and number > 4:
        raise FaultError(
            ("nodes", k),
            f"has TPDO {number}, which has no default COB-ID: add it to nodes.pdos with a cob_id",
        )
    fields = tuple(field for n, sensor in chosen for field in _fields(n, sensor, eds))
    can_id = cob_id if cob_id is not None else 0x100 * number + 0x80 + node.node_id
    pdo = Pdo(can_id, node.node_id, number, synchronous, sync, period, fields)
    if pdo.length > 8:
        raise FaultError(
            ("sensors", chosen[-1][0], "pdo"), f"would hold {pdo.length} bytes, 8 at most: use another pdo"
        )
    return pdo


def _fields(n: int, sensor: SensorTable, eds: vendor_eds.Eds | None) -> list[Field]:
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
    before, after = ([_gap(n, skipped, eds) for skipped in some] for some in (sensor.skip_before, sensor.skip_after))
    return [*before, field, *after]


def _gap(n: int, skipped: Skipped, eds: vendor_eds.Eds | None) -> Field:
    return Field(None, *skipped.object, _code(n, skipped, eds), 1.0, 0.0, "1", 0.0, 0.0)


def _code(n: int, mapped: SensorTable | Skipped, eds: vendor_eds.Eds | None) -> str:
    """The struct code of a mapped object: the file's or the EDS file's; where both give one, they must agree."""
    said = TYPES[mapped.type] if mapped.type else None
    if eds is None:
        if said is None:
            raise FaultError(("sensors", n), f"lacks the key type: write one of {', '.join(TYPES)}")
        return said
    try:
        found = vendor_eds.mapped_code(eds, *mapped.object)
    except vendor_eds.EdsError as error:
        raise FaultError(("sensors", n, "object"), f"does not agree with its node's EDS: {error}") from None
    if said not in (None, found):
        raise FaultError(
            ("sensors", n, "type"), f"is {mapped.type}, its node's EDS says {TYPE_NAMES[found]}: correct it"
        )
    return found


def _check_fixed(eds: vendor_eds.Eds, pdo: Pdo, key: Key) -> None:
    """Raises FaultError unless a node whose mapping cannot be written already maps what the file says."""
    mapped = vendor_eds.default_mapping(eds, pdo.number)
    wanted = tuple((f.index, f.sub, 8 * CODES[f.code]) for f in pdo.fields)
    if mapped != wanted:
        shown = ", ".join(f"{i:04X}h:{s}" for i, s, _ in mapped) or "nothing"
        raise FaultError(
            key,
            f"maps {shown} into TPDO {pdo.number} and cannot be changed: list the sensors in that order",
        )


def _fits(field: Field) -> bool:
    """Whether the object's type holds the whole range, apart from the one value that means "no value"."""
    if field.code == "f":
        return True
    bits = 8 * CODES[field.code]
    low, high = (0, (1 << bits) - 2) if field.code.isupper() else (1 - (1 << (bits - 1)), (1 << (bits - 1)) - 1)
    raw = sorted((value - field.offset) / field.scale for value in (field.low, field.high))
    return low - 0.5 <= raw[0] and raw[1] <= high + 0.5
