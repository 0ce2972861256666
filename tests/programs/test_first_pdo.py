"""From the start of `cylforce run` to its first PDO on a bus that other processes see: a second at most.

Of its processor time, on a computer that imports numpy in 0.1 s: other programs slow this computer's clock, not the
program. While it computes it hardly waits: on a bus where computing costs no time its first PDO comes after 24 ms
(tests/virtual_clock)."""

import asyncio
import os
import subprocess
import sys
from pathlib import Path

from cylforce.can.opening import open_bus
from cylforce.can.python_can import Relay
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR
from speed import takes_at_most

MOST_S = 1.0  # the goal of the project


def processor_s(pid):
    """Processor time [s] of a process so far."""
    ticks = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


async def first_pdo(name, ours):
    """Processor time [s] of a daemon on a bus when the first of our PDOs comes."""
    seen, took = asyncio.Event(), []
    bus = open_bus(name)

    def on_frame(frame):
        if frame.can_id in ours and not took:
            took.append(processor_s(daemon.pid))
            seen.set()

    bus.attach(asyncio.get_running_loop(), on_frame)
    command = (sys.executable, "-m", "cylforce", "run", str(EXCAVATOR), "--bus", name)
    daemon = await asyncio.create_subprocess_exec(*command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        await asyncio.wait_for(seen.wait(), 60.0)
    finally:
        daemon.terminate()
        await daemon.wait()
    bus.close()
    return took[0]


def test_the_first_pdo_comes_within_a_second():
    ours = {pdo.can_id for pdo in load(EXCAVATOR).service.publication}
    with Relay() as relay:
        assert takes_at_most(MOST_S, lambda: asyncio.run(first_pdo(relay.name, ours)))
