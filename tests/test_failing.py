"""The daemon when something in or around it fails: a step that raises, a reader of its messages that stopped, a step
that hangs under a watchdog."""

import asyncio
import os
import socket
import subprocess
import sys
import threading
import time

import pytest
import structlog

from cylforce.can.opening import open_bus
from cylforce.programs.common.readings import make_core
from cylforce.programs.live.messages import ROOM, Messages, configure_messages
from cylforce.programs.live.notify import Manager
from cylforce.programs.live.station import SOFTWARE, serve
from cylforce.programs.run import Daemon
from cylforce.service.state import NOTHING_KEPT
from cylforce.settings.machine_file import load
from cylforce.signals.events import Tick
from scenarios import EXCAVATOR

MACHINE = load(EXCAVATOR)
STEPS = 20  # of the daemon before something happens to it


def daemon_on(name):
    """A daemon on a bus without sensors."""
    return Daemon(MACHINE, make_core(MACHINE, None), open_bus(f"virtual:{name}"), None, NOTHING_KEPT)


def run(daemon, manager=None, seconds=10.0):
    """Serve until it ends by itself, or so many seconds."""

    async def main():
        until = asyncio.Event()
        asyncio.get_running_loop().call_later(seconds, until.set)
        await serve(daemon, until, lambda: None, manager=manager)

    asyncio.run(main())


def after(daemon, count, then):
    """From its tick number `count` on the daemon's step does `then` instead."""
    step, ticks = daemon._step, []

    def changed(state, event):
        if isinstance(event, Tick):
            ticks.append(event.t_us)
            if len(ticks) >= count:
                then()
        return step(state, event)

    daemon._step = changed
    return ticks


def broken():
    raise ZeroDivisionError("a step that fails")


def test_a_step_that_raises_ends_the_daemon_after_it_said_so(monkeypatch):
    daemon = daemon_on("raises")
    sent = []
    ticks = after(daemon, STEPS, broken)
    publish = daemon.node.publish

    def kept(number, data):
        sent.append((number, data))
        publish(number, data)

    monkeypatch.setattr(daemon.node, "publish", kept)
    started = time.monotonic()
    with pytest.raises(ZeroDivisionError):
        run(daemon)
    assert time.monotonic() - started < 5.0
    assert len(ticks) == STEPS  # not one step more
    last = dict(sent[-len(MACHINE.service.publication) :])
    assert set(last) == {pdo.number for pdo in MACHINE.service.publication}  # all values once more, as none
    assert SOFTWARE in daemon.node.emergencies._active


def test_a_reader_that_stopped_delays_no_step_and_what_is_lost_is_counted():
    """Standard error is a pipe that nobody reads, of a page: lines beyond it and the queue are dropped."""
    read, write = os.pipe()
    with os.fdopen(write, "w") as stream:
        messages = Messages(stream)
        started = time.monotonic()
        for k in range(3 * ROOM):
            messages.write(f"{k} {'x' * 200}\n")
        assert time.monotonic() - started < 1.0
        assert messages.dropped > ROOM
        taken = b""
        deadline = time.monotonic() + 10.0
        while b"0 xxx" not in taken and time.monotonic() < deadline:
            taken += os.read(read, 65536)
        reader = threading.Thread(target=lambda: [None for _ in iter(lambda: os.read(read, 65536), b"")], daemon=True)
        reader.start()
        messages.close()
        messages.write("again\n")
        messages.close()
        assert messages._told == messages.dropped


def test_messages_of_a_process_are_complete_at_its_end():
    code = (
        "from cylforce.programs.live.messages import configure_messages, last_messages\n"
        "import structlog\nconfigure_messages()\n"
        "for k in range(300): structlog.get_logger().info('line', k=k)\n"
        "last_messages()\n"
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
            run(daemon, seconds=1.0)
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
    run(daemon, tell, seconds=0.5)
    said += words(heard)
    assert said[0] == b"READY=1\nWATCHDOG=1"
    assert said[-1] == b"STOPPING=1"
    assert said.count(b"WATCHDOG=1") > 10


def test_a_step_that_hangs_feeds_no_watchdog(manager):
    """While it hangs nothing is said; the late step that follows says nothing either."""
    heard, tell = manager
    during = []

    def hang():
        words(heard)
        time.sleep(0.3)
        during.extend(words(heard))

    daemon = daemon_on("hangs")
    after(daemon, STEPS, hang)
    run(daemon, tell, seconds=1.0)
    assert during == []


def test_without_a_manager_nothing_is_said():
    for environment in ({}, {"NOTIFY_SOCKET": "/nowhere/at/all"}):
        silent = Manager(environment)
        silent.ready()
        silent.alive()
        silent.stopping()
