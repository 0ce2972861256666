"""Recorded events to rows of samples, one row per tick."""

from collections import Counter
from collections.abc import Iterable, Iterator

import numpy as np

from cylforce.service.assembler import Assembler
from cylforce.signals.estimate import Array, Reason, Sample
from cylforce.signals.events import Event, Frame
from cylforce.signals.kinds import Kind
from cylforce.signals.turns import Follower

PIECE = 30_000  # rows per piece; chosen: bounds the memory needed
LONGEST_JUMP = 1000  # missing rows at most between two ticks, for a longer pause or a jump backwards too; chosen


def samples(
    assembler: Assembler, events: Iterable[Event], period_us: int, unusable: Counter[Reason] | None = None
) -> Iterator[Array]:
    """One row of SI values per tick, in pieces (T, S) of PIECE rows; a row is NaN when any of its signals is missing,
    late or not usable. `period_us`: the fixed step, by which missing ticks are recognised. In `unusable`, where given,
    ticks without a sample are counted by their reasons. The slew angle goes on where its encoder passes the end of its
    circle."""
    signals = assembler.service.machine.signals
    slew = Follower([k for k, signal in enumerate(signals) if signal.kind is Kind.SLEW_ANGLE])
    rows: list[Array] = []
    for row in _rows(assembler, events, period_us, Counter() if unusable is None else unusable):
        rows.append(row)
        if len(rows) == PIECE:
            yield slew.follow(np.array(rows))
            rows.clear()
    if rows:
        yield slew.follow(np.array(rows))


def _rows(assembler: Assembler, events: Iterable[Event], period_us: int, unusable: Counter[Reason]) -> Iterator[Array]:
    inputs, still = assembler.begin(), assembler.still
    missing = np.full(len(assembler.service.machine.signals), np.nan)
    last_us: int | None = None
    for event in events:
        if isinstance(event, Frame):
            inputs = assembler.receive(inputs, (event,), still)
            continue
        for _ in range(0 if last_us is None else skipped(event.t_us - last_us, period_us)):
            yield missing
        sample = assembler.sample(inputs, event.t_us)
        whole = is_whole(sample)
        if not whole:
            unusable[max((*sample.reasons, sample.late))] += 1
        yield sample.values if whole else missing
        last_us = event.t_us


def skipped(elapsed_us: int, period_us: int) -> int:
    """Number of rows that are missing between two ticks `elapsed_us` apart."""
    count = round(elapsed_us / period_us) - 1
    return min(count, LONGEST_JUMP) if count >= 0 else LONGEST_JUMP


def is_whole(sample: Sample) -> bool:
    """Whether every signal came in time and is usable."""
    return sample.late is Reason.NONE and all(reason is Reason.NONE for reason in sample.reasons)
