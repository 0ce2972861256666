"""Recordings as gapless stretches of samples: what identification works on."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.core.assembler import Assembler
from cylforce.words.estimate import Array, Reason, Sample
from cylforce.words.events import Event, Frame

PIECE = 30_000  # rows that are held at once
LONGEST_JUMP = 1000  # periods of silence that are kept as missing rows; a longer one, or one back, only separates


def samples(assembler: Assembler, events: Iterable[Event], period_us: int) -> Iterator[Array]:
    """One row of SI values per tick, in pieces (T, S) of some minutes; NaN where something was missing or could not be
    believed."""
    rows: list[Array] = []
    for row in _rows(assembler, events, period_us):
        rows.append(row)
        if len(rows) == PIECE:
            yield np.array(rows)
            rows.clear()
    if rows:
        yield np.array(rows)


def _rows(assembler: Assembler, events: Iterable[Event], period_us: int) -> Iterator[Array]:
    inputs, still = assembler.begin(), (False,) * len(assembler.service.machine.signals)
    missing = np.full(len(assembler.service.machine.signals), np.nan)
    last_us: int | None = None
    for event in events:
        if isinstance(event, Frame):
            inputs = assembler.receive(inputs, event, still)
            continue
        for _ in range(0 if last_us is None else skipped(event.t_us - last_us, period_us)):
            yield missing
        sample = assembler.sample(inputs, event.t_us)
        yield sample.values if is_whole(sample) else missing
        last_us = event.t_us


def skipped(elapsed_us: int, period_us: int) -> int:
    """Missing rows between two ticks."""
    count = round(elapsed_us / period_us) - 1
    return min(count, LONGEST_JUMP) if count >= 0 else LONGEST_JUMP


def is_whole(sample: Sample) -> bool:
    """Every signal came in time and can be believed."""
    return sample.held is Reason.NONE and all(reason is Reason.NONE for reason in sample.reasons)


def gapless(values: Array, longest: int) -> list[Array]:
    """Stretches without NaN of samples (T, S); gaps of up to `longest` rows are bridged along a line."""
    return [stretch for _, stretch in stretches(values, longest)]


def stretches(values: Array, longest: int) -> list[tuple[int, Array]]:
    """The same, each with the number of its first row."""
    good = np.flatnonzero(np.all(np.isfinite(values), axis=1))
    if good.size == 0:
        return []
    parts = np.split(good, np.flatnonzero(np.diff(good) > longest + 1) + 1)
    return [(int(part[0]), _bridged(values, part)) for part in parts]


class Part(NamedTuple):
    """Samples `values` (T, S) without NaN from row `first` of a recording on; whether it `goes_on` where the part
    before ended."""

    first: int
    values: Array
    goes_on: bool


def parts(pieces: Iterable[Array], longest: int, size: int, least: int) -> Iterator[Part]:
    """The stretches of a recording that comes in pieces (T, S), each in parts of `size` rows, the last one of up to
    `size` + `least`; stretches shorter than `least` are left out."""
    count, pending = 0, None  # rows so far, and the part that may go on in the next piece
    for piece in pieces:
        begin, held, goes_on = count, piece, False
        if pending is not None:
            missing = np.full((count - pending.first - len(pending.values), piece.shape[1]), np.nan)
            begin, held, goes_on = pending.first, np.concatenate([pending.values, missing, piece]), pending.goes_on
        count, pending = count + len(piece), None
        for first, stretch in stretches(held, longest):
            *whole, rest = _cut(Part(begin + first, stretch, goes_on and first == 0), size, least)
            yield from whole
            if count - rest.first - len(rest.values) <= longest:
                pending = rest
            elif len(rest.values) >= least:
                yield rest
    if pending is not None and len(pending.values) >= least:
        yield pending


def _cut(part: Part, size: int, least: int) -> Iterator[Part]:
    while len(part.values) >= size + least:
        yield Part(part.first, part.values[:size], part.goes_on)
        part = Part(part.first + size, part.values[size:], goes_on=True)
    yield part


def _bridged(values: Array, good: NDArray[np.intp]) -> Array:
    steps = np.arange(good[0], good[-1] + 1)
    if steps.size == good.size:
        return values[steps]
    return np.stack([np.interp(steps, good, column) for column in values[good].T], axis=1)
