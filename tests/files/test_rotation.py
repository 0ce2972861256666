"""A log of limited size: files that each stand alone, the oldest deleted; every part replays to the same bytes."""

import asyncio
import json
import os
import time
from dataclasses import asdict, is_dataclass

import numpy as np
import pytest

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.commissioning.identification import identify
from cylforce.files.atomic import RecordingError
from cylforce.files.candump import Sent
from cylforce.files.checkpoint import packed, unpacked, unpacked_state
from cylforce.files.logfile import RETRY_US, Header, LogWriter, header_lines, running_versions
from cylforce.files.logreader import log_header, read_events
from cylforce.files.rotation import Rotation, check_room
from cylforce.programs.common.readings import header_of, make_core, model_of
from cylforce.programs.replay import run_replay
from cylforce.programs.run import Daemon
from cylforce.programs.sim import run_sim
from cylforce.service.memory import NOTHING_KEPT
from cylforce.service.service import WeighingService
from cylforce.settings.identified import write_identified
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Status
from cylforce.signals.events import Frame, Tick
from scenarios import EXCAVATOR, moved

T0 = 1_700_000_000_000_000
KEEP = 1000
HEADER = Header(
    versions=running_versions(),
    machine="machine.toml",
    machine_sha256="ab" * 32,
    identified_sha256=None,
    state={"zero": 0.0, "tare": 0.0},
    bus="socketcan:can0",
    node_id=10,
)


def written(path, ticks, size, keep, first=0):
    """`ticks` ticks, a new file whenever the writer asks for one; its header names the tick at which it begins."""
    with LogWriter(path, HEADER, T0, "can0", rotation=Rotation(size, keep)) as log:
        for k in range(first, first + ticks):
            if log.needs_new_file:
                state = {"zero": float(k), "tare": 0.0}
                log.begin_file(lambda state=state: HEADER.model_copy(update={"state": state}), T0 + k)
            log.log(Tick(T0 + k * 10_000))
    assert (log.lost, log.failure) == (0, None)
    return parts(path)


def parts(path):
    """The files of a log, oldest first."""
    older = path.parent.glob(f"{path.stem}.[0-9]*.log")
    return [*sorted(older, key=lambda p: int(p.name.split(".")[1])), path]


def numbers(path):
    """The ticks in a file, by their numbers."""
    return [(e.t_us - T0) // 10_000 for e in read_events(path, 10_000)[1]]


def test_files_follow_each_other_without_a_hole(tmp_path):
    """Each file has its own header; together they hold every event once, in order; none is much above the size."""
    files = written(tmp_path / "run.log", 5000, 20_000, KEEP)
    assert len(files) > 5
    assert [n for path in files for n in numbers(path)] == list(range(5000))
    for path in files[1:]:
        assert log_header(path).state["zero"] == numbers(path)[0]
    longest = len(header_lines(HEADER, T0)) + 20_000 + 51 * 33  # half a second waits for the writing thread
    assert max(path.stat().st_size for path in files) <= longest


def test_the_oldest_file_is_deleted(tmp_path):
    """Of the older files `keep` stay, the newest ones; their numbers go on after a restart."""
    (tmp_path / "run.x.log").write_text("another's")
    (tmp_path / "run.2.log.bak").write_text("another's")
    files = written(tmp_path / "run.log", 5000, 20_000, 3)
    assert len(files) == 4
    kept = [n for path in files for n in numbers(path)]
    assert kept == list(range(kept[0], 5000))
    assert kept[0] > 0
    last = int(files[-2].name.split(".")[1])
    again = written(tmp_path / "run.log", 1, 20_000, 3, first=5000)
    assert [p.name for p in again] == [*(f"run.{n}.log" for n in (last - 1, last, last + 1)), "run.log"]
    assert numbers(again[-2])[-1] == 4999
    assert (tmp_path / "run.x.log").exists()
    assert (tmp_path / "run.2.log.bak").exists()


def test_no_older_file_is_kept_if_none_is_wanted(tmp_path):
    files = written(tmp_path / "run.log", 5000, 20_000, 0)
    assert [p.name for p in files] == ["run.log"]
    assert numbers(files[0])[-1] == 4999


def test_without_a_limit_there_is_one_file(tmp_path):
    with LogWriter(tmp_path / "run.log", HEADER, T0, "can0") as log:
        for k in range(5000):
            assert not log.needs_new_file
            log.log(Tick(T0 + k * 10_000))
    assert len(parts(tmp_path / "run.log")) == 1


def test_a_disk_that_refuses_the_next_file_ends_the_log_until_it_takes_one(tmp_path):
    """The folder is gone when the next file is to begin: told once, all else goes on; it is back: so is the log."""
    folder, away, told = tmp_path / "logs", tmp_path / "elsewhere", []
    folder.mkdir()
    log = LogWriter(folder / "run.log", HEADER, T0, "can0", report=told.append, rotation=Rotation(100_000, 1))
    log.log(Tick(T0))
    folder.rename(away)
    t_us = ticked(log, T0, 40)
    assert len(told) == 1
    assert "logging stopped: No such file" in told[0]
    assert "is tried again every 10 s" in told[0]
    away.rename(folder)
    begun = ticked(log, t_us, 15)
    log.close()
    assert told[1:] == [f"{folder / 'run.log'}: logging continues"]
    assert_without_hole(folder / "run.log", begun)


def ticked(log, t_us, seconds):
    """A daemon's ticks for so long, with a turn where the log wants one; the thread gets time. The last time."""
    for _ in range(100 * seconds):
        t_us += 10_000
        if log.needs_new_file:
            log.begin_file(lambda: HEADER, t_us)
        log.log(Tick(t_us))
        if t_us % 500_000 < 10_000:
            time.sleep(0.01)
    return t_us


def assert_without_hole(path, last_us):
    ticks = [event.t_us for event in read_events(path, 10_000)[1]]
    assert ticks == list(range(ticks[0], last_us + 1, 10_000))
    assert len(ticks) > 100


def test_a_file_that_cannot_be_opened_at_the_start_is_tried_again(tmp_path):
    told, path = [], tmp_path / "later" / "run.log"
    log = LogWriter(path, HEADER, T0, "can0", report=told.append, rotation=Rotation(10_000_000, 1))
    t_us = ticked(log, T0, 15)
    assert len(told) == 1
    assert "logging stopped: No such file" in told[0]
    path.parent.mkdir()
    last = ticked(log, t_us, 15)
    log.close()
    assert told[1:] == [f"{path}: logging continues"]
    assert_without_hole(path, last)


def test_a_full_disk_costs_no_older_log_and_is_used_again(tmp_path):
    path, told = tmp_path / "run.log", []
    (tmp_path / "run.1.log").write_text("an older one")
    path.symlink_to("/dev/full")
    log = LogWriter(path, HEADER, T0, "can0", report=told.append, rotation=Rotation(10_000_000, 1))
    last = ticked(log, T0, 40)
    log.close()
    assert ["No space left" in said for said in told] == [True, False]
    assert (tmp_path / "run.1.log").read_text() == "an older one"
    assert_without_hole(path, last)


def test_a_disk_that_is_nearly_full_is_left_alone(tmp_path, monkeypatch):
    free = [0]
    disk = os.statvfs(tmp_path)

    class Disk:
        f_frsize, f_blocks = disk.f_frsize, disk.f_blocks

        @property
        def f_bavail(self):
            return free[0]

    monkeypatch.setattr("cylforce.files.rotation.os.statvfs", lambda path: Disk())
    rotation = Rotation(1_000_000, 1)
    with pytest.raises(OSError, match="No space left"):
        check_room(tmp_path / "run.log", rotation)
    free[0] = 2 * rotation.size // disk.f_frsize + 1
    check_room(tmp_path / "run.log", rotation)


@pytest.mark.parametrize("how", ["renamed", "deleted", "replaced"])
def test_a_log_that_lost_its_name_begins_a_file_that_has_it(tmp_path, how):
    path, told = tmp_path / "run.log", []
    log = LogWriter(path, HEADER, T0, "can0", report=told.append, rotation=Rotation(10_000_000, 5))
    t_us = ticked(log, T0, 3)
    if how == "deleted":
        path.unlink()
    else:
        path.rename(tmp_path / "mine.log")
    if how == "replaced":
        path.write_text("another program's")
    last = ticked(log, t_us, 5)
    log.close()
    assert told == []
    assert_without_hole(path, last)
    if how == "renamed":
        taken = [e.t_us for f in (tmp_path / "mine.log", path) for e in read_events(f, 10_000)[1]]
        assert taken == list(range(T0 + 10_000, last + 1, 10_000))  # nothing is lost between the two
    if how == "replaced":
        assert (tmp_path / "run.1.log").read_text() == "another program's"


def test_attempts_are_ten_seconds_apart(tmp_path):
    log = LogWriter(tmp_path / "no" / "run.log", HEADER, T0, "can0", report=lambda _: None, rotation=Rotation(10**6, 1))
    for t in (1, RETRY_US - 1):
        log.log(Tick(T0 + t))
        assert not log.needs_new_file
    log.log(Tick(T0 + RETRY_US))
    assert log.needs_new_file
    log.close()


class ToldTime:
    """In place of the daemon's timer: one tick is due, at a time that the test says."""

    deadline_us = 0

    def read(self):
        return 1

    def close(self):
        return


@pytest.fixture(scope="module")
def logged(tmp_path_factory):
    """The machine, its tares, the files of a daemon's log of a digging cycle, what it concluded, and its last state; in
    the middle the weight is tared."""
    folder = tmp_path_factory.mktemp("rotation")
    path, tares, source = folder / "machine.toml", folder / "identified.toml", folder / "cycle.log"
    path.write_text(EXCAVATOR.read_text())
    machine = load(path)
    write_identified(tares, identify(model_of(machine), [moved(machine)]), machine, [])
    run_sim(path, cycles=1, seed=3, log=source)
    estimates, name = [], "virtual:rotation"
    header = header_of(machine, tares, name)

    async def main():
        writer = LogWriter(folder / "run.log", header, T0, "can0", rotation=Rotation(150_000, KEEP))
        daemon = Daemon(machine, make_core(machine, tares), open_bus(name), writer, NOTHING_KEPT)
        daemon.on_estimate = estimates.append
        daemon.timer.close()
        daemon.timer = ToldTime()
        daemon.network.poll(now_us())
        daemon.bus.attach(asyncio.get_running_loop(), lambda frame: None, daemon.on_sent)
        daemon.node.boot()
        for event in read_events(source, 10_000)[1]:
            play(daemon, event, machine)
        daemon.bus.close()
        writer.close()
        return daemon.weighing

    state = asyncio.run(main())
    return machine, tares, parts(folder / "run.log"), estimates, state


def play(daemon, event, machine):
    """One event of a recording into a daemon; the weight is tared as soon as it is OK."""
    if isinstance(event, Tick):
        daemon.timer.deadline_us = event.t_us
        daemon.on_timer()
        tared = daemon.weighing.scale.tare != 0.0
        if daemon.weighing.estimate.load.mass.status is Status.OK and not tared:
            tare = bytes([0x23, 0x39, 0x61, 1]) + b"tare"
            daemon.on_frame(Frame(event.t_us + 1, 0x600 + machine.service.node_id, tare))
    elif isinstance(event, Frame):
        daemon.on_frame(event)


def test_every_part_replays_to_the_same_bytes(logged):
    """Each file alone, and nothing but the machine file and the tares: all frames that were sent, every estimate."""
    machine, tares, files, estimates, last = logged
    assert len(files) > 4
    told, at = [], 0
    for path in files:
        found = run_replay(machine, path, tares, told.append)
        assert (found.different, told) == (0, [])
        assert found.compared > 50
        assert [str(e) for e in found.estimates] == [str(e) for e in estimates[at : at + len(found.estimates)]]
        at += len(found.estimates)
    assert at == len(estimates)
    assert_same(found.service.snapshot(), last.snapshot())
    assert last.scale.tare != 0.0
    assert any(e.gross.status is Status.OK for e in estimates)
    assert estimates[-1].booking is not None


def rewritten(path, target, **changes):
    """The log with another header."""
    header = log_header(path).model_copy(update=changes)
    body = [line for line in path.read_text().splitlines(keepends=True) if " cylforce " not in line]
    target.write_text(header_lines(header, T0) + "".join(body))
    return target


def test_a_part_without_its_state_differs(logged, tmp_path):
    """Zero and tare alone are not enough: filters and lift then start anew."""
    machine, tares, files, _, _ = logged
    header = log_header(files[2])
    alone = {name: header.state[name] for name in ("zero", "tare")}
    found = run_replay(machine, rewritten(files[2], tmp_path / "a.log", state=alone), tares, lambda _: None)
    assert found.different > 0


def test_a_state_of_another_version_is_told_and_not_used(logged, tmp_path):
    machine, tares, files, _, _ = logged
    versions = log_header(files[2]).versions | {"cylforce": "0.0.1"}
    told = []
    found = run_replay(machine, rewritten(files[2], tmp_path / "a.log", versions=versions), tares, told.append)
    assert found.different > 0
    assert "continues an earlier log of other tares or another version" in told[0]
    told.clear()
    run_replay(machine, files[2], None, told.append)
    assert "continues an earlier log of other tares or another version" in told[0]


@pytest.mark.parametrize("broken", ["x", [1, 2], None])
def test_a_broken_state_is_refused(logged, tmp_path, broken):
    machine, tares, files, _, _ = logged
    state = log_header(files[2]).state | {"service": broken}
    with pytest.raises(RecordingError, match="the state in the log's header is broken"):
        run_replay(machine, rewritten(files[2], tmp_path / "a.log", state=state), tares, lambda _: None)


def test_a_state_comes_back_to_the_last_bit(logged):
    """Through JSON, as text: types, arrays and the order of their elements in memory, NaN."""
    state = logged[4]
    said = json.loads(json.dumps(packed(state.snapshot()), allow_nan=False))
    back = WeighingService.start(state.core)
    back.restore(unpacked_state(back.types(), said))
    assert_same(back.snapshot(), state.snapshot())


def assert_same(a, b):
    assert type(a) is type(b)
    if isinstance(a, np.ndarray):
        assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes())
    elif is_dataclass(a):
        assert_same(asdict(a), asdict(b))
    elif isinstance(a, dict):
        assert_same(tuple(a.items()), tuple(b.items()))
    elif isinstance(a, tuple | list):
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    else:
        assert a == b or (a != a and b != b)


@pytest.mark.parametrize("order", ["C", "F"])
def test_the_order_of_elements_is_kept(order):
    array = np.asarray(np.arange(6.0).reshape(2, 3), order=order)
    back = unpacked(np.ndarray, packed(array))
    assert back.flags["F_CONTIGUOUS"] == (order == "F")
    np.testing.assert_array_equal(back, array)


def test_frames_that_we_sent_are_in_the_file_of_their_tick(logged):
    """A part begins with a tick, so that every frame it holds is compared with what that very part concludes."""
    for path in logged[2][1:]:
        first = next(iter(read_events(path, 10_000)[1]))
        assert isinstance(first, Tick)
        assert any(isinstance(e, Sent) for e in read_events(path, 10_000)[1])
