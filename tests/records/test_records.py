"""The records: nothing is lost, nothing doubled, whatever happens to the program, the disk or the file."""

import csv
import json
import resource
import sqlite3
import struct
from contextlib import closing, contextmanager
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest

from cylforce.display.tickets import ticket_page
from cylforce.files.atomic import RecordingError
from cylforce.programs.common.readings import model_of
from cylforce.programs.live.books import Ledger
from cylforce.programs.records import ticket_text
from cylforce.records.export import export, telematics
from cylforce.records.labels import label_truck, name_product, set_to_zero
from cylforce.records.queries import bookings, totals
from cylforce.records.recorder import Recorder
from cylforce.records.schema import MIGRATIONS, VERSION, open_labels, open_reading, open_writing
from cylforce.records.ticket import ticket
from cylforce.records.writing import Change
from cylforce.service import commands
from cylforce.service.booking import Weighed
from cylforce.service.commands import Scale
from cylforce.service.core import Core
from cylforce.service.loading.truck import (
    Truck,
    correct_bucket,
    next_part,
    next_truck,
    set_accepted,
    set_product,
)
from cylforce.service.memory import Memory
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Booking
from cylforce.signals.events import Frame
from cylforce.signals.units import MASS_UNITS
from scenarios import EXCAVATOR, fed
from shifts import START, booked, shift
from studies import kills


@pytest.fixture
def path(tmp_path):
    return tmp_path / "records.db"


def test_what_was_kept_comes_back(path):
    kept = Memory(Scale(3.0, 40.0), Truck(7, 12_000.0, 2))
    end = shift(path, 3, kept)
    recorder = Recorder(path, START)
    recorder.close()
    found = recorder.kept
    assert found.scale == end.scale
    assert (found.truck, found.booking.number) == (end.truck, 3)
    assert found.truck.total == pytest.approx(300.0 + 3.0 - 3 * 40.0)


def test_every_column_of_a_booking(path):
    shift(path, 1, Memory(Scale(2.0, 10.0), Truck(1, 0.0, 4)))
    with closing(open_reading(path)) as found:
        [row] = bookings(found)
    wanted = {"number": 1, "mass": 90.0, "gross": 112.0, "standard_error": 5.0, "carry_back": 10.0, "cycle": 18.5}
    wanted |= {"contact": 6.2, "peak": 84_000.0, "zero": 2.0, "tare": 10.0, "attachment": "standard", "drift": 1.5}
    wanted |= {"status": "OK", "accepted": 1, "product": 4, "truck": 1}
    assert {name: row[name] for name in wanted} == wanted


def test_cancelled_bookings_stay_and_do_not_count(path):
    kept = shift(path, 3)
    recorder = Recorder(path, START)
    truck = set_accepted(kept.truck, 2, False).truck
    recorder.put(Change(1, replace(kept, truck=truck), None, "cancelled 2"))
    recorder.close()
    with closing(open_reading(path)) as found:
        assert [row["accepted"] for row in bookings(found)] == [1, 0, 1]
        [total] = totals(found)
        assert (total.loads, total.mass) == (2, 202.0)
        words = found.execute("SELECT words FROM changes").fetchall()
    assert [tuple(row) for row in words] == [("cancelled 2",)]


def test_a_booking_written_twice_counts_once(path):
    recorder = Recorder(path, START)
    change = booked(Memory(), 500.0)
    recorder.put(change)
    recorder.put(change)
    recorder.close()
    with closing(open_reading(path)) as found:
        assert len(bookings(found)) == 1
        assert totals(found)[0].mass == 500.0


class Put:
    """Takes what is handed over, and what is shown."""

    failure, recorded, audited = "", 0, 0

    def __init__(self):
        self.changes = []

    def put(self, change):
        self.changes.append(change)

    def report_failure(self):
        pass

    def set_value(self, index, sub, value):
        pass


def test_a_booking_that_becomes_more_precise_is_handed_over_once():
    """It does so many times a second while the bucket returns; each would be a transaction on the disk."""
    loaded_file = load(EXCAVATOR)
    state, put = WeighingService.start(Core(loaded_file.service, model_of(loaded_file).data_sheet)), Put()
    ledger = Ledger(put, put, state.memory)
    for error in (3.0, 2.0, 1.0):
        made = Booking(1, 5, 900.0, error, 10.0, error, 890.0, error)
        state.bookings.booking = made
        state.bookings.dumped = Weighed(900.0, 1.0, np.zeros(1), np.zeros(1), 100)
        ledger.look(state)
    assert [change.booked.booking.standard_error for change in put.changes] == [3.0]


def test_when_the_bucket_has_returned_the_last_weight_is_handed_over():
    loaded_file = load(EXCAVATOR)
    state, put = WeighingService.start(Core(loaded_file.service, model_of(loaded_file).data_sheet)), Put()
    ledger, lifted = Ledger(put, put, state.memory), Weighed(900.0, 1.0, np.zeros(1), np.zeros(1), 100)
    for mass, dumped in ((890.0, lifted), (892.0, lifted), (893.0, lifted), (893.0, None), (893.0, None)):
        made = Booking(1, 5, 900.0, 3.0, 900.0 - mass, 1.0, mass, 2.0)
        made = made if state.bookings.booking != made else state.bookings.booking
        state.bookings.booking, state.bookings.dumped = made, dumped
        ledger.look(state)
    assert [change.final and change.final.dumped for change in put.changes] == [None, 893.0]


def test_the_final_weight_counts_in_totals_and_truck(path):
    """Whether accepted or cancelled; written twice it counts once."""
    kept = shift(path, 2, Memory(Scale(2.0, 10.0)))
    recorder = Recorder(path, START)
    for mass in (500.0, 600.0):
        kept = (change := booked(kept, mass)).kept
        recorder.put(change)
        final = replace(change.booked.booking, carry_back=8.0, dumped=mass + 4.0, dumped_error=3.0)
        kept = replace(kept, truck=correct_bucket(kept.truck, final.number, 4.0), booking=final)
        if mass == 600.0:
            kept = replace(kept, truck=set_accepted(kept.truck, final.number, False).truck)
        for _ in range(2):
            recorder.put(Change(2, kept, None, "", final))
    recorder.close()
    with closing(open_reading(path)) as found:
        rows = bookings(found)
        assert [(row["mass"], row["standard_error"], row["carry_back"], row["final"]) for row in rows[2:]] == [
            (494.0, 3.0, 6.0, 1),
            (594.0, 3.0, 6.0, 1),
        ]
        assert [row["final"] for row in rows[:2]] == [0, 0]
        [total] = totals(found)
        assert (total.loads, total.mass) == (3, pytest.approx(90.0 + 91.0 + 494.0))
    again = Recorder(path, START)
    again.close()
    assert again.kept.truck == kept.truck
    assert kept.truck.total == pytest.approx(total.mass)


def test_records_of_the_first_version_are_kept(path):
    with closing(sqlite3.connect(path)) as old:
        old.executescript(f"{MIGRATIONS[0]} PRAGMA user_version = 1;")
        old.execute("INSERT INTO starts VALUES (1, 1, 2, 'stopped', '0.1.0', 'Excavator')")
        old.execute(
            "INSERT INTO bookings (start, number, t_us, truck, product, mass, standard_error, gross, carry_back, "
            "cycle, contact, peak, zero, tare, attachment, drift, status) "
            "VALUES (1, 1, 1, 1, 0, 700.0, 4.0, 712.0, 12.0, 18.0, 6.0, 8e4, 0.0, 0.0, 'standard', 0.0, 'OK')"
        )
        old.commit()
    shift(path, 1)
    with closing(open_reading(path)) as found:
        assert [(row["mass"], row["final"]) for row in bookings(found)] == [(700.0, 0), (100.0, 0)]
        assert totals(found)[0].mass == 800.0


def test_a_start_without_an_end_is_interrupted(path):
    shift(path, 1)
    with closing(sqlite3.connect(path)) as found, found:
        found.execute("UPDATE starts SET how = 'running', ended_us = NULL")
    shift(path, 1)
    with closing(open_reading(path)) as found:
        assert [row["how"] for row in found.execute("SELECT how FROM starts ORDER BY id")] == ["interrupted", "stopped"]
        assert [row["number"] for row in bookings(found)] == [1, 2]


def test_totals_of_short_shift_and_ever(path):
    shift(path, 2)
    with closing(open_labels(path)) as found:
        set_to_zero(found, "short", 1)
        name_product(found, 0, "gravel")
    shift(path, 1)
    with closing(open_reading(path)) as found:
        assert [(t.name, t.loads, t.mass) for t in totals(found, "short")] == [("gravel", 1, 100.0)]
        assert totals(found, "shift")[0].loads == 3
        assert totals(found)[0].mass == 301.0
    with closing(open_labels(path)) as found, pytest.raises(RecordingError, match="grand: cannot be set to zero"):
        set_to_zero(found, "grand", 1)


def test_a_ticket_and_its_copy(path):
    shift(path, 2)
    with closing(open_labels(path)) as found:
        label_truck(found, 1, {"customer": "Huber"})
        first, again = ticket(found, 1, 5), ticket(found, 1, 6)
        with pytest.raises(RecordingError, match="truck 9: has no booked bucket"):
            ticket(found, 9, 7)
        with pytest.raises(RecordingError, match="colour: is no label"):
            label_truck(found, 1, {"colour": "red"})
    assert (first.number, first.printed, again.printed, again.t_us) == (1, 1, 2, 5)
    assert (first.mass, first.standard_error, first.labels["customer"]) == (201.0, 10.0, "Huber")


def test_the_next_truck_is_closed_and_opened(path):
    kept = shift(path, 1)
    recorder = Recorder(path, START)
    recorder.put(Change(77, replace(kept, truck=next_truck(kept.truck).truck), None, "truck 2 opened"))
    recorder.close()
    with closing(open_reading(path)) as found:
        rows = found.execute("SELECT number, closed_us FROM trucks ORDER BY number").fetchall()
    assert [tuple(row) for row in rows] == [(1, 77), (2, None)]


def test_exports(path, tmp_path):
    shift(path, 3)
    with closing(open_reading(path)) as found:
        for suffix in ("csv", "json", "parquet"):
            assert export(found, tmp_path / f"out.{suffix}") == 3
        with pytest.raises(RecordingError, match="has no ending of a format"):
            export(found, tmp_path / "out.xls")
        figures = telematics(found)
    with (tmp_path / "out.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["mass_kg"]) for row in rows] == [100.0, 101.0, 102.0]
    assert json.loads((tmp_path / "out.json").read_text())[0]["time"].endswith("Z")
    assert pq.read_table(tmp_path / "out.parquet").column("booking").to_pylist() == [1, 2, 3]
    when = {"datetime": "2023-11-14T22:13:20.000Z"}
    assert figures["CumulativePayloadTotals"] == when | {"PayloadUnits": "kilogram", "Payload": 303.0}
    assert figures["CumulativeLoadCount"] == when | {"Count": 3}


@pytest.mark.parametrize("spoil", ["corrupt", "newer", "cut"])
def test_a_file_that_cannot_be_read_is_kept_aside(path, spoil):
    shift(path, 2)
    if spoil == "newer":
        with closing(sqlite3.connect(path)) as found:
            found.execute(f"PRAGMA user_version = {VERSION + 1}")
    else:
        data = path.read_bytes()
        path.write_bytes(b"no database" * 1000 if spoil == "corrupt" else data[: len(data) // 2 - 100])
    before, told = path.read_bytes(), []
    if spoil == "newer":
        with pytest.raises(RecordingError, match=f"of version {VERSION + 1}, this cylforce reads 1 to {VERSION}"):
            open_reading(path)
    recorder = Recorder(path, START, told.append)
    recorder.put(booked(recorder.kept, 10.0))
    recorder.close()
    assert path.with_name("records.kept-1.db").read_bytes() == before
    assert "it was kept as records.kept-1.db, and new records begin" in told[0]
    with closing(open_reading(path)) as found:
        assert len(bookings(found)) == 1


@contextmanager
def no_more_room():
    """No file grows beyond 100 kB: a write beyond that fails, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_full_disk_stops_the_records_only(path):
    told = []
    recorder = Recorder(path, START, told.append)
    kept = recorder.kept
    with no_more_room():
        for _ in range(2000):
            change = booked(kept, 10.0)
            recorder.put(change)
            kept = change.kept
        recorder.close()
    assert "no more bookings are recorded (" in recorder.failure
    assert told == [recorder.failure]


def test_the_first_change_that_cannot_be_written_ends_the_records_with_its_reason(path):
    """Another program has taken the table away."""
    told = []
    recorder = Recorder(path, START, told.append)
    with closing(sqlite3.connect(path)) as other:
        other.execute("DROP TABLE bookings")
    recorder.put(booked(recorder.kept, 10.0))
    recorder.close()
    assert "(no such table: bookings)" in recorder.failure
    assert told == [recorder.failure]
    recorder.put(booked(recorder.kept, 10.0))
    assert told == [recorder.failure]


def test_what_is_written_is_on_the_disk_before_it_is_confirmed(path):
    """Synchronous FULL (2), with a write-ahead log: a power cut takes nothing that was told."""
    with closing(open_writing(path, print)) as found:
        assert found.execute("PRAGMA synchronous").fetchone() == (2,)
        assert found.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_a_folder_that_cannot_be_written(tmp_path):
    told = []
    recorder = Recorder(tmp_path / "absent" / "records.db", START, told.append)
    recorder.put(booked(recorder.kept, 10.0))
    recorder.close()
    assert len(told) == 1
    assert "weighing continues" in told[0]


def test_a_second_service_is_refused(path):
    recorder = Recorder(path, START)
    with pytest.raises(RecordingError, match="another service writes these records"):
        Recorder(path, START)
    recorder.close()
    open_reading(path).close()


def test_handing_over_costs_next_to_nothing_while_the_disk_stalls(path):
    """Another program holds the database until 500 of them are handed over: none of them waits for it. A busy machine
    may take longer to write them afterwards than an end of the service waits."""
    recorder = Recorder(path, START, close_s=120.0)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        kept = recorder.kept
        for _ in range(500):
            change = booked(kept, 10.0)
            recorder.put(change)
            kept = change.kept
        other.execute("COMMIT")
    recorder.close()
    with closing(open_reading(path)) as found:
        assert len(bookings(found)) == 500


def test_years_of_bookings_are_queried(path):
    """100 000 bookings, two years of work: totals, last bookings and a truck's."""
    shift(path, 1)
    with closing(sqlite3.connect(path)) as found, found:
        row = found.execute("SELECT * FROM bookings").fetchone()
        marks = ",".join("?" * len(row))
        many = ((k, row[1], k, row[3] + k, k // 6, k % 4, *row[6:]) for k in range(2, 100_001))
        found.executemany(f"INSERT INTO bookings VALUES ({marks})", many)
    with closing(open_reading(path)) as found:
        assert sum(t.loads for t in totals(found)) == 100_000
        assert len(bookings(found, last=20)) == 20
        assert len(bookings(found, truck=500)) == 6


KILLED = ("starts_forgetful", "lost", "doubled", "tickets_lost", "totals_wrong")


def test_killed_at_random_moments_nothing_is_lost_or_doubled(path):
    """A dozen times kill -9 while buckets are booked and tickets printed (`tools/accuracy kills` does it 200 times).
    The count itself is checked: without a booking that was told, one is lost and a total is wrong."""
    found = kills.trial(path, 12, 3)
    assert found["told"] > 0
    assert [found[key] for key in KILLED] == [0] * len(KILLED)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(
            "DELETE FROM bookings WHERE accepted AND number = (SELECT min(number) FROM bookings WHERE accepted)"
        )
        connection.execute("DELETE FROM tickets WHERE truck = (SELECT max(truck) FROM tickets)")
        trucks = frozenset(row[0] for row in connection.execute("SELECT number FROM trucks"))
    spoilt = kills.figures(path, kills.Kept(found["told"], trucks))
    assert (spoilt["lost"], spoilt["totals_wrong"]) == (1, 1)
    assert spoilt["tickets_lost"] >= 1


def test_of_a_writer_that_is_not_atomic_the_same_kills_lose_something(tmp_path):
    """The control: half a file is left, sooner or later, and the next start begins with none."""
    found = kills.trial(tmp_path / "naive.json", 30, 3, kills.naive_work)
    assert found["told"] > 0
    assert found["starts_forgetful"] > 0


def test_a_split_truck_is_kept_and_its_ticket_has_each_part(path):
    """Gravel, then sand in the truck, then sand in the trailer; the ticket in pounds is the same mass."""
    kept = Memory(truck=Truck(1, 5000.0, 1, trailer=3000.0))
    recorder = Recorder(path, START)
    for k, change in enumerate((lambda t: t, lambda t: set_product(t, 2).truck, lambda t: next_part(t).truck)):
        kept = replace(kept, truck=change(kept.truck))
        made = booked(kept, 1000.0 + k, k)
        recorder.put(made)
        kept = made.kept
    recorder.close()
    again = Recorder(path, START)
    again.close()
    assert again.kept.truck == kept.truck
    with closing(open_labels(path)) as connection:
        name_product(connection, 1, "gravel")
        found = ticket(connection, 1, 5)
    assert [tuple(x) for x in found.shares] == [
        (1, "gravel", 1000.0, 1), (1, "2", 1001.0, 1), (2, "2", 1002.0, 1)
    ]  # fmt: skip
    text = ticket_text(found).splitlines()
    assert "Part 2  2  1002.0 kg in 1 buckets  target 3000.0 kg" in text
    assert text[-1] == "Total: 3003.0 kg +- 15.0 kg in 3 buckets"
    assert ticket_text(found, MASS_UNITS["lb"]).splitlines()[-1] == "Total: 6620 lb +- 33 lb in 3 buckets"
    assert ticket_text(found, MASS_UNITS["short-ton"]).splitlines()[-1].startswith("Total: 3.310 sh tn +- 0.017 sh tn")
    page = ticket_page(found, "de", MASS_UNITS["t"])
    assert page.count("<tr>") == 4 + 4
    assert "3,003 t ± 0,015 t" in page


def test_a_bucket_that_hangs_is_the_same_after_a_short_outage(path):
    """Kept with its errors; after as long as a working cycle takes it may be another one."""
    hanging = Weighed(900.0, 4.0, np.array([0.5, -2.0]), np.array([1.0]), 300, -2.7)
    recorder = Recorder(path, START)
    recorder.put(Change(START.t_us, Memory(hanging=hanging), None, ""))
    recorder.close()
    for later_s, same in ((11.0, True), (13.0, False), (-1.0, False)):
        again = Recorder(path, START._replace(t_us=START.t_us + round(1e6 * later_s)))
        again.close()
        assert (again.kept.hanging is not None) is same
        assert again.kept.lost == (0.0 if same else 900.0)
        assert not same or str(again.kept.hanging) == str(hanging)


def test_a_bucket_by_hand_is_marked_in_the_records_and_on_the_ticket(path):
    """From the command to the ticket: the ledger hands it over as such, a restart does not forget it."""
    loaded_file = load(EXCAVATOR)
    core, recorder = Core(loaded_file.service, model_of(loaded_file).data_sheet), Recorder(path, START)
    state = WeighingService.start(core, recorder.kept)
    ledger = Ledger(Put(), recorder, state.memory)
    order = struct.pack("<BHBi", 0x23, commands.LOADING, commands.ADD, 8500)
    fed(state, Frame(1, 0x600 + core.service.node_id, order))
    ledger.look(state)
    ledger.look(state)
    recorder.close()
    with closing(open_labels(path)) as connection:
        (row,) = bookings(connection)
        assert (row["mass"], row["standard_error"], row["status"]) == (850.0, 0.0, "BY_HAND")
        assert [line.by_hand for line in ticket(connection, 1, 5).lines] == [True]
        assert ticket_text(ticket(connection, 1, 6)).splitlines()[2].endswith("850.0 kg   by hand")
    again = Recorder(path, START)
    again.close()
    assert (again.kept.truck.total, again.kept.booking.number) == (850.0, 1)


def test_the_tool_is_in_every_booking_and_survives_a_restart(path):
    shift(path, 1, Memory(tool="grab"))
    again = Recorder(path, START)
    again.close()
    assert again.kept.tool == "grab"
    with closing(open_reading(path)) as connection:
        assert [row["attachment"] for row in bookings(connection)] == ["grab"]
