"""What the service says in its journal: overruns at most once a second, a refused command in words."""

import asyncio
from itertools import pairwise

import pytest
import structlog

from cylforce.can.opening import open_bus
from cylforce.programs.common.readings import make_core
from cylforce.programs.run import Daemon
from cylforce.service import commands
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Quantity, Reason, Status, invalid
from cylforce.signals.events import Frame
from scenarios import EXCAVATOR

PERIOD_US = 10_000
T0 = 1_700_000_000_000_000
RATED = 1500.0
OURS = 64


class Late:
    """In place of the daemon's timer: `due` ticks are due, one of which is served."""

    def __init__(self):
        self.due, self.deadline_us = 1, T0

    def read(self):
        self.deadline_us += self.due * PERIOD_US
        return self.due

    def close(self):
        return


@pytest.fixture
def daemon():
    """A daemon on a bus without sensors, whose ticks the test serves."""
    machine = load(EXCAVATOR)

    async def made():
        return Daemon(machine, make_core(machine, None), open_bus("virtual:messages"), None, NOTHING_KEPT)

    found = asyncio.run(made())
    found.timer.close()
    found.timer = Late()
    yield found
    found.bus.close()


def said(daemon, due):
    """The overrun messages while so many ticks are due each time: (time, missed, overruns)."""
    found = []
    for ticks in due:
        daemon.timer.due = ticks
        with structlog.testing.capture_logs() as lines:
            daemon.on_timer()
        found += [(daemon.timer.deadline_us, m["missed"], m["overruns"]) for m in lines if m["event"] == "overrun"]
    return found


def test_overruns_are_reported_once_a_second(daemon):
    """Every second tick is missed for five seconds: six messages, a second apart, which together count them all."""
    lines = said(daemon, [2] * 250 + [1] * 100)
    times = [t for t, _, _ in lines]
    assert len(lines) == 6
    assert all(b - a >= 1_000_000 for a, b in pairwise(times))
    assert sum(missed for _, missed, _ in lines) == 250 == daemon.counts.overruns
    assert lines[-1][2] == 250


def test_the_first_overrun_is_reported_at_once_and_a_clock_set_back_silences_none(daemon):
    assert len(said(daemon, [1, 1, 3])) == 1
    assert said(daemon, [1] * 200) == []
    daemon.timer.deadline_us -= 3600 * 1_000_000
    assert [missed for _, missed, _ in said(daemon, [5])] == [4]


def weight(kg):
    return Quantity(kg, 1.0, Status.OK, Reason.NONE)


OBEYED = [
    (
        "zero",
        b"ZERO",
        weight(1.0),
        0x06090030,
        "zero refused: the four bytes written must be the word zero, not b'ZERO'",
    ),
    (
        "tare",
        b"zero",
        weight(1.0),
        0x06090030,
        "tare refused: the four bytes written must be the word tare, not b'zero'",
    ),
    (
        "tare",
        b"tare",
        invalid(Reason.AT_REST),
        0x08000022,
        "tare refused: the weight must be OK, and it is invalid (at rest)",
    ),
    (
        "zero",
        b"zero",
        weight(-30.1),
        0x06090030,
        (
            "zero refused: the weight is -30.1 kg, the limit +-30.0 kg (2 % of rated payload): "
            "empty the tool, or find what else is wrong"
        ),
    ),
    ("zero", b"zero", weight(30.0), 0, "zero set to 30.0 kg, tare to 0.0 kg"),
    ("tare", b"tara", weight(500.0), 0, "tare set to 490.0 kg"),
]


@pytest.mark.parametrize(("what", "data", "mass", "verdict", "words"), OBEYED)
def test_a_command_is_answered_in_words(what, data, mass, verdict, words):
    """The rule, the value and the limit."""
    before = commands.Scale(10.0)
    scale, answer = commands.obey(commands.ScaleCommand(what, data), before, mass, RATED)
    assert (answer.verdict, answer.words) == (verdict, words)
    assert (scale == before) == (verdict != 0)


def test_a_refused_command_is_logged(daemon):
    """As a warning, with the abort code that the bus saw."""
    with structlog.testing.capture_logs() as lines:
        daemon.on_frame(Frame(T0, 0x600 + OURS, bytes([0x23, 0x25, 0x61, 1]) + b"zero"))
    [line] = [m for m in lines if m["event"] == "command"]
    assert line["log_level"] == "warning"
    assert line["abort"] == "0x8000022"
    assert line["words"] == "zero refused: the weight must be OK, and it is invalid (starting)"
