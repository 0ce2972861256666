"""Words of the kernel's restricted Python, with their meaning when it is interpreted.

When a wheel is built, Cython reads `Number` as a C double, `Count` as a C integer, `Numbers` and `Counts` as pointers
to several of them. It reads `record` as a class with C fields and `inner` as a C function. A name outside functions
that is a `Count` or `Number` becomes a C constant (`hatch_build.py`).

The kernel may call only itself and `math`. It may not divide by zero, and not use complex numbers, `**` or `hypot`,
whose rounding differs between interpreter and C library. Both forms then give the same bits."""

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
    """Mark a class as a record with fixed fields, which Cython compiles; return it unchanged."""
    return made


def inner(function: F) -> F:
    """Mark a function that only the kernel itself calls, which Cython makes a function of C; return it unchanged."""
    return function


def whole(number: Number) -> Count:
    """Return a number without a fraction as an integer."""
    return int(number)


def as_numbers(given: Numbers) -> Numbers:
    """Return an array that a record keeps, as the kernel's functions take it: unchanged; compiled, its pointer."""
    return given


def as_counts(given: Counts) -> Counts:
    """Return an array of integers that a record keeps, as the kernel's functions take it (see `as_numbers`)."""
    return given
