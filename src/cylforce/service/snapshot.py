"""State of the estimators as plain data: copied, restored and described by types, for the header of a log."""

from array import array
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any, get_type_hints

import numpy as np

State = dict[str, Any]


class Constants:
    """Base of the constants that an estimator computes once for its machine. No snapshot contains them."""


class Estimator:
    """Base of an object whose fields change from step to step: a dataclass with slots.

    A field is state, unless its type is derived from `Constants`. A field may be an estimator itself, or a dictionary
    of estimators.
    """

    __slots__ = ()

    def snapshot(self) -> State:
        """Return a copy of the state as a dictionary, with the names of the fields as keys."""
        return {name: _copied(getattr(self, name)) for name in kinds(type(self))}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Replace the state by a copy of a `snapshot`.

        state: value of each field, by its name; of a field that is an estimator, that estimator's own snapshot; of a
               dictionary of estimators, a dictionary of theirs by the same keys
        """
        for name in kinds(type(self)):
            now = getattr(self, name)
            if isinstance(now, Estimator):
                now.restore(state[name])
            elif _is_table(now):
                for key, part in now.items():
                    part.restore(state[name][key])
            else:
                setattr(self, name, _copied(state[name]))

    def types(self) -> dict[str, Any]:
        """Return the type of each field of the state, by the field's name.

        For a field that is an estimator it is that estimator's dictionary of types; for a dictionary of estimators, a
        dictionary of those by the same keys. Fields of constants are no state, and are omitted."""
        found = dict[str, Any]()
        for name, kind in kinds(type(self)).items():
            now = getattr(self, name)
            if _is_table(now):
                found[name] = {key: part.types() for key, part in now.items()}
            else:
                found[name] = now.types() if isinstance(now, Estimator) else kind
        return found


def kinds(estimator: type) -> dict[str, Any]:
    """Return the types of an estimator's state as a dictionary, with the names of the fields as keys."""
    return _kinds(estimator)


@cache
def _kinds(estimator: type) -> dict[str, Any]:
    """Return the types of an estimator's fields by their names, without those derived from `Constants`."""
    hints = get_type_hints(estimator)
    names = [field.name for field in fields(estimator)]
    return {name: hints[name] for name in names if not _is_constant(hints[name])}


def _is_constant(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Constants)


def _is_table(value: object) -> bool:
    """Return whether a field is a dictionary of estimators."""
    return isinstance(value, dict) and all(isinstance(part, Estimator) for part in value.values())


def _copied(value: Any) -> Any:  # noqa: ANN401 - the value of any field
    """Return a copy of a field's value that later steps do not change; that of an estimator is its `snapshot`.

    Arrays keep the order of their elements in memory, because linear algebra may round differently in the other order.
    """
    if isinstance(value, Estimator):
        return value.snapshot()
    if isinstance(value, dict):
        return {key: _copied(part) for key, part in value.items()}
    if isinstance(value, np.ndarray):
        return value.copy(order="K")
    return value[:] if isinstance(value, array | list) else value
