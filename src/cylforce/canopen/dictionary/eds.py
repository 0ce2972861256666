"""The EDS file (CiA 306) of our node, from the same table as its object dictionary."""

from collections.abc import Iterable, Sequence
from struct import pack

from cylforce.canopen.dictionary.object_dictionary import PRODUCT, REVISION, own_objects
from cylforce.canopen.dictionary.object_table import DATA_TYPES, VARIABLE, Entry, Object
from cylforce.signals.layout import Pdo

_MANDATORY = {0x1000, 0x1001, 0x1018}
_BIT_RATES = {10: 0, 20: 0, 50: 0, 125: 1, 250: 1, 500: 1, 800: 0, 1000: 1}  # kbit/s: supported or not
_DATE, _TIME = "11-21-2026", "12:00AM"  # date of the layout, not of the run: the same table gives the same file

Section = tuple[str, Sequence[tuple[str, object]]]  # name, and its lines as (key, value)


def eds(pdos: Sequence[Pdo], heartbeat_ms: int = 500, sync_us: int = 0) -> str:
    """Return the text of the EDS file (ASCII, lines end with a line feed); node numbers in it are relative ($NODEID).

    pdos: TPDOs that the node sends
    heartbeat_ms: its heartbeat period [ms]
    sync_us: period of the SYNC that it produces [us]; 0: another node does
    """
    objects = own_objects(pdos, heartbeat_ms, sync_us)
    described = (section for item in objects for section in _object(item))
    sections = [*_device(len(pdos)), *_lists(objects), *described]
    return "\n".join(_section(name, lines) for name, lines in sections)


def _section(name: str, lines: Iterable[tuple[str, object]]) -> str:
    """Return the text of a section."""
    return f"[{name}]\n" + "".join(f"{key}={value}\n" for key, value in lines)


def _device(tpdos: int) -> list[Section]:
    """Return the sections about file and device; `tpdos`: number of TPDOs."""
    changed = (("Time", _TIME), ("Date", _DATE))
    file = [
        *(("FileName", "cylforce.eds"), ("FileVersion", REVISION), ("FileRevision", 0), ("EDSVersion", "4.0")),
        ("Description", "Interaction force and payload weight of a hydraulic machine"),
        *((f"Creation{key}", value) for key, value in changed),
        ("CreatedBy", "cylforce"),
        *((f"Modification{key}", value) for key, value in changed),
        ("ModifiedBy", "cylforce"),
    ]
    device = [
        *(("VendorName", "cylforce"), ("VendorNumber", "0x0")),
        *(("ProductName", "cylforce"), ("ProductNumber", hex(PRODUCT)), ("RevisionNumber", hex(REVISION))),
        ("OrderCode", "cylforce"),
        *((f"BaudRate_{rate}", possible) for rate, possible in _BIT_RATES.items()),
        *(("SimpleBootUpMaster", 0), ("SimpleBootUpSlave", 1), ("Granularity", 0), ("DynamicChannelsSupported", 0)),
        *(("CompactPDO", 0), ("GroupMessaging", 0), ("NrOfRXPDO", 0), ("NrOfTXPDO", tpdos), ("LSS_Supported", 0)),
    ]
    dummies = [(f"Dummy{code:04X}", 0) for code in range(1, 8)]
    return [("FileInfo", file), ("DeviceInfo", device), ("DummyUsage", dummies), ("Comments", [("Lines", 0)])]


def _lists(objects: Sequence[Object]) -> list[Section]:
    """Return the lists of mandatory, optional and manufacturer objects."""
    indices = [item.index for item in objects]
    manufacturer = [index for index in indices if 0x2000 <= index < 0x6000]
    mandatory = [index for index in indices if index in _MANDATORY]
    optional = [index for index in indices if index not in _MANDATORY and index not in manufacturer]
    groups = (("MandatoryObjects", mandatory), ("OptionalObjects", optional), ("ManufacturerObjects", manufacturer))
    return [
        (name, [("SupportedObjects", len(group)), *((str(k), f"0x{i:04X}") for k, i in enumerate(group, 1))])
        for name, group in groups
    ]


def _object(item: Object) -> list[Section]:
    """Return the sections of an object: its own, and one for each sub-index."""
    index = f"{item.index:04X}"
    if item.kind == VARIABLE:
        return [(index, _entry(item.entries[0]))]
    head = [("ParameterName", item.name), ("ObjectType", hex(item.kind)), ("SubNumber", len(item.entries))]
    return [(index, head), *((f"{index}sub{entry.sub:X}", _entry(entry)) for entry in item.entries)]


def _entry(entry: Entry) -> list[tuple[str, object]]:
    """Return the lines of one value."""
    lines: list[tuple[str, object]] = [
        ("ParameterName", entry.name),
        ("ObjectType", hex(VARIABLE)),
        ("DataType", f"0x{DATA_TYPES[entry.code]:04X}"),
        ("AccessType", entry.access),
        ("DefaultValue", _default(entry)),
        ("PDOMapping", int(entry.mappable)),
    ]
    limits = (("LowLimit", entry.low), ("HighLimit", entry.high))
    return lines + [(key, limit) for key, limit in limits if limit is not None]


def _default(entry: Entry) -> str:
    """Return the default value as CiA 306 writes it; empty: none.

    A float is written as its bits in hex, a signed number or one digit in decimal, another unsigned number in hex; a
    number to which the node number is added as $NODEID+0x...; text as it is.
    """
    value = entry.default
    if value is None or isinstance(value, str):
        return value or ""
    if entry.code == "f":
        return f"0x{pack('>f', value).hex().upper()}"  # the bits of a REAL32
    if entry.relative:
        return f"$NODEID+0x{int(value):X}"
    return str(int(value)) if entry.code.islower() or value < 10 else f"0x{int(value):X}"
