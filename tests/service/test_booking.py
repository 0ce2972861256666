"""Which weight is booked, and how well it is known; spills; weights of zero. The truth is drawn, not estimated."""

from array import array
from types import SimpleNamespace

import numpy as np
import pytest

import bookkeeping
from bookkeeping import RATED, bookings, changed, constants
from cylforce.estimation.model import Tares
from cylforce.estimation.recursive import known, solution, update
from cylforce.estimation.residual import GOOD_ENOUGH
from cylforce.service.booking import Bookings, MissedReason, Weighed, difference
from cylforce.service.loading.lift import Lift, SpillCheck
from cylforce.service.spill import change, changed_at, information
from weighing.score import class_y_b, inside

STILL = SimpleNamespace(values=np.zeros(2), covariance=np.diag([4.0, 1.0]))


def noted(books, weight, t, drift=STILL):
    return bookkeeping.noted(books, weight, t, drift)


def parted(books):
    return changed(books, Bookings.end_lift)


def spilled(books):
    return changed(books, Bookings.change_load)


def unseen(books):
    return changed(books, Bookings.discard_candidate)


def error(weight, given, drift):
    return constants(given).error(weight, drift)


def tares(scale_error=0.0, spread=0.0, common_error=0.0):
    known = (np.zeros(1), np.diag([spread**2]), np.zeros(0))
    return Tares((), ("a",), *known, True, 1.0, scale_error, common_error=common_error)


def weight(mass, noise=1.0, gain=0.0, drifted=(0.0, 0.0), moving=100, tilt=None, hung=None):
    hung = tilt if hung is None else hung
    return Weighed(mass, noise, np.array([gain]), np.array(drifted), moving, tilt, hung=hung)


def test_the_error_has_noise_tares_drift_and_scale():
    """Each part by itself, and all together in squares."""
    assert error(weight(1000.0, noise=9.0), tares(), STILL) == pytest.approx(3.0)
    assert error(weight(1000.0, noise=0.0), tares(0.01), STILL) == pytest.approx(10.0)
    assert error(weight(1000.0, noise=0.0, gain=2.0), tares(spread=2.0), STILL) == pytest.approx(4.0)
    assert error(weight(1000.0, noise=0.0, drifted=(1.0, 2.0)), tares(), STILL) == pytest.approx(np.sqrt(8.0))
    whole = error(weight(1000.0, 9.0, 2.0, (1.0, 2.0)), tares(0.01, 2.0), STILL)
    assert whole == pytest.approx(np.sqrt(9.0 + 100.0 + 16.0 + 8.0))


def test_errors_that_lift_and_return_share_cancel():
    """The same gain on tares and drift: only noise and the scale of the difference are left."""
    lifted, left = weight(1000.0, 4.0, 5.0, (3.0, 1.0)), weight(20.0, 4.0, 5.0, (3.0, 1.0))
    assert error(difference(lifted, left), tares(0.0, 10.0), STILL) == pytest.approx(np.sqrt(8.0))
    assert error(lifted, tares(0.0, 10.0), STILL) > 50.0


def test_intervals_hold_as_often_as_they_say():
    """Drawn tares, drift, scale and noise: 95 % of the intervals hold the truth; without the scale fewer do."""
    rng, own = np.random.default_rng(4), weight(1000.0, 9.0, 2.0, (1.0, 2.0))
    parts = rng.normal(size=(4, 4000)) * np.array([3.0, 2.0 * 2.0, np.hypot(2.0, 2.0), 10.0])[:, None]
    wrong = parts.sum(axis=0)
    told = np.full(4000, error(own, tares(0.01, 2.0), STILL))
    assert inside(wrong, told) == pytest.approx(0.95, abs=0.01)
    assert inside(wrong, np.full(4000, error(own, tares(0.0, 2.0), STILL))) < 0.8


def test_a_drift_found_in_the_return_corrects_the_lift():
    later = SimpleNamespace(values=np.array([2.0, 0.0]), covariance=STILL.covariance)
    assert weight(1000.0, drifted=(3.0, 0.0)).corrected(later) == pytest.approx(994.0)


def having(books, withheld):
    return changed(books, lambda found: setattr(found, "withheld", withheld))


def after(books, *weights):
    for t, each in enumerate(weights):
        books = noted(books, each, t)
    return books


def test_what_only_the_masses_bound_of_the_scale_is_in_the_error_and_withholds_nothing():
    """6 % of 1200 kg are 72 kg, of the 15 kg that noise, tares, drift and the cylinders' scale may have."""
    books = bookings(tares(0.001, 0.0, 0.06))
    for each in (weight(1200.0), weight(1200.0), None, weight(5.0), weight(5.0)):
        books = parted(books) if each is None else noted(books, each, 0)
    scale = np.hypot(0.001, 0.06)
    assert books.booking.standard_error == pytest.approx(np.hypot(1.0, 1200.0 * scale))
    assert books.booking.dumped_error == pytest.approx(np.hypot(np.sqrt(2.0), 1195.0 * scale))


def test_gross_what_remained_and_what_left():
    """One booking a lift, refined while the bucket returns; the last weight before the lift ends does not count."""
    books = parted(after(bookings(tares()), weight(900.0), weight(905.0), weight(700.0)))
    books = after(books, weight(12.0), weight(14.0))
    first = books.booking
    assert (first.number, first.mass, first.carry_back, first.dumped) == (1, 905.0, 12.0, 893.0)
    refined = after(books, weight(15.0)).booking
    assert (refined.number, refined.t_us, refined.carry_back) == (1, first.t_us, 14.0)


def test_while_it_is_not_sure_that_the_sensors_agree_a_booking_waits():
    """It is made when that is sure again; if the next load comes before, it is told as missed."""
    books = having(parted(after(bookings(tares()), weight(900.0), weight(905.0))), withheld=True)
    waits = after(books, weight(12.0), weight(14.0))
    assert waits.booking is None
    assert after(having(waits, withheld=False), weight(15.0)).booking.mass == 900.0
    later = after(parted(having(waits, withheld=False)), weight(500.0), weight(500.0))
    assert (later.booking, later.missed.number, later.missed.mass) == (None, 1, 900.0)


def test_after_a_spill_the_later_weight_is_booked_and_half_a_bucket_is_not():
    books = after(bookings(tares()), weight(900.0, moving=300), weight(900.0, moving=330))
    books = after(spilled(books), weight(860.0, moving=50), weight(860.0, moving=80), weight(300.0, moving=90))
    books = after(parted(books), weight(10.0), weight(10.0))
    assert books.booking.mass == 860.0


def test_a_loaders_bucket_that_curls_in_the_heap_does_not_dump():
    """1988 kg were weighed in the heap, when the bucket had curled by 35 degrees since that load hung; then 1232
    kg hang in the bucket curled by 11 more: that is the load, not the rest of a dump."""
    books = after(bookings(tares()), *[weight(1988.0, tilt=0.6, hung=0.0)] * 2)
    books = after(parted(books), *[weight(1232.0, tilt=0.8, hung=0.8)] * 2)
    books = after(parted(books), *[weight(10.0, tilt=-0.7)] * 2)
    assert books.booking.mass == 1232.0


def test_one_mass_that_reads_as_a_load_and_then_as_an_empty_bucket_is_not_booked():
    """Dirt of 5 % of rated in an empty bucket: 76 and 74 kg are one mass, known to 5 kg. When 20 kg of it are left,
    the rest has left the bucket, and is booked."""
    dirt = after(bookings(tares()), *[weight(76.0, noise=12.0)] * 2, *[weight(74.0, noise=12.0)] * 3)
    assert (dirt.booking, dirt.missed.number) == (None, 0)
    booking = after(dirt, *[weight(20.0, noise=12.0)] * 2).booking
    assert (booking.number, booking.mass, booking.carry_back) == (1, 76.0, 20.0)
    assert booking.dumped > 3.0 * booking.dumped_error


def test_what_left_is_compared_with_its_own_error_and_not_with_that_of_the_weights():
    """28 kg left a bucket of 80 kg. An error of 10 kg that both weights share does not count, one in the last does."""
    for lifted, number in ((20.0, 1), (0.0, None)):
        books = bookings(tares())
        shaky = SimpleNamespace(values=np.zeros(2), covariance=np.diag([0.25, 0.25]))
        for each in [weight(80.0, drifted=(lifted, 0.0))] * 2 + [weight(52.0, drifted=(20.0, 0.0))] * 2:
            books = noted(books, each, 1, shaky)
        assert (books.booking and books.booking.number) == number


def test_dirt_after_a_booked_bucket_is_no_bucket_of_its_own():
    """What stays in the bucket reads 74, 76 and 74 kg while it returns."""
    books = parted(after(bookings(tares()), *[weight(900.0)] * 2))
    books = after(books, *[weight(mass, noise=4.0) for mass in (74.0, 74.0, 76.0, 76.0, 74.0, 74.0)])
    assert (books.booking.number, books.booking.mass) == (1, 900.0)


def test_a_smaller_load_after_a_dump_that_was_not_seen_is_the_next_one_and_the_one_before_is_reported():
    """1712 kg are dumped unseen. 1618 kg begin to hang in the open bucket and stay in the curled one."""
    books = after(bookings(tares()), *[weight(1712.0, tilt=-2.7)] * 2)
    books = after(parted(books), *[weight(1618.0, tilt=-1.9, hung=-1.8)] * 2)
    books = after(books, *[weight(1618.0, tilt=-2.6, hung=-1.8)] * 2)
    assert (books.booking, books.missed.number, books.missed.mass) == (None, 1, 1712.0)
    assert books.missed.reason is MissedReason.DUMP_NOT_WEIGHED
    books = after(parted(books), *[weight(10.0, tilt=-0.5)] * 2)
    assert (books.booking.number, books.booking.mass, books.missed.number) == (1, 1618.0, 1)


@pytest.mark.parametrize(("tilt", "mass"), [(-2.8, 400.0), (-1.9, 899.0)])
def test_a_part_tipped_off_is_a_smaller_load_and_half_a_dump_is_not(tilt, mass):
    """400 of 900 kg are left: in the bucket as it hung before, or in one that has tilted by half a right angle."""
    books = after(bookings(tares()), weight(900.0, tilt=-2.7), weight(900.0, tilt=-2.7))
    books = after(books, weight(899.0, tilt=-2.2), weight(899.0, tilt=-2.2))  # it begins to open
    books = after(parted(books), weight(400.0, moving=50, tilt=tilt), weight(400.0, moving=60, tilt=tilt))
    books = after(parted(books), weight(10.0, tilt=-0.5), weight(10.0, tilt=-0.5))
    assert books.booking.mass == mass


def test_an_error_that_the_full_and_the_empty_bucket_share_does_not_hinder_the_booking():
    """What left the bucket is booked: 25 kg of a drift in both weights do not count, in one of them they do."""
    unknown = SimpleNamespace(values=np.zeros(2), covariance=np.diag([1.0, 1.0]))

    def worked(lifted, empty):
        books = bookings(tares())
        for t, each in enumerate([weight(900.0, drifted=(lifted, 0.0))] * 2 + [weight(10.0, drifted=(empty, 0.0))] * 2):
            books = noted(books, each, t, unknown)
        return books

    allowed = GOOD_ENOUGH * RATED
    shared = worked(0.9 * allowed, 1.5 * allowed).booking
    assert shared.carry_back_error > allowed > shared.standard_error > shared.dumped_error
    assert worked(0.0, 0.9 * allowed).booking is not None
    assert worked(0.0, 1.5 * allowed).booking is None
    assert worked(1.1 * allowed, 1.1 * allowed).booking is None


def test_after_an_outage_the_load_before_it_is_told_and_not_booked():
    """It is not known whether it was dumped, or what hangs now is still the same."""
    books = unseen(after(bookings(tares()), weight(900.0), weight(900.0)))
    assert (books.missed.number, books.missed.mass, books.missed.reason) == (1, 900.0, MissedReason.INTERRUPTED)
    assert after(books, weight(10.0), weight(10.0)).booking is None
    books = after(parted(after(books, weight(600.0), weight(600.0))), weight(10.0), weight(10.0))
    assert (books.booking.number, books.booking.mass, books.missed.number) == (1, 600.0, 1)
    assert unseen(books).missed.number == 1


def remembered(mass=900.0):
    """The state after a restart with a load in the bucket."""
    return bookings(tares(), candidate=weight(mass), remembered=True)


def test_a_load_that_hangs_again_after_a_restart_is_booked():
    books = after(parted(after(remembered(), weight(901.0), weight(901.0))), weight(10.0), weight(10.0))
    assert (books.booking.number, books.missed.number) == (1, 0)


def test_a_load_that_leaves_after_a_restart_is_booked():
    """Seen empty at once, or while it is being dumped."""
    books = after(remembered(), weight(10.0), weight(10.0))
    assert (books.booking.mass, books.missed.number) == (900.0, 0)
    books = parted(after(remembered(), weight(300.0), weight(300.0)))
    books = after(books, weight(10.0), weight(10.0))
    assert (books.booking.mass, books.missed.number) == (900.0, 0)


def test_another_load_after_a_restart_is_booked_and_the_one_before_is_told():
    books = after(remembered(), weight(1200.0), weight(1200.0))
    assert (books.missed.number, books.missed.mass, books.missed.reason) == (1, 900.0, MissedReason.INTERRUPTED)
    books = after(parted(books), weight(10.0), weight(10.0))
    assert (books.booking.number, books.booking.mass, books.missed.number) == (1, 1200.0, 1)


def test_a_load_that_follows_an_unclear_return_replaces_the_one_before_and_this_is_told():
    unclear = weight(10.0, noise=RATED)
    books = after(bookings(tares()), weight(900.0), weight(900.0))
    books = parted(noted(parted(books), unclear, 1))
    shaky = SimpleNamespace(values=np.zeros(2), covariance=np.diag([900.0, 900.0]))
    drifted = weight(10.0, drifted=(1.0, 0.0))
    for _ in range(2):
        books = noted(books, drifted, 2, shaky)
    books = after(parted(books), weight(600.0), weight(600.0))
    assert (books.missed.number, books.missed.mass, books.missed.reason) == (1, 900.0, MissedReason.EMPTY_INACCURATE)
    assert books.candidate.mass == 600.0


def test_a_change_of_the_load_is_found_within_its_error():
    """Rows of 1000 kg, then of 960 kg: the change is -40 kg; an unknown friction widens its error."""
    rng, load = np.random.default_rng(1), np.array([1000.0, 700.0, 100.0, 500.0])
    root, gram, marks = known(np.zeros(4), np.full(4, 3e3)), np.zeros((4, 1)), []
    for kilograms in (1000.0, 960.0):
        columns, other = rng.normal(size=(400, 4)), np.sign(kilograms - 980.0) * np.ones((400, 1))
        torque = columns @ (load * kilograms / 1000.0) + rng.normal(size=400)
        root, gram = update(root, columns, torque, np.ones(400)), gram + columns.T @ other
        marks.append(information(root, gram))
    parts = marks[0], marks[1] - marks[0]
    by, wrong = change(*parts, np.zeros((1, 1)))
    assert abs(by + 40.0) < 4.0 * wrong < 4.0
    assert change(*parts, np.array([[100.0]]))[1] > wrong


def hung(kilograms, seed=1, looks=8, rows=40):
    """Information of a lift at each look, begun with what is known of nothing, and the rows of each look."""
    rng, load = np.random.default_rng(seed), np.array([1.0, 0.7, 0.1, 0.5])
    root, gram, parts = known(np.zeros(4), np.full(4, 3e3)), np.zeros((4, 1)), []
    marks = [information(root, gram)]
    for k in range(looks):
        columns, other = rng.normal(size=(rows, 4)), rng.normal(size=(rows, 1))
        torque = columns @ (load * kilograms[k]) + 10.0 * rng.normal(size=rows)
        root, gram = update(root, columns, torque, np.full(rows, 100.0)), gram + 0.01 * columns.T @ other
        marks.append(information(root, gram))
        parts.append((columns, torque, other))
    return np.array(marks), parts


def test_the_moment_from_which_on_another_load_hangs_is_found():
    """1000 kg fall to 900 kg during the fourth look; none is, of a load that stays, or changes by less than counts."""
    nothing = np.zeros((1, 1))
    falls, _ = hung([1000.0, 1000.0, 1000.0, 950.0, 900.0, 900.0, 900.0, 900.0])
    assert changed_at(falls[:-1], falls[-1], nothing, 15.0) == 4
    assert changed_at(falls[:3], falls[3], nothing, 15.0) is None
    assert changed_at(falls[:-1], falls[-1], nothing, 150.0) is None
    assert changed_at(falls[:-1], falls[-1], np.array([[1e6]]), 15.0) is None
    assert not any(changed_at(m[:-1], m[-1], nothing, 15.0) for m, _ in (hung([1000.0] * 8, k) for k in range(20)))


def test_a_lift_from_a_mark_on_knows_what_came_since_and_nothing_else():
    """Estimate, sensitivity and counts are those of a lift that began there."""
    marks, parts = hung([1000.0] * 4 + [900.0] * 4)
    looks = tuple(SpillCheck(moving, -3.0 + moving / 200.0) for moving in (0, 20, 40, 60, 80, 110, 140, 170))
    whole = Lift(array("d"), 240, 0, 200, array("d"), marks[:-1], looks, mixed=False)
    found = whole.since(4, marks[-1], SpillCheck(200, -2.0), 30, marks[0])
    root, gram = known(np.zeros(4), np.full(4, 3e3)), np.zeros((4, 1))
    for columns, torque, other in parts[4:]:
        root, gram = update(root, columns, torque, np.full(40, 100.0)), gram + 0.01 * columns.T @ other
    values, covariance = solution(root)
    assert found.values == pytest.approx(values)
    assert found.covariance == pytest.approx(covariance)
    assert found.gram == pytest.approx(gram)
    assert found.root.factor.T @ found.root.factor == pytest.approx(root.factor.T @ root.factor)
    assert (found.taken, found.moving, found.tilt) == (120, 120, -2.6)
    assert [look.moving for look in found.checks] == [0, 30, 60, 90, 120]
    assert found.marks[0] == pytest.approx(marks[0])


def test_class_y_b_by_hand():
    """Errors of 2 kg of 1500: within 2 d for d = 1 at most, so n = 1500."""
    assert class_y_b(np.array([1000.0]), np.array([2.0]), 1500.0) == 1500
    assert class_y_b(np.array([1000.0]), np.array([31.0]), 1500.0) == 0
