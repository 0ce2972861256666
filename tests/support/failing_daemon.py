"""A daemon to which something happens after a number of steps."""

import asyncio
from types import SimpleNamespace

from cylforce.can.opening import open_bus
from cylforce.programs.common.readings import make_core
from cylforce.programs.live.station import serve
from cylforce.programs.run import Daemon
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR
from waiting import until

MACHINE = load(EXCAVATOR)
STEPS = 20  # of the daemon before something happens to it


def daemon_on(name, log=None):
    """A daemon on a bus without sensors."""
    return Daemon(MACHINE, make_core(MACHINE, None), open_bus(f"virtual:{name}"), log, NOTHING_KEPT)


def run(daemon, manager=None, done=lambda: False):
    """Serve until it ends by itself or `done()`, however long a busy machine takes for that."""

    async def main():
        ended = asyncio.Event()
        served = asyncio.create_task(serve(daemon, ended, lambda: None, manager=manager))
        await until(lambda: served.done() or done())
        ended.set()
        await served

    asyncio.run(main())


def after(daemon, count, then):
    """From its tick number `count` on the daemon's handler does `then` first."""
    handler, ticks = daemon.handler, []

    def on_tick(t_us):
        ticks.append(t_us)
        if len(ticks) >= count:
            then()
        return handler.on_tick(t_us)

    daemon.handler = SimpleNamespace(on_frame=handler.on_frame, on_tick=on_tick)
    return ticks
