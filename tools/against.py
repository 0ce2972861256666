"""`tools/bench --against`: a step beside well-known pieces of work, in turn in one run: the whole step, with its
frames, the log and the encoding of what is due, over an update of filterpy's Kalman filter (14 states, 2 outputs);
the kernel alone; decoding beside python-can and canopen. Processor time, of small groups in turn, so that what slows
the core for one slows it for the other."""

import contextlib
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any, NamedTuple

from rich.table import Table

from bench import due_at, recorded_events
from cylforce.commissioning.identification import identify
from cylforce.estimation.kernel import choice
from cylforce.files.candump import event_lines
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.programs.sim import run_sim
from cylforce.service.assembler import Assembler
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.events import Event, Frame, Tick
from studies._rivals import c_updates, canopen_decoder, filterpy_update, numpy_update, padasip_update

GROUP = 25  # steps between two measurements of the others
UPDATES = 20  # of a rival in a group
ROWS = ("advance",)
SOLVE = ("residual_torque", "weigh_load", "gate", "take", "conclude", "tool_force", "published_forces", "learn_noise")
A_TICK = 8  # frames that are judged together: those of a step
WORDS = {
    "step": "whole step: frames, tick, log, PDOs that are due",
    "rows": "kernel: motion, levers, columns, filters",
    "solve": "kernel: residual, recursion, weight, forces",
    "decode": "a frame to checked signals",
    "canopen": "a frame by python-can and canopen",
    "filterpy": "an update of filterpy's Kalman filter, 14 x 2",
    "padasip": "an update of padasip's FilterRLS, 14",
    "numpy": "an update of least squares in NumPy, 14 x 2",
    "c": "an update of the Kalman filter by a loop of C",
}
Times = dict[str, list[float]]  # microseconds of one piece of work, group by group


class Kernel:
    """The kernel that runs, with a stopwatch at each of its functions."""

    def __init__(self, kernel: Any) -> None:  # noqa: ANN401 - of either form
        self._kernel, self.took = kernel, dict[str, float]()

    def __getattr__(self, name: str) -> Any:  # noqa: ANN401 - its classes and functions
        found = getattr(self._kernel, name)
        if name not in (*ROWS, *SOLVE):
            return found

        def timed(*arguments: Any) -> Any:  # noqa: ANN401 - what the function takes and gives
            begin = process_time()
            result = found(*arguments)
            self.took[name] = self.took.get(name, 0.0) + process_time() - begin
            return result

        return timed


def recorded(config: Path) -> tuple[Core, list[Event]]:
    """A simulated machine, identified from its empty motion, and the events of its digging cycle."""
    loaded = load(config)
    with TemporaryDirectory() as name, contextlib.redirect_stdout(io.StringIO()):
        moves, cycle = Path(name) / "moves.log", Path(name) / "cycle.log"
        run_sim(config, scenario="moves", seed=1, log=moves)
        run_sim(config, scenario="cycles", cycles=1, seed=1, log=cycle)
        tares = identify(model_of(loaded), recorded_segments(loaded, moves)).tares
        return Core(loaded.service, tares), list(recorded_events(loaded, cycle))


def measure(config: Path, rounds: int) -> Times:
    """All pieces of work on a digging cycle, round by round."""
    core, events = recorded(config)
    with TemporaryDirectory() as name:
        loop = c_updates(Path(name), 100 * UPDATES)
    found: Times = {name: [] for name in WORDS}
    for _ in range(rounds):
        stepped(core, events, found, loop)
    kernel_alone(core, events, rounds, found)
    return {name: times for name, times in found.items() if times}


def stepped(core: Core, events: Sequence[Event], found: Times, loop: Callable[[], object] | None) -> None:
    """The step and the others in turn."""
    rivals = {"filterpy": filterpy_update(), "padasip": padasip_update(), "numpy": numpy_update()}
    decode = canopen_decoder(core.service)
    weighing, due, steps = WeighingService.start(core), due_at(core), 0
    for group in grouped(events):
        begin = process_time()
        for event in group:
            estimate = weighing.on_event(event)
            if estimate is not None:
                steps += 1
                core.encoders.due(estimate, due[steps % len(due)])
        event_lines(group, "can0")
        found["step"].append((process_time() - begin) / GROUP * 1e6)
        frames = [e for e in group if isinstance(e, Frame) and e.can_id in core.inputs.decoders]
        inputs, moving = Assembler.start(core.inputs), weighing.moving
        inputs.restore(weighing.inputs.snapshot())
        together = [frames[k : k + A_TICK] for k in range(0, len(frames), A_TICK)]
        us = each_us(lambda some, i=inputs, m=moving: i.receive(some, m), together)
        found["decode"].append(us * len(together) / max(len(frames), 1))
        found["canopen"].append(each_us(decode, frames))
        for name, rival in rivals.items():
            found[name].append(each_us(lambda _, rival=rival: rival(), range(UPDATES)))
        if loop is not None:
            found["c"].append(each_us(lambda _: loop(), range(1)) / (100 * UPDATES))


def each_us(work: Callable[..., object], of: Iterable[object]) -> float:
    """Microseconds of one call."""
    items = list(of)
    begin = process_time()
    for item in items:
        work(item)
    return (process_time() - begin) / max(len(items), 1) * 1e6


def grouped(events: Sequence[Event]) -> Iterator[list[Event]]:
    """The events of GROUP steps each; the last, shorter one is left out."""
    group, ticks = list[Event](), 0
    for event in events:
        group.append(event)
        ticks += isinstance(event, Tick)
        if ticks == GROUP:
            yield group
            group, ticks = [], 0


def kernel_alone(core: Core, events: Sequence[Event], rounds: int, found: Times) -> None:
    """Of each group of steps the time in the kernel's functions, less that of asking the clock."""
    watched = Kernel(choice.chosen())
    empty = min(asked() for _ in range(1000))
    with choice.using(watched):
        fresh = Core(core.service, core.tares)
        for _ in range(rounds):
            weighing = WeighingService.start(fresh)
            for group in grouped(events):
                watched.took.clear()
                for event in group:
                    weighing.on_event(event)
                for name, functions in (("rows", ROWS), ("solve", SOLVE)):
                    us = [1e6 * (watched.took[f] / GROUP - empty) for f in functions if f in watched.took]
                    found[name].append(sum(us))


def asked() -> float:
    """Seconds of asking the clock."""
    begin = process_time()
    return process_time() - begin


class Ratios(NamedTuple):
    """What is compared, at the median; `decode_over_canopen` by frames; `filterpy_us` tells how fast the machine is."""

    step_over_filterpy: float
    rows_us: float
    solve_us: float
    decode_over_canopen: float
    filterpy_us: float


def ratios(found: Times) -> Ratios:
    """Medians of group by group."""
    over = [a / b for a, b in zip(found["step"], found["filterpy"], strict=True)]
    decode = [a / b for a, b in zip(found["decode"], found["canopen"], strict=True)]
    rows, solve, filterpy = (median(found[name]) for name in ("rows", "solve", "filterpy"))
    return Ratios(median(over), rows, solve, median(decode), filterpy)


def table(found: Times) -> Table:
    """Each piece of work: least and median microseconds, and the median over that of filterpy."""
    form = "interpreted" if choice.chosen() is choice.INTERPRETED else "compiled"
    text = Table(title=f"A step beside others, kernel {form}, processor time")
    for words in ("", "us, least", "us, median", "over filterpy's"):
        text.add_column(words, justify="right" if words else "left")
    base = median(found["filterpy"])
    for name, words in WORDS.items():
        if name in found:
            middle = median(found[name])
            text.add_row(words, f"{min(found[name]):.1f}", f"{middle:.1f}", f"{middle / base:.2f}")
    text.add_section()
    text.add_row("a frame over python-can and canopen", "", "", f"{ratios(found).decode_over_canopen:.2f}")
    return text
