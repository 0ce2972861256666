"""Rows of samples, one per tick, from recorded events."""

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
    inputs: Assembler, events: Iterable[Event], period_us: int, unusable: Counter[Reason] | None = None
) -> Iterator[Array]:
    """Yield one row of SI values per tick, in pieces (T, S) of PIECE rows, the last piece of fewer.

    A row is NaN when any of its signals is missing, late or not usable. For missing ticks there are rows of NaN, too
    (`missing_rows`). The slew angle is unwrapped.

    inputs:    of the sensors, before any frame; updated with the frames
    events:    recorded frames and ticks
    period_us: fixed step, by which missing ticks are recognised [us]
    unusable:  updated, where given: number of ticks whose row is NaN, by the reason; missing ticks do not count
    """
    signals = inputs.constants.service.machine.signals
    slew = Follower([k for k, signal in enumerate(signals) if signal.kind is Kind.SLEW_ANGLE])
    rows: list[Array] = []
    for row in _rows(inputs, events, period_us, Counter() if unusable is None else unusable):
        rows.append(row)
        if len(rows) == PIECE:
            yield slew.follow(np.array(rows))
            rows.clear()
    if rows:
        yield slew.follow(np.array(rows))


def _rows(inputs: Assembler, events: Iterable[Event], period_us: int, unusable: Counter[Reason]) -> Iterator[Array]:
    """Yield one row (S,) of SI values for each tick of a log; NaN where a tick is missing or a signal is not usable.

    inputs:    last values of the sensors, updated with the frames
    events:    frames and ticks in their order
    period_us: fixed step [us]
    unusable:  updated: number of ticks whose row is NaN, by the largest reason; missing ticks do not count
    """
    missing = np.full(len(inputs.constants.service.machine.signals), np.nan)
    last_us: int | None = None
    for event in events:
        if isinstance(event, Frame):
            inputs.receive((event,))
            continue
        for _ in range(0 if last_us is None else missing_rows(event.t_us - last_us, period_us)):
            yield missing
        sample = inputs.sample(event.t_us)
        whole = is_whole(sample)
        if not whole:
            unusable[max((*sample.reasons, sample.late))] += 1
        yield sample.values if whole else missing
        last_us = event.t_us


def missing_rows(elapsed_us: int, period_us: int) -> int:
    """Return the number of missing rows between two ticks `elapsed_us` [us] apart, at most LONGEST_JUMP.

    It is LONGEST_JUMP also where the second tick is earlier, or less than half a period later, than the first one."""
    count = round(elapsed_us / period_us) - 1
    return min(count, LONGEST_JUMP) if count >= 0 else LONGEST_JUMP


def is_whole(sample: Sample) -> bool:
    """Return whether every signal is in time and usable."""
    return sample.late is Reason.NONE and all(reason is Reason.NONE for reason in sample.reasons)
