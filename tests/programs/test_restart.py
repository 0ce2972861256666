"""The service with records: zero and truck commanded over SDO are there after a restart, and its log replays."""

import asyncio
import struct

from cylforce.can.opening import open_bus
from cylforce.canopen.dictionary.object_dictionary import LOADING, RECORDING, RECORDS
from cylforce.files.logfile import LogWriter
from cylforce.programs.common.readings import header_of, make_core
from cylforce.programs.live.books import open_recorder
from cylforce.programs.replay import run_replay
from cylforce.programs.run import Daemon
from cylforce.records.writing import BookedBucket, Change
from cylforce.service.commands import NEXT, PRODUCT, TARGET, Scale
from cylforce.service.loading.cycle import LastBucket
from cylforce.service.loading.truck import NO_TRUCK, add_bucket
from cylforce.service.memory import Memory
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Booking
from scenarios import EXCAVATOR
from waiting import until

MACHINE = load(EXCAVATOR)
REQUEST = 0x600 + MACHINE.service.node_id
ANSWER = 0x580 + MACHINE.service.node_id
SHOWN_STEPS = 30  # after which the objects show what was commanded: they are written every 0.1 s


async def served(path, log, requests):
    """Start the service on a bus of its own and send requests, each when the one before is answered. Return its state
    and objects once it has published what they changed."""
    recorder = open_recorder(path, MACHINE)
    header = header_of(MACHINE, None, "virtual:kept", recorder.kept)
    writer = LogWriter(log, header, 1, "kept")
    core = make_core(MACHINE, None)
    daemon = Daemon(MACHINE, core, open_bus("virtual:kept"), writer, recorder.kept, recorder)
    panel = open_bus("virtual:kept")
    loop, answers = asyncio.get_running_loop(), []
    panel.attach(loop, lambda frame: frame.can_id == ANSWER and answers.append(frame.data))
    daemon.start(loop)
    for count, (sub, data) in enumerate(requests, 1):
        panel.send(REQUEST, struct.pack("<BHB", 0x23, LOADING, sub) + data)
        await until(lambda count=count: len(answers) == count)
    published = daemon.counts.steps + SHOWN_STEPS
    await until(lambda: daemon.counts.steps >= published and daemon.node.raw(LOADING, RECORDS) == RECORDING)
    state, shown = daemon.weighing, {sub: daemon.node.raw(LOADING, sub) for sub in range(1, RECORDS + 1)}
    await daemon.stop(loop)
    panel.close()
    recorder.close()
    return state, shown


def test_a_restart_changes_nothing(tmp_path):
    path, log = tmp_path / "records.db", tmp_path / "run.log"
    recorder = open_recorder(path, MACHINE)
    booking = Booking(8, 1_000_000, 900.0, 4.0, 0.0, 0.0, 900.0, 4.0)
    kept = Memory(Scale(5.0, 20.0), add_bucket(NO_TRUCK, booking, 20.0), booking)
    recorder.put(Change(1_000_000, kept, BookedBucket(booking, LastBucket(1.0, 1.0, 1.0), 0.0, "OK"), ""))
    recorder.close()
    state, shown = asyncio.run(
        served(path, log, [(TARGET, struct.pack("<i", 90_000)), (PRODUCT, struct.pack("<I", 2))])
    )
    assert state.scale == kept.scale
    assert (state.truck.total, state.truck.target, state.truck.product) == (880.0, 9000.0, 2)
    assert (shown[7], shown[8], shown[9], shown[10], shown[RECORDS]) == (8800, 1, 8, 8, RECORDING)
    found = run_replay(MACHINE, log, None, lambda sentence: None)
    assert found.different == 0
    assert found.service.memory == state.memory
    again, _ = asyncio.run(served(path, log, [(NEXT, b"next")]))
    assert (again.scale, again.truck.number, again.truck.target) == (kept.scale, 2, 9000.0)
    assert again.bookings.booking.number == 8
