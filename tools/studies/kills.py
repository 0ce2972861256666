"""Is anything that was told ever lost, or booked twice? A shift is worked - buckets booked and made final, some
cancelled, trucks changed, tickets printed - by a process that is killed (SIGKILL) at random moments, again and again,
with one file of records.

The control is the same shift with a writer that is not atomic: of that something must be lost.

Told is a booking whose number the records have confirmed (object 2190h:10), and a ticket that was printed. Afterwards
each must be there once, and every total must be the sum of the bookings."""

import argparse
import json
import os
import random
import signal
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from rich.console import Console
from rich.table import Table

from cylforce.records.queries import bookings, totals
from cylforce.records.recorder import Recorder
from cylforce.records.schema import open_labels, open_reading
from cylforce.records.ticket import ticket
from cylforce.records.writing import BookedBucket, Change, Start
from cylforce.service.loading.cycle import LastBucket
from cylforce.service.loading.truck import add_bucket, correct_bucket, next_truck, set_accepted, set_product
from cylforce.service.memory import Memory
from cylforce.signals.estimate import Booking

from ._naive import naive_figures, naive_shift

START = Start(1_700_000_000_000_000, "study", "Excavator")
CYCLE = LastBucket(18.5, 6.2, 84_000.0)
BUCKETS, CANCELLED, PRODUCTS = 5, 0.2, 3  # buckets a truck, share cancelled, products
LONGEST_S = 0.06  # between start and kill: some fifty transactions
ENOUGH = 8  # bytes of a message: one letter, seven digits


Shift = Callable[[Path, int, random.Random], None]


class Kept(NamedTuple):
    """What was told: the highest booking that was confirmed, and the tickets' trucks; the last booking that a start
    knew when it `begun`."""

    booking: int
    tickets: frozenset[int]
    begun: int = 0


def work(path: Path, pipe: int, rng: random.Random) -> None:
    """One more start of the shift, until killed; writes into `pipe` what is certain."""
    recorder = Recorder(path, START)
    kept = recorder.kept
    _say(pipe, "b", recorder.recorded)
    while True:
        kept = _bucket(recorder, kept, rng)
        while recorder.recorded < (kept.booking.number if kept.booking else 0):
            time.sleep(0.0)
        _say(pipe, "b", recorder.recorded)
        if len(kept.truck.buckets) >= BUCKETS:
            kept = _next(recorder, kept, path, pipe, rng)


def _bucket(recorder: Recorder, kept: Memory, rng: random.Random) -> Memory:
    """A bucket is booked, weighed better while it returns, and in part of the cases cancelled."""
    number, mass = (kept.booking.number if kept.booking else 0) + 1, rng.uniform(300.0, 1500.0)
    first = Booking(number, START.t_us + number, mass + 12.0, 4.0, 12.0, 2.0, mass, 5.0)
    kept = replace(kept, truck=add_bucket(kept.truck, first, kept.scale.tare), booking=first)
    recorder.put(Change(first.t_us, kept, BookedBucket(first, CYCLE, 1.5, "OK"), ""))
    final = replace(first, dumped=mass + 3.0, carry_back=9.0)
    kept = replace(kept, truck=correct_bucket(kept.truck, number, 3.0), booking=final)
    recorder.put(Change(first.t_us + 1, kept, None, "", final))
    if rng.random() < CANCELLED:
        kept = replace(kept, truck=set_accepted(kept.truck, number, False).truck)
        recorder.put(Change(first.t_us + 2, kept, None, "cancelled"))
    return kept


def _next(recorder: Recorder, kept: Memory, path: Path, pipe: int, rng: random.Random) -> Memory:
    """The truck's ticket is printed, and the next truck comes, for another product."""
    number = kept.truck.number
    if any(bucket.accepted for bucket in kept.truck.buckets):
        with closing(open_labels(path)) as connection:
            ticket(connection, number, START.t_us)
        _say(pipe, "t", number)
    kept = replace(kept, truck=set_product(next_truck(kept.truck).truck, rng.randrange(PRODUCTS)).truck)
    recorder.put(Change(START.t_us, kept, None, "next truck"))
    return kept


def _say(pipe: int, what: str, number: int) -> None:
    os.write(pipe, f"{what}{number:0{ENOUGH - 1}d}".encode())


def naive_work(path: Path, pipe: int, rng: random.Random) -> None:
    """The same of the control."""
    naive_shift(path, pipe, rng, _say, BUCKETS, CANCELLED)


def killed(path: Path, seed: int, shift: Shift = work) -> Kept:
    """One start that is killed at a random moment; what it had told until then."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        try:
            shift(path, writing, random.Random(seed))
        finally:
            os._exit(1)
    os.close(writing)
    with os.fdopen(reading, "rb") as told:
        first = told.read(ENOUGH)
        time.sleep(random.Random(-seed - 1).uniform(0.0, LONGEST_S))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        text = (first + told.read()).decode()
    said = [(text[k], int(text[k + 1 : k + ENOUGH])) for k in range(0, len(text), ENOUGH)]
    trucks = frozenset(n for what, n in said if what == "t")
    return Kept(max((n for what, n in said if what == "b"), default=0), trucks, said[0][1])


def figures(path: Path, told: Kept) -> dict[str, int]:
    """What is in the records, and what is wrong with it."""
    with closing(open_reading(path)) as found:
        rows, tickets = bookings(found), found.execute("SELECT truck, printed FROM tickets").fetchall()
        numbers = [row["number"] for row in rows]
        sums: dict[int, tuple[int, float]] = {}
        for row in (row for row in rows if row["accepted"]):
            loads, mass = sums.get(row["product"], (0, 0.0))
            sums[row["product"]] = loads + 1, mass + row["mass"]
        known = {total.product: (total.loads, total.mass) for total in totals(found) if total.loads}
    wrong = [p for p in sums.keys() | known.keys() if not _alike(sums.get(p, (0, 0.0)), known.get(p, (0, 0.0)))]
    return {
        "bookings": len(rows),
        "told": told.booking,
        "lost": len(set(range(1, told.booking + 1)) - set(numbers)),
        "doubled": len(numbers) - len(set(numbers)),
        "tickets": len(tickets),
        "tickets_lost": len(told.tickets - {row["truck"] for row in tickets}),
        "totals_wrong": len(wrong),
    }


def _alike(a: tuple[int, float], b: tuple[int, float]) -> bool:
    return a[0] == b[0] and abs(a[1] - b[1]) < 1e-3  # kg: sums in another order differ by rounding


def trial(path: Path, kills: int, seed: int, shift: Shift = work) -> dict[str, int]:
    """So many kills of one shift, of the records' or of the naive writer; after how many of them the next start did not
    know the last booking that was told."""
    told, forgotten, before = Kept(0, frozenset()), 0, 0
    for k in range(kills):
        more = killed(path, seed + k, shift)
        forgotten, before = forgotten + (more.begun < before), more.booking
        told = Kept(max(told.booking, more.booking), told.tickets | more.tickets)
    found = figures(path, told) if shift is work else naive_figures(path, (told.booking, told.tickets))
    return {"kills": kills, "starts_forgetful": forgotten, **found}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with TemporaryDirectory() as folder:
        found = trial(Path(folder) / "records.db", options.kills, options.seed)
        control = trial(Path(folder) / "naive.json", options.kills, options.seed, naive_work)
    shown = Table(title="a shift that is killed again and again")
    for name in ("writer", *found):
        shown.add_column(name.replace("_", " "), justify="left" if name == "writer" else "right")
    shown.add_row("records", *map(str, found.values()))
    shown.add_row("naive", *map(str, control.values()))
    Console(width=120, highlight=False).print(shown)
    if options.json:
        options.json.write_text(json.dumps({**found, "control": control}, indent=1) + "\n")


if __name__ == "__main__":
    main()
