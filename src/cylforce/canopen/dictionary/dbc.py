"""The DBC file of all that our node and the sensors send, from the same tables as their PDOs and EDS."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from cylforce.canopen.j1939 import (
    ANGLE,
    CARGO_KG,
    ERROR_KG,
    FORCE_N,
    LARGEST,
    LARGEST_TOTAL,
    LIFETIME_LOADED,
    LIFETIME_UNLOADED,
    LOADED,
    NOT_AVAILABLE,
    OURS,
    PROCESS_DATA,
    UNLOADED,
    VALUE,
    VEHICLE_WEIGHT,
    identifier,
)
from cylforce.mechanics.installation import SensorNode
from cylforce.service.published_values import EVENT_KIND, FORCE_QUALITY, PAYLOAD_QUALITY, QUALITY
from cylforce.signals.contact import EventKind
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.identifiers import EMCY, HEARTBEAT
from cylforce.signals.layout import CODES, Field, Pdo, not_available
from cylforce.signals.units import DEGREE

NODE = "cylforce"
PERIOD = "GenMsgCycleTime"  # the attribute from which CAN tools read the period of a message [ms]
_UNITS = {"rad": ("deg", DEGREE), "1": ("", 1.0)}  # SI unit: unit shown instead, its size in SI
_NMT = {0: "boot_up", 4: "stopped", 5: "operational", 127: "pre_operational"}
_STATUS_BITS = 2  # of a quality; the other bits are the reason

_TOTALS = {
    LOADED: "loaded_total_mass",
    UNLOADED: "unloaded_total_mass",
    LIFETIME_LOADED: "lifetime_loaded_total_mass",
    LIFETIME_UNLOADED: "lifetime_unloaded_total_mass",
}


class DbcSignal(NamedTuple):
    """A signal of a message.

    name: name in the file
    start: position of its lowest bit
    length: number of bits
    signed: whether the raw value is signed
    scale: factor of value = raw * scale + offset, in `unit`
    offset: offset of the value, in `unit`
    unit: unit of the value
    words: names of raw values
    low: least value; 0 with `high` 0: not limited
    high: greatest value
    """

    name: str
    start: int
    length: int
    signed: bool
    scale: float
    offset: float
    unit: str
    words: Mapping[int, str]
    low: float = 0.0
    high: float = 0.0


class DbcMessage(NamedTuple):
    """A message.

    name: name in the file
    can_id: identifier, with DBC's flag for 29 bits
    length: [bytes]
    sender: name of the node
    signals: its signals
    period_ms: period [ms]; 0: sent on events
    note: comment
    """

    name: str
    can_id: int
    length: int
    sender: str
    signals: list[DbcSignal]
    period_ms: int
    note: str


def dbc(
    pdos: Sequence[Pdo],
    node_id: int,
    sensors: Sequence[SensorNode] = (),
    heartbeat_ms: int = 500,
    j1939: int | None = None,
) -> str:
    """Return the text of the DBC file (ASCII, little endian): TPDOs, heartbeat and emergency messages of all nodes.

    pdos: TPDOs of our node
    node_id: number of our node
    sensors: the sensor nodes
    heartbeat_ms: heartbeat period of our node [ms]
    j1939: our address on J1939; None: nothing is sent there
    """
    unsorted = list(_messages(NODE, node_id, pdos, heartbeat_ms))
    for node in sensors:
        unsorted += _messages(node.name, node.node_id, node.pdos, round(1e3 * node.heartbeat_s))
    unsorted += _j1939(j1939, round(1e3 * pdos[0].period_s)) if j1939 is not None else []
    messages = sorted(unsorted, key=lambda message: message.can_id)
    tables = [*pdos, *(pdo for node in sensors for pdo in node.pdos)]
    return "".join(
        [
            'VERSION ""\n\nNS_ :\n\nBS_:\n\n',
            f"BU_: {' '.join([NODE, *(node.name for node in sensors)])}\n\n",
            *map(_message, messages),
            *(f'CM_ BO_ {message.can_id} "{message.note}";\n' for message in messages),
            *map(_notes, tables),
            f'BA_DEF_ BO_ "{PERIOD}" INT 0 3600000;\nBA_DEF_DEF_ "{PERIOD}" 0;\n',
            *(f'BA_ "{PERIOD}" BO_ {m.can_id} {m.period_ms};\n' for m in messages if m.period_ms),
            *map(_types, tables),
            *(_words(message.can_id, signal) for message in messages for signal in message.signals),
        ]
    )


def _messages(name: str, node_id: int, pdos: Sequence[Pdo], heartbeat_ms: int) -> Iterator[DbcMessage]:
    """Yield the messages of a node: its PDOs, heartbeat and emergency message.

    name: name of the node
    heartbeat_ms: period of its heartbeat [ms]
    """
    for pdo in pdos:
        yield DbcMessage(
            name=f"{name}_tpdo{pdo.number}",
            can_id=pdo.can_id,
            length=pdo.length,
            sender=name,
            signals=_signals(pdo),
            period_ms=round(1e3 * pdo.period_s),
            note=f"TPDO {pdo.number} of node {node_id}, {'after SYNC' if pdo.synchronous else 'by a timer'}",
        )
    yield DbcMessage(
        name=f"{name}_heartbeat",
        can_id=HEARTBEAT + node_id,
        length=1,
        sender=name,
        signals=[_integer("nmt_state", 0, 8, _NMT)],
        period_ms=heartbeat_ms,
        note=f"Heartbeat of node {node_id}",
    )
    yield DbcMessage(
        name=f"{name}_emergency",
        can_id=EMCY + node_id,
        length=8,
        sender=name,
        signals=[
            _integer("error_code", 0, 16, {0: "no_error"}),
            _integer("error_register", 16, 8),
            _integer("error_information", 24, 40),
        ],
        period_ms=0,
        note=f"EMCY of node {node_id}",
    )


def _integer(name: str, start: int, length: int, words: Mapping[int, str] | None = None) -> DbcSignal:
    """Return an unsigned signal without unit and scale.

    start: position of its lowest bit
    length: [bits]
    words: names of raw values
    """
    return DbcSignal(
        name=name, start=start, length=length, signed=False, scale=1.0, offset=0.0, unit="", words=words or {}
    )


def _j1939(address: int, period_ms: int) -> list[DbcMessage]:
    """Return our messages on J1939 (`canopen/j1939.py`).

    address: our address on J1939
    period_ms: period of weight, standard error and force [ms]; totals are sent every second
    """
    payload, force = ("payload_status", "payload_reason"), ("soil_magnitude_status", "soil_magnitude_reason")
    weight = [_two_bytes("cargo_weight", 40, scale=CARGO_KG, unit="kg")]
    ours = [
        _two_bytes("payload_standard_error", 0, scale=ERROR_KG, unit="kg"),
        _two_bytes("soil_magnitude", 16, scale=FORCE_N, unit="N"),
        _two_bytes("soil_direction", 32, scale=ANGLE / DEGREE, unit="deg")._replace(
            offset=-180.0, low=-180.0, high=180.0
        ),
        *_quality(*payload, 48),
        *_quality(*force, 56),
    ]
    total = [
        _integer("process_data_command", 0, 4, {VALUE: "value"}),
        _integer("process_data_element", 4, 12),
        _integer("total_of", 16, 16, _TOTALS),
        DbcSignal(
            name="total",
            start=32,
            length=32,
            signed=True,
            scale=1.0,
            offset=0.0,
            unit="kg",
            words={},
            high=float(LARGEST_TOTAL),
        ),
    ]
    return [
        DbcMessage(name, identifier(pgn, address), 8, NODE, signals, every_ms, f"J1939, PGN {pgn}: {what}")
        for name, pgn, signals, every_ms, what in (
            ("vehicle_weight", VEHICLE_WEIGHT, weight, period_ms, "Vehicle Weight, SPN 181"),
            (f"{NODE}_j1939", OURS, ours, period_ms, "Proprietary B"),
            (f"{NODE}_totals", PROCESS_DATA, total, 1000, "process data of ISO 11783, DDI 428 to 431"),
        )
    ]


def _two_bytes(name: str, start: int, scale: float, unit: str) -> DbcSignal:
    """Return an unsigned signal of two bytes on J1939, whose raw values are 0 to LARGEST, or NOT_AVAILABLE.

    start: position of its lowest bit
    scale: resolution, in `unit`
    """
    return DbcSignal(
        name=name,
        start=start,
        length=16,
        signed=False,
        scale=scale,
        offset=0.0,
        unit=unit,
        words={NOT_AVAILABLE: "no_value"},
        high=scale * LARGEST,
    )


def _quality(status: str, reason: str, start: int, bits: int = 8) -> list[DbcSignal]:
    """Return the signals of status and reason, which are packed into a quality of `bits` bits from bit `start` on.

    status, reason: names of the two signals
    """
    return [
        _integer(status, start, _STATUS_BITS, _names(Status)),
        _integer(reason, start + _STATUS_BITS, bits - _STATUS_BITS, _names(Reason)),
    ]


def _signals(pdo: Pdo) -> list[DbcSignal]:
    """Return the signals of a PDO, one after the other."""
    signals: list[DbcSignal] = []
    start = 0
    for field in pdo.fields:
        signals += _field(field, start)
        start += 8 * CODES[field.code]
    return signals


def _field(field: Field, start: int) -> Iterable[DbcSignal]:
    """Yield the signals of a PDO's field: two (status, reason) for a quality, none for unused bytes, else one.

    start: position of its lowest bit in the data
    """
    if field.signal is None:
        return
    if field.signal in (PAYLOAD_QUALITY, FORCE_QUALITY, *QUALITY.values()):
        name = field.signal.removesuffix("_quality")
        yield from _quality(f"{name}_status", f"{name}_reason", start, 8 * CODES[field.code])
        return
    unit, size = _UNITS.get(field.unit, (field.unit, 1.0))
    words = {} if field.code == "f" else {int(not_available(field.code)): "no_value"}
    words |= _names(EventKind) if field.signal == EVENT_KIND else {}
    yield DbcSignal(
        name=field.signal,
        start=start,
        length=8 * CODES[field.code],
        signed=field.code.islower(),
        scale=field.scale / size,
        offset=field.offset / size,
        unit=unit,
        words=words,
        low=field.low / size,
        high=field.high / size,
    )


def _names(words: type[Status] | type[Reason] | type[EventKind]) -> dict[int, str]:
    """Return the names of an enumeration's values, in lower case, by value."""
    return {int(word): word.name.lower() for word in words}


def _message(message: DbcMessage) -> str:
    """Return the lines that define a message and its signals."""
    head = f"BO_ {message.can_id} {message.name}: {message.length} {message.sender}\n"
    return head + "".join(map(_signal, message.signals)) + "\n"


def _signal(signal: DbcSignal) -> str:
    """Return the line that defines a signal."""
    sign = "-" if signal.signed else "+"
    place = f"{signal.start}|{signal.length}@1{sign}"
    limits = f"[{signal.low:.12g}|{signal.high:.12g}]"
    scale = f"({signal.scale:.12g},{signal.offset:.12g})"
    return f' SG_ {signal.name} : {place} {scale} {limits} "{signal.unit}" Vector__XXX\n'


def _notes(pdo: Pdo) -> str:
    """Return the lines that comment a PDO's signals with their bandwidth and delay."""
    noted = ((signal.name, field.note) for field in pdo.fields if field.note for signal in _field(field, 0))
    return "".join(f'CM_ SG_ {pdo.can_id} {name} "{note}";\n' for name, note in noted)


def _types(pdo: Pdo) -> str:
    """Return the entries SIG_VALTYPE_ that mark floating-point signals."""
    floats = (field.signal for field in pdo.fields if field.code == "f" and field.signal)
    return "".join(f"SIG_VALTYPE_ {pdo.can_id} {name} : 1;\n" for name in floats)


def _words(can_id: int, signal: DbcSignal) -> str:
    """Return the table of named raw values of a signal."""
    if not signal.words:
        return ""
    pairs = " ".join(f'{raw} "{word}"' for raw, word in signal.words.items())
    return f"VAL_ {can_id} {signal.name} {pairs} ;\n"
