"""Independent tasks of a long computation, which a program may run in several processes."""

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar

Result = TypeVar("Result")
Other = TypeVar("Other")


class Runner(Protocol):
    """Runs tasks."""

    def __call__(self, tasks: Sequence[Callable[[], Result]]) -> list[Result]:
        """Return the result of every task, in the order of the tasks. Raises what a task raises."""
        ...


def one_by_one(tasks: Sequence[Callable[[], Result]]) -> list[Result]:
    """Run tasks one after another in this process."""
    return [task() for task in tasks]


def both(run: Runner, one: Callable[[], Result], other: Callable[[], Other]) -> tuple[Result, Other]:
    """Return the results of two tasks, the first of which stays in this process."""
    tasks: list[Callable[[], Any]] = [one, other]
    first, second = run(tasks)
    return first, second
