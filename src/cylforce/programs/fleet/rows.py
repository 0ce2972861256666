"""The results as a table: one row for each recording, readable while the work goes on."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cylforce.files.atomic import replacing
from cylforce.fleet.coordinates import Coordinate
from cylforce.fleet.courses import Course

FIRST = ("machine", "recording", "made", "type", "state", "reason", "warnings", "change", "change_probability")
PLACES = ("address", "sha256")
Rows = Sequence[Mapping[str, Any]]


def write_rows(path: Path, rows: Rows) -> None:
    """Write the table whole or not at all; readers see the old one or the new one."""
    import pyarrow as pa
    from pyarrow import parquet

    names = list(dict.fromkeys((*FIRST, *(name for row in rows for name in row))))
    columns = {name: [row.get(name) for row in rows] for name in names}
    made = {name: _column(pa, values) for name, values in columns.items()}
    with replacing(path) as temporary:
        parquet.write_table(pa.table(made), temporary)


def _column(pa: Any, values: list[Any]) -> Any:  # noqa: ANN401 - pyarrow has no types
    kinds = set(map(type, values)) - {type(None)}
    if kinds <= {float, int} and kinds:
        numbers = np.array(values, dtype=np.float64)  # None becomes NaN
        return pa.array(numbers, mask=np.logical_not(np.isfinite(numbers)))
    if list in kinds:
        texts = any(isinstance(x, str) for v in values if v for x in v)
        return pa.array(values, pa.list_(pa.string() if texts else pa.float64()))
    return pa.array(values, pa.string())


def course_rows(quantities: Sequence[Coordinate], course: Course) -> list[dict[str, Any]]:
    """Return the course of the quantities as a row for each recording.

    `own:` is the value from this recording alone, `value:` with the machine's earlier ones as prior, `expected:` from
    the earlier ones alone. The first two have standard errors.
    """
    ways = ("value", "error", "own", "own_error", "expected")
    names = ["gap_past", "gap_type", *(f"{way}:{c.name}" for c in quantities for way in ways)]
    values = np.stack([getattr(course, way) for way in ways], axis=-1).reshape(len(course.own), -1)
    table = np.column_stack([course.from_past, course.from_type, values])
    return [dict(zip(names, line, strict=True)) for line in table.tolist()]
