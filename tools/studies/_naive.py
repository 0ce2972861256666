"""A writer as one writes it first, as a control of `kills`: all bookings in one JSON file, which is opened for writing
and written anew at each change. Killed meanwhile it leaves half a file, and the next start begins with none."""

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

Say = Callable[[int, str, int], None]


class NaiveBook:
    """The bookings in a file; each row is number, mass [kg], whether it counts, truck."""

    def __init__(self, path: Path) -> None:
        self._path = path
        try:
            self.kept: dict[str, Any] = json.loads(path.read_text())
        except (OSError, ValueError):
            self.kept = {"rows": [], "tickets": [], "total": 0.0}

    def save(self) -> None:
        """Write all of it, in place."""
        with self._path.open("w") as file:
            json.dump(self.kept, file)

    def book(self, mass: float, truck: int) -> int:
        """One more bucket; its number."""
        rows = self.kept["rows"]
        rows.append([rows[-1][0] + 1 if rows else 1, mass, True, truck])
        self.kept["total"] += mass
        self.save()
        return int(rows[-1][0])

    def cancel(self) -> None:
        """The last bucket does not count."""
        row = self.kept["rows"][-1]
        row[2] = False
        self.kept["total"] -= row[1]
        self.save()

    def ticket(self, truck: int) -> None:
        """A truck's ticket is printed."""
        self.kept["tickets"].append(truck)
        self.save()


def naive_shift(path: Path, pipe: int, rng: random.Random, say: Say, buckets: int, cancelled: float) -> None:
    """One more start of the shift, until killed; says into `pipe` what is certain."""
    book = NaiveBook(path)
    rows = book.kept["rows"]
    truck = rows[-1][3] if rows else 1
    say(pipe, "b", rows[-1][0] if rows else 0)
    while True:
        for _ in range(buckets):
            number = book.book(rng.uniform(300.0, 1500.0), truck)
            say(pipe, "b", number)
            if rng.random() < cancelled:
                book.cancel()
        book.ticket(truck)
        say(pipe, "t", truck)
        truck += 1


def naive_figures(path: Path, told: tuple[int, frozenset[int]]) -> dict[str, int]:
    """What is in the file, and what is wrong with it; `told`: number of the last booking that was certain, trucks whose
    ticket was."""
    kept = NaiveBook(path).kept
    numbers, total = [row[0] for row in kept["rows"]], sum(row[1] for row in kept["rows"] if row[2])
    return {
        "bookings": len(numbers),
        "told": told[0],
        "lost": len(set(range(1, told[0] + 1)) - set(numbers)),
        "doubled": len(numbers) - len(set(numbers)),
        "tickets": len(kept["tickets"]),
        "tickets_lost": len(told[1] - set(kept["tickets"])),
        "totals_wrong": int(abs(total - kept["total"]) > 1e-3),
    }
