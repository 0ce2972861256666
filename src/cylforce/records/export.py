"""Export the records for other programs: CSV, JSON, Parquet, and the two figures of ISO 15143-3 telematics."""

import csv
import json
import sqlite3
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cylforce.files.atomic import RecordingError, replacing
from cylforce.records.queries import bookings, cumulated

# Column of an export: column of the records. Names contain the unit.
COLUMNS = {
    "start": "start",
    "booking": "number",
    "time": "t_us",
    "truck": "truck",
    "part": "part",
    "product": "product",
    "product_name": "product_name",
    "mass_kg": "mass",
    "standard_error_kg": "standard_error",
    "gross_kg": "gross",
    "carry_back_kg": "carry_back",
    "cycle_s": "cycle",
    "contact_s": "contact",
    "peak_force_n": "peak",
    "zero_kg": "zero",
    "tare_kg": "tare",
    "attachment": "attachment",
    "drift_kg": "drift",
    "status": "status",
    "accepted": "accepted",
    "final": "final",
    "customer": "customer",
    "job": "job",
    "operator": "operator",
    "note": "note",
}
SUFFIXES = (".csv", ".json", ".parquet")


def iso(t_us: int) -> str:
    """Return a time [us] in UTC as text, to the millisecond."""
    return datetime.fromtimestamp(1e-6 * t_us, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def row_of(booking: sqlite3.Row) -> dict[str, Any]:
    """Return a booking with the names of the export's columns, its time as text in UTC.

    booking: row of `queries.bookings`
    """
    row = {name: booking[column] for name, column in COLUMNS.items()}
    return row | {"time": iso(booking["t_us"]), "accepted": bool(booking["accepted"]), "final": bool(booking["final"])}


def export(connection: sqlite3.Connection, path: Path, since_us: int = 0) -> int:
    """Write the bookings, cancelled ones too, into a file of the format that its ending names; return their number.

    Raises RecordingError.

    since_us: from this time on [us]
    """
    if path.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{path}: has no ending of a format: name it {', '.join('*' + s for s in SUFFIXES)}")
    rows = [row_of(booking) for booking in bookings(connection, since_us)]
    with replacing(path) as temporary:
        {".csv": _csv, ".json": _json, ".parquet": _parquet}[path.suffix.lower()](rows, temporary)
    return len(rows)


def _csv(rows: list[dict[str, Any]], path: Path) -> None:
    """Write rows as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)


def _json(rows: list[dict[str, Any]], path: Path) -> None:
    """Write rows as JSON."""
    path.write_text(json.dumps(rows, indent=1, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")


def _parquet(rows: list[dict[str, Any]], path: Path) -> None:
    """Write rows as Parquet. Raises RecordingError without pyarrow."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise RecordingError(f"{path}: Parquet needs pyarrow: pip install 'cylforce[tables]'") from error
    columns = {name: [row[name] for row in rows] for name in COLUMNS}
    pq.write_table(pa.table(columns), path)


def telematics(connection: sqlite3.Connection) -> dict[str, Any]:
    """Return `CumulativePayloadTotals` and `CumulativeLoadCount` of ISO 15143-3, each with the time of the last
    booking: mass [kg] and number of all loads ever, without cancelled ones.
    """
    mass, loads, t_us = cumulated(connection)
    when = None if t_us is None else iso(t_us)
    return {
        "CumulativePayloadTotals": {"datetime": when, "PayloadUnits": "kilogram", "Payload": round(mass, 1)},
        "CumulativeLoadCount": {"datetime": when, "Count": loads},
    }
