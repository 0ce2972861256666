"""`tools/bench --functions`: where the time of a step goes, by function. The running program is looked at each
millisecond of processor time, which slows every function alike, unlike a profiler that watches calls."""

import signal
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from time import process_time
from types import FrameType
from typing import NamedTuple

from rich.table import Table

from against import recorded
from bench import due_at
from cylforce.files.candump import event_lines
from cylforce.files.logfile import BLOCK_LINES
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.signals.events import Event

EVERY_S = 0.001
SHOWN = 36
NOT_SHOWN = ("profiled.", "bench.", "<frozen", "runpy.")
WORDS = {
    "<string>.<lambda>": "(a named tuple is made)",
    "<string>.__create_fn__.<locals>.__init__": "(a dataclass is made)",
}


class Share(NamedTuple):
    """Microseconds of a step in a function, and in it alone."""

    whole_us: float
    own_us: float


class Looker:
    """Looks at the running program, and counts in which functions it is."""

    def __init__(self) -> None:
        self.whole, self.own, self.looks = Counter[str](), Counter[str](), 0

    def __call__(self, _: int, frame: FrameType | None) -> None:
        """One look."""
        self.looks += 1
        seen = list[str]()
        while frame is not None:
            code = frame.f_code
            seen.append(f"{Path(code.co_filename).stem}.{code.co_qualname}")
            frame = frame.f_back
        self.own[seen[0]] += 1
        self.whole.update(set(seen))

    def watch(self, work: Callable[[], int]) -> tuple[dict[str, Share], float]:
        """Time of each function in the work, which tells how many steps it took; and that of a step [us]."""
        before = signal.signal(signal.SIGPROF, self)
        signal.setitimer(signal.ITIMER_PROF, EVERY_S, EVERY_S)
        begin = process_time()
        try:
            steps = work()
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)
        step_us = (process_time() - begin) / steps * 1e6
        each = step_us / max(self.looks, 1)
        return {name: Share(n * each, self.own[name] * each) for name, n in self.whole.items()}, step_us


def measure(config: Path, rounds: int) -> tuple[dict[str, Share], float]:
    """Steps through a digging cycle, again and again, with log and PDOs."""
    core, events = recorded(config)
    stepped(core, events)
    return Looker().watch(lambda: sum(stepped(core, events) for _ in range(rounds)))


def stepped(core: Core, events: list[Event]) -> int:
    """The number of steps taken."""
    weighing, due, steps, logged = WeighingService.start(core), due_at(core), 0, list[Event]()
    for event in events:
        logged.append(event)
        estimate = weighing.on_event(event)
        if estimate is not None:
            steps += 1
            core.encoders.due(estimate, due[steps % len(due)])
        if len(logged) >= BLOCK_LINES:
            event_lines(logged, "can0")
            logged.clear()
    return steps


def table(found: dict[str, Share], step_us: float) -> Table:
    """The functions in which most time passes, with those that they call."""
    text = Table(title=f"A step of {step_us:.0f} us by function")
    for words in ("", "us, whole", "us, alone"):
        text.add_column(words, justify="right" if words else "left")
    largest = sorted(found.items(), key=lambda item: -item[1].whole_us)
    for name, share in [each for each in largest if not each[0].startswith(NOT_SHOWN)][:SHOWN]:
        text.add_row(WORDS.get(name, name), f"{share.whole_us:.1f}", f"{share.own_us:.1f}")
    return text
