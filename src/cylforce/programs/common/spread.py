"""Which parts of long recordings are looked at: as many as memory holds, evenly spread."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cylforce.estimation.segments import Part


class Kept(NamedTuple):
    """A part, the number of its recording, and its own there."""

    recording: int
    number: int
    part: Part


class Spread:
    """At most `most` parts of several recordings that are read one after the other. Whenever there are more, the
    recording that has most gives up every second of its parts, and of what follows there only every so many-th is
    taken; when each has but one left, every second recording goes."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: list[Kept] = []
        self._parts: defaultdict[int, int] = defaultdict(lambda: 1)  # every so many-th of a recording
        self._recordings = 1  # every so many-th of all

    def add(self, kept: Kept) -> None:
        """The next part; recordings and their parts are counted from 0."""
        self._kept += [kept] if self._wanted(kept) else []
        while len(self._kept) > self._most:
            longest, count = Counter(k.recording for k in self._kept).most_common(1)[0]
            if count > 1:
                self._parts[longest] *= 2
            else:
                self._recordings *= 2
            self._kept = [k for k in self._kept if self._wanted(k)]

    def _wanted(self, kept: Kept) -> bool:
        return kept.recording % self._recordings == 0 and kept.number % self._parts[kept.recording] == 0

    def of(self, recording: int) -> Iterator[Part]:
        """What is kept of a recording; parts that follow each other are one again."""
        held: list[Kept] = []
        for kept in (k for k in self._kept if k.recording == recording):
            if held and not (kept.part.goes_on and kept.number == held[-1].number + 1):
                yield _whole(held)
                held = []
            held.append(kept)
        if held:
            yield _whole(held)


def _whole(held: list[Kept]) -> Part:
    return Part(held[0].part.first, np.concatenate([k.part.values for k in held]), held[0].part.goes_on)
