"""The words of the kernel's restricted Python. Interpreted they mean what stands here. When a wheel is built, Cython
reads `Number` as a C double, `Count` as a C integer, `Numbers` and `Counts` as places of several of them, `record`
as a class with C fields, `inner` as a C function, and a name outside functions that is a `Count` or `Number` as a C
constant (`hatch_build.py`).

What the kernel may not do: call anything but itself and `math`, divide by zero, use complex numbers, `**` or
`hypot`, whose rounding differs between interpreter and C library. Then both forms give the same bits."""

from array import array
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

Number = float
Count = int
if TYPE_CHECKING:
    Numbers = array[float]
    Counts = array[int]
else:
    Numbers = Counts = array  # which has no subscript before Python 3.12

C = TypeVar("C")
F = TypeVar("F", bound=Callable[..., Any])


def record(made: type[C]) -> type[C]:
    """A class with fixed fields."""
    return made


def inner(function: F) -> F:
    """A function that only the kernel itself calls."""
    return function


def whole(number: Number) -> Count:
    """A number that is whole, as an integer."""
    return int(number)


def as_numbers(given: Numbers) -> Numbers:
    """An array that a record keeps, as the kernel's functions take it."""
    return given


def as_counts(given: Counts) -> Counts:
    """An array of integers that a record keeps, as the kernel's functions take it."""
    return given
