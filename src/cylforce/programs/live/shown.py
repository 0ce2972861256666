"""The machine, service and display of a cab for the demo, each a process of its own, until a signal."""

import asyncio
import signal
import sys
from contextlib import suppress
from pathlib import Path

ENDLESS = 10_000  # digging cycles, the most that can be simulated: two days
END_S = 10.0


class Ensemble:
    """Processes of this program, which end together."""

    def __init__(self) -> None:
        self._processes: list[asyncio.subprocess.Process] = []

    async def add(self, *words: object, quiet: bool = True) -> None:
        """Start one more: `cylforce WORDS`."""
        out = asyncio.subprocess.DEVNULL if quiet else None  # errors are shown, the service's journal is not
        err = asyncio.subprocess.DEVNULL if words[0] == "run" else None
        command = (sys.executable, "-m", "cylforce", *(str(word) for word in words))
        self._processes.append(await asyncio.create_subprocess_exec(*command, stdout=out, stderr=err))

    async def first_end(self) -> None:
        """Wait until one of them ends."""
        waits = [asyncio.ensure_future(process.wait()) for process in self._processes]
        await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)

    async def stop(self) -> None:
        """End them all."""
        for process in self._processes:
            with suppress(ProcessLookupError):
                process.terminate()
        for process in self._processes:
            with suppress(TimeoutError):
                await asyncio.wait_for(process.wait(), END_S)


async def show(machine: Path, identified: Path, bus: str, seed: int, listen: str) -> None:
    """Run all three until SIGINT or SIGTERM, or until one ends."""
    stop, stage, loop = asyncio.Event(), Ensemble(), asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop.set)
    records = identified.with_name("records.db")
    await stage.add("run", machine, "--bus", bus, "--identified", identified, "--records", records)
    await stage.add("sim", machine, "--bus", bus, "--scenario", "cycles", "--cycles", ENDLESS, "--seed", seed)
    await stage.add("display", machine, "--bus", bus, "--records", records, "--listen", listen, quiet=False)
    ended = asyncio.create_task(stage.first_end())
    stopped = asyncio.create_task(stop.wait())
    await asyncio.wait([ended, stopped], return_when=asyncio.FIRST_COMPLETED)
    await stage.stop()
    stopped.cancel()
    await ended
