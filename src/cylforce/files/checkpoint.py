"""A program's state as JSON and back, without loss: tuples, numbers, enumerations, arrays, bytes.

A log that continues an earlier one begins with the state of the service at that moment, so that a replay of it alone
gives the same bytes as the service gave."""

from array import array
from base64 import b64decode, b64encode
from math import isfinite
from typing import Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, JsonValue, TypeAdapter

T = TypeVar("T")
BYTES = "bytes"  # in place of a type of elements


class PackedArray(BaseModel):
    """An array: its elements' type in numpy's notation, its shape, its bytes in base 64. `by_columns`: the order of its
    elements in memory, because linear algebra may round differently in the other order; `plain`: Python's own array of
    numbers, not numpy's."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    dtype: str
    shape: tuple[int, ...]
    by_columns: bool
    data: str
    plain: bool = False


def packed(value: object) -> JsonValue:
    """The state as JSON: (named) tuples as lists, arrays as their bytes, NaN and infinities as words."""
    if isinstance(value, np.ndarray):
        return _packed_array(value).model_dump(mode="json")
    if isinstance(value, array):
        whole = _packed_array(np.frombuffer(value, value.typecode))
        return whole.model_copy(update={"plain": True}).model_dump(mode="json")
    if isinstance(value, bytes):
        data = b64encode(value).decode("ascii")
        return PackedArray(dtype=BYTES, shape=(len(value),), by_columns=False, data=data).model_dump(mode="json")
    if isinstance(value, tuple):
        return [packed(part) for part in value]
    if isinstance(value, float):
        return float(value) if isfinite(value) else str(float(value))
    return cast(JsonValue, value)


def unpacked(kind: type[T], value: JsonValue) -> T:
    """The state of type `kind` that was packed. Raises ValueError when it is not one."""
    return TypeAdapter(kind, config=ConfigDict(arbitrary_types_allowed=True)).validate_python(_with_arrays(value))


def _packed_array(of: NDArray[np.generic]) -> PackedArray:
    by_columns = of.ndim > 1 and abs(of.strides[0]) < abs(of.strides[-1])
    data = b64encode(of.tobytes("F" if by_columns else "C")).decode("ascii")
    return PackedArray(dtype=of.dtype.str, shape=of.shape, by_columns=by_columns, data=data)


def _with_arrays(value: JsonValue) -> object:
    if isinstance(value, list):
        return [_with_arrays(part) for part in value]
    return _array(PackedArray.model_validate(value)) if isinstance(value, dict) else value


def _array(said: PackedArray) -> "NDArray[np.generic] | array[float] | bytes":
    if said.dtype == BYTES:
        return b64decode(said.data)
    order: Literal["C", "F"] = "F" if said.by_columns else "C"
    flat = np.frombuffer(b64decode(said.data), np.dtype(said.dtype))
    if said.plain:
        return array(flat.dtype.char, flat.tobytes())
    return np.array(flat.reshape(said.shape, order=order), order=order)
