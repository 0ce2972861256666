"""Conversion of PDO data to SI values and back, by `struct` formats compiled once from the table of PDO layouts."""

from collections.abc import Mapping, Sequence
from functools import cache
from math import isfinite, nan
from struct import Struct
from typing import NamedTuple

from cylforce.signals.kinds import ANGLE_UNIT
from cylforce.signals.layout import CODES, Field, Pdo, not_available
from cylforce.signals.turns import in_range


class Slot(NamedTuple):
    """One field of a PDO that carries a signal.

    signal:        number of the signal
    item:          place among the PDO's fields
    scale, offset: SI value = raw * scale + offset
    low, high:     accepted range [SI]
    """

    signal: int
    item: int
    scale: float
    offset: float
    low: float
    high: float


class Decoder(NamedTuple):
    """Compiled layout of a PDO.

    node_id: CANopen node number of the sender
    struct:  compiled format of all fields, little endian
    slots:   fields that carry signals
    missing: raw value of each field that means "no value"; None: a float, where NaN means it
    """

    node_id: int
    struct: Struct
    slots: tuple[Slot, ...]
    missing: tuple[float | None, ...]


def decoders(pdos: tuple[Pdo, ...], signals: Mapping[str, int]) -> dict[int, Decoder]:
    """Return the decoder of each PDO by its CAN identifier. Fields whose name is not in `signals` are skipped.

    pdos:    layouts of the sensors' PDOs
    signals: number of each signal by its name
    """
    return {pdo.can_id: _decoder(pdo, signals) for pdo in pdos}


def _decoder(pdo: Pdo, signals: Mapping[str, int]) -> Decoder:
    """Return the decoder of one PDO: where its bytes carry signals, and how their raw values become SI values.

    pdo:     layout of the PDO
    signals: number of each signal by its name; fields with other names are skipped
    """
    slots = tuple(
        Slot(signals[f.signal], k, f.scale, f.offset, f.low, f.high)
        for k, f in enumerate(pdo.fields)
        if f.signal is not None and f.signal in signals
    )
    missing = tuple(not_available(f.code) if f.code != "f" else None for f in pdo.fields)
    return Decoder(pdo.node_id, _struct(pdo), slots, missing)


def _struct(pdo: Pdo) -> Struct:
    """Return the compiled format of a PDO's data, little endian, without gaps."""
    return _little_endian(*[field.code for field in pdo.fields])


@cache
def _little_endian(*codes: str) -> Struct:
    """Return the compiled little-endian format of fields with these `struct` codes, without gaps."""
    return Struct("<" + "".join(codes))


def decode(pdo: Pdo, data: bytes) -> dict[str, float]:
    """Return the SI values that the data of a PDO carry, by the names of the signals; NaN for "no value".

    Values out of the fields' ranges are returned, too; bytes beyond the PDO are ignored. Raises struct.error when
    `data` is shorter than the PDO.

    pdo:  layout of the PDO
    data: bytes of the frame
    """
    raw = _struct(pdo).unpack_from(data)
    return {
        f.signal: float("nan") if f.code != "f" and r == not_available(f.code) else r * f.scale + f.offset
        for f, r in zip(pdo.fields, raw, strict=True)
        if f.signal is not None
    }


def encode(pdo: Pdo, values: Mapping[str, float]) -> bytes:
    """Return the data of a PDO from SI values by name.

    A value that is missing, not finite or outside the field's range is sent as "no value". An angle outside its range
    is sent with the whole turns added that lead into it, as its sensor does. Unused bytes are sent as 0.

    values: SI value of each signal, by its name
    """
    return packed(layout(pdo), [_readable(f, values.get(f.signal, nan)) if f.signal else 0.0 for f in pdo.fields])


def _readable(field: Field, value: float) -> float:
    """Return a field's value [SI] as its sensor sends it: an angle with the whole turns that lead into the range.

    A value that is in range or not finite, any other unit, and an angle that no whole turns lead into the range are
    returned as they are."""
    if field.unit != ANGLE_UNIT or not isfinite(value) or field.low <= value <= field.high:
        return value
    return float(in_range(value, field.low, field.high))


class Raw(NamedTuple):
    """Conversion of a field's value to a number on the bus.

    low, high:     range of the value [SI]
    scale, offset: value = raw * scale + offset [SI]
    integers:      smallest and largest integer that carries a value; None: a float
    missing:       number that means "no value"
    """

    low: float
    high: float
    scale: float
    offset: float
    integers: tuple[int, int] | None
    missing: int | float

    @property
    def fits(self) -> bool:
        """Whether the field is an integer without offset, and no value of its range needs another than it can hold.

        The ends of the range are checked: each has an integer that carries it, or the one that means "no value".
        """
        if self.offset or self.integers is None:
            return False
        least, most = self.integers
        return all(
            least <= end <= most or end == self.missing for end in (self.low / self.scale, self.high / self.scale)
        )


class Layout(NamedTuple):
    """Layout of a PDO, for encoding.

    struct: compiled format of all fields, little endian
    fields: conversion of each field, in their order
    """

    struct: Struct
    fields: tuple[Raw, ...]


@cache
def layout(pdo: Pdo) -> Layout:
    """Return the layout of a PDO, for encoding."""
    return Layout(_struct(pdo), tuple(map(_raw_field, pdo.fields)))


def _raw_field(f: Field) -> Raw:
    """Return the conversion of a field's value to a number on the bus."""
    return Raw(f.low, f.high, f.scale, f.offset, _RAW_RANGES.get(f.code), not_available(f.code))


def packed(of: Layout, values: Sequence[float]) -> bytes:
    """Return the data of a PDO from the SI values of all its fields, in their order.

    A value that is not finite, out of the field's range, or without an integer is sent as "no value". Unlike
    `encode`, it adds no whole turns to angles.
    """
    return of.struct.pack(*_raws(of, values))


def _raws(of: Layout, values: Sequence[float]) -> list[float]:
    """Return the number on the bus of each field: raw = (value - offset) / scale, rounded where it is an integer.

    A value that is not finite, out of the field's range, or without an integer is sent as "no value".

    values: SI values of all fields, in their order
    """
    raws = list[float]()
    for (low, high, scale, offset, integers, missing), value in zip(of.fields, values, strict=True):
        if not low <= value <= high or not isfinite(value):
            raws.append(missing)
        elif integers is None:
            raws.append((value - offset) / scale)
        else:
            raw = round((value - offset) / scale)
            raws.append(raw if integers[0] <= raw <= integers[1] else missing)
    return raws


def _raw_range(code: str) -> tuple[int, int]:
    """Return the smallest and largest integer that carries a value: all but the one that means "no value"."""
    bits = 8 * CODES[code]
    return (0, (1 << bits) - 2) if code.isupper() else (1 - (1 << (bits - 1)), (1 << (bits - 1)) - 1)


_RAW_RANGES = {code: _raw_range(code) for code in CODES if code != "f"}
