"""Detect tables whose values are repeated: the exporting program filled its rows with the last value (sample and
hold).
"""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.files.atomic import RecordingError
from cylforce.files.tables import Table
from cylforce.signals.estimate import Array

# Consecutive leaps between repeated values that show sample and hold. Measured: at most 2 in 95 tables of another
# generator, at most 4 with readings in coarse steps, at most 8 with readings that change by a threshold only; in held
# tables nearly all changes.
HELD_LEAPS = 20
COARSE_STEPS = 1.5  # steps of a reading: a smaller change is one step, a larger one at least two (rounding)


class Held(NamedTuple):
    """A signal whose values are repeated.

    signal: its name
    from_s: time of the first value that is repeated [s]
    every_s: median time between two changes [s]
    """

    signal: str
    from_s: float
    every_s: float


def check_held(path: Path, pieces: Iterable[Table], late_s: Sequence[float]) -> Iterator[Table]:
    """Yield the pieces of a table. Raises RecordingError at the first piece that repeats the values of a signal.

    late_s: age beyond which a value is outdated, for each signal [s]
    """
    for piece in pieces:
        if repeating := held(piece, late_s):
            first, every = repeating[0], len(repeating) == len(piece.signals)
            names = "all signals" if every else ", ".join(held_signal.signal for held_signal in repeating)
            raise RecordingError(
                f"{path}: values are repeated from {first.from_s:.6g} s on ({names}): they change every "
                f"{first.every_s:.3g} s only, while rows are {np.median(np.diff(piece.t_s)):.3g} s apart: export the "
                "rows at which the sensors were read, or interpolate between them; do not repeat the last value"
            )
        yield piece


def held(table: Table, late_s: Sequence[float]) -> list[Held]:
    """Return the signals of a table whose values are repeated while the sensor's reading changes.

    A sensor that is read in each row and moves by several of its steps from one row to the next does not stand still
    before and after that. Where it does for longer than `late_s`, HELD_LEAPS times in a row, rows repeat a value.

    late_s: age beyond which a value is outdated, for each signal [s]
    """
    signals = [_held(name, table.t_s, table.values[:, k], late_s[k]) for k, name in enumerate(table.signals)]
    return [signal for signal in signals if signal is not None]


def _held(signal: str, t_s: Array, values: Array, late_s: float) -> Held | None:
    """Return where the values of a signal are repeated; None where they are not.

    t_s:    (T,) times of the rows [s]
    values: (T,) in the unit of the signal; NaN: unknown
    late_s: time [s] for which a value stands still on both sides of a change if rows repeat it
    """
    known = np.isfinite(values)
    t_s, values = t_s[known], values[known]
    sizes = np.abs(np.diff(values))
    changes = np.flatnonzero(sizes)  # row `changes[k]` is the last one of value k, whose first is changes[k - 1] + 1
    if len(changes) < HELD_LEAPS + 2:
        return None
    sizes = sizes[changes]
    repeated = t_s[changes[1:]] - t_s[changes[:-1] + 1] > late_s  # value k, for k = 1 ...
    both_repeated = repeated[:-1] & repeated[1:]  # change k, for k = 1 ... but the last
    leaps = np.cumsum(both_repeated & (sizes[1:-1] > COARSE_STEPS * np.min(sizes)))
    consecutive = leaps - np.maximum.accumulate(np.where(both_repeated, 0, leaps))
    enough = np.flatnonzero(consecutive >= HELD_LEAPS)
    if not len(enough):
        return None
    first = int(np.max(np.flatnonzero(consecutive[: enough[0]] == 0), initial=-1)) + 1
    every_s = np.median(np.diff(t_s[changes[first + 1 : enough[0] + 2]]))
    return Held(signal=signal, from_s=float(t_s[changes[first] + 1]), every_s=float(every_s))
