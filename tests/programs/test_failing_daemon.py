"""The daemon when something in or around it fails: a step that raises, a reader of its messages that stopped, a step
that hangs under a watchdog."""

import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
import structlog

from cylforce.can.opening import open_bus
from cylforce.files.atomic import RecordingError
from cylforce.files.candump import Sent
from cylforce.files.logfile import LogWriter
from cylforce.files.logreader import read_events
from cylforce.files.rotation import Rotation
from cylforce.programs.common.readings import header_of, make_core
from cylforce.programs.live.messages import ROOM, Messages, configure_messages
from cylforce.programs.live.notify import Manager
from cylforce.programs.live.station import SOFTWARE
from cylforce.programs.run import Daemon, check_log
from cylforce.service.memory import NOTHING_KEPT
from failing_daemon import MACHINE, STEPS, after, daemon_on, run
from scenarios import EXCAVATOR


def broken():
    raise ZeroDivisionError("a step that fails")


def test_a_step_that_raises_ends_the_daemon_after_it_said_so(tmp_path):
    log = LogWriter(tmp_path / "run.log", header_of(MACHINE, None, "virtual:raises", NOTHING_KEPT), 1, "raises")
    daemon = daemon_on("raises", log)
    ticks = after(daemon, STEPS, broken)
    with pytest.raises(ZeroDivisionError):
        run(daemon)
    assert len(ticks) == STEPS  # not one step more
    published = {pdo.can_id for pdo in MACHINE.service.publication}
    _, events = read_events(tmp_path / "run.log", 10_000)
    sent = [event.can_id for event in events if isinstance(event, Sent) and event.can_id in published]
    assert set(sent[-len(published) :]) == published  # all values once more, as none
    assert SOFTWARE in daemon.node.emergencies.active


def test_a_reader_that_stopped_delays_no_step_and_what_is_lost_is_counted():
    """Standard error is a pipe that nobody reads, of a page: lines beyond it and the queue are dropped. A write that
    waited for the reader would never return."""
    read, write = os.pipe()
    with os.fdopen(write, "w") as stream:
        messages = Messages(stream)
        for k in range(3 * ROOM):
            messages.write(f"{k} {'x' * 200}\n")
        assert messages.dropped > ROOM
        taken = b""
        while b"0 xxx" not in taken:
            taken += os.read(read, 65536)
        reader = threading.Thread(target=lambda: [None for _ in iter(lambda: os.read(read, 65536), b"")], daemon=True)
        reader.start()
        messages.close()
        messages.write("again\n")
        messages.close()
        assert messages.reported == messages.dropped


def test_messages_of_a_process_are_complete_at_its_end():
    code = (
        "from cylforce.programs.live.messages import configure_messages\n"
        "import structlog\nconfigure_messages()\n"
        "for k in range(300): structlog.get_logger().info('line', k=k)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert [f'"k": {k}' in line for k, line in enumerate(done.stderr.splitlines())] == [True] * 300


def test_a_daemon_whose_messages_nobody_reads_goes_on_and_ends():
    read, write = os.pipe()
    try:
        with os.fdopen(write, "w") as stream:
            configure_messages(stream)
            daemon = daemon_on("blocked")
            say = structlog.get_logger("cylforce")
            ticks = after(daemon, 1, lambda: [say.info("much", text="x" * 500) for _ in range(100)])
            run(daemon, done=lambda: len(ticks) > 40)
    finally:
        structlog.reset_defaults()
        os.close(read)
    assert len(ticks) > 40


@pytest.fixture
def manager(tmp_path):
    """A service manager's socket, and what tells it."""
    place = tmp_path / "notify"
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.bind(str(place))
    heard.setblocking(False)
    yield heard, Manager({"NOTIFY_SOCKET": str(place)})
    heard.close()


def words(heard):
    found = []
    while True:
        try:
            found.append(heard.recv(100))
        except BlockingIOError:
            return found


def test_the_manager_hears_that_it_is_ready_alive_and_stops(manager):
    heard, tell = manager
    said = []
    daemon = daemon_on("alive")
    after(daemon, 1, lambda: said.extend(words(heard)))
    run(daemon, tell, done=lambda: said.count(b"WATCHDOG=1") > 10)
    said += words(heard)
    assert said[0] == b"READY=1\nWATCHDOG=1"
    assert said[-1] == b"STOPPING=1"


def test_a_step_that_hangs_feeds_no_watchdog(manager):
    """While it hangs nothing is said; the late step that follows says nothing either."""
    heard, tell = manager
    during, hung = [], []

    def hang():
        words(heard)
        time.sleep(0.3)
        during.extend(words(heard))
        hung.append(True)

    daemon = daemon_on("hangs")
    after(daemon, STEPS, hang)
    run(daemon, tell, done=lambda: len(hung) > 1)
    assert during == []


def test_a_log_that_cannot_be_written_now_does_not_keep_the_service_from_starting(tmp_path):
    check_log(tmp_path / "absent" / "run.log", (EXCAVATOR,))
    log = LogWriter(
        tmp_path / "absent" / "run.log", header_of(MACHINE, None, "virtual:nolog", NOTHING_KEPT), 1, "can0",
        report=lambda words: None, rotation=Rotation(10**6, 1),
    )  # fmt: skip
    core = make_core(MACHINE, None)
    daemon = Daemon(MACHINE, core, open_bus("virtual:nolog"), log, NOTHING_KEPT)
    ticks = after(daemon, 10**9, lambda: None)
    run(daemon, done=lambda: len(ticks) > 20)
    assert log.failure


def test_a_log_that_cannot_be_meant_is_refused(tmp_path):
    pipe, machine = tmp_path / "pipe.log", tmp_path / "machine.log"
    os.mkfifo(pipe)
    machine.write_text("")
    (tmp_path / "folder.log").mkdir()
    for log, why in (
        (pipe, "no ordinary file"),
        (tmp_path / "folder.log", "no ordinary file"),
        (tmp_path / "run.txt", r"must end in \.log"),
        (machine, "would replace another file"),
    ):
        with pytest.raises(RecordingError, match=why):
            check_log(log, (machine,))


def test_without_a_manager_nothing_is_said():
    """And no socket stays open."""
    open_files = Path("/proc/self/fd")
    before = len(list(open_files.iterdir()))
    for environment in ({}, {"NOTIFY_SOCKET": "/nowhere/at/all"}):
        silent = Manager(environment)
        silent.ready()
        silent.alive()
        silent.stopping()
        assert len(list(open_files.iterdir())) <= before
