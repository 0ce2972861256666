"""The DBC file of all that our node sends, from the same table as its PDOs and EDS."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from cylforce.service.publication import EVENT_KIND, FORCE_QUALITY, PAYLOAD_QUALITY, QUALITY
from cylforce.signals.contact import EventKind
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.layout import CODES, Field, Pdo, not_available
from cylforce.signals.units import DEGREE

NODE = "cylforce"
_UNITS = {"rad": ("deg", DEGREE), "1": ("", 1.0)}  # SI unit: unit shown instead, its size in SI
_NMT = {0: "boot_up", 4: "stopped", 5: "operational", 127: "pre_operational"}
_STATUS_BITS = 2


class DbcSignal(NamedTuple):
    """A signal: place and length [bits], scale and offset to `unit`; `words`: names of raw values."""

    name: str
    start: int
    length: int
    signed: bool
    scale: float
    offset: float
    unit: str
    words: Mapping[int, str]


def dbc(pdos: Sequence[Pdo], node_id: int) -> str:
    """The file's text (ASCII): our TPDOs, heartbeat and emergency message, little endian."""
    messages = [
        *((f"{NODE}_tpdo{pdo.number}", pdo.can_id, pdo.length, _signals(pdo)) for pdo in pdos),
        (f"{NODE}_heartbeat", 0x700 + node_id, 1, [DbcSignal("nmt_state", 0, 8, False, 1.0, 0.0, "", _NMT)]),
        (f"{NODE}_emergency", 0x80 + node_id, 8, _emergency()),
    ]
    ordered = sorted(messages, key=lambda message: message[1])
    return "".join(
        [
            'VERSION ""\n\nNS_ :\n\nBS_:\n\n',
            f"BU_: {NODE}\n\n",
            *(_message(*message) for message in ordered),
            *(_notes(pdo) for pdo in pdos),
            *(_types(pdo) for pdo in pdos),
            *(_words(can_id, signal) for _, can_id, _, signals in ordered for signal in signals),
        ]
    )


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
        yield DbcSignal(f"{what}_status", start, _STATUS_BITS, False, 1.0, 0.0, "", _names(Status))
        bits = 8 * CODES[field.code] - _STATUS_BITS
        yield DbcSignal(f"{what}_reason", start + _STATUS_BITS, bits, False, 1.0, 0.0, "", _names(Reason))
        return
    unit, size = _UNITS.get(field.unit, (field.unit, 1.0))
    words = {} if field.code == "f" else {int(not_available(field.code)): "no_value"}
    words |= _names(EventKind) if field.signal == EVENT_KIND else {}
    scale, offset = field.scale / size, field.offset / size
    yield DbcSignal(field.signal, start, 8 * CODES[field.code], field.code.islower(), scale, offset, unit, words)


def _names(words: type[Status] | type[Reason] | type[EventKind]) -> dict[int, str]:
    return {int(word): word.name.lower() for word in words}


def _emergency() -> list[DbcSignal]:
    return [
        DbcSignal("error_code", 0, 16, False, 1.0, 0.0, "", {0: "no_error"}),
        DbcSignal("error_register", 16, 8, False, 1.0, 0.0, "", {}),
        DbcSignal("error_information", 24, 40, False, 1.0, 0.0, "", {}),
    ]


def _message(name: str, can_id: int, length: int, signals: Iterable[DbcSignal]) -> str:
    return f"BO_ {can_id} {name}: {length} {NODE}\n" + "".join(map(_signal, signals)) + "\n"


def _signal(signal: DbcSignal) -> str:
    sign = "-" if signal.signed else "+"
    place = f"{signal.start}|{signal.length}@1{sign}"
    return (
        f' SG_ {signal.name} : {place} ({signal.scale:.12g},{signal.offset:.12g}) [0|0] "{signal.unit}" Vector__XXX\n'
    )


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
