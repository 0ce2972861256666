"""The DBC file of all that our node and the sensors send, from the same tables as their PDOs and EDS."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from cylforce.canopen.j1939 import (
    LARGEST_TOTAL,
    LIFETIME_LOADED,
    LIFETIME_UNLOADED,
    LOADED,
    OURS,
    PROCESS_DATA,
    UNLOADED,
    VEHICLE_WEIGHT,
    identifier,
)
from cylforce.mechanics.installation import SensorNode
from cylforce.service.publication import EVENT_KIND, FORCE_QUALITY, PAYLOAD_QUALITY, QUALITY
from cylforce.signals.contact import EventKind
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.layout import CODES, Field, Pdo, not_available
from cylforce.signals.units import DEGREE

NODE = "cylforce"
PERIOD = "GenMsgCycleTime"  # the attribute by which CAN tools know how often a message comes
_UNITS = {"rad": ("deg", DEGREE), "1": ("", 1.0)}  # SI unit: unit shown instead, its size in SI
_NMT = {0: "boot_up", 4: "stopped", 5: "operational", 127: "pre_operational"}
_STATUS_BITS = 2

_TOTALS = {
    LOADED: "loaded_total_mass",
    UNLOADED: "unloaded_total_mass",
    LIFETIME_LOADED: "lifetime_loaded_total_mass",
    LIFETIME_UNLOADED: "lifetime_unloaded_total_mass",
}


class DbcSignal(NamedTuple):
    """A signal: place and length [bits], scale and offset to `unit`; `words`: names of raw values; least and greatest
    value (both 0: not said)."""

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
    """A message: name, identifier, length [bytes], sender, signals; how often it is sent [ms] (0: when something
    happens); what it is."""

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
    """The file's text (ASCII): our TPDOs, heartbeat and emergency message, and those of the sensors; little endian.
    `j1939`: our address there, if any."""
    everything = [(NODE, node_id, pdos, heartbeat_ms)]
    everything += [(node.name, node.node_id, node.pdos, round(1e3 * node.heartbeat_s)) for node in sensors]
    found = [message for node in everything for message in _messages(*node)]
    found += _j1939(j1939, round(1e3 * pdos[0].period_s)) if j1939 is not None else []
    messages = sorted(found, key=lambda message: message.can_id)
    tables = [pdo for _, _, own, _ in everything for pdo in own]
    return "".join(
        [
            'VERSION ""\n\nNS_ :\n\nBS_:\n\n',
            f"BU_: {' '.join(name for name, *_ in everything)}\n\n",
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
    """All that a node sends of itself."""
    for pdo in pdos:
        how = "after SYNC" if pdo.synchronous else "by a timer"
        note = f"TPDO {pdo.number} of node {node_id}, {how}"
        period = round(1e3 * pdo.period_s)
        yield DbcMessage(f"{name}_tpdo{pdo.number}", pdo.can_id, pdo.length, name, _signals(pdo), period, note)
    beat = [DbcSignal("nmt_state", 0, 8, False, 1.0, 0.0, "", _NMT)]
    yield DbcMessage(f"{name}_heartbeat", 0x700 + node_id, 1, name, beat, heartbeat_ms, f"Heartbeat of node {node_id}")
    yield DbcMessage(f"{name}_emergency", 0x80 + node_id, 8, name, _emergency(), 0, f"EMCY of node {node_id}")


def _j1939(address: int, period_ms: int) -> list[DbcMessage]:
    """Our messages on J1939 (`canopen/j1939.py`)."""
    absent, largest = {0xFFFF: "no_value"}, 64255.0
    payload, force = ("payload_status", "payload_reason"), ("soil_magnitude_status", "soil_magnitude_reason")
    weight = [DbcSignal("cargo_weight", 40, 16, False, 2.0, 0.0, "kg", absent, 0.0, 2.0 * largest)]
    ours = [
        DbcSignal("payload_standard_error", 0, 16, False, 0.1, 0.0, "kg", absent, 0.0, 0.1 * largest),
        DbcSignal("soil_magnitude", 16, 16, False, 10.0, 0.0, "N", absent, 0.0, 10.0 * largest),
        DbcSignal("soil_direction", 32, 16, False, 0.01, -180.0, "deg", absent, -180.0, 180.0),
        *_quality(*payload, 48),
        *_quality(*force, 56),
    ]
    total = [
        DbcSignal("process_data_command", 0, 4, False, 1.0, 0.0, "", {3: "value"}),
        DbcSignal("process_data_element", 4, 12, False, 1.0, 0.0, "", {}),
        DbcSignal("total_of", 16, 16, False, 1.0, 0.0, "", _TOTALS),
        DbcSignal("total", 32, 32, True, 1.0, 0.0, "kg", {}, 0.0, float(LARGEST_TOTAL)),
    ]
    return [
        DbcMessage(name, identifier(pgn, address), 8, NODE, signals, every_ms, f"J1939, PGN {pgn}: {what}")
        for name, pgn, signals, every_ms, what in (
            ("vehicle_weight", VEHICLE_WEIGHT, weight, period_ms, "Vehicle Weight, SPN 181"),
            (f"{NODE}_j1939", OURS, ours, period_ms, "Proprietary B"),
            (f"{NODE}_totals", PROCESS_DATA, total, 1000, "process data of ISO 11783, DDI 428 to 431"),
        )
    ]


def _quality(status: str, reason: str, start: int, bits: int = 8) -> list[DbcSignal]:
    """A quality byte as its two parts."""
    return [
        DbcSignal(status, start, _STATUS_BITS, False, 1.0, 0.0, "", _names(Status)),
        DbcSignal(reason, start + _STATUS_BITS, bits - _STATUS_BITS, False, 1.0, 0.0, "", _names(Reason)),
    ]


def _signals(pdo: Pdo) -> list[DbcSignal]:
    found: list[DbcSignal] = []
    start = 0
    for field in pdo.fields:
        found += _field(field, start)
        start += 8 * CODES[field.code]
    return found


def _field(field: Field, start: int) -> Iterable[DbcSignal]:
    if field.signal is None:
        return
    if field.signal in (PAYLOAD_QUALITY, FORCE_QUALITY, *QUALITY.values()):
        what = field.signal.removesuffix("_quality")
        yield from _quality(f"{what}_status", f"{what}_reason", start, 8 * CODES[field.code])
        return
    unit, size = _UNITS.get(field.unit, (field.unit, 1.0))
    words = {} if field.code == "f" else {int(not_available(field.code)): "no_value"}
    words |= _names(EventKind) if field.signal == EVENT_KIND else {}
    scale, offset = field.scale / size, field.offset / size
    limits = (field.low / size, field.high / size)
    signed = field.code.islower()
    yield DbcSignal(field.signal, start, 8 * CODES[field.code], signed, scale, offset, unit, words, *limits)


def _names(words: type[Status] | type[Reason] | type[EventKind]) -> dict[int, str]:
    return {int(word): word.name.lower() for word in words}


def _emergency() -> list[DbcSignal]:
    return [
        DbcSignal("error_code", 0, 16, False, 1.0, 0.0, "", {0: "no_error"}),
        DbcSignal("error_register", 16, 8, False, 1.0, 0.0, "", {}),
        DbcSignal("error_information", 24, 40, False, 1.0, 0.0, "", {}),
    ]


def _message(message: DbcMessage) -> str:
    head = f"BO_ {message.can_id} {message.name}: {message.length} {message.sender}\n"
    return head + "".join(map(_signal, message.signals)) + "\n"


def _signal(signal: DbcSignal) -> str:
    sign = "-" if signal.signed else "+"
    place = f"{signal.start}|{signal.length}@1{sign}"
    limits = f"[{signal.low:.12g}|{signal.high:.12g}]"
    scale = f"({signal.scale:.12g},{signal.offset:.12g})"
    return f' SG_ {signal.name} : {place} {scale} {limits} "{signal.unit}" Vector__XXX\n'


def _notes(pdo: Pdo) -> str:
    """Bandwidth and delay, as comments."""
    said = ((field.signal, field.note) for field in pdo.fields if field.note)
    return "".join(f'CM_ SG_ {pdo.can_id} {name} "{note}";\n' for name, note in said)


def _types(pdo: Pdo) -> str:
    """Floating-point signals need an entry of their own (SIG_VALTYPE_)."""
    floats = (field.signal for field in pdo.fields if field.code == "f" and field.signal)
    return "".join(f"SIG_VALTYPE_ {pdo.can_id} {name} : 1;\n" for name in floats)


def _words(can_id: int, signal: DbcSignal) -> str:
    if not signal.words:
        return ""
    pairs = " ".join(f'{raw} "{word}"' for raw, word in signal.words.items())
    return f"VAL_ {can_id} {signal.name} {pairs} ;\n"
