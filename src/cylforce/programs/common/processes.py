"""Tasks of a long computation in several processes, one for each processor."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Generic

from cylforce.signals.tasks import Result, one_by_one

MOST = 4  # processes: each has results of its own in memory
FORKS = multiprocessing.get_context("fork")


def in_processes(tasks: Sequence[Callable[[], Result]]) -> list[Result]:
    """Run tasks in as many processes as this one may use processors.

    This process runs every n-th task, forks run the others: they inherit the tasks' arguments, and send the results.
    With one processor, and in a fork, all tasks run in this process; so do those of a fork that is killed. Not for a
    program with threads: a fork inherits the locks that they hold.
    """
    count = min(len(os.sched_getaffinity(0)), len(tasks), MOST)
    if count < 2 or multiprocessing.parent_process() is not None:
        return one_by_one(tasks)
    shares = [tasks[k::count] for k in range(count)]
    forks = [_Fork(share) for share in shares[1:]]
    try:
        parts = [one_by_one(shares[0]), *(fork.results() for fork in forks)]
    finally:
        for fork in forks:
            fork.end()
    return [parts[k % count][k // count] for k in range(len(tasks))]


class _Fork(Generic[Result]):
    """Process that runs a share of the tasks."""

    def __init__(self, tasks: Sequence[Callable[[], Result]]) -> None:
        self._tasks = tasks
        self._receives, sends = FORKS.Pipe(duplex=False)
        self._process = FORKS.Process(target=_run, args=(tasks, sends), daemon=True)
        self._process.start()
        sends.close()

    def results(self) -> list[Result]:
        """Return the results of its tasks. Raises what one of them raised."""
        try:
            found = self._receives.recv()
        except EOFError:
            return one_by_one(self._tasks)
        if isinstance(found, Exception):
            raise found
        return list(found)

    def end(self) -> None:
        """End the process, whatever it does."""
        self._receives.close()
        self._process.terminate()
        self._process.join()


def _run(tasks: Sequence[Callable[[], Result]], sends: Connection) -> None:
    """Send the results of tasks, or the exception of one."""
    try:
        found: object = one_by_one(tasks)
    except Exception as error:  # noqa: BLE001 - raised where the results are wanted
        found = error
    sends.send(found)
