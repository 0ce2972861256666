"""The daemon on a real vcan0 while others fill the bus: foreign frames do not reach it."""

import asyncio
import multiprocessing
import socket
import time
from struct import Struct

from cylforce.can.opening import open_bus
from cylforce.programs.run import Daemon
from cylforce.service.core import Core
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from faulting.lateness import FOREIGN, FRAME, flooded
from scenarios import EXCAVATOR, identified

RATE = 4000  # foreign frames per second
SECONDS = 3.0


def answering(frames):
    """Sensors that answer each SYNC with the same posture, in a process of their own."""
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as sensors:
        sensors.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, Struct("=II").pack(0x80, 0x7FF))
        sensors.bind(("vcan0",))
        while sensors.recv(16):
            for can_id, data in frames:
                sensors.send(FRAME.pack(can_id, len(data), data.ljust(8, b"\0")))


async def received(loaded, core):
    """Count the frames that the bus took, and the foreign ones among those that reached the daemon."""
    bus = open_bus("socketcan:vcan0")
    daemon = Daemon(loaded, core, bus, None, NOTHING_KEPT)
    receive, foreign = daemon.on_frame, []
    daemon.on_frame = lambda frame: (receive(frame), frame.can_id in FOREIGN and foreign.append(frame))
    daemon.start(asyncio.get_running_loop())
    await asyncio.sleep(1.0)
    foreign.clear()  # what came between opening and filtering
    before = bus.counters.received
    await asyncio.sleep(SECONDS)
    found = bus.counters.received - before
    await daemon.stop(asyncio.get_running_loop())
    return found, len(foreign)


def test_foreign_frames_do_not_reach_the_daemon():
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    middle = {f"{link.name}_angle": (link.angle_low + link.angle_high) / 2 for link in core.service.machine.links}
    frames = [
        (pdo.can_id, encode(pdo, {f.signal: middle.get(f.signal, 0.0) for f in pdo.fields if f.signal}))
        for node in core.service.nodes
        for pdo in node.pdos
    ]
    process = multiprocessing.get_context("fork")
    others = [
        process.Process(target=answering, args=(frames,)),
        process.Process(target=flooded, args=("vcan0", RATE)),
    ]
    for other in others:
        other.start()
    time.sleep(1.0)
    try:
        ours, foreign = asyncio.run(received(loaded, core))
    finally:
        for other in others:
            other.kill()
            other.join()
    assert ours > 100.0 * SECONDS  # of some 900 a second
    assert foreign == 0
