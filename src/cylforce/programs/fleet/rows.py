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
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {float, int} and kinds:
        return pa.array([None if v is None or not np.isfinite(v) else float(v) for v in values], pa.float64())
    if list in kinds:
        texts = any(isinstance(x, str) for v in values if v for x in v)
        return pa.array(values, pa.list_(pa.string() if texts else pa.float64()))
    return pa.array(values, pa.string())


def course_columns(quantities: Sequence[Coordinate], course: Course, k: int) -> dict[str, Any]:
    """What the course says of recording k: of each quantity its value by this recording (`own:`), with the machine's
    earlier ones as prior (`value:`), each with its standard error, and what the earlier ones alone let expect."""
    found: dict[str, Any] = {"gap_past": float(course.from_past[k]), "gap_type": float(course.from_type[k])}
    for i, c in enumerate(quantities):
        found[f"value:{c.name}"] = float(course.value[k, i])
        found[f"error:{c.name}"] = float(course.error[k, i])
        found[f"own:{c.name}"] = float(course.own[k, i])
        found[f"own_error:{c.name}"] = float(course.own_error[k, i])
        found[f"expected:{c.name}"] = float(course.expected[k, i])
    return found
