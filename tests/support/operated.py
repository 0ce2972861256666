"""A program that guides an operator, as a process on the kernel's bus, and the simulated machine that he moves."""

import asyncio
import sys
from typing import NamedTuple

from cylforce.can.opening import open_bus
from cylforce.programs.live.sim_bus import play_until

BUS = "socketcan:vcan0"
LONGEST_S = 900.0


class Ended(NamedTuple):
    """A program that has ended: exit code, standard error, lines of standard output."""

    code: int
    errors: str
    lines: list[str]


def operated(words, play, on_line):
    """Run `cylforce WORDS` to its end while the machine of `play` moves on BUS.

    `on_line` is called with each line that the program prints, so that the scenes of `play` can follow it.
    """
    return asyncio.run(_operated([sys.executable, "-m", "cylforce", *map(str, words), "--bus", BUS], play, on_line))


async def _operated(command, play, on_line):
    pipe = {"stderr": asyncio.subprocess.PIPE, "stdout": asyncio.subprocess.PIPE}
    process = await asyncio.create_subprocess_exec(*command, **pipe)
    stop, bus, lines = asyncio.Event(), open_bus(BUS), []

    async def listen():
        while line := await process.stdout.readline():
            lines.append(line.decode().rstrip())
            on_line(lines[-1])

    machine = asyncio.create_task(play_until(play, bus, None, stop))
    listening = asyncio.create_task(listen())
    try:
        errors = await asyncio.wait_for(process.stderr.read(), LONGEST_S)
        await listening
    finally:
        stop.set()
        await machine
        bus.close()
        if process.returncode is None:
            process.kill()
            await process.wait()
    return Ended(process.returncode, errors.decode(), lines)
