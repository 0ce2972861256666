"""Errors of signals that nobody notices: how large they probably are, and what they add to a standard error. The truth
is drawn, not estimated."""

from dataclasses import astuple
from types import SimpleNamespace

import numpy as np
import pytest

import bookkeeping
from bookkeeping import RATED, bookings
from cylforce.estimation.drift import drift_spread
from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.model import EXPECTED, Tares
from cylforce.estimation.residual import GOOD_ENOUGH
from cylforce.service.adaptation import DriftFilter
from cylforce.service.booking import ProbableErrors, Weighed, difference
from cylforce.service.core import Core
from cylforce.service.plausibility.blocks import LOAD, BlockGatherer
from cylforce.service.plausibility.undetected import CLASS, MEMORY, UndetectedErrors, off_probability
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Reason, invalid_force
from cylforce.signals.events import Tick
from scenarios import EXCAVATOR, cycles, fed, identified, through, with_value
from weighing.parts import Parts

LIFT = 200  # samples of a lift, more than those of a second
PRIOR = np.full(LOAD + 1, 0.01)
TARES = Tares((), ("a",), np.zeros(1), np.zeros((1, 1)), np.zeros(0), True)
STILL = SimpleNamespace(values=np.zeros(1), covariance=np.zeros((1, 1)))


def noted(books, weight, t):
    return bookkeeping.noted(books, weight, t, STILL)


class Rows:
    """The constants of blocks of two signals, and seconds of motion: load, one everyday change, two errors, torque."""

    size, memory, prior, pressed, rows = 2, 1.0, PRIOR, (), 3

    def __init__(self, seed=3):
        self.rng, self.kernel = np.random.default_rng(seed), choice.chosen()

    @staticmethod
    def without_zeros(rows, drift):
        return rows

    @staticmethod
    def turned_force(channels, force):
        return np.zeros((3, 2))

    def second(self, hung, off, many=200):
        """Rows (many, K) of a load (4,) and errors `off` (2,), without noise."""
        columns = self.rng.normal(size=(many, LOAD + 1 + self.size))
        torque = columns[:, :LOAD] @ hung + columns[:, LOAD + 1 :] @ off
        return np.column_stack([columns, torque])


def after(rows, seconds, taken=LIFT):
    """What is known after seconds of rows; those of one list are one lift."""
    errors = UndetectedErrors.start(rows)
    nothing = np.zeros_like(errors.lift)
    for lift in seconds:
        for k, each in enumerate(lift):
            blocks = SimpleNamespace(last=each.T @ each, products=nothing, errors=np.zeros((3, 2)), explained=True)
            errors.update(blocks, None, invalid_force(Reason.STARTING), (k + 1) * taken, STILL)
    return errors


def test_the_size_of_an_error_is_found_beside_loads_of_each_lift():
    rows, off = Rows(), np.array([0.7, 0.0])
    lifts = [[rows.second(hung, off) for _ in range(2)] for hung in (np.array([900.0, 1, 2, 3]), np.zeros(LOAD))]
    assert after(rows, lifts).probable.sizes[0] == pytest.approx(0.7, rel=1e-3)


def test_a_pressure_of_which_the_torques_hardly_tell_is_off_by_no_more_than_its_class():
    """Half of an error that is known as badly as the class, all of one that is known well; an angle may slip by any
    size. The same seconds in units so large that they tell next to nothing leave nothing of a pressure's error."""
    rows = Rows()
    rows.pressed = (0,)
    for square, expected in ((CLASS**-2.0, 1.5), (1e6, 3.0)):
        found = UndetectedErrors.start(rows).within_class(np.array([3.0, 0.5]), np.array([square, 1e-6]))
        assert found == pytest.approx([expected, 0.5], rel=1e-3)
    second = rows.second(np.array([900.0, 1, 2, 3]), np.array([0.7, 0.0]))
    well, hardly = (after(rows, [[scale * second]]).probable.sizes[0] for scale in (1.0, 1e-4))
    assert well > 0.69
    assert hardly < 0.01 * well


def test_the_slope_is_by_how_much_the_mass_of_the_lift_would_change():
    """As by least squares from the rows themselves, with the load's prior as rows of their own."""
    rows = Rows()
    own = rows.second(np.array([900.0, 1, 2, 3]), np.zeros(2), many=12)
    known = np.vstack([own[:, :LOAD], np.diag(np.sqrt(PRIOR[:LOAD]))])
    torque = np.vstack([own[:, LOAD + 1 : -1], np.zeros((LOAD, 2))])
    expected = np.linalg.lstsq(known, torque, rcond=None)[0][0]
    assert after(rows, [[own]]).slopes == pytest.approx(expected)


def test_an_error_that_is_over_is_forgotten():
    rows = Rows()
    was, now = rows.second(np.zeros(LOAD), np.array([1.0, 0.0])), np.zeros(2)
    seconds = [[was]] + [[rows.second(np.zeros(LOAD), now)] for _ in range(round(3.0 * MEMORY))]
    assert abs(after(rows, seconds).probable.sizes[0]) < 0.1


def test_a_second_that_began_before_the_lift_does_not_count():
    rows = Rows()
    one = rows.second(np.zeros(LOAD), np.array([1.0, 0.0]))
    assert not after(rows, [[one]], taken=LIFT // 4).probable.sizes.any()


def test_an_error_counts_as_far_as_there_is_evidence_for_one():
    """By hand: of two signals one is off by four standard errors, in 99 samples: (exp(8) + 1) / sqrt(100)."""
    odds = (np.exp(8.0) + 1.0) / 10.0
    assert off_probability(np.array([16.0, 0.0]), 99.0, 99.0) == pytest.approx(odds / (1.0 + odds))
    assert off_probability(np.zeros(2), 99.0, 99.0) == pytest.approx(1.0 / 6.0)
    assert off_probability(np.array([1e6, 0.0]), 1e6, 99.0) == pytest.approx(1.0)


def test_evidence_counts_by_how_much_the_torques_scatter():
    """Squares four times as large as at commissioning make the same error half as many standard errors large; smaller
    ones change nothing."""
    as_before, more = (
        off_probability(np.array([4.0, 0.0]), 103.0, 99.0),
        off_probability(np.array([16.0, 0.0]), 4 * 99.0 + 16.0, 99.0),
    )
    assert more == pytest.approx(as_before)
    assert off_probability(np.array([4.0, 0.0]), 30.0, 99.0) == pytest.approx(as_before)


def test_where_nothing_seems_off_little_of_it_is_told():
    """Torque that is noise alone, of its standard error: what would explain it best is not taken for an error; where a
    signal is off it is."""
    rows, found = Rows(), []
    for size in (0.0, 1.0):
        seconds = [[rows.second(np.zeros(LOAD), np.array([size, 0.0]), many=15) for _ in range(8)] for _ in range(2)]
        for each in (second for lift in seconds for second in lift):
            each[:, -1] += rows.rng.normal(size=len(each))
        found.append(after(rows, seconds).probable)
    none, some = found
    assert none.off < 0.3
    assert some.off > 0.99
    assert some.expected == pytest.approx(some.sizes, rel=0.01)
    assert np.all(abs(none.expected) < 0.6 * abs(none.sizes))


def test_what_the_weight_is_corrected_for_is_no_error_of_a_signal():
    """The drift of a zero that is taken from the weight is taken from the block's torque: the rows are the same as of a
    machine without it."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    blocks, drift, rng = core.monitor.blocks, DriftFilter.start(core.drift), np.random.default_rng(4)
    values = rng.normal(size=drift.values.size) * np.r_[np.zeros(6), np.full(3, 300.0)]
    size = len(BlockGatherer.start(blocks).last)
    rows = rng.normal(size=(15, size))
    spread = drift_spread(core.model, core.tares.values, EXPECTED)
    drifted = rows.copy()
    drifted[:, -1] += core.tares.scale * rows[:, LOAD : LOAD + 9] @ (values / spread)
    drift.values = values
    found = blocks.without_zeros(drifted.T @ drifted, drift)
    assert found == pytest.approx(rows.T @ rows, rel=1e-9, abs=1e-9)


def test_zeros_that_spread_as_the_returns_tell_are_no_evidence():
    """Torque of a zero that is off by four times what it is every day: unless the returns tell of ten times as much."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    blocks, drift, rng = core.monitor.blocks, DriftFilter.start(core.drift), np.random.default_rng(5)
    second, left = BlockGatherer.start(blocks), []
    rows = rng.normal(size=(25, len(second.last)))
    rows[:, -1] = 4.0 * rows[:, LOAD + 6]
    second.gram, second.rows, second.samples = numbers((blocks.memory * rows.T @ rows).ravel()), 25, 5
    assert blocks.prior_of(drift) == pytest.approx(blocks.prior)
    for scale in (1.0, 100.0):
        drift.scale = np.array([1.0, scale])
        left.append(second.conclude(drift).residual[0])
    assert left[1] < 0.1 * left[0]


def test_a_force_seems_to_turn_with_an_angle_that_is_off():
    """Finite difference of the torques of a force at the tooth line."""
    loaded = load(EXCAVATOR)
    core, force, by = Core(loaded.service, identified(loaded)), complex(30e3, -50e3), 1e-6
    machine, theta = core.service.machine, np.array([0.5, -1.2, -0.8])
    channels = np.zeros(9)
    channels[:3] = theta
    found = core.monitor.blocks.turned_force(channels, force)

    def torque(q):
        return (machine.tool_point(q).gradient.conj() * force).real

    for j in range(3):
        shifted = theta + by * (np.arange(3) == j)
        assert found[:, 3 + j] == pytest.approx((torque(shifted) - torque(theta)) / by, rel=1e-3)
    assert not found[:, :3].any()


def weight(mass, slopes):
    return Weighed(mass, 4.0, np.zeros(1), np.zeros(1), 100, slopes=np.array(slopes))


def test_a_weight_is_as_uncertain_as_signals_are_off():
    """Each signal by itself, in squares; what is the same in lift and return cancels."""
    lifted, sizes = weight(900.0, (3.0, -4.0)), np.array([2.0, 3.0])
    constants = bookkeeping.constants(TARES)
    assert constants.error(lifted, STILL) == pytest.approx(2.0)
    assert constants.reported_error(lifted, STILL, sizes) == pytest.approx(np.sqrt(4.0 + 36.0 + 144.0))
    what_left = difference(lifted, weight(0.0, (3.0, -4.0)))
    assert constants.reported_error(what_left, STILL, sizes) == pytest.approx(np.sqrt(8.0))


def test_the_parts_of_a_standard_error_by_hand():
    """Noise 4 kg^2; a tare off by 2 changes the mass by 3 each; a drift off by 1 by 5 each; 1 % of 900 kg; a signal off
    by 2 changes it by 3 each."""
    tares = TARES._replace(covariance=np.array([[4.0]]), scale_error=0.01)
    constants = bookkeeping.constants(tares)
    drift = SimpleNamespace(values=np.zeros(1), covariance=np.array([[1.0]]))
    lifted = Weighed(900.0, 4.0, np.array([3.0]), np.array([5.0]), 100, slopes=np.array([3.0]))
    parts = astuple(constants.variances(lifted, drift, tares, np.array([2.0])))
    assert parts == pytest.approx((4.0, 36.0, 25.0, 81.0, 36.0))
    assert constants.reported_error(lifted, drift, np.array([2.0])) == pytest.approx(np.sqrt(182.0))
    left = Weighed(100.0, 5.0, np.array([1.0]), np.array([5.0]), 100, slopes=np.array([3.0]))
    both = constants.reported_error(difference(lifted, left), drift, np.array([2.0]))
    assert both == pytest.approx(np.sqrt(9.0 + 16.0 + 64.0))


def test_the_study_says_how_wide_each_way_is_and_what_holds():
    """Two bookings, off by 0.4 and 3 %; 1 % without unnoticed errors, by which the first way adds nothing, the second
    two squares of a percent."""
    told = 1e-4 * np.array([[0.2, 0.3, 0.5, 0.0, 7.0]] * 2)
    found = Parts(np.array([0.004, -0.03]), told, 1e-4 * np.array([[0.0, 2.0, 1.0, 0.5]] * 2))
    assert found.width("without") == pytest.approx(0.01)
    assert found.width("whole") == pytest.approx(0.01 * np.sqrt(3.0))
    assert (found.share("without"), found.share("whole")) == (0.5, 1.0)


def test_nothing_is_booked_while_signals_may_be_so_far_off():
    """By more than what is good enough, certainly: the booking waits. What is probable is told with it."""
    enough, made = GOOD_ENOUGH * RATED, []
    for size in (1.01 * enough, 0.99 * enough):
        books = bookings(TARES, probable=ProbableErrors(np.array([2.0 * enough]), np.array([size])))
        for t, mass in enumerate((900.0, 900.0, 0.0, 0.0)):
            books = noted(books, weight(mass, (1.0,)), t)
        made.append(books.booking)
    assert made[0] is None
    assert made[1].standard_error == pytest.approx(np.hypot(2.0, 2.0 * enough))


def test_one_signal_is_off_and_not_all():
    """Two signals, each of which would explain the same torques: what is certain of either does not add up."""
    enough, books = (
        GOOD_ENOUGH * RATED,
        bookings(TARES, probable=ProbableErrors(np.full(2, 12.0), np.full(2, 0.8 * GOOD_ENOUGH * RATED))),
    )
    for t, mass in enumerate((900.0, 900.0, 0.0, 0.0)):
        books = noted(books, weight(mass, (1.0, 1.0)), t)
    assert books.booking is not None
    assert books.booking.standard_error > enough


def booked(core, events):
    """Masses and standard errors [kg] of bookings when they are made, by number."""
    found = {}
    for estimate in through(core, events)[1]:
        if estimate.booking is not None:
            found.setdefault(estimate.booking.number, estimate.booking)
    return np.array([(b.mass, b.standard_error) for b in found.values()]).T


def test_a_bucket_angle_that_slides_makes_weights_as_uncertain_as_they_are_wrong():
    """By six degrees in three seconds, before the first load is lifted; a load in the bucket explains as much. A weight
    is off by more than two of the standard errors in order, none of what is then told."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    events, masses = cycles(loaded, count=3)
    slid = with_value(events, core.service, "bucket_angle", lambda t, q: q + 0.1 * min(t / 3.0, 1.0))
    (fine, told), (wrong, more) = booked(core, events), booked(core, slid)
    assert all(abs(fine - masses) < told)
    off = abs(wrong - masses[: len(wrong)])
    assert any(off > 2.0 * told[: len(off)])
    assert all(off < 2.0 * more)


def test_a_force_is_as_uncertain_as_signals_are_off():
    """The same tick with and without a torque of the boom by an error of a signal."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    events, _ = cycles(loaded, count=1)
    last = max(k for k, event in enumerate(events) if isinstance(event, Tick))
    state, *_ = through(core, events[:last])
    found = []
    for torque in (0.0, 20e3):
        torques = np.zeros_like(state.monitor.undetected.torques)
        torques[0, 0] = torque
        begun = state.copied()
        begun.monitor.undetected.torques = torques
        found.append(fed(begun, events[last]).estimate.force)
    assert found[1].z.standard_error > found[0].z.standard_error + 1e3
    assert found[1].z.value == found[0].z.value
