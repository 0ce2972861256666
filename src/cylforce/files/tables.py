"""Tables of samples, CSV or Parquet: a time column and one per signal, in SI units or by a mapping."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.files.atomic import RecordingError, replacing
from cylforce.files.cells import Cells, pyarrow, read_csv, read_parquet
from cylforce.signals.estimate import Array

SUFFIXES = (".csv", ".parquet")
TIME = "t_s"  # name of the time column
LONGEST_LEAP_S = 3600.0  # s between two rows: a longer one is a clock that was set, or two recordings; chosen
LONGEST_SPAN_S = 100_000.0  # s of a table: a day of recording and more; each second of it takes memory; chosen
GAP_PERIODS = 5  # periods; values within a longer gap are unknown and become NaN; chosen


class ColumnMap(NamedTuple):
    """The column of a table that contains a signal: SI value = cell * scale + offset.

    signal: name of the signal
    column: name of the column
    scale: factor of the conversion to SI
    offset: offset of the conversion to SI
    """

    signal: str
    column: str
    scale: float
    offset: float


class TableMap(NamedTuple):
    """Columns and units of another program's table; signals without an entry are columns of their own name.

    time_column: name of the time column
    time_scale_s: seconds = cell * time_scale_s
    columns: columns of the signals
    """

    time_column: str
    time_scale_s: float
    columns: tuple[ColumnMap, ...]


class Table(NamedTuple):
    """Samples of S signals.

    t_s: (T,) increasing time [s]
    values: (T, S) values [SI]; NaN: unknown
    signals: (S,) names
    """

    t_s: Array
    values: Array
    signals: tuple[str, ...]


def read_table(path: Path, signals: Sequence[str], mapping: TableMap | None = None) -> Table:
    """Read the named signals of a table; other columns are ignored.

    An empty cell, a null or the word nan is an unknown value (NaN). A CSV has one header line; commas, semicolons or
    tabs separate its cells; decimals are marked by a point. Raises RecordingError when a column is missing or
    ambiguous, a cell is no number or infinite, time does not increase, or there are fewer than two rows; it names the
    file and the line (of a CSV) or row (of Parquet, from 1).

    mapping: columns and units of another program's table
    """
    return joined(list(table_pieces(path, signals, mapping)))


def joined(pieces: Sequence[Table]) -> Table:
    """Return one table from its pieces."""
    return Table(
        t_s=np.concatenate([piece.t_s for piece in pieces]),
        values=np.concatenate([piece.values for piece in pieces]),
        signals=pieces[0].signals,
    )


def table_pieces(
    path: Path, signals: Sequence[str], mapping: TableMap | None = None, *, as_recording: bool = False
) -> Iterator[Table]:
    """Read a table as `read_table`, and yield it piece by piece.

    as_recording: the table will be resampled, so that a time which leaps by more than LONGEST_LEAP_S or spans more than
        LONGEST_SPAN_S is refused: its gaps would fill the memory
    """
    wanted = _columns(signals, mapping)
    names = [mapping.time_column if mapping else TIME, *(c.column for c in wanted)]
    scale = np.array([mapping.time_scale_s if mapping else 1.0, *(c.scale for c in wanted)])
    offset = np.array([0.0, *(c.offset for c in wanted)])
    count, last, first = 0, -np.inf, np.nan
    for cells in read_parquet(path, names) if path.suffix.lower() == ".parquet" else read_csv(path, names):
        if len(cells.at):
            _check(path, cells, names, last)
            si = cells.numbers * scale + offset
            first = si[0, 0] if np.isnan(first) else first
            if as_recording:
                _check_span(path, cells, si[:, 0], (first, last * scale[0]))
            count, last = count + len(cells.at), cells.numbers[-1, 0]
            yield Table(np.ascontiguousarray(si[:, 0]), np.ascontiguousarray(si[:, 1:]), tuple(signals))
    if count < 2:
        raise RecordingError(f"{path}: holds {count} rows, at least two are needed")


def _columns(signals: Sequence[str], mapping: TableMap | None) -> list[ColumnMap]:
    """Return the column of each signal: that of the mapping, else the column of its own name, in SI units."""
    named = {column.signal: column for column in mapping.columns} if mapping else {}
    return [named.get(signal, ColumnMap(signal, signal, 1.0, 0.0)) for signal in signals]


def _check(path: Path, cells: Cells, names: list[str], last: float) -> None:
    """Raise RecordingError for an infinite value in a piece, or a time that does not increase.

    names: names of the columns, of which the first is the time
    last: time of the row before the piece, in the unit of the file; -inf: none
    """
    infinite = np.argwhere(np.isinf(cells.numbers))
    if len(infinite):
        row, column = infinite[0]
        raise RecordingError(f"{path}, {cells.place} {cells.at[row]}: column {names[column]!r} is infinite")
    t = cells.numbers[:, 0]
    bad = np.flatnonzero(np.isnan(t) | ~(np.diff(t, prepend=last) > 0.0))
    if len(bad):
        why = "is empty or not a number: delete the row" if np.isnan(t[bad[0]]) else "does not increase: sort the rows"
        raise RecordingError(f"{path}, {cells.place} {cells.at[bad[0]]}: time (column {names[0]!r}) {why}")


def _check_span(path: Path, cells: Cells, t_s: Array, before: tuple[float, float]) -> None:
    """Raise RecordingError for a time that is too far from the one before it, or from the first.

    t_s: (T,) times of the piece [s]
    before: the table's first time, and the last before this piece [s]; -inf: none
    """
    first, last = before
    leaps = np.diff(t_s, prepend=last if np.isfinite(last) else first)
    bad = np.flatnonzero((leaps > LONGEST_LEAP_S) | (t_s - first > LONGEST_SPAN_S))
    if not len(bad):
        return
    k, where = bad[0], f"{path}, {cells.place} {cells.at[bad[0]]}"
    if leaps[k] > LONGEST_LEAP_S:
        raise RecordingError(
            f"{where}: time leaps by {leaps[k]:.6g} s, more than {LONGEST_LEAP_S:g} s: a wrong stamp, or two "
            "recordings: correct it, or split the file there"
        )
    raise RecordingError(
        f"{where}: {t_s[k] - first:.6g} s after the first row, more than {LONGEST_SPAN_S:g} s: split the file"
    )


class SlowTableError(RecordingError):
    """A table has too few rows a second."""


def resample(table: Table, rate_hz: float) -> Table:
    """Return the table at a fixed rate from its first row on, linear between rows, never beyond the last.

    Values within a gap of more than GAP_PERIODS periods are NaN, and so are values beside a NaN. Raises SlowTableError
    when the table's own rate is so low that all of it would be such a gap.

    rate_hz: samples a second; a period is 1 / rate_hz
    """
    return joined(list(resampled([table], rate_hz)))


def resampled(pieces: Iterable[Table], rate_hz: float) -> Iterator[Table]:
    """Resample a table in pieces as `resample`; its own rate is that of its first piece.

    pieces: consecutive parts of one table
    rate_hz: samples a second
    """
    recent: Table | None = None
    start, done = 0.0, 0
    for piece in pieces:
        if recent is None:
            _check_rate(piece, rate_hz)
            recent, start = piece, float(piece.t_s[0])
        else:
            recent = joined([recent._replace(t_s=recent.t_s[-1:], values=recent.values[-1:]), piece])
        count = int((recent.t_s[-1] - start) * rate_hz) + 1
        yield _at(recent, start + np.arange(done, count) / rate_hz, rate_hz)
        done = max(done, count)
    if recent is not None:
        count = int((recent.t_s[-1] - start) * rate_hz + 1e-6) + 1
        yield _at(recent, start + np.arange(done, count) / rate_hz, rate_hz)


def _check_rate(table: Table, rate_hz: float) -> None:
    """Raise SlowTableError for too few rows a second to resample a table at a rate [Hz]."""
    steps = np.diff(table.t_s)
    if len(steps) and np.median(steps) > _widest(rate_hz):
        raise SlowTableError(
            f"the table has {1.0 / float(np.median(steps)):.3g} rows a second, too few for {rate_hz:g} Hz: record "
            f"{rate_hz / GAP_PERIODS:g} at least; if its time is in ms, the machine file says so: [table], scale_ms = 1"
        )


def _widest(rate_hz: float) -> float:
    """Return the widest gap that is interpolated [s], with a tolerance for rounding."""
    return GAP_PERIODS * (1.0 + 1e-9) / rate_hz


def _at(table: Table, t_s: Array, rate_hz: float) -> Table:
    """Return the table at times (K,) [s] within it: linear between its rows, NaN within gaps.

    rate_hz: rate of the times [Hz], on whose period the width of a gap depends (`_widest`)
    """
    values = np.stack([np.interp(t_s, table.t_s, column) for column in table.values.T], axis=-1)
    if len(table.t_s) > 1:
        steps = np.diff(table.t_s)
        before = np.clip(np.searchsorted(table.t_s, t_s, side="right") - 1, 0, len(steps) - 1)
        inside = (t_s > table.t_s[before]) & (t_s < table.t_s[before + 1])
        values[inside & (steps[before] > _widest(rate_hz))] = np.nan
    return Table(t_s, values, table.signals)


def write_table(path: Path, table: Table) -> None:
    """Write a CSV or, by its suffix, a Parquet file that `read_table` reads back exactly.

    Raises RecordingError when the disk refuses, or pyarrow is missing.
    """
    columns = np.column_stack([table.t_s, table.values])
    names = [TIME, *table.signals]
    if path.suffix.lower() == ".parquet":
        arrow = pyarrow(path)
        with replacing(path) as temporary:
            arrow.parquet.write_table(arrow.table(list(columns.T), names=names), temporary)
        return
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(names)
        file.writelines(_text_rows(columns))


def _text_rows(columns: Array) -> Iterator[str]:
    """Yield the rows as text that gives the same numbers again."""
    for row in columns:
        yield ",".join(map(repr, row.tolist())) + "\n"
