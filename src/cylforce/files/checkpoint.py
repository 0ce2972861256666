"""A program's state as JSON and back, without loss: dataclasses, tuples, numbers, enumerations, arrays, bytes.

A log that continues an earlier one begins with the state of the service at that moment. A replay of it alone then gives
the same bytes as the service gave.
"""

from array import array
from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import isfinite
from typing import Any, Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, JsonValue, TypeAdapter

T = TypeVar("T")
BYTES = "bytes"  # type of elements of a value that is bytes, not an array


class PackedArray(BaseModel):
    """An array as JSON.

    dtype: type of its elements in numpy's notation, or BYTES
    shape: its shape
    by_columns: whether its elements lie in memory column by column, not row by row; it is kept because linear algebra
        may round differently in the other order
    data: its bytes in base 64
    plain: whether it is an `array.array` of Python, not an array of numpy
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    dtype: str
    shape: tuple[int, ...]
    by_columns: bool
    data: str
    plain: bool = False


def packed(value: object) -> JsonValue:
    """Return a state as JSON: dataclasses and dictionaries as objects, (named) tuples and lists as lists, arrays as
    their bytes, NaN and infinities as words."""
    if isinstance(value, np.ndarray | array | bytes):
        return _packed_elements(value).model_dump(mode="json")
    if isinstance(value, tuple | list):
        return [packed(part) for part in value]
    if isinstance(value, Mapping):
        return {str(name): packed(part) for name, part in value.items()}
    if is_dataclass(value):
        return {field.name: packed(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, float):
        return float(value) if isfinite(value) else str(float(value))
    return cast(JsonValue, value)


def unpacked(kind: type[T], value: JsonValue) -> T:
    """Return the state from its JSON, the inverse of `packed`. Raises ValueError when the JSON is not of this type.

    kind: type of the state
    value: JSON as from `packed`
    """
    config = ConfigDict(arbitrary_types_allowed=True)
    # in a tuple, because pydantic takes no configuration for a dataclass itself
    (found,) = TypeAdapter(tuple[kind], config=config).validate_python((_with_arrays(value),))  # type: ignore[valid-type]
    return cast(T, found)


def unpacked_state(kinds: Mapping[str, Any], value: JsonValue) -> dict[str, Any]:
    """Return the state from its JSON, by the types of its parts: a type, or a dictionary of such types by name.
    Raises ValueError when the JSON is not of these types."""
    if not isinstance(value, dict) or value.keys() != kinds.keys():
        raise ValueError("the state has other parts than this version's")
    return {
        name: unpacked_state(kind, value[name]) if isinstance(kind, dict) else unpacked(kind, value[name])
        for name, kind in kinds.items()
    }


def _packed_elements(value: "NDArray[np.generic] | array[float] | bytes") -> PackedArray:
    """Return bytes, an array of Python or one of numpy as JSON, the inverse of `_array`."""
    if isinstance(value, bytes):
        data = b64encode(value).decode("ascii")
        return PackedArray(dtype=BYTES, shape=(len(value),), by_columns=False, data=data)
    if isinstance(value, array):
        return _packed_array(np.frombuffer(value, value.typecode)).model_copy(update={"plain": True})
    return _packed_array(value)


def _packed_array(values: NDArray[np.generic]) -> PackedArray:
    """Return a numpy array of any shape as JSON, with its elements in their order in memory."""
    by_columns = values.ndim > 1 and abs(values.strides[0]) < abs(values.strides[-1])
    data = b64encode(values.tobytes("F" if by_columns else "C")).decode("ascii")
    return PackedArray(dtype=values.dtype.str, shape=values.shape, by_columns=by_columns, data=data)


def _with_arrays(value: JsonValue) -> object:
    """Return the state with its bytes and arrays (Python's and NumPy's) unpacked, everything else as it is."""
    if isinstance(value, list):
        return [_with_arrays(part) for part in value]
    if not isinstance(value, dict):
        return value
    if "dtype" in value:
        return _array(PackedArray.model_validate(value))
    return {name: _with_arrays(part) for name, part in value.items()}


def _array(whole: PackedArray) -> "NDArray[np.generic] | array[float] | bytes":
    """Return the bytes or array that were packed, of the same type, shape and order in memory."""
    if whole.dtype == BYTES:
        return b64decode(whole.data)
    order: Literal["C", "F"] = "F" if whole.by_columns else "C"
    flat = np.frombuffer(b64decode(whole.data), np.dtype(whole.dtype))
    if whole.plain:
        return array(flat.dtype.char, flat.tobytes())
    return np.array(flat.reshape(whole.shape, order=order), order=order)
