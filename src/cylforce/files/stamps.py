"""Time stamps of another program's log: detect frames with wrong stamps (strays), and where its clock was set."""

from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

from cylforce.files.atomic import Report
from cylforce.files.candump import Sent
from cylforce.signals.events import Frame

Stamped = TypeVar("Stamped", Frame, Frame | Sent)

NAMED = 20  # steps of a clock that are reported one by one, the others are counted; chosen


def without_strays(frames: Iterable[Stamped], period_us: int, name: str, report: Report) -> Iterator[Stamped]:
    """Yield the frames without strays, and report how many were omitted.

    A stray is stamped more than `period_us` from the frame before it and from the frame after it; the frame after it is
    nearer to the frame before it than to the stray. Several strays may follow each other. A smaller error moves a frame
    by less than a sample. Where an identifier repeats before the frames continue at the old time, they are no strays:
    the clock was set, or the bus was silent. At the recording's end such frames are strays only if they are stamped
    earlier than the frame before them.

    period_us: period of the service's steps [us]
    name: name of the recording in a report
    report: called with a sentence
    """
    newest: int | None = None  # latest stamp since the clock was set
    apart: list[Stamped] = []  # frames more than a period from `newest` that may be strays
    strays = _Strays(name, report)
    for frame in frames:
        t_us = frame.t_us
        if apart and newest is not None and max(abs(t_us - newest), period_us) < abs(t_us - apart[-1].t_us):
            strays.add(apart, newest)
            apart = []
        if apart:
            apart.append(frame)
            if frame.can_id in {earlier.can_id for earlier in apart[:-1]}:
                newest = max(t_us, apart[-2].t_us)
                yield from apart
                apart = []
        elif newest is None or abs(t_us - newest) <= period_us:
            newest = t_us if newest is None or t_us > newest else newest
            yield frame
        else:
            apart = [frame]
    if apart and newest is not None and apart[0].t_us < newest:
        strays.add(apart, newest)
    else:
        yield from apart
    strays.report()


class _Strays:
    """Count of omitted frames, with the first of them."""

    def __init__(self, name: str, report: Report) -> None:
        self._name, self._report, self._count = name, report, 0
        self._first_us = self._offset_us = 0  # of the first one: its stamp, and that less the stamp before it [us]

    def add(self, frames: Sequence[Frame | Sent], newest_us: int) -> None:
        """Count frames that were omitted.

        frames:    one or more
        newest_us: latest stamp before them [us]
        """
        if not self._count:
            self._first_us, self._offset_us = frames[0].t_us, frames[0].t_us - newest_us
        self._count += len(frames)

    def report(self) -> None:
        """Report them, at the recording's end."""
        if self._count:
            way = "ahead of" if self._offset_us > 0 else "behind"
            self._report(
                f"{self._name}: frames stamped {abs(self._offset_us) / 1e6:.6g} s {way} the frames beside them, the "
                f"first at {self._first_us / 1e6:.6f} s, were left out: {self._count}; their stamps are wrong"
            )


class Cuts:
    """Reports where the clock of a recording was set, the first NAMED times with their moment.

    name: name of the recording in a report
    report: called with a sentence
    count: times that the clock was set
    """

    def __init__(self, name: str, report: Report) -> None:
        self._name, self._report, self.count = name, report, 0

    def add(self, before_us: int, after_us: int) -> None:
        """Report that the stamp `after_us` follows `before_us`."""
        self.count += 1
        if self.count <= NAMED:
            by, way = abs(after_us - before_us) / 1e6, "back" if after_us < before_us else "ahead"
            self._report(
                f"{self._name}: the clock of the recording steps {way} by {by:.6g} s, from {before_us / 1e6:.6f} to "
                f"{after_us / 1e6:.6f} s: the recording is cut there"
            )

    def report(self) -> None:
        """Report the number of all, at the recording's end, if there are more than NAMED."""
        if self.count > NAMED:
            self._report(f"{self._name}: the clock of the recording was set {self.count} times: it is cut at each")
