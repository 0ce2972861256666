"""Recordings cut into stretches of samples without gaps, as the identification needs them."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.estimate import Array


def gapless(values: Array, longest: int) -> list[Array]:
    """Return the stretches without NaN of samples (T, S); gaps of up to `longest` rows are filled by linear
    interpolation."""
    return [stretch for _, stretch in stretches(values, longest)]


def stretches(values: Array, longest: int) -> list[tuple[int, Array]]:
    """Return the stretches of a recording without NaN, each with the number of its first row.

    values:  (T, S) samples, NaN where there is none
    longest: rows of a gap up to which it is filled by linear interpolation
    """
    good = np.flatnonzero(np.all(np.isfinite(values), axis=1))
    if good.size == 0:
        return []
    parts = np.split(good, np.flatnonzero(np.diff(good) > longest + 1) + 1)
    return [(int(part[0]), _bridged(values, part)) for part in parts]


class Part(NamedTuple):
    """Part of a recording without NaN.

    first:   row of the recording at which it begins
    values:  (T, S) samples
    goes_on: whether it follows the part before without a gap
    """

    first: int
    values: Array
    goes_on: bool


def parts(pieces: Iterable[Array], longest: int, size: int, least: int) -> Iterator[Part]:
    """Yield the stretches of a recording, each cut into parts of `size` rows. The last part of a stretch has less than
    `size` + `least` rows.

    pieces:  (T, S) the recording, one piece after the other
    longest: rows of a gap up to which it is filled by interpolation
    size:    rows of a part
    least:   rows of the shortest stretch that is used; shorter ones are omitted
    """
    count, pending = 0, None  # rows so far, and the part that may go on in the next piece
    for piece in pieces:
        begin, rows, goes_on = count, piece, False
        if pending is not None:
            missing = np.full((count - pending.first - len(pending.values), piece.shape[1]), np.nan)
            begin, rows, goes_on = pending.first, np.concatenate([pending.values, missing, piece]), pending.goes_on
        count, pending = count + len(piece), None
        for first, stretch in stretches(rows, longest):
            *whole, rest = _cut(Part(begin + first, stretch, goes_on and first == 0), size, least)
            yield from whole
            if count - rest.first - len(rest.values) <= longest:
                pending = rest
            elif len(rest.values) >= least:
                yield rest
    if pending is not None and len(pending.values) >= least:
        yield pending


def _cut(part: Part, size: int, least: int) -> Iterator[Part]:
    """Yield a part in pieces of `size` rows; the last piece has less than `size + least` rows.

    Each piece but the first one goes on from the piece before."""
    while len(part.values) >= size + least:
        yield Part(part.first, part.values[:size], part.goes_on)
        part = Part(part.first + size, part.values[size:], goes_on=True)
    yield part


def _bridged(values: Array, good: NDArray[np.intp]) -> Array:
    """Return the samples from the first to the last good row, with the rows between interpolated linearly.

    values: (T, S) samples
    good:   numbers of the rows without NaN, in ascending order
    """
    steps = np.arange(good[0], good[-1] + 1)
    if steps.size == good.size:
        return values[steps]
    return np.stack([np.interp(steps, good, column) for column in values[good].T], axis=1)
