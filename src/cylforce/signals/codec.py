"""Bytes to SI values and back, by structs compiled once from the table of PDO layouts."""

from collections.abc import Mapping
from math import isfinite, nan
from struct import Struct
from typing import NamedTuple

from cylforce.signals.layout import CODES, Field, Pdo, not_available


class Slot(NamedTuple):
    """Where a decoded value goes: signal number, scale, offset, believed range."""

    signal: int
    item: int
    scale: float
    offset: float
    low: float
    high: float


class Decoder(NamedTuple):
    """A PDO's compiled layout."""

    node_id: int
    struct: Struct
    slots: tuple[Slot, ...]
    missing: tuple[float | None, ...]


def decoders(pdos: tuple[Pdo, ...], signals: Mapping[str, int]) -> dict[int, Decoder]:
    """CAN identifier -> decoder; `signals` maps names to numbers, fields of other names are gaps."""
    return {pdo.can_id: _decoder(pdo, signals) for pdo in pdos}


def _decoder(pdo: Pdo, signals: Mapping[str, int]) -> Decoder:
    slots = tuple(
        Slot(signals[f.signal], k, f.scale, f.offset, f.low, f.high)
        for k, f in enumerate(pdo.fields)
        if f.signal is not None and f.signal in signals
    )
    missing = tuple(not_available(f.code) if f.code != "f" else None for f in pdo.fields)
    return Decoder(pdo.node_id, _struct(pdo), slots, missing)


def _struct(pdo: Pdo) -> Struct:
    return Struct("<" + "".join(field.code for field in pdo.fields))


def decode(pdo: Pdo, data: bytes) -> dict[str, float]:
    """Named SI values of a PDO's data; NaN where the producer says that it has none."""
    raw = _struct(pdo).unpack_from(data)
    return {
        f.signal: float("nan") if f.code != "f" and r == not_available(f.code) else r * f.scale + f.offset
        for f, r in zip(pdo.fields, raw, strict=True)
        if f.signal is not None
    }


def encode(pdo: Pdo, values: Mapping[str, float]) -> bytes:
    """Data of a PDO from named SI values; what is missing, not finite or out of the field's range becomes "no
    value"."""
    return _struct(pdo).pack(*(_raw(f, values.get(f.signal, nan) if f.signal else 0.0) for f in pdo.fields))


def _raw(field: Field, value: float) -> int | float:
    if not isfinite(value) or not field.low <= value <= field.high:
        return not_available(field.code)
    if field.code == "f":
        return (value - field.offset) / field.scale
    low, high = _RAW_RANGES[field.code]
    raw = round((value - field.offset) / field.scale)
    return raw if low <= raw <= high else not_available(field.code)


def _raw_range(code: str) -> tuple[int, int]:
    """Integers that carry a value: all but the one that says "no value"; of signed ones as many below 0 as above."""
    bits = 8 * CODES[code]
    return (0, (1 << bits) - 2) if code.isupper() else (1 - (1 << (bits - 1)), (1 << (bits - 1)) - 1)


_RAW_RANGES = {code: _raw_range(code) for code in CODES if code != "f"}
