"""The numbers in the cells of CSV and Parquet files, each with its line or row."""

import csv
from array import array
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, TextIO

import numpy as np
from numpy.typing import NDArray

from cylforce.files.atomic import RecordingError, lines_of
from cylforce.signals.estimate import Array

ROWS = 1 << 15  # rows in memory at once; chosen
READ_BYTES = 1 << 16  # bytes of each column that are read at once; chosen


class Cells(NamedTuple):
    """Numbers as in the file, with their places.

    numbers: (T, columns) values of the cells; NaN: empty
    place: word for a place in the file: "line" (of a CSV) or "row" (of Parquet)
    at: (T,) number of each row's line or row, from 1
    """

    numbers: Array
    place: str
    at: NDArray[np.int64]


def _positions(path: Path, present: Sequence[str], wanted: Sequence[str]) -> list[int]:
    """Return the positions, from 0, of the wanted columns among those present.

    Raises RecordingError where one is missing or there are several of its name.
    """
    missing = [name for name in dict.fromkeys(wanted) if name not in present]
    if missing:
        all_present = ", ".join(present) or "none at all"
        raise RecordingError(f"{path}: has no column {', '.join(missing)}; it has {all_present}")
    twice = [name for name in wanted if present.count(name) > 1]
    if twice:
        raise RecordingError(f"{path}: has several columns named {twice[0]}; give each a name of its own")
    return [present.index(name) for name in wanted]


def read_csv(path: Path, names: list[str]) -> Iterator[Cells]:
    """Yield the named columns of a CSV file, in the order of `names`, in pieces of ROWS rows.

    An empty cell is NaN. The last piece may be empty. Raises RecordingError where the file is not such a table.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            yield from _parse_csv(path, file, names)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: is not UTF-8 text ({error.reason}); save it as UTF-8") from error


def _parse_csv(path: Path, file: TextIO, names: list[str]) -> Iterator[Cells]:
    """Yield the named columns of an open CSV file, see `read_csv`.

    The delimiter is the first of comma, semicolon and tab that the header contains. Blank lines are skipped.
    """
    lines_read = lines_of(path, file)
    head = next(lines_read, "")
    delimiter = next((mark for mark in ",;\t" if mark in head), ",")
    header = [row for number, row in _csv_rows(path, iter([head]), delimiter, 0)]
    present = [name.strip() for name in (header[0] if header else [])]
    positions = _positions(path, present, names)
    numbers, lines = array("d"), array("q")
    for line, row in _csv_rows(path, lines_read, delimiter, 1):
        if len(row) == len(present):
            numbers.extend(_numbers(path, line, row, positions, names))
            lines.append(line)
        elif row:
            raise RecordingError(f"{path}, line {line}: has {len(row)} cells, the header has {len(present)}")
        if len(lines) == ROWS:
            yield Cells(np.array(numbers).reshape(-1, len(names)), "line", np.array(lines))
            numbers, lines = array("d"), array("q")
    yield Cells(np.array(numbers).reshape(-1, len(names)), "line", np.array(lines))


def _csv_rows(path: Path, lines: Iterator[str], delimiter: str, before: int) -> Iterator[tuple[int, list[str]]]:
    """Yield every row with the number of its (last) line; `before`: number of lines before the first one.

    Raises RecordingError where the text is not CSV.
    """
    reader = csv.reader(lines, delimiter=delimiter, skipinitialspace=True)
    try:
        for row in reader:
            yield reader.line_num + before, row
    except csv.Error as error:
        raise RecordingError(f"{path}, line {reader.line_num + before}: is not CSV: {error}") from error


def _numbers(path: Path, line: int, row: list[str], positions: list[int], names: list[str]) -> list[float]:
    """Return the numbers of the wanted columns of a row; NaN for an empty cell. Raises RecordingError.

    line: number of the row's line
    positions: places of these columns in the row
    names: names of these columns
    """
    try:
        return [float(row[k]) for k in positions]
    except ValueError:
        return [_number(path, line, row[k], name) for k, name in zip(positions, names, strict=True)]


def _number(path: Path, line: int, cell: str, name: str) -> float:
    """Return the number in a cell, NaN for an empty one. Raises RecordingError.

    line: number of the cell's line
    name: name of its column
    """
    try:
        return float(cell.strip() or "nan")
    except ValueError as error:
        raise RecordingError(f"{path}, line {line}: column {name!r} holds {cell[:40]!r}, no number") from error


def pyarrow(path: Path) -> ModuleType:
    """Return the library that reads Parquet. Raises RecordingError where the extra `tables` is not installed."""
    try:
        import_module("pyarrow.parquet")
        return import_module("pyarrow")
    except ImportError as error:
        raise RecordingError(f"{path}: Parquet needs pyarrow: pip install 'cylforce[tables]'") from error


def read_parquet(path: Path, names: list[str]) -> Iterator[Cells]:
    """Yield the named columns of a Parquet file, in the order of `names`, in pieces of ROWS rows at most.

    A null is NaN. Raises RecordingError where the file is not such a table, a column does not hold numbers, or pyarrow
    is missing.
    """
    arrow, first = pyarrow(path), 1
    try:
        # without read-ahead, which would load the whole file
        with (
            path.open("rb") as raw,
            arrow.parquet.ParquetFile(raw, pre_buffer=False, buffer_size=READ_BYTES) as file,
        ):
            schema = file.schema_arrow
            _positions(path, schema.names, names)
            _check_kinds(path, arrow, dict(zip(schema.names, schema.types, strict=True)), names)
            for part in file.iter_batches(ROWS, columns=list(dict.fromkeys(names))):
                columns = [part[name].cast(arrow.float64(), safe=False) for name in names]
                # filling nulls loads a library, which takes a quarter of a second: only where there are any
                columns = [column.fill_null(np.nan) if column.null_count else column for column in columns]
                rows = np.arange(first, first := first + part.num_rows)
                yield Cells(np.stack([np.from_dlpack(column) for column in columns], axis=-1), "row", rows)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {error.strerror or error}") from error
    except arrow.ArrowException as error:
        raise RecordingError(
            f"{path}: is no Parquet file: {str(error).splitlines()[0]}; save the table anew"
        ) from error


def _check_kinds(path: Path, arrow: ModuleType, kinds: dict[str, object], names: list[str]) -> None:
    """Raise RecordingError for a column that does not hold numbers.

    arrow: the library pyarrow
    kinds: Arrow type of each column of the file, by name
    names: columns to check
    """
    for name in names:
        if not (arrow.types.is_floating(kinds[name]) or arrow.types.is_integer(kinds[name])):
            raise RecordingError(f"{path}: column {name!r} holds {kinds[name]}, not numbers")
