"""Tasks run in several processes give what they give one after another."""

import os
import signal
from functools import partial

import pytest

from cylforce.programs.common.processes import in_processes

PARENT = os.getpid()


@pytest.mark.parametrize("count", range(6))
def test_results_are_in_the_order_of_the_tasks(count):
    assert in_processes([partial(pow, k, 2) for k in range(count)]) == [k**2 for k in range(count)]


def test_tasks_see_what_this_process_made():
    made = object()
    assert in_processes([lambda: id(made) for _ in range(3)]) == [id(made)] * 3


@pytest.mark.parametrize("place", range(3))
def test_the_error_of_a_task_is_raised(place):
    tasks = [partial(float, "1"), partial(float, "2"), partial(float, "3")]
    tasks[place] = partial(float, "none")
    with pytest.raises(ValueError, match="none"):
        in_processes(tasks)


def killed_in_a_fork() -> str:
    if os.getpid() != PARENT:
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def test_tasks_of_a_killed_fork_run_here():
    assert in_processes([killed_in_a_fork] * 4) == ["done"] * 4


def test_a_fork_makes_no_forks():
    _, (one, other) = in_processes([lambda: in_processes([os.getpid] * 2)] * 2)
    assert one == other


def test_no_fork_remains():
    in_processes([os.getpid] * 2)
    with pytest.raises(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)
