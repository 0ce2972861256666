"""Waiting for what is certain to come, and a clock that a busy machine cannot slow down."""

import asyncio
import selectors
import time

PATIENCE_S = 120.0  # on any machine, however busy: longer than anything that is waited for takes


async def until(condition, seconds=PATIENCE_S):
    """Return when the condition holds; fail after so many seconds of the loop's clock."""
    loop = asyncio.get_running_loop()
    deadline = loop.time() + seconds
    while not condition():
        assert loop.time() < deadline, "waited in vain"
        await asyncio.sleep(0.005)


class _Skipping(selectors.DefaultSelector):
    """A selector that does not wait: it reports how long it would have waited."""

    def __init__(self):
        super().__init__()
        self.waited_s = 0.0

    def select(self, timeout=None):
        assert timeout is not None, "nothing is left to wait for: the test would hang"
        self.waited_s += max(timeout, 0.0)
        return super().select(0.0)


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop on a clock of its own: computing takes no time, idle time is skipped.

    For tests whose parts all live in one loop. What comes from a thread, a process or a socket needs the real clock.
    """

    def __init__(self):
        self._skipping = _Skipping()
        super().__init__(self._skipping)

    def time(self):
        """Return the seconds that were skipped so far."""
        return self._skipping.waited_s


def run_virtually(main):
    """Run a coroutine on a virtual clock, which begins at 0 s."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)


def wait_until(condition, seconds=PATIENCE_S):
    """Block until the condition holds; fail after so many seconds."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.02)
