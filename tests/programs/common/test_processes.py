"""A function mapped in several processes gives what it gives in one."""

import os
import signal

import pytest

from cylforce.programs.common.processes import map_in_processes

PARENT = os.getpid()


@pytest.mark.parametrize("count", range(6))
def test_results_are_in_the_order_of_the_arguments(count):
    assert map_in_processes(lambda k: k**2, range(count)) == [k**2 for k in range(count)]


def test_the_function_sees_what_this_process_made():
    made = object()
    assert map_in_processes(lambda _: id(made), range(3)) == [id(made)] * 3


@pytest.mark.parametrize("place", range(3))
def test_an_error_is_raised(place):
    arguments = ["1", "2", "3"]
    arguments[place] = "none"
    with pytest.raises(ValueError, match="none"):
        map_in_processes(float, arguments)


def killed_in_a_fork(_) -> str:
    if os.getpid() != PARENT:
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def test_arguments_of_a_killed_fork_are_taken_here():
    assert map_in_processes(killed_in_a_fork, range(4)) == ["done"] * 4


def test_a_fork_makes_no_forks():
    _, (one, other) = map_in_processes(lambda _: map_in_processes(lambda _: os.getpid(), range(2)), range(2))
    assert one == other


def test_no_fork_remains():
    for process in set(map_in_processes(lambda _: os.getpid(), range(2))) - {PARENT}:
        with pytest.raises(ChildProcessError):
            os.waitpid(process, os.WNOHANG)
