"""The truck that is being loaded: its buckets add up whatever the operator does, and every refusal says why."""

import math
import struct
from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cylforce.estimation.recursive import known
from cylforce.estimation.residual import Residual
from cylforce.service import commands
from cylforce.service.commands import Scale
from cylforce.service.core import Core
from cylforce.service.loading.cycle import Cycle, LastBucket
from cylforce.service.loading.lift import lift_numbers
from cylforce.service.loading.truck import KEPT, NO_TRUCK, Truck, add_bucket, set_accepted
from cylforce.service.memory import Memory
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Booking, Quantity, Reason, Status, invalid_force, no_estimate
from cylforce.signals.events import Frame
from instants import rows_of
from scenarios import EXCAVATOR, fed, identified

MACHINE = load(EXCAVATOR)
CORE = Core(MACHINE.service, identified(MACHINE))
NODE = MACHINE.service.node_id


def written(sub, data, state=None):
    """State and output after an SDO download of four bytes to 2190h:`sub`."""
    state = WeighingService.start(CORE) if state is None else state
    frame = Frame(1, 0x600 + NODE, struct.pack("<BHB", 0x23, commands.LOADING, sub) + data)
    return state, fed(state, frame)


def test_a_bucket_counts_what_left_it_less_the_tare():
    truck = add_bucket(NO_TRUCK, Booking(7, 0, 1012.0, 5.0, 12.0, 2.0, 1000.0, 6.0), 30.0)
    assert (truck.total, truck.filled, truck.buckets[0].number) == (970.0, 1, 7)


@given(st.lists(st.tuples(st.booleans(), st.integers(1, 60)), max_size=40))
def test_the_total_is_the_sum_of_the_accepted_buckets(orders):
    truck = Truck()
    for number in range(1, 11):
        truck = add_bucket(truck, Booking(number, 0, 100.0 * number, 5.0, 0.0, 0.0, 100.0 * number, 5.0), 0.0)
    for accepted, number in orders:
        truck = set_accepted(truck, number, accepted).truck
    counted = [bucket for bucket in truck.buckets if bucket.accepted]
    assert truck.filled == len(counted)
    assert abs(truck.total - sum(bucket.mass for bucket in counted)) < 1e-6


def test_only_the_last_buckets_can_be_cancelled():
    truck = Truck()
    for number in range(1, KEPT + 2):
        truck = add_bucket(truck, Booking(number, 0, 10.0, 1.0, 0.0, 0.0, 10.0, 1.0), 0.0)
    assert set_accepted(truck, 1, False).verdict == commands.NOT_NOW
    assert "booking 1 cannot be cancelled" in set_accepted(truck, 1, False).words
    assert set_accepted(truck, 2, False).truck.filled == KEPT


def test_truck_and_trailer_have_a_target_and_a_sum_each():
    """By SDO: 12 t for the truck, 8 t for the trailer; a bucket of the truck that is cancelled later is not the
    trailer's; the next truck begins with the first target again."""
    state, _ = written(commands.TARGET, struct.pack("<i", 120_000))
    state, _ = written(commands.TRAILER, struct.pack("<i", 80_000), state)
    for number in (1, 2):
        truck = add_bucket(state.truck, Booking(number, 0, 900.0, 5.0, 0.0, 0.0, 900.0, 5.0), 0.0)
        state.truck = truck
        state, out = written(commands.PART, b"next", state)
    assert out.words == "truck 1, part 2 with 900.0 kg, part 3 begun"
    truck = add_bucket(state.truck, Booking(3, 0, 700.0, 5.0, 0.0, 0.0, 700.0, 5.0), 0.0)
    assert (truck.part, truck.target, truck.in_part, truck.total) == (3, 8000.0, 700.0, 2500.0)
    truck = set_accepted(truck, 1, False).truck
    assert (truck.in_part, truck.total) == (700.0, 1600.0)
    state.truck = truck
    state, _ = written(commands.NEXT, b"next", state)
    assert state.truck == Truck(2, 12_000.0, trailer=8000.0)
    state, out = written(commands.PART, b"then", state)
    assert out.words.startswith("next part refused: the four bytes written must be the word next")
    assert written(commands.TRAILER, struct.pack("<i", -1), state)[1].verdict == commands.OUT_OF_RANGE


def test_target_product_and_next_truck_by_sdo():
    state, out = written(commands.TARGET, struct.pack("<i", 120_000))
    assert (out.verdict, state.truck.target) == (0, 12_000.0)
    state, out = written(commands.PRODUCT, struct.pack("<I", 3), state)
    assert (out.verdict, state.truck.product) == (0, 3)
    state, out = written(commands.NEXT, b"next", state)
    assert state.truck == Truck(2, 12_000.0, 3)
    assert out.words == "truck 1 closed with 0.0 kg, truck 2 opened"


def test_refusals_say_why():
    for sub, data, words in [
        (commands.TARGET, struct.pack("<i", -1), "target refused: -0.1 kg is not 0 (none) to 1000000 kg"),
        (commands.PRODUCT, struct.pack("<I", 70_000), "product refused: 70000 is not"),
        (commands.NEXT, b"NEXT", "must be the word next, not b'NEXT'"),
        (commands.CANCEL, struct.pack("<I", 9), "booking 9 cannot be cancelled: it is not among"),
    ]:
        state, out = written(sub, data)
        assert out.verdict, sub
        assert words in out.words
        assert state.truck == NO_TRUCK


def test_what_was_kept_is_there_after_a_restart():
    kept = Memory(Scale(3.0, 50.0), Truck(4, 9000.0, 1), Booking(17, 5, 900.0, 4.0, 0.0, 0.0, 900.0, 4.0))
    state = WeighingService.start(CORE, kept)
    assert state.memory == kept
    assert state.estimate.booking.number == 17


def test_a_cycle_counts_contact_and_keeps_the_largest_force():
    cycle = Cycle()
    for k in range(1, 5):
        air = no_estimate(k * 1_000_000, Reason.STARTING, None)
        force = Quantity(1000.0 * k, 10.0, Status.OK, Reason.NONE)
        soil = replace(invalid_force(Reason.STARTING), magnitude=force)
        cycle.update(replace(air, soil=soil) if k in (2, 3) else air)
    assert cycle.figures == LastBucket(3.0, 2.0, 3000.0)


class TestByHand:
    def test_a_bucket_that_was_not_weighed_counts_and_is_marked(self):
        state, out = written(commands.ADD, struct.pack("<i", 8500))
        booking = state.bookings.booking
        assert (out.verdict, out.words) == (0, "booking 1 by hand: 850.0 kg")
        assert (booking.number, booking.dumped, booking.by_hand) == (1, 850.0, True)
        assert (state.truck.total, state.truck.filled) == (850.0, 1)
        state, out = written(commands.CANCEL, struct.pack("<I", 1), state)
        assert (out.verdict, state.truck.total, state.truck.filled) == (0, 0.0, 0)

    def test_it_has_the_next_number_and_the_tare_does_not_count(self):
        booking = Booking(17, 5, 900.0, 4.0, 0.0, 0.0, 900.0, 4.0)
        begun = WeighingService.start(CORE, Memory(Scale(3.0, 50.0), Truck(), booking))
        state, _ = written(commands.ADD, struct.pack("<i", 8500), begun)
        assert (state.bookings.booking.number, state.truck.total) == (18, 850.0)

    def test_what_is_no_mass_is_refused_in_words(self):
        for mass in (0, -5, 2_000_000_000):
            state, out = written(commands.ADD, struct.pack("<i", mass))
            assert (out.verdict, state.truck) == (commands.OUT_OF_RANGE, NO_TRUCK)
            assert "bucket by hand refused" in out.words


def test_a_bucket_that_is_not_curled_is_not_noted_for_booking():
    """It says so while the load hangs; the same load curled is noted."""
    values, rows = np.array([900.0, 500.0, 100.0, 300.0]), len(CORE.service.machine.rows)
    columns = np.zeros((rows, len(CORE.model.parameters)))
    residual = CORE.load.residual_of_arrays(Residual(np.zeros(rows), np.ones(rows), np.zeros(rows), columns))
    noted = {}
    for curled in (True, False):
        service = WeighingService.start(CORE)
        lift = service.load.lift
        lift.numbers = lift_numbers(known(values, np.ones(4)), lift.gram, (values, np.eye(4)))
        lift.taken, lift.moving = 299, 250
        weight = service.load.update(residual, rows_of([1] * rows))
        service.note_weight(weight, 1, None, curled=curled)
        reason = service.load.load(weight, curled=curled).mass.reason
        noted[curled] = (service.bookings.newest is not None, reason)
    assert noted[True][0]
    assert noted[False] == (False, Reason.NOT_CURLED)


def test_the_machine_file_says_where_the_bucket_is_curled(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(EXCAVATOR.read_text().replace("[tool]", "[tool]\ncurled_deg = [-138, -60]"))
    low, high = load(path).service.machine.curled
    assert (round(math.degrees(low)), round(math.degrees(high))) == (-138, -60)
    assert MACHINE.service.machine.curled is None
