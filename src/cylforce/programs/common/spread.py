"""Selection of stretches of long recordings: as many as fit into memory, evenly spread."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cylforce.estimation.segments import Part


class Kept(NamedTuple):
    """Selected stretch.

    recording: number of its recording
    number:    its own number in the recording
    part:      the stretch
    """

    recording: int
    number: int
    part: Part


class Spread:
    """Selection of at most `most` stretches of several recordings that are read one after the other.

    If there are more, the recording with the most loses every second one. From then on only every second, fourth, ...
    of its stretches is added. Once each recording has a single one, every second recording is dropped.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._kept: list[Kept] = []
        self._parts: defaultdict[int, int] = defaultdict(lambda: 1)  # every so many-th of a recording
        self._recordings = 1  # every so many-th of all

    def add(self, kept: Kept) -> None:
        """Add the next stretch; recordings and their stretches are counted from 0."""
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
        """Yield the selected stretches of a recording; consecutive ones are joined."""
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
