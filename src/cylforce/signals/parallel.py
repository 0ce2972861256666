"""Maps of a function over arguments, which a program may run in several threads or processes."""

from collections.abc import Callable, Sequence
from typing import Any

ParallelMap = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # results in the order of the arguments


def sequential_map(work: Callable[[Any], Any], arguments: Sequence[Any]) -> list[Any]:
    """Return the results of a function for each argument, one after the other."""
    return [work(argument) for argument in arguments]
