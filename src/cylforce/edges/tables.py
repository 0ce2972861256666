"""Tables of samples, CSV or Parquet: a time column and one per signal, in SI units or by a mapping."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.edges.cells import Cells, pyarrow, read_csv, read_parquet
from cylforce.edges.files import RecordingError, replacing
from cylforce.words.estimate import Array

SUFFIXES = (".csv", ".parquet")
TIME = "t_s"
GAP_PERIODS = 5  # what lies in a longer gap is not known, and becomes NaN


class ColumnMap(NamedTuple):
    """Where a signal stands in a foreign table: SI value = cell * scale + offset."""

    signal: str
    column: str
    scale: float
    offset: float


class TableMap(NamedTuple):
    """How a foreign table is read: seconds = cell * time_scale_s; other signals are columns of their name."""

    time_column: str
    time_scale_s: float
    columns: tuple[ColumnMap, ...]


class Table(NamedTuple):
    """Samples: `t_s` (T,) [s] increasing, `values` (T, S) in SI units or NaN, names of the S signals."""

    t_s: Array
    values: Array
    signals: tuple[str, ...]


def read_table(path: Path, signals: Sequence[str], mapping: TableMap | None = None) -> Table:
    """The named signals of a table; columns of other names are not looked at.

    An empty cell, a null or the word nan is an unknown value (NaN). A CSV has one header line; commas,
    semicolons or tabs stand between its cells; decimals are marked by a point.

    Raises
    ------
    RecordingError
        When a column is missing or ambiguous, a cell is no number or infinite, time does not increase, or
        there are fewer than two rows; names the file and the line (of a CSV) or row (of Parquet, from 1).
    """
    wanted = _columns(signals, mapping)
    names = [mapping.time_column if mapping else TIME, *(c.column for c in wanted)]
    cells = read_parquet(path, names) if path.suffix.lower() == ".parquet" else read_csv(path, names)
    _check(path, cells, names)
    scale = np.array([mapping.time_scale_s if mapping else 1.0, *(c.scale for c in wanted)])
    si = cells.numbers * scale + np.array([0.0, *(c.offset for c in wanted)])
    return Table(np.ascontiguousarray(si[:, 0]), np.ascontiguousarray(si[:, 1:]), tuple(signals))


def _columns(signals: Sequence[str], mapping: TableMap | None) -> list[ColumnMap]:
    named = {column.signal: column for column in mapping.columns} if mapping else {}
    return [named.get(signal, ColumnMap(signal, signal, 1.0, 0.0)) for signal in signals]


def _check(path: Path, cells: Cells, names: list[str]) -> None:
    if len(cells.at) < 2:
        raise RecordingError(f"{path}: holds {len(cells.at)} rows, at least two are needed")
    infinite = np.argwhere(np.isinf(cells.numbers))
    if len(infinite):
        row, column = infinite[0]
        raise RecordingError(f"{path}, {cells.place} {cells.at[row]}: column {names[column]!r} is infinite")
    t = cells.numbers[:, 0]
    bad = np.flatnonzero(np.isnan(t) | np.concatenate([[False], ~(np.diff(t) > 0.0)]))
    if len(bad):
        why = "is empty or not a number" if np.isnan(t[bad[0]]) else "does not increase"
        raise RecordingError(f"{path}, {cells.place} {cells.at[bad[0]]}: time (column {names[0]!r}) {why}")


def resample(table: Table, rate_hz: float) -> Table:
    """The table at a fixed rate from its first row on, linear between rows, never beyond the last.

    What lies within a gap of more than five periods is NaN, as is what lies beside a NaN.

    Raises
    ------
    RecordingError
        When the table's own rate is so low that all of it would be such a gap.
    """
    steps = np.diff(table.t_s)
    widest = GAP_PERIODS * (1.0 + 1e-9) / rate_hz
    if np.median(steps) > widest:
        raise RecordingError(
            f"the table has {1.0 / float(np.median(steps)):.3g} rows a second, too few for {rate_hz:g} Hz"
        )
    count = int(np.floor((table.t_s[-1] - table.t_s[0]) * rate_hz + 1e-6)) + 1
    t_s = table.t_s[0] + np.arange(count) / rate_hz
    values = np.stack([np.interp(t_s, table.t_s, column) for column in table.values.T], axis=-1)
    before = np.clip(np.searchsorted(table.t_s, t_s, side="right") - 1, 0, len(steps) - 1)
    inside = (t_s > table.t_s[before]) & (t_s < table.t_s[before + 1])
    values[inside & (steps[before] > widest)] = np.nan
    return Table(t_s, values, table.signals)


def write_table(path: Path, table: Table) -> None:
    """Write a CSV or, by its suffix, a Parquet file that `read_table` reads back exactly.

    Raises
    ------
    RecordingError
        When the disk refuses, or pyarrow is missing.
    """
    columns = np.column_stack([table.t_s, table.values])
    names = [TIME, *table.signals]
    if path.suffix.lower() == ".parquet":
        arrow = pyarrow(path)
        with replacing(path) as temporary:
            arrow.parquet.write_table(arrow.table(list(columns.T), names=names), temporary)
        return
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerow(names)
        file.writelines(_text_rows(columns))


def _text_rows(columns: Array) -> Iterator[str]:
    for row in columns:
        yield ",".join(map(repr, row.tolist())) + "\n"
