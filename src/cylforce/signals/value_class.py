"""Immutable values of which a step makes many."""

from dataclasses import dataclass
from typing import TypeVar, dataclass_transform

T = TypeVar("T")


@dataclass_transform(frozen_default=True)
def value_class(kind: type[T]) -> type[T]:
    """Return a class as a dataclass with slots whose fields are never assigned after its construction (a decorator).

    mypy reports an assignment, as for a frozen dataclass. Python does not check it again in operation: the
    construction of a frozen dataclass takes three times as long, which was a tenth of a step.
    """
    return dataclass(slots=True, unsafe_hash=True)(kind)
