"""The daemon on a real vcan0 whose other nodes send anything: arbitrary frames, most of them with identifiers that
matter, and arbitrary SDO transfers. A tenth of what the whole study sends; that is `long`.

As measured in a guest beside other work: 1e6 frames and 1e5 transfers in 127 s, memory from 174.5 to 175.5 MB."""

import asyncio
import multiprocessing
import random
import select
import socket
import time
from pathlib import Path
from struct import Struct

import pytest

from cylforce.can.opening import open_bus
from cylforce.programs.run import Daemon
from cylforce.service.core import Core
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR, identified

FRAME = Struct("=IB3x8s")
EXTENDED = 0x8000_0000
EACH = 10  # frames before each transfer
ANSWER_S = 0.02  # for which an answer is waited for: some requests get none
WARM = 0.2  # share of all after which memory is compared: every path was taken once
MOST_MB = 1.0
LONGEST_S = 1200.0  # until every path was taken once
START = FRAME.pack(0x000, 2, bytes([1, 0]).ljust(8, b"\0"))  # NMT: all nodes
OBJECTS = (0x1000, 0x1001, 0x1003, 0x1005, 0x1010, 0x1014, 0x1016, 0x1017, 0x1018, 0x1400, 0x1800, 0x1801, 0x1A00)
OBJECTS += (0x2100, 0x2110, 0x2120, 0x2130, 0x2140, 0x2190, 0x21A0, 0x6125, 0x6139, 0x6144, 0x7100)


def arbitrary(rng, known):
    """A frame: three quarters with an identifier that matters."""
    can_id = rng.choice(known) if rng.random() < 0.75 else rng.getrandbits(29) | EXTENDED
    if rng.random() < 0.1:
        can_id = rng.getrandbits(11)
    size = 8 if rng.random() < 0.7 else rng.randrange(9)
    return FRAME.pack(can_id, size, rng.randbytes(size).ljust(8, b"\0"))


def requests(rng):
    """Frames of one transfer: mostly a read or a write of an object, then segments or nothing that fits."""
    index = rng.choice(OBJECTS) + rng.choice((0, 0, 0, rng.randrange(8)))
    command = rng.choice((0x40, 0x40, 0x23, 0x2B, 0x2F, 0x21, 0x20, 0xA0, 0xC0, 0x80, rng.randrange(256)))
    yield bytes([command, index & 255, index >> 8, rng.choice((0, 1, 2, rng.randrange(256)))]) + rng.randbytes(4)
    for _ in range(rng.choice((0, 0, 0, 1, 5))):
        yield bytes([rng.choice((0x60, 0x70, 0x00, 0x10, 0x01, 0x11, rng.randrange(256)))]) + rng.randbytes(7)


def strangers(known, node_id, transfers, seed, warm, done):
    """Send EACH arbitrary frames and a transfer, so often; each frame of a transfer waits for an answer."""
    rng = random.Random(seed)
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as bus:
        bus.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, Struct("=II").pack(0x580 + node_id, 0x7FF))
        bus.bind(("vcan0",))
        for k in range(transfers):
            for _ in range(EACH):
                bus.send(arbitrary(rng, known))
            bus.send(START)
            for data in requests(rng):
                bus.send(FRAME.pack(0x600 + node_id, 8, data))
                if select.select([bus], [], [], ANSWER_S)[0]:
                    bus.recv(16)
            if k == int(WARM * transfers):
                warm.set()
                time.sleep(0.5)
    done.set()


def resident_mb():
    """Memory of this process [MB]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 1e6


async def fuzzed(core, loaded, others):
    """Memory [MB] when every path was taken once, and at the end; what failed; steps and frames."""
    bus, failed = open_bus("socketcan:vcan0"), []
    daemon = Daemon(loaded, core, bus, None, NOTHING_KEPT)
    loop = asyncio.get_running_loop()
    loop.set_exception_handler(lambda _, context: failed.append(context))
    daemon.start(loop)
    process, warm = others
    process.start()
    await asyncio.to_thread(warm.wait, LONGEST_S)
    memory = [resident_mb()]
    await asyncio.to_thread(process.join)
    memory.append(resident_mb())
    steps = daemon.counts.steps
    await asyncio.sleep(0.5)
    going = daemon.counts.steps - steps
    received, dropped = bus.counters.received, bus.counters.dropped
    await daemon.stop(loop)
    return memory, failed, {"received": received, "dropped": dropped, "steps": steps, "going": going}


@pytest.mark.parametrize("transfers", [2_000, pytest.param(100_000, marks=pytest.mark.long)])
def test_whatever_others_send_nothing_fails_and_memory_does_not_grow(transfers):
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    service = loaded.service
    known = [pdo.can_id for node in service.nodes for pdo in node.pdos]
    known += [0x700 + node.node_id for node in service.nodes] + [0x80 + node.node_id for node in service.nodes]
    known += [0x580 + node.node_id for node in service.nodes] + [pdo.can_id for pdo in service.publication]
    known += [0x000, 0x080, 0x600 + service.node_id, 0x700 + service.node_id]
    context = multiprocessing.get_context("fork")
    warm, done = context.Event(), context.Event()
    process = context.Process(target=strangers, args=(known, service.node_id, transfers, 24, warm, done))
    try:
        (before, after), failed, counts = asyncio.run(fuzzed(core, loaded, (process, warm)))
    finally:
        process.kill()
        process.join()
    print(f"{transfers * EACH} frames, {transfers} transfers: {before:.1f} MB, {after:.1f} MB, {counts}")
    assert not failed
    assert done.is_set()
    assert counts["going"] > 10
    assert after - before < MOST_MB
