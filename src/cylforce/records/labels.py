"""Write labels and resets by people: names of products, labels of trucks, a total set to zero."""

import sqlite3

from cylforce.files.atomic import RecordingError
from cylforce.records.queries import SHIFT, SHORT, truck

LABELS = ("customer", "job", "operator", "note")
LONGEST = 200  # characters of a label; chosen


def label_truck(connection: sqlite3.Connection, number: int, labels: dict[str, str]) -> None:
    """Write labels of a truck. Raises RecordingError for an unknown truck, label or too long a text.

    number: number of the truck
    labels: text of each label, by its name (LABELS)
    """
    if truck(connection, number) is None:
        raise RecordingError(f"truck {number}: is not in the records: `cylforce records list` names those that are")
    for name, text in labels.items():
        if name not in LABELS:
            raise RecordingError(f"{name}: is no label of a truck: use {', '.join(LABELS)}")
        connection.execute(f"UPDATE trucks SET {name} = ? WHERE number = ?", (_short(name, text), number))  # noqa: S608


def name_product(connection: sqlite3.Connection, number: int, name: str) -> None:
    """Give a product's number a name. Raises RecordingError when it is too long."""
    values = (number, _short("product", name))
    connection.execute("INSERT INTO products VALUES (?, ?) ON CONFLICT DO UPDATE SET name = excluded.name", values)


def set_to_zero(connection: sqlite3.Connection, which: str, t_us: int) -> None:
    """Begin the short or shift total anew; the bookings stay. Raises RecordingError for any other total.

    which: SHORT or SHIFT
    t_us: present time [us]
    """
    if which not in (SHORT, SHIFT):
        raise RecordingError(f"{which}: cannot be set to zero: use {SHORT} or {SHIFT}")
    values = (which, t_us)
    connection.execute(
        "INSERT OR REPLACE INTO marks VALUES (?, (SELECT coalesce(max(id), 0) FROM bookings), ?)", values
    )


def _short(name: str, text: str) -> str:
    """Return a text as it is. Raises RecordingError if it has more than LONGEST characters.

    name: name of the label, for the error
    """
    if len(text) > LONGEST:
        raise RecordingError(f"{name}: has {len(text)} characters: write at most {LONGEST}")
    return text
