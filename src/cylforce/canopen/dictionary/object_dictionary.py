"""Object dictionaries of our own node, from its publication, and of a sensor, from its configuration.

Objects 1000h-1FFFh: CiA 301; 6xxxh-9xxxh: the device profiles CiA 404, 406, 410; 2xxxh: ours.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from math import log10, pi

from cylforce import __version__
from cylforce.canopen.dictionary.object_table import (
    ARRAY,
    RECORD,
    TEXT,
    VARIABLE,
    Entry,
    Object,
    group,
    merged,
    variable,
    with_first_entry,
)
from cylforce.canopen.emergency import HISTORY
from cylforce.canopen.tpdo import DISABLED, NO_REMOTE
from cylforce.mechanics.installation import SensorNode
from cylforce.service.commands import KG, NEXT_WORD, SIGNATURES
from cylforce.service.loading.truck import LARGEST_TARGET
from cylforce.signals.identifiers import (
    EMCY,
    FIRST_PDO,
    LAST_OTHER_PDO,
    RPDOS,
    SDO_REQUEST,
    SDO_RESPONSE,
    SYNC,
    TPDOS,
)
from cylforce.signals.layout import CODES, Field, Pdo, not_available
from cylforce.signals.units import BAR, DEGREE, MILLIMETRE

CONSUMERS = 16  # entries of 1016h, heartbeat consumers; chosen
PRODUCT, REVISION = 1, 1  # in 1018h; vendor 0: cylforce has no vendor-ID
ZERO, TARE = 0x6125, 0x6139  # commands, at sub-index 1
UNIT, DIGITS, STATUS, TARE_VALUE = 0x6131, 0x6132, 0x6150, 0x9138  # of the process values (CiA 404)
INT16, INT32 = 0x7130, 0x9130  # process values as INTEGER16 and INTEGER32 (CiA 404)
ADAPTATION, OFF, FROZEN, FOLLOWING = 0x2170, 0, 1, 2  # adaptation of the tares to temperature and wear; its states
UNEXPLAINED, JOINTS = 0x21B0, 8  # residual torque of the empty machine, of the first eight measured joints

LOADING = 0x2190  # the truck that is being loaded
TRUCK, TOTAL, COUNT, LAST, RECORDED, RECORDS = 6, 7, 8, 9, 10, 11  # its sub-indices that are read only
TOOL, ADD = 12, 13  # number of the tool: a command that can be read; a bucket entered by hand: a command
PART, TRAILER, IN_PART, PART_NUMBER = 14, 15, 16, 17  # next part and its target: commands; mass and number: read only
NO_RECORDS, RECORDING, RECORDS_STOPPED = 0, 1, 2  # values of sub-index RECORDS

PROTECTION = 0x21A0  # lock, audit trail, identity of software and files
CODE, LOCK_STATE, SECONDS_LEFT, AUDIT_COUNT, SOFTWARE_ID, PARAMETERS_ID, MACHINE_ID = range(1, 8)  # its sub-indices

_LARGEST_U32 = 0xFFFFFFFF
_LARGEST_TARGET = round(LARGEST_TARGET / KG)
_NEXT, _ZERO = (int.from_bytes(word, "little") for word in (NEXT_WORD, *SIGNATURES[0x6125]))
_TARA, _TARE = sorted(int.from_bytes(word, "little") for word in SIGNATURES[0x6139])
_LONGEST_HEARTBEAT_MS = 10_000
_COB_IDS = FIRST_PDO, DISABLED | NO_REMOTE | LAST_OTHER_PDO  # limits of a PDO's COB-ID
_SLOTS = 8  # entries of a mapping that can be written: as many as a frame has bytes
# SI unit -> code of CiA 303-2 for the unit in which it is published, that unit's size in SI
_UNITS = {
    "kg": (0x00020000, 1.0),
    "N": (0x03210000, 1e3),
    "rad": (0x00410000, DEGREE),
    "Pa": (0x004E0000, BAR),
    "m": (0xFD010000, MILLIMETRE),
    "rad/s": (0x00410300, DEGREE),
    "K": (0x002D0000, 1.0),
    "s": (0xFD030000, 1e-3),
    "1": (0x00000000, 1.0),
}
_NAMES = {
    404: {0x6130: "AI input PV", INT16: "AI input PV", INT32: "AI input PV", 0x9140: "AI net PV"},
    406: {0x6004: "Position value", 0x6030: "Speed value"},
    410: {0x6010: "Slope long16", 0x6020: "Slope lateral16", 0x6110: "Slope long32", 0x6120: "Slope lateral32"},
}
_OURS = {0x2130: "Standard error", 0x2150: "Quality", 0x2160: "Booked payload", 0x2180: "Last event"}  # records


def own_objects(
    pdos: Sequence[Pdo], heartbeat_ms: int = 500, sync_us: int = 0, watched: Sequence[int] = ()
) -> tuple[Object, ...]:
    """Return the objects of our node.

    Raises ValueError if there are more consumers than entries, or if a published object has no name.

    pdos: TPDOs that it sends
    heartbeat_ms: its heartbeat period [ms]
    sync_us: period of the SYNC that it produces [us]; 0: another node does
    watched: entries of 1016h, the heartbeats that it monitors: node number in bits 16 to 22, time [ms] in bits 0 to 15
    """
    if len(watched) > CONSUMERS:
        raise ValueError(f"{len(watched)} nodes have a heartbeat, {CONSUMERS} can be watched: set heartbeat_ms = 0")
    entries = [*watched, *[0] * (CONSUMERS - len(watched))]
    produces = 1 << 30 if sync_us else 0
    consumers = (
        Entry(k, f"Consumer {k}", "I", "rw", entry, low=0, high=0x7FFFFF) for k, entry in enumerate(entries, 1)
    )
    fields = [field for pdo in pdos for field in pdo.fields]
    return merged(
        [
            *_communication(404, "cylforce", (0, PRODUCT, REVISION, 0), heartbeat_ms, SYNC | produces),
            variable(0x1006, "Communication cycle period", "I", "ro", sync_us),
            group(0x1016, "Consumer heartbeat time", ARRAY, consumers),
            *(item for pdo in pdos for item in _tpdo(pdo, "ro", len(pdo.fields))),
            *(_published_object(field) for field in fields),
            *_own_channels(channels(fields)),
            group(ADAPTATION, "Adaptation", RECORD, _adaptation()),
            group(LOADING, "Truck", RECORD, _loading()),
            group(PROTECTION, "Protection", RECORD, _protection()),
            group(UNEXPLAINED, "Torque residual", ARRAY, _unexplained()),
        ]
    )


def _adaptation() -> tuple[Entry, ...]:
    """Return the entries about the adaptation to temperature and wear."""
    drift = Entry(1, "Adaptation drift, in 0.1 kg of payload", "i", "ro", 0)
    return drift, Entry(2, "Adaptation state: 0 off, 1 frozen, 2 following", "B", "ro", OFF)


def _unexplained() -> tuple[Entry, ...]:
    """Return the entries of the residual torques."""
    none = not_available("i")
    return tuple(
        Entry(k, f"Torque residual of measured joint {k}, in N m", "i", "ro", none) for k in range(1, JOINTS + 1)
    )


def _protection() -> tuple[Entry, ...]:
    """Return the entries of lock and audit trail, see `canopen.access` and `records.audit`."""
    return (
        Entry(CODE, "Code that unlocks; 0 locks", "I", "wo", low=0, high=_LARGEST_U32),
        Entry(LOCK_STATE, "Lock: 0 no code, 1 locked, 2 unlocked, 3 blocked", "B", "ro", 0),
        Entry(SECONDS_LEFT, "Seconds until it locks, or until the next code", "H", "ro", 0),
        Entry(AUDIT_COUNT, "Number of the last audit entry", "I", "ro", 0),
        Entry(SOFTWARE_ID, "Software: first 4 bytes of the SHA-256 of its files", "I", "ro", 0),
        Entry(PARAMETERS_ID, "Identified parameters: first 4 bytes of the SHA-256", "I", "ro", 0),
        Entry(MACHINE_ID, "Machine file: first 4 bytes of the SHA-256", "I", "ro", 0),
    )


def _loading() -> tuple[Entry, ...]:
    """Return the entries about truck and tool. Sub-indices 1 to 5 and 12 to 15 are commands, see `service.commands`."""
    return (
        Entry(1, "Target, in 0.1 kg; 0: none", "i", "rw", 0, low=0, high=_LARGEST_TARGET),
        Entry(2, "Number of the product", "I", "rw", 0, low=0, high=_LARGEST_U32),
        Entry(3, "Next truck", "I", "wo", low=_NEXT, high=_NEXT),
        Entry(4, "Cancel booking", "I", "wo", low=1, high=_LARGEST_U32),
        Entry(5, "Accept booking", "I", "wo", low=1, high=_LARGEST_U32),
        Entry(TRUCK, "Number of the truck", "I", "ro", 1),
        Entry(TOTAL, "Mass in the truck, in 0.1 kg", "i", "ro", 0),
        Entry(COUNT, "Buckets in the truck", "I", "ro", 0),
        Entry(LAST, "Number of the last booking", "I", "ro", 0),
        Entry(RECORDED, "Number of the last booking on disk", "I", "ro", 0),
        Entry(RECORDS, "State of the records: 0 off, 1 on, 2 stopped", "B", "ro", NO_RECORDS),
        Entry(TOOL, "Number of the attachment; 0: standard", "I", "rw", 0, low=0, high=_LARGEST_U32),
        Entry(ADD, "Bucket by hand, in 0.1 kg", "i", "wo", low=1, high=_LARGEST_TARGET),
        Entry(PART, "Next part of the truck", "I", "wo", low=_NEXT, high=_NEXT),
        Entry(TRAILER, "Target of the trailer, in 0.1 kg; 0: none", "i", "rw", 0, low=0, high=_LARGEST_TARGET),
        Entry(IN_PART, "Mass in this part, in 0.1 kg", "i", "ro", 0),
        Entry(PART_NUMBER, "Number of the part; 1: the truck itself", "I", "ro", 1),
    )


def sensor_objects(node: SensorNode) -> tuple[Object, ...]:
    """Return the objects of a simulated sensor as delivered.

    It can send the PDOs of `node`, and is configured over SDO where its mapping is writable.
    """
    identity = tuple(0 if number is None else number for number in node.identity)
    fields = [field for pdo in node.pdos for field in pdo.fields]
    tpdos = (_as_delivered(pdo) if node.writable_mapping else _tpdo(pdo, "ro", len(pdo.fields)) for pdo in node.pdos)
    return merged(
        [
            *_communication(node.profile, node.name, identity, 0, SYNC),
            *(item for tpdo in tpdos for item in tpdo),
            *(_sensor_object(field, node.profile) for field in fields),
            *_profile(node.profile, fields),
        ]
    )


def channels(fields: Iterable[Field]) -> dict[int, Field]:
    """Return the fields with CiA 404's process values among the fields of PDOs, by number of their channel.

    The number is the sub-index of all objects of a channel.
    """
    return {field.sub: field for field in fields if field.index in (INT16, INT32)}


def _communication(profile: int, name: str, identity: Sequence[int], heartbeat_ms: int, sync: int) -> list[Object]:
    """Return the communication objects that every node has.

    profile: number of the device profile, such as 404
    name: name of the node
    identity: vendor, product, revision and serial number
    heartbeat_ms: period of its heartbeat [ms]; 0: none
    sync: COB-ID of SYNC with the producer bit
    """
    analog_inputs = 0x00020000 if profile == 404 else 0
    numbers = zip(("Vendor-ID", "Product code", "Revision number", "Serial number"), identity, strict=True)
    errors = (Entry(k, f"Standard error field {k}", "I", "ro", 0) for k in range(1, HISTORY + 1))
    server = (
        Entry(1, "COB-ID client to server", "I", "ro", SDO_REQUEST, relative=True),
        Entry(2, "COB-ID server to client", "I", "ro", SDO_RESPONSE, relative=True),
    )
    return [
        variable(0x1000, "Device type", "I", "ro", analog_inputs | profile),
        variable(0x1001, "Error register", "B", "ro", 0),
        with_first_entry(
            group(0x1003, "Pre-defined error field", ARRAY, errors),
            Entry(0, "Number of errors", "B", "rw", 0),
        ),
        variable(0x1005, "COB-ID SYNC", "I", "ro", sync),
        variable(0x1008, "Manufacturer device name", TEXT, "const", name),
        variable(0x100A, "Manufacturer software version", TEXT, "const", __version__),
        Object(0x1014, "COB-ID EMCY", VARIABLE, (Entry(0, "COB-ID EMCY", "I", "ro", EMCY, relative=True),)),
        with_first_entry(
            variable(0x1017, "Producer heartbeat time", "H", "rw", heartbeat_ms),
            Entry(0, "Producer heartbeat time", "H", "rw", heartbeat_ms, low=0, high=_LONGEST_HEARTBEAT_MS),
        ),
        group(0x1018, "Identity object", RECORD, (Entry(k, n, "I", "ro", v) for k, (n, v) in enumerate(numbers, 1))),
        group(0x1200, "SDO server parameter", RECORD, server),
    ]


def _tpdo(pdo: Pdo, access: str, mapped: int) -> list[Object]:
    """Return communication and mapping parameters of a TPDO.

    access: "ro" or "rw", of all parameters but the identifier, which can always be written; "rw" also adds unused
        entries to the mapping, up to _SLOTS, and lifts the limits of the identifier
    mapped: how many of the entries are in use
    """
    entries = [f.index << 16 | f.sub << 8 | 8 * CODES[f.code] for f in pdo.fields]
    slots = entries + [0] * (_SLOTS - len(entries)) if access == "rw" else entries
    relative = pdo.can_id - pdo.node_id in (*TPDOS, *RPDOS)
    limits = _COB_IDS if access == "ro" else (None, None)
    parameter = (
        Entry(1, "COB-ID used by TPDO", "I", "rw", pdo.can_id - relative * pdo.node_id, relative, *limits),
        Entry(2, "Transmission type", "B", access, max(pdo.sync, 1) if pdo.synchronous else 255),
        Entry(5, "Event timer", "H", access, 0 if pdo.synchronous else round(1e3 * pdo.period_s)),
    )
    name = f"TPDO {pdo.number}"
    objects = (Entry(k, f"Application object {k}", "I", access, entry) for k, entry in enumerate(slots, 1))
    return [
        group(0x17FF + pdo.number, f"{name} communication parameter", RECORD, parameter),
        with_first_entry(
            group(0x19FF + pdo.number, f"{name} mapping parameter", RECORD, objects),
            Entry(0, "Number of mapped objects", "B", access, mapped),
        ),
    ]


def _as_delivered(pdo: Pdo) -> list[Object]:
    """Return the parameters of a TPDO as delivered: one object mapped, the default identifier, no cyclic transmission.

    A TPDO beyond the fourth, which has no default identifier, is disabled.
    """
    default = TPDOS[pdo.number - 1] + pdo.node_id if pdo.number <= len(TPDOS) else DISABLED
    return _tpdo(pdo._replace(can_id=default, synchronous=False, period_s=0.0), "rw", 1)


def _published_object(field: Field) -> Object:
    """Return the object of a published value. Raises ValueError if it has no name; unused bytes need none."""
    index = field.index
    if field.signal is None:
        return _sensor_object(field, 0)
    if index in _OURS:
        return _mapped_object(field, _OURS[index], RECORD)
    if index not in _NAMES[404]:
        problem = f"object {index:04X}h of the published value {field.signal} has no name"
        raise ValueError(f"{problem}: add its index to _OURS in canopen/dictionary/object_dictionary.py")
    return _mapped_object(field, _NAMES[404][index])


def _sensor_object(field: Field, profile: int) -> Object:
    """Return the object of a sensor's value. Objects that its profile does not name are named by their index."""
    return _mapped_object(field, _NAMES.get(profile, {}).get(field.index, f"Object {field.index:04X}"))


def _mapped_object(field: Field, name: str, kind: int = ARRAY) -> Object:
    """Return the object that a PDO's field carries; its default is "no value".

    name: of the object
    kind: ARRAY or RECORD, of an object with sub-indices
    """
    full_name = name if field.sub == 0 else f"{name} {field.signal or field.sub}"
    full_name += f" ({field.note})" if field.note else ""
    entry = Entry(field.sub, full_name, field.code, "ro", not_available(field.code), mappable=True)
    if field.sub == 0:
        return Object(field.index, name, VARIABLE, (entry,))
    return group(field.index, name, kind, (entry,))


def unit_and_digits(field: Field) -> tuple[int, int]:
    """Return unit (6131h) and decimal digits (6132h) of a field's integers: value = integer / 10^digits units.

    The unit is a code of CiA 303-2 and not always the SI unit, see _UNITS.
    """
    code, size = _UNITS[field.unit]
    return code, max(0, round(-log10(abs(field.scale) / size)))


def _channel_objects(by_number: dict[int, Field]) -> list[Object]:
    """Return the objects 6131h and 6132h: unit and decimal digits of each channel.

    by_number: field of each channel by its number, see `channels`
    """
    units = {number: unit_and_digits(field) for number, field in by_number.items()}
    return [
        group(
            UNIT,
            "AI physical unit PV",
            ARRAY,
            (Entry(k, f"Unit of channel {k}", "I", "ro", unit) for k, (unit, digits) in units.items()),
        ),
        group(
            DIGITS,
            "AI decimal digits PV",
            ARRAY,
            (Entry(k, f"Digits of channel {k}", "B", "ro", digits) for k, (unit, digits) in units.items()),
        ),
    ]


def _own_channels(by_number: dict[int, Field]) -> list[Object]:
    """Return the objects of CiA 404 beside the published process values.

    They are unit, digits and status of each channel, zero and tare, and each process value in the integer type in which
    it is not published.

    by_number: field of each channel by its number, see `channels`
    """
    return [
        *_channel_objects(by_number),
        group(ZERO, "AI autozero", ARRAY, [Entry(1, "Autozero of channel 1", "I", "wo", low=_ZERO, high=_ZERO)]),
        group(TARE, "AI autotare", ARRAY, [Entry(1, "Autotare of channel 1", "I", "wo", low=_TARA, high=_TARE)]),
        group(TARE_VALUE, "AI tare zero", ARRAY, [Entry(1, "Tare of channel 1", "i", "ro", not_available("i"))]),
        group(
            STATUS, "AI status", ARRAY, (Entry(k, f"Status of channel {k}", "B", "ro", 1) for k in sorted(by_number))
        ),
        *(_published_object(replace(f, index=INT16, code="h")) for f in by_number.values() if f.index != INT16),
        *(_published_object(replace(f, index=INT32, code="i")) for f in by_number.values() if f.index != INT32),
    ]


def _profile(profile: int, fields: Sequence[Field]) -> list[Object]:
    """Return the objects with which a device of a profile describes its integers; none for other profiles.

    404: unit and digits of each channel; 410: resolution [0.001 deg]; 406: steps per revolution, 0 for a length

    profile: number of the device profile
    fields: fields of the PDOs that the device sends
    """
    if profile == 404:
        by_number = {f.sub: f for f in fields if f.index in (0x6130, INT16, INT32)}
        return _channel_objects(by_number) if by_number else []
    position = next((f for f in fields if f.unit in ("rad", "m")), None)
    if profile == 410 and position is not None:
        return [variable(0x6000, "Resolution", "H", "ro", round(1e3 * position.scale / DEGREE))]
    if profile == 406 and position is not None:
        turn = round(2.0 * pi / abs(position.scale)) if position.unit == "rad" else 0
        return [
            variable(0x6000, "Operating parameters", "H", "ro", 0),
            variable(0x6001, "Measuring units per revolution", "I", "ro", turn),
        ]
    return []
