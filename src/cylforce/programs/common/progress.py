"""Progress of a long command: a bar on the terminal, nothing without one."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from cylforce.signals.events import Event

Watch = Callable[[str, float | None], None]  # name of the task; its completed share (0..1), None where unknown

EVERY = 5000  # events
HEAD_BYTES = 1 << 16


def silent(doing: str, share: float | None) -> None:
    """Ignore progress."""


@contextmanager
def progress_bar(steps: int | None = None) -> Iterator[Watch]:
    """Yield the progress function of a bar on the terminal of standard error; the bar is removed at the end.

    steps: number of tasks that one bar covers; None: one bar for each task
    """
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield over_one(bar) if steps is None else over_all(bar, steps)


def over_one(bar: Progress) -> Watch:
    """Return the progress function of a bar that restarts with each task."""
    task = bar.add_task("", total=None)

    def watch(doing: str, share: float | None) -> None:
        if share is None:
            bar.reset(task, description=doing, total=None)
        else:
            bar.update(task, description=doing, total=1.0, completed=min(share, 1.0))

    return watch


def over_all(bar: Progress, steps: int) -> Watch:
    """Return the progress function of a bar over all tasks, the share of the present one included."""
    task, begun = bar.add_task("", total=float(steps)), list[str]()

    def watch(doing: str, share: float | None) -> None:
        if doing not in begun[-1:]:
            begun.append(doing)
        done = min(len(begun) - 1 + min(share or 0.0, 1.0), float(steps))
        bar.update(task, description=f"{min(len(begun), steps)}/{steps} {doing}", completed=done)

    return watch


def watched(path: Path, events: Iterable[Event], watch: Watch) -> Iterator[Event]:
    """Yield the events of a recording and report the share that has been read."""
    expected = _expected(path)
    for k, event in enumerate(events):
        if k % EVERY == 0:
            watch(f"reading {path.name}", None if expected is None else k / expected)
        yield event


def _expected(path: Path) -> float | None:
    """Return the estimated number of lines of a .log file, from its beginning.

    None for other files, whose lines are no events.
    """
    if path.suffix.lower() != ".log":
        return None
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    return path.stat().st_size * head.count(b"\n") / len(head) if b"\n" in head else None
