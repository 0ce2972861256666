"""Leaps of pressures: what is doubted of made-up readings, and what the service then publishes until it knows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.pressures import CODES
from cylforce.estimation.model import Model
from cylforce.service.core import Core
from cylforce.service.plausibility.detector import Interruption, MonitoredMachine
from cylforce.service.plausibility.detectors.pressure_step import (
    AFTER,
    BEFORE,
    DEGREE,
    FREE,
    KNOWN,
    LONGEST,
    PressureStep,
    StepTest,
)
from cylforce.service.plausibility.pressure_groups import GROUP, GROUPS, QUIET, TENTH, GroupConstants, GroupStatistics
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Reason, Status
from faulting.edits import BAR
from rig import rig
from scenarios import EXCAVATOR, cycles, identified, seconds, through, with_value

SIZE = BEFORE + AFTER
LEVELS = np.array([120.0, 8.0, 60.0, 25.0, 15.0, 40.0]) * BAR
NOISE = 0.1 * BAR
T = np.arange(SIZE) - (SIZE - 1) / 2.0


@pytest.fixture(scope="module")
def leaping():
    """The excavator's pressures: head and rod side of boom, stick and bucket."""
    return StepTest(load(EXCAVATOR).service.machine, 100.0)


def smooth(rng):
    """Readings of six pressures that change as a motion makes them change, with noise."""
    slopes, bends = rng.normal(0.0, 2.0 * BAR, 6), rng.normal(0.0, 0.2 * BAR, 6)
    return LEVELS + T[:, None] * slopes + T[:, None] ** 2 * bends + rng.normal(0.0, NOISE, (SIZE, 6))


def exchanged(window, *pairs):
    found = window.copy()
    for a, b in pairs:
        found[BEFORE:, [a, b]] = window[BEFORE:, [b, a]]
    return found


def test_motion_does_not_leap(leaping):
    rng = np.random.default_rng(1)
    assert all(leaping.suspicion(smooth(rng)) == NOTHING_SUSPECTED for _ in range(2000))


def test_pressures_that_cross_are_not_exchanged(leaping):
    """At twenty bar between two messages."""
    rng = np.random.default_rng(2)
    for slope in (2.0, 5.0, 20.0):
        window = smooth(rng)
        window[:, 0] = 50.0 * BAR + slope * BAR * T + rng.normal(0.0, NOISE, SIZE)
        window[:, 1] = 50.0 * BAR - slope * BAR * T + rng.normal(0.0, NOISE, SIZE)
        assert leaping.suspicion(window) == NOTHING_SUSPECTED


def test_exchanged_sides_are_found(leaping):
    rng = np.random.default_rng(3)
    for cylinder in range(3):
        head, rod = 2 * cylinder, 2 * cylinder + 1
        suspicion = leaping.suspicion(exchanged(smooth(rng), (head, rod)))
        assert suspicion == SensorSuspicion(
            Level.SUSPECTED, SensorFault.SWAPPED, (leaping.signals[head], leaping.signals[rod])
        )


def test_exchanged_nodes_are_found(leaping):
    rng = np.random.default_rng(4)
    suspicion = leaping.suspicion(exchanged(smooth(rng), (0, 2), (1, 3)))
    assert suspicion == SensorSuspicion(Level.SUSPECTED, SensorFault.SWAPPED, tuple(leaping.signals[:4]))


def test_signals_that_read_the_same_are_not_exchanged(leaping):
    rng = np.random.default_rng(5)
    window = smooth(rng)
    window[:, 1] = window[:, 0] + rng.normal(0.0, NOISE, SIZE)
    assert leaping.suspicion(exchanged(window, (0, 1))) == NOTHING_SUSPECTED


def test_a_pressure_that_steps_is_found_with_its_size(leaping):
    rng = np.random.default_rng(6)
    for pressure, bar in ((0, 8.0), (3, -5.0), (5, 20.0)):
        window = smooth(rng)
        window[BEFORE:, pressure] += bar * BAR
        suspicion = leaping.suspicion(window)
        assert replace(suspicion, size=0.0) == SensorSuspicion(
            Level.SUSPECTED, SensorFault.STEPPED, (leaping.signals[pressure],)
        )
        assert suspicion.size == pytest.approx(bar * BAR, abs=BAR)


def test_the_noise_before_tells_smaller_steps_from_noise(leaping):
    """Nineteen standard errors of the sensor: too little by itself, enough after a second of no more noise than the
    sensor's, too little after one of three times as much. In noise of the sensor alone nothing steps."""
    rng, found = np.random.default_rng(15), []
    for noise in (1.0, 3.0):
        for bar in (0.0, 1.9):
            earlier = LEVELS + rng.normal(0.0, noise * NOISE, (40, LONGEST - SIZE, 6))
            windows = np.stack([smooth(rng) for _ in earlier])
            windows[:, BEFORE:, 2] += bar * BAR
            long = np.concatenate([earlier, windows], axis=1)
            found.append(
                [np.mean([leaping.suspicion(w).cause is SensorFault.STEPPED for w in x]) for x in (windows, long)]
            )
    assert np.round(found, 1).tolist() == [[0.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 0.0]]


@pytest.mark.parametrize("form", [choice.INTERPRETED, choice.chosen()], ids=["interpreted", "chosen"])
def test_only_what_changes_by_more_than_what_is_around_it_is_looked_at(form):
    """A steady slope, however steep, is not, nor a change within the gate; a step beyond it is, of the second pressure,
    too. A slope's change within a reading beside changes of four fifths of it on either side is a fifth."""

    def suspicious(*changes):
        first = np.concatenate([np.zeros(BEFORE - 1), np.cumsum(changes), np.full(2, float(np.sum(changes)))])
        both = np.stack([np.zeros_like(first), first], axis=1)
        return bool(form.may_step(2, numbers(both.ravel()), BEFORE, numbers([1.0, 1.0])))

    assert not suspicious(0.0, 0.0, 0.0)
    assert not suspicious(0.0, 0.9, 0.0)
    assert suspicious(0.0, 1.1, 0.0)
    assert suspicious(0.0, -1.1, 0.0)
    assert not suspicious(100.0, 100.0, 100.0)
    assert not suspicious(4.8, 5.7, 4.8)  # 1.5 x 5.7 - 0.5 x 15.3 = 0.9
    assert suspicious(4.8, 5.9, 4.8)  # 1.1


def misfit(readings, noise, step=False):
    """Minus the log likelihood of what the best curve leaves, by least squares, without and with the noise before."""
    curves = np.stack([*(T**k for k in range(DEGREE + 1)), *([T[BEFORE - 1] < T] if step else [])], axis=1)
    left = np.sum((readings - curves @ np.linalg.lstsq(curves, readings, rcond=None)[0]) ** 2) / noise**2
    share = (KNOWN + left) / (KNOWN + FREE)
    return 0.5 * FREE * np.log(max(left / FREE, 1.0)), 0.5 * (FREE + KNOWN) * np.log(max(share, 1.0))


def ratios(window, noise, swaps):
    """Log likelihood ratios of a step of each pressure, of each exchange; the misfits without and with a step."""
    plain, stepped = ([misfit(x, noise, step) for x in window.T] for step in (False, True))
    steps = [max(a - b for a, b in zip(*both, strict=True)) for both in zip(plain, stepped, strict=True)]

    def better(a, b):
        return plain[a][0] - misfit(np.concatenate([window[:BEFORE, a], window[BEFORE:, b]]), noise)[0]

    swaps = [sum(2.0 * min(better(a, b), better(b, a)) for a, b in pairs) for pairs in swaps]
    return steps, swaps, [x[0] for x in plain + stepped]


@pytest.mark.parametrize("form", [choice.INTERPRETED, choice.chosen()], ids=["interpreted", "chosen"])
def test_arrays_are_asked_only_of_what_can_be_sure(leaping, form):
    """Six pressures, one with a step of up to 60 times the sensor's noise, two exchanged that are as far apart: what
    the kernel says at the first look, and what least squares say, with and without step or exchange."""
    rng, noise = np.random.default_rng(16), load(EXCAVATOR).service.machine.signals[leaping.signals[0]].standard_error
    pairs, most = leaping.pairs, leaping.most_pairs
    told = (leaping.curves, DEGREE + 1, np.full(6, noise**2), float(FREE), float(KNOWN), leaping.least, pairs)
    seen = set()
    for k in range(300):
        window = smooth(rng)
        window[:, 1] = window[:, 0] + rng.uniform(0.0, 60.0) * noise + rng.normal(0.0, NOISE, SIZE)
        window[BEFORE:, 2] += rng.uniform(0.0, 60.0) * noise * (k % 3 == 0)
        window = exchanged(window, (0, 1)) if k % 2 == 0 else window
        room, found = numbers(np.zeros(12 * (DEGREE + 3))), numbers(np.zeros(12))
        sure = form.possible_steps(6, window, SIZE, BEFORE, *told, len(leaping.swaps), most, room, found)
        steps, swaps, misfits = ratios(window, noise, leaping.swaps)
        assert sure == (max(steps) > leaping.least) + 2 * (max(swaps) > leaping.least)
        np.testing.assert_allclose(found, misfits, atol=1e-5)
        seen.add(sure)
    assert seen == {0, 1, 2, 3}


def test_when_all_of_them_are_hit_none_stepped(leaping):
    """The tooth meets a stone: the boom's head side falls by 70 bar within 30 ms, its rod side by 10 at once."""
    window = smooth(np.random.default_rng(7))
    window[BEFORE - 1 :, 0] -= 70.0 * BAR * np.clip(np.arange(AFTER + 1) / 3.0, 0.0, 1.0)
    window[BEFORE:, 1] += 10.0 * BAR
    assert leaping.suspicion(window) == NOTHING_SUSPECTED
    window[:, 0] = LEVELS[0]
    assert leaping.suspicion(window).cause is SensorFault.STEPPED


def detector(machine=None):
    """A detector of leaps before any reading."""
    service = load(EXCAVATOR).service
    model = Model(machine or service.machine, service.filters, ())
    return PressureStep.start(MonitoredMachine(model, model.data_sheet, 300e3))


def course(readings, steps=None, machine=None):
    """The detector after readings (T, 6) that come at steps."""
    leap = detector(machine)
    for k, row in zip(steps or range(1, len(readings) + 1), readings.tolist(), strict=True):
        leap.take(numbers(row), k, numbers(()))
    return leap


def test_a_leap_is_looked_for_as_readings_come():
    rng = np.random.default_rng(8)
    window = smooth(rng)
    long = np.concatenate([window[:1] + rng.normal(0.0, NOISE, (30, 6)), window])
    long[-AFTER:, 2] += 5.0 * BAR
    assert course(long[:-1]).report == NOTHING_SUSPECTED
    state = course(long)
    assert (state.report.cause, state.since) == (SensorFault.STEPPED, len(long))


def test_nothing_is_said_across_a_pause():
    window = smooth(np.random.default_rng(9))
    window[BEFORE:, 2] += 50.0 * BAR
    steps = [*range(1, BEFORE + 1), *range(BEFORE + AFTER + 2, BEFORE + 2 * AFTER + 2)]
    assert course(window, steps).report == NOTHING_SUSPECTED
    leap = course(window[:BEFORE])
    leap.interrupt(Interruption(frozen=False, out_of_range=()))
    assert not leap.readings


def test_a_reading_that_is_missing_does_not_matter():
    window = smooth(np.random.default_rng(9))
    window[BEFORE:, 2] += 50.0 * BAR
    for lost in (3, BEFORE + 2, SIZE - 2):
        steps = [k for k in range(1, SIZE + 1) if k != lost]
        state = course(np.delete(window, lost - 1, axis=0), steps)
        assert state.report.cause is SensorFault.STEPPED


def test_a_node_whose_frames_waited_has_not_leapt():
    """Five frames of a node are missing; of those that then come together the tick finds the oldest one, the next tick
    the newest. The pressure has changed by 10 bar between them."""
    rng, gone, size = np.random.default_rng(11), range(40, 45), 70
    rising = LEVELS + np.arange(size)[:, None] * np.array([2.0, 0.1, 0.0, 0.0, 0.0, 0.0]) * BAR
    readings = rising + rng.normal(0.0, NOISE, rising.shape)
    readings[gone.stop, 0] = readings[gone.start, 0]
    steps = [k for k in range(size) if k not in gone]
    assert course(readings[steps], steps).report == NOTHING_SUSPECTED


@pytest.mark.parametrize("late", [True, False])
def test_no_leap_is_concluded_beside_a_reading_that_is_late(late):
    """Its frame is still the one before."""
    window, leap = smooth(np.random.default_rng(12)), detector()
    window[BEFORE:, 2] += 50.0 * BAR
    for k, row in enumerate(window.tolist(), 1):
        seen = k - 1 if late and k == BEFORE else k
        leap.take(numbers(row), k, numbers([1e4 * seen] * len(row)))
    assert (leap.report == NOTHING_SUSPECTED) is late


def test_pressures_that_are_sent_every_other_step_are_read_so():
    """Else each value but the first of a motion would be a leap, or noise."""
    machine = load(EXCAVATOR).service.machine
    slower = replace(machine, signals=tuple(replace(s, period_s=0.02) for s in machine.signals))
    window = smooth(np.random.default_rng(10))
    assert course(np.repeat(window, 2, axis=0), machine=slower).readings == numbers(window.ravel())


def test_a_machine_without_pressures_has_no_leaps():
    leap = detector(replace(rig(), signals=()))
    for k in range(1, 40):
        leap.take(numbers(()), k, numbers(()))
    assert leap.report == NOTHING_SUSPECTED


@pytest.fixture(scope="module")
def work():
    """The excavator's service, identified, the events of two cycles, and how many there are."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    events, masses = cycles(loaded, count=2)
    return core, events, len(masses)


DIGS = 4.0  # s: the tool is in the ground, and any force possible


def test_exchanged_sides_are_doubted_at_once_in_the_ground(work):
    core, events, _ = work
    values = {}

    def remember(name):
        def change(t, value):
            values[name, t] = value
            return value

        return change

    for name in ("boom_head_pressure", "boom_rod_pressure"):
        with_value(events, core.service, name, remember(name))
    head = with_value(
        events, core.service, "boom_head_pressure", lambda t, v: values.get(("boom_rod_pressure", t), v), DIGS
    )
    both = with_value(
        head, core.service, "boom_rod_pressure", lambda t, v: values.get(("boom_head_pressure", t), v), DIGS
    )
    state, estimates, _ = through(core, [e for e in both if seconds(e) < DIGS + 1.0])
    begun = 1e-6 * estimates[0].t_us
    after = [e for e in estimates if 1e-6 * e.t_us > begun + DIGS + 0.1]
    assert len(after) > 80
    assert all(e.force.x.status is not Status.OK and e.gross.status is not Status.OK for e in after)
    assert after[-1].force.x.reason is Reason.SENSORS_DISAGREE
    assert state.monitor.suspicion.level is not Level.FINE


def test_a_leap_that_was_none_is_taken_back_in_the_air_and_its_bucket_booked(work):
    """A pressure that is 10 bar higher for a second of digging only."""
    core, events, count = work
    spoilt = with_value(events, core.service, "stick_rod_pressure", lambda _, v: v + 10.0 * BAR, DIGS, DIGS + 1.0)
    cut = [e for e in spoilt if seconds(e) < DIGS + 0.5]
    state, estimates, _ = through(core, cut)
    assert state.monitor.suspicion.cause is SensorFault.STEPPED
    assert estimates[-1].force.x.reason is Reason.SENSORS_DISAGREE
    state, estimates, _ = through(core, spoilt)
    assert state.monitor.suspicion == NOTHING_SUSPECTED
    assert any(e.force.x.status is Status.OK for e in estimates[-1000:])
    assert state.estimate.booking.number == count


def listens(course, stated=np.inf):
    """Whose noise is gone after each group of readings (T,), and the state then."""
    constants, state, found = GroupConstants(rig()), GroupStatistics.start(1), []
    constants.signals, constants.stated = [0], numbers([stated**2])
    for group in course.reshape(-1, GROUP):
        state.take(constants, numbers(group), numbers([1.0]), np.array([True]))
        found.append(bool(state.gone[0]))
    return found, state


def moving(rng, groups=100):
    return 20.0 * np.sin(0.02 * np.arange(groups * GROUP)) + rng.normal(0.0, 1.0, groups * GROUP)


@pytest.mark.parametrize(("noise", "within"), [(0.2, 1), (0.5, 4)])
def test_noise_that_is_gone_is_missed(noise, within):
    """A fifth of it in half a second, half of it in one and a quarter."""
    rng = np.random.default_rng(11)
    course = moving(rng)
    found, _ = listens(np.concatenate([course, course[-1] + noise * rng.normal(0.0, 1.0, 20 * GROUP)]))
    assert not any(found[:100])
    assert all(found[100 + within :])


def test_noise_is_learnt_anew_when_the_pressure_changes_nevertheless():
    rng = np.random.default_rng(12)
    course = moving(rng)
    _, state = listens(np.concatenate([course, course[-1] + rng.normal(0.0, 0.2, 20 * GROUP)]))
    assert state.since[0] > GROUPS
    state.learn_anew(np.array([False]))
    assert state.gone.all()
    state.learn_anew(np.array([True]))
    assert not state.gone.any()
    assert not state.known.any()


def test_more_noise_than_the_sensor_states_is_the_oils():
    """Of which less says nothing of the sensor."""
    rng = np.random.default_rng(15)
    quieter = np.concatenate([moving(rng), rng.normal(0.0, 0.5, 4 * GROUP)])
    assert any(listens(quieter)[0])
    assert any(listens(quieter, 1.0)[0])
    assert not any(listens(quieter, 0.5)[0])


def test_a_pressure_that_rests_keeps_its_noise():
    rng = np.random.default_rng(13)
    assert not any(listens(rng.normal(0.0, 1.0, 2000 * GROUP))[0])


def test_digits_are_no_noise():
    """A value that toggles, at most, between two digits."""
    rng = np.random.default_rng(14)
    course = np.round(20.0 * np.sin(0.02 * np.arange(100 * GROUP)) + rng.normal(0.0, 0.2, 100 * GROUP))
    resting = (rng.uniform(size=20 * GROUP) < 0.01).astype(float)
    assert not any(listens(np.concatenate([course, resting]))[0])
    assert CODES == 2


def test_the_limits_of_noise_are_the_quantiles_that_they_are_said_to_be():
    tests = 36000.0 * 4 * 6 * len(QUIET)
    for n, limit in enumerate(QUIET, 1):
        free = n * GROUP - 1
        assert chi2.ppf(1.0 / tests, free) / free == pytest.approx(limit, rel=1e-4)
    rows = np.zeros((GROUP - 2, GROUP))
    for k in range(GROUP - 2):
        rows[k, k : k + 3] = 1.0, -2.0, 1.0
    spread = rows @ rows.T
    free = np.trace(spread) ** 2 / (spread**2).sum()
    assert chi2.ppf(0.1, free) / free == pytest.approx(TENTH, rel=1e-4)
