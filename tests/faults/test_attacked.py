"""What was done to an earlier service from outside, where no other test shows it: faults of sensors while buckets are
booked, a step that hangs under a watchdog, a restart with a load in the bucket, the unit's exposure."""

import os
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cylforce.files.tables import Table
from cylforce.programs.common.play import prepare
from cylforce.service.commands import Scale
from cylforce.service.core import Core
from cylforce.service.memory import Memory
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Status
from faulting.__main__ import scenario
from faulting.edits import named
from faulting.order import in_order
from faulting.runs import LONG_S
from faulting.works import Case
from scenarios import EXCAVATOR, SEED, identified, played, scene, seconds, through

TESTS = Path(__file__).resolve().parents[1]
UNIT = TESTS.parent / "systemd" / "cylforce.service"
CYCLES, BEGIN = 9, 12.0  # a fault begins in the first one, at 12 s
MOVES_S, FIRST_OK_S = 1.5, 3.0  # after a restart: the first motion; the first weight after that at most
EXPOSURE = 1.5  # of a unit, by systemd-analyze, at most


# --- sensors ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def case():
    """The simulated excavator at work."""
    loaded = load(EXCAVATOR)
    values = np.concatenate([r.values for r in prepare(loaded, "cycles", SEED, 0.1, amount=CYCLES).records])
    times = np.arange(len(values)) / loaded.service.filters.rate_hz
    names = tuple(s.name for s in loaded.service.machine.signals)
    return Case("cycles", loaded, Core(loaded.service, identified(loaded)), Table(times, values, names))


@pytest.fixture(scope="module")
def order(case):
    """What is said without a fault."""
    return in_order(case)


@pytest.mark.parametrize("name", named(load(EXCAVATOR).service.machine, BEGIN))
def test_a_fault_of_the_table_books_nothing_wrong_and_shows_nothing_wrong_for_longer(case, order, name):
    """Wrong: more than three standard errors."""
    found = scenario(case, order, named(case.loaded.service.machine, BEGIN)[name], SEED).wrong
    assert found.wrong_bookings == 0
    assert found.longest_s <= LONG_S
    assert np.isfinite(found.doubted_s)


# --- a step that hangs ------------------------------------------------------------------------------------------------

HANGING = """
import sys
sys.path.insert(0, sys.argv[1])
from cylforce.programs.live.notify import Manager
from failing_daemon import STEPS, after, daemon_on, run

def hang():
    print("hangs", flush=True)
    while True:
        pass

daemon = daemon_on("hangs")
after(daemon, STEPS, hang)
run(daemon, Manager())
"""


def words(heard, wait_s):
    """Return what the service manager hears until it has heard nothing for so long."""
    found = []
    heard.settimeout(wait_s)
    while True:
        try:
            found.append(heard.recv(100))
        except (TimeoutError, BlockingIOError):
            return found


def test_a_step_that_hangs_is_ended_by_its_watchdog(tmp_path):
    """By a manager that does what systemd does: no word for a watchdog period, then SIGABRT. All words of the service
    were sent before its step began to hang, so that it is ended one period after the last one."""
    watchdog_s = float(re.search(r"^WatchdogSec=(\d+)$", UNIT.read_text(), re.MULTILINE)[1])
    place = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(place))
        surroundings = {**os.environ, "NOTIFY_SOCKET": str(place)}
        command = (sys.executable, "-c", HANGING, str(TESTS / "support"))
        with subprocess.Popen(command, env=surroundings, stdout=subprocess.PIPE, text=True) as daemon:
            try:
                while "hangs" not in daemon.stdout.readline():
                    assert daemon.poll() is None
                before = words(heard, 0.0)
                after = words(heard, watchdog_s)
                daemon.send_signal(signal.SIGABRT)
                daemon.wait(60.0)
            finally:
                daemon.kill()
    assert before[0].startswith(b"READY=1")
    assert after == []
    assert daemon.returncode == -signal.SIGABRT


# --- restart, unit ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mass", [0.0, 300.0])
@pytest.mark.parametrize("begin", [(0.3, -1.2, -0.9), (0.6, -1.7, -0.6)])
def test_after_a_restart_the_weight_is_ok_within_3_s_of_motion(case, begin, mass):
    """The service starts with what it kept, while the machine stands still; then boom and stick move."""
    strokes = [(0, MOVES_S, MOVES_S + 3.0, 0.4), (1, MOVES_S, MOVES_S + 3.0, -0.4)]
    events = played(case.loaded, [scene(begin, strokes, MOVES_S + 3.0, mass)])
    _, found, _ = through(case.core, events, WeighingService.start(case.core, Memory(Scale(5.0))))
    first = next(e for e in found if e.gross.status is Status.OK)
    assert seconds(first) - MOVES_S <= FIRST_OK_S
    assert abs(first.gross.value - mass + 5.0) < 3.0 * first.gross.standard_error


def test_the_unit_exposes_little():
    command = ("systemd-analyze", "security", "--offline=true", "--no-pager", str(UNIT))
    told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    assert float(re.search(r"exposure level for cylforce\.service: ([\d.]+)", told)[1]) <= EXPOSURE
