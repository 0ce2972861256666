"""A function mapped over arguments in several processes, one for each processor."""

import multiprocessing
import os
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

from cylforce.signals.parallel import sequential_map

MOST = 4  # processes: each has results of its own in memory
FORKS = multiprocessing.get_context("fork")

Work = Callable[[Any], Any]


def map_in_processes(work: Work, arguments: Sequence[Any]) -> list[Any]:
    """Return the results of a function for each argument, computed on as many processors as this process may use.

    This process takes every n-th argument, forks of it take the others and send their results. With one processor, and
    in a fork, this process takes all arguments; it also takes those of a fork that is killed. A program with threads
    must not use it: a fork inherits the locks that they hold. Raises what the function raises.
    """
    count = min(len(os.sched_getaffinity(0)), len(arguments), MOST)
    if count < 2 or multiprocessing.parent_process() is not None:
        return sequential_map(work, arguments)
    shares = [arguments[k::count] for k in range(count)]
    forks = [_Fork(work, share) for share in shares[1:]]
    try:
        parts = [sequential_map(work, shares[0]), *(fork.results() for fork in forks)]
    finally:
        for fork in forks:
            fork.end()
    return [parts[k % count][k // count] for k in range(len(arguments))]


class _Fork:
    """Process that computes the results for a share of the arguments."""

    def __init__(self, work: Work, arguments: Sequence[Any]) -> None:
        self._work, self._arguments = work, arguments
        self._receives, sends = FORKS.Pipe(duplex=False)
        self._process = FORKS.Process(target=_send_results, args=(work, arguments, sends), daemon=True)
        self._process.start()
        sends.close()

    def results(self) -> list[Any]:
        """Return the results. Raises what the function raised."""
        try:
            found = self._receives.recv()
        except EOFError:  # it was killed
            return sequential_map(self._work, self._arguments)
        if isinstance(found, Exception):
            raise found
        return list(found)

    def end(self) -> None:
        """End the process, whatever it does."""
        self._receives.close()
        self._process.terminate()
        self._process.join()


def _send_results(work: Work, arguments: Sequence[Any], sends: Connection) -> None:
    """Send the results, or the exception of the function."""
    try:
        found: object = sequential_map(work, arguments)
    except Exception as error:  # noqa: BLE001 - raised where the results are wanted
        found = error
    sends.send(found)
