"""Sensors that contradict each other: what each view says of made-up readings, and what the service then publishes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, f

from cylforce.files.checkpoint import packed, unpacked_state
from cylforce.service.adaptation import DriftFilter
from cylforce.service.core import Core
from cylforce.service.loading.lift import lift_numbers
from cylforce.service.plausibility.blocks import Block, cost, no_blocks
from cylforce.service.plausibility.detectors.constant_error import (
    KEPT,
    UNSURE,
    VOTES,
    ConstantError,
    ConstantOffset,
    VoteConstants,
)
from cylforce.service.plausibility.detectors.driven_tool import LEAST, DrivenTool
from cylforce.service.plausibility.detectors.empty_bucket import EmptyBucket
from cylforce.service.plausibility.detectors.fallen import BelowVacuum, BurstHose
from cylforce.service.plausibility.detectors.frozen_pressure import CONSTANT, FrozenPressure
from cylforce.service.plausibility.detectors.swept_tool import SweptTool
from cylforce.service.plausibility.monitor import Monitor
from cylforce.service.plausibility.pressure_groups import CHANGES, COLOURED, GROUP, GROUPS, PressureGroups
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Force, Quantity, Reason, Status, invalid
from cylforce.signals.kinds import Kind
from cylforce.simulation.trajectory import JointCourse, Move
from faulting.edits import BAR, Fault, edited, named
from machines import excavator, stick_and_bucket
from rig import monitored, readings, rig, stepped
from scenarios import EXCAVATOR, cycles, fed, identified, played, scene, through, with_value

STEPS, NONE = GROUP * GROUPS, np.zeros(0)


def pressure(course, ways=(1.0, -1.0)):
    """What is seen of a rig's head pressure along `course` (T,) [Pa] while the cylinder goes first one way, then the
    other."""
    machine = monitored(rig())
    stuck, burst, groups = FrozenPressure.start(machine), BurstHose.start(machine), PressureGroups.start(machine.groups)
    values = readings(len(course), head=course, rod=1e6)
    speed = np.repeat(ways, len(course) // len(ways)) * 0.1
    for row, v in zip(values, speed, strict=True):
        stepped(burst, groups, row, [v])
        stuck.on_step(SimpleNamespace(groups=groups))
    return bool(stuck.marked[0]), bool(burst.marked[0])


def noisy(course, seed=1):
    """With the noise of a sensor, 0.1 bar."""
    return course + np.random.default_rng(seed).normal(0.0, 0.1 * BAR, len(course))


def test_a_pressure_that_does_not_change_when_its_cylinder_turns_is_stuck():
    assert pressure(noisy(np.full(STEPS, 20e5))) == (True, False)
    turned = np.repeat((20e5, 20.3e5), STEPS // 2)
    assert pressure(noisy(turned)) == (False, False)


def test_a_pressure_that_oscillates_about_a_mean_is_not_stuck():
    """Oil between a heavy arm and its valve: 8 Hz, 3 bar, far above the noise of the sensor."""
    course = 15e5 + 3.0 * BAR * np.sin(2.0 * np.pi * 8.0 * np.arange(STEPS) / 100.0)
    assert np.ptp(course.reshape(-1, GROUP).mean(axis=1)) < 0.1 * BAR  # its means do not change
    assert pressure(noisy(course)) == (False, False)


def test_a_pressure_is_not_stuck_before_its_cylinder_has_turned():
    assert pressure(noisy(np.full(STEPS, 20e5)), ways=(1.0,)) == (False, False)


@pytest.mark.parametrize(("steps", "burst"), [(4, True), (40, False)])
def test_a_hose_has_burst_when_the_pressure_falls_at_once(steps, burst):
    falling = np.clip(1.0 - np.arange(STEPS) / steps, 0.0, 1.0)
    assert pressure(90e5 * falling, ways=(1.0,))[1] is burst


@pytest.mark.parametrize(("bar", "below"), [(-3.0, True), (-1.5, False)])
def test_no_pressure_stays_below_vacuum(bar, below):
    """A sensor's zero may be off by a bar, so that vacuum shows as two."""
    machine = monitored(rig())
    vacuum, burst = BelowVacuum.start(machine), BurstHose.start(machine)
    groups = PressureGroups.start(machine.groups)
    for row in readings(STEPS, head=noisy(np.full(STEPS, bar * BAR)), rod=1e6):
        stepped(vacuum, groups, row, [0.0])
        burst.on_step(SimpleNamespace(groups=groups))
    assert (bool(vacuum.marked[0]), bool(burst.marked[0])) == (below, False)


def test_a_pressure_that_dips_is_no_burst():
    course = np.full(STEPS, 90e5)
    course[100:103] = 0.0
    assert not pressure(noisy(course), ways=(1.0,))[1]


def test_a_pressure_that_falls_to_that_of_the_return_line_is_no_burst():
    assert not pressure(np.repeat((90e5, 3e5), STEPS // 2))[1]


def acting(x, z):
    """A force with standard errors of 100 N."""
    parts = [Quantity(value, 100.0, Status.OK, Reason.NONE) for value in (x, z)]
    return Force(*parts, *parts, (1e4, 0.0, 1e4))


@pytest.mark.parametrize(
    ("force", "velocity", "driven"),
    [
        (acting(30e3, 0.0), 0.5 + 0j, True),
        (acting(-30e3, 0.0), 0.5 + 0j, False),  # soil resists
        (acting(0.0, -15e3), -0.5j, False),  # a load hangs, and is lowered
        (acting(0.0, -150e3), -0.5j, True),  # no load is as heavy
        (replace(acting(2e3, -10e3), covariance=(1e4, 4e4, 2e5)), -0.4 + 0.9j, False),  # lifted, and resists
        (acting(0.0, 15e3), 0.5j, True),  # no load pulls upwards
        (acting(400.0, 0.0), 0.5 + 0j, False),
        (acting(6.5e3, 0.0), 0.5 + 0j, True),  # 2 % of the rated force
        (acting(5.5e3, 0.0), 0.5 + 0j, False),
        (acting(30e3, 0.0), 0.04 + 0j, False),  # too slow to have a direction
    ],
)
def test_surroundings_do_not_drive_the_tool(force, velocity, driven):
    tool = DrivenTool.start(monitored(rig(), 200.0))
    for _ in range(20):
        tool.take(force, velocity, np.array([1e4]))
    assert (tool.level is Level.REJECTED) is driven


def test_a_fast_arm_that_stops_is_not_driven():
    """Its inertia shows at one sample, which stands for 0.3 m of path; what drives it is there at the next, too."""
    for pushes, driven in (((30e3, 0.0, 0.0), False), ((30e3, 30e3), True)):
        tool, levels = DrivenTool.start(monitored(rig())), []
        for push in (0.0, *pushes):
            tool.take(acting(push, 0.0), 1.5 + 0j, np.array([1e4]))
            levels.append(tool.level)
        assert (max(levels) > Level.FINE) is driven


def test_a_machine_that_drives_is_pushed_by_the_heap():
    """Also where the errors of both parts go together: how it pushes says nothing of the mass that is lifted."""
    heap = replace(acting(-40e3, -5e3), covariance=(1e6, -5e5, 1e6))
    cases = ((acting(30e3, 0.0), 0.5 + 0j, False), (acting(0.0, 15e3), 0.5j, True), (heap, 0.3j, False))
    for force, velocity, driven in cases:
        tool = DrivenTool.start(monitored(replace(rig(), signals=()), 200.0))
        for _ in range(20):
            tool.take(force, velocity, np.array([1e4]))
        assert (tool.level is Level.REJECTED) is driven


def test_a_gyro_on_a_loader_does_not_say_that_it_stands():
    """It measures how the loader steers: what pushes horizontally may be the heap."""
    for arm, driven in ((stick_and_bucket(), False), (excavator(), True)):
        tool = DrivenTool.start(monitored(arm, 200.0))
        for _ in range(20):
            tool.take(acting(30e3, 0.0), 0.5 + 0j, np.ones(len(arm.rows)))
        assert (tool.level is Level.REJECTED) is driven


@pytest.mark.parametrize(
    ("beside", "driven"),
    [
        (acting(0.0, 0.0), False),  # all of it is the load's
        (acting(30e3, 0.0), True),
        (replace(acting(0.0, 0.0), x=invalid(Reason.SINGULAR)), False),
    ],
)
def test_the_force_of_a_weighed_load_drives_nothing(beside, driven):
    tool = DrivenTool.start(monitored(rig(), 200.0))
    for _ in range(20):
        tool.take(acting(30e3, -15e3), 0.5 + 0j, np.array([1e4]), beside)
    assert (tool.level is Level.REJECTED) is driven


def test_a_load_that_is_reached_out_while_the_house_slews_drives_nothing(machine):
    """At 0.9 rad/s 1400 kg pull outwards with up to 7 kN, in the direction in which the stick reaches."""
    core, *_ = machine
    strokes = [(0, 1.0, 3.0, 0.2), (1, 3.0, 4.0, 0.1), (0, 4.5, 6.5, -0.15), (1, 7.0, 10.0, 1.1), (1, 10.5, 12.5, -0.9)]
    swung = scene(np.radians([15.0, -110.0, -110.0]), strokes, 14.0, 1400.0)
    swung = swung._replace(slew=JointCourse(0.0, (Move(5.0, 12.0, 3.36),)))
    state, estimates, _ = through(core, played(load(EXCAVATOR), [swung]))
    outwards = [e.force.x.value for e in estimates if e.force.x.status is not Status.INVALID]
    assert max(outwards) > driven_least(core)
    assert state.monitor.suspicion == NOTHING_SUSPECTED
    assert {e.gross.status for e in estimates[800:1200]} == {Status.OK}


def driven_least(core):
    """The smallest force [N] that counts as a push."""
    return LEAST * core.monitor.rated_force


def slews(rate):
    """The last three channels, of which the last one is the slew rate or angle."""
    return np.array([[0.0, rate(k)] for k in range(3)])


@pytest.mark.parametrize(
    ("kind", "course"), [(Kind.SLEW_RATE, lambda _: -0.45), (Kind.SLEW_ANGLE, lambda k: 2.0 - 0.0045 * k)]
)
def test_nothing_is_swept_through_the_ground(kind, course):
    """Nearly half a radian a second: the third second that no load explains is one too many; one that a load does ends
    it, rest and reversing do not."""
    signal = replace(rig().signals[0], kind=kind)
    tool, levels = SweptTool.start(monitored(replace(rig(), signals=(signal,)))), []
    for explained in (False, None, False, False, True, *[False] * 7):
        for _ in range(5):
            tool.slew(slews(course))
        tool.end_block(explained)
        levels.append(tool.level)
    assert tool.fast
    found = [0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1, 2]
    assert levels == [Level(k) for k in found]


def test_without_a_slew_sensor_nothing_is_swept():
    tool = SweptTool.start(monitored(replace(rig(), signals=())))
    tool.slew(slews(lambda _: 5.0))
    assert (tool.running, tool.fast) == (0.0, False)


def test_a_force_without_a_value_drives_nothing():
    tool = DrivenTool.start(monitored(rig(), 200.0))
    for _ in range(20):
        tool.take(replace(acting(30e3, 0.0), x=invalid(Reason.SINGULAR)), 1.0 + 0j, np.array([1e4]))
    assert (tool.path, tool.drives) == (0.0, False)


@pytest.fixture(scope="module")
def machine():
    """The excavator's service, identified, and the events of two cycles."""
    loaded = load(EXCAVATOR)
    core = Core(loaded.service, identified(loaded))
    return core, *cycles(loaded, count=2)


def block(core, left, signal, size, information=4.0):
    """A block that leaves `left` times its 15 samples as it is, and nothing with an error of `size` of one signal."""
    many = core.monitor.blocks.size
    linear, square = np.zeros(many), np.full(many, 1e-3)
    square[signal], linear[signal] = information, information * size
    numbers = (np.array([x]) for x in (max(left * 15.0, information * size**2), 100.0, 5.0, 15.0))
    return Block(*numbers, linear, square, np.full(many, 30.0))


def evidence(core, blocks):
    """What these blocks say."""
    votes, all_blocks = VoteConstants(core.monitor), no_blocks(core.monitor.blocks.size)
    for each in blocks:
        all_blocks = all_blocks.followed_by(each, KEPT)
    return votes.likeliest(all_blocks), votes.limits[Level.REJECTED]


def test_several_seconds_must_agree_on_the_error_of_a_signal(machine):
    core, *_ = machine
    wrong = block(core, 0.0, 1, 4.0)
    for count in (1, VOTES - 1, VOTES + 1):
        offset, limit = evidence(core, [wrong] * count)
        assert (offset.evidence > limit) is (count > VOTES)
        assert (offset.signal, offset.size) == (1, pytest.approx(4.0))


def test_seconds_that_contradict_each_other_reject_nothing(machine):
    core, *_ = machine
    offset, _ = evidence(core, [block(core, 0.0, 1, size) for size in (4.0, -4.0, 8.0, -8.0, 12.0, 16.0)])
    assert offset.evidence < VoteConstants(core.monitor).limits[Level.SUSPECTED]


def test_torques_that_scatter_more_than_at_commissioning_say_less(machine):
    """Of two blocks the one whose best error leaves four times its variance has a quarter of the votes."""
    core, *_ = machine
    calm = block(core, 0.0, 1, 1.0, information=6.0)
    rough = replace(calm, residual=calm.residual + 4.0 * calm.weight)
    (one, _), (other, _) = evidence(core, [calm]), evidence(core, [rough])
    assert one.evidence == pytest.approx(4.0 * other.evidence)
    assert one.evidence > 0.0


OFF, SECONDS = 3.0, 10  # standard errors by which friction is off, or bar of a pressure; seconds of motion


def second(core, way, friction, error):
    """A second in which all cylinders move one `way`. The boom's friction is off by `friction` (standard errors of
    everyday changes), its pressure by `error` (bar): while it extends both change its torque alike."""
    many, frictions = core.monitor.blocks.size, core.monitor.blocks.frictions
    columns = np.full((15, frictions + many + 1), 1e-3)  # the other signals and frictions change nothing
    columns[:, 0], columns[:, frictions] = way, 1.0
    columns[:, -1] = way * friction + error
    rows = columns.T @ columns
    own = rows - np.outer(rows[0], rows[0]) / (rows[0, 0] + 1.0)  # with a friction of the block's own
    linear, square = own[frictions:-1, -1], np.maximum(np.diagonal(own)[frictions:-1], 1e-9)
    numbers = (np.array([x]) for x in (own[-1, -1], 100.0, 5.0, 15.0))
    masses, friction_prior = np.zeros(len(rows)), np.stack([np.zeros(frictions), np.ones(frictions)])
    masses[-1] = 100.0
    ways = np.full(len(core.service.machine.cylinders), 0.1 * way)
    return Block(*numbers, linear, square, np.full(many, 30.0), rows, masses, friction_prior, ways)


@pytest.mark.parametrize(
    ("ways", "friction", "error", "rejected"),
    [
        ((1.0,), OFF, 0.0, False),  # one friction that is paid for once explains it
        ((1.0, -1.0), OFF, 0.0, False),
        ((1.0, -1.0), 0.0, OFF, True),  # no friction acts alike both ways
    ],
)
def test_cold_oil_is_one_friction_for_all_seconds(machine, ways, friction, error, rejected):
    """Paid for anew each second it was evidence that a signal is off."""
    core, *_ = machine
    blocks = [second(core, ways[k % len(ways)], friction, error) for k in range(SECONDS)]
    offset, limit = evidence(core, blocks)
    assert (offset.evidence > limit, offset.confirmed) == (rejected, rejected)
    anew = [replace(each, rows=NONE, masses=NONE, friction_prior=NONE) for each in blocks]
    assert (evidence(core, anew)[0].evidence > limit) is (len(ways) == 1 or rejected)


def test_contact_does_not_vote(machine):
    core, *_ = machine
    contact = block(core, 50.0, 1, 0.1)
    assert cost(contact, 0.0, 1500.0)[0] == cost(contact, 4.0, 1500.0)[0]
    assert evidence(core, [contact] * 20)[0].evidence == 0.0


@pytest.fixture(scope="module")
def spoilt(machine):
    """States and estimates along the work with 60 bar less on the boom's head side from the first load's lift on."""
    core, events, _ = machine
    less = with_value(events, core.service, "boom_head_pressure", lambda t, value: max(value - 60e5, 2e5), 10.0)
    return through(core, less)


def test_work_in_order_is_never_doubted(machine):
    core, events, masses = machine
    state, estimates, _ = through(core, events)
    assert state.monitor.suspicion == NOTHING_SUSPECTED
    assert not any(e.gross.reason is Reason.SENSORS_DISAGREE for e in estimates)
    assert state.estimate.booking.number == len(masses)


def test_a_rejected_signal_leaves_neither_weight_nor_force_nor_bookings(spoilt):
    state, estimates, _ = spoilt
    assert state.monitor.suspicion.level is Level.REJECTED
    last = estimates[-1]
    for quantity in (last.gross, last.net, *last.force.quantities, *last.soil.quantities):
        assert quantity.status is Status.INVALID
        assert quantity.reason is Reason.SENSORS_DISAGREE
    assert last.booking is None


def test_the_boom_is_named(machine, spoilt):
    core, *_ = machine
    state, *_ = spoilt
    names = {core.service.machine.signals[k].name for k in state.monitor.suspicion.signals}
    assert "boom_head_pressure" in names
    assert names <= {"boom_head_pressure", "boom_rod_pressure"}


def test_what_is_suspected_is_stored_with_the_state(spoilt):
    state, *_ = spoilt
    again = WeighingService.start(state.core)
    again.restore(unpacked_state(again.types(), packed(state.snapshot())))
    assert again.monitor.suspicion == state.monitor.suspicion


def test_with_some_evidence_that_a_signal_is_off_nothing_is_ok_and_no_booking_made(machine):
    core, events, masses = machine
    some = ConstantOffset(0, 5.0, 1.01 * UNSURE, True)
    state = WeighingService.start(core)
    votes = state.monitor.detector(ConstantError)
    votes.offset = some
    votes.constants = SimpleNamespace(likeliest=lambda blocks: some, suspicion=votes.constants.suspicion)
    outcomes = [fed(state, event) for event in events]
    estimates = [out.estimate for out in outcomes if out.estimate is not None]
    for shown in ({e.gross.status for e in estimates}, {e.force.x.status for e in estimates}):
        assert shown == {Status.DEGRADED, Status.INVALID}
    assert state.monitor.suspicion == NOTHING_SUSPECTED
    assert state.estimate.booking is None
    assert state.bookings.missed.number == len(masses) - 1


@pytest.mark.parametrize("number", range(6))
def test_the_signals_that_may_be_off_are_named(machine, number):
    """The gatherer's signals: forces of the cylinders, then angles."""
    core, *_ = machine
    votes = VoteConstants(core.monitor)
    limits = votes.limits
    names = [s.name for s in core.service.machine.signals]
    part = ("boom", "stick", "bucket")[number % 3]
    whose = [f"{part}_head_pressure", f"{part}_rod_pressure"] if number < 3 else [f"{part}_angle"]
    for level, evidence in (
        (Level.SUSPECTED, limits[Level.SUSPECTED] + 0.1),
        (Level.REJECTED, limits[Level.REJECTED] + 0.1),
    ):
        suspicion = votes.suspicion(ConstantOffset(number, 0.5, evidence))
        assert suspicion.level is level
        assert [names[k] for k in suspicion.signals] == whose
        assert suspicion.size == (0.5 * BAR if number < 3 else 0.5)
    assert votes.suspicion(ConstantOffset(number, 0.5, limits[Level.SUSPECTED])) == NOTHING_SUSPECTED


def test_evidence_of_a_time_with_a_frozen_signal_is_dropped_unless_a_signal_is_doubted(machine):
    core, *_ = machine
    some = ConstantOffset(0, 5.0, 1.01 * UNSURE, True)
    for frozen, level, kept in (
        (False, Level.FINE, True),
        (True, Level.FINE, False),
        (True, Level.SUSPECTED, True),
    ):
        monitor = Monitor.start(core.monitor)
        monitor.detector(ConstantError).offset = some
        monitor.suspicion = SensorSuspicion(level)
        monitor.interrupt(frozen=frozen)
        assert (monitor.detector(ConstantError).offset == some) is kept
        assert monitor.unsure is kept


def warm(core):
    """A drift of which a return has shown that there is none."""
    drift = DriftFilter.start(core.drift)
    drift.covariance, drift.returned = np.zeros_like(drift.covariance), True
    return drift


def test_a_bucket_that_weighs_less_than_nothing_is_doubted_until_it_is_seen_otherwise(machine):
    core, *_ = machine
    lift, drift = core.load.new_lift(), warm(core)

    def seen(bucket, kilograms, status=Status.OK, taken=200):
        after, lift.taken = EmptyBucket.start(core.monitor), taken
        after.restore(bucket.snapshot())
        sample = SimpleNamespace(gross=Quantity(kilograms, 10.0, status, Reason.NONE), lift=lift, drift=drift)
        after.on_sample(SimpleNamespace(now=sample))
        return after

    bucket = seen(EmptyBucket.start(core.monitor), -29.0)
    assert not bucket.fault
    first = seen(bucket, -31.0)
    assert not first.fault
    assert not seen(first, -31.0, taken=220).fault  # it may end yet
    assert not seen(seen(first, np.nan, Status.INVALID, 5), -31.0, taken=240).fault  # the lift ended: another one
    assert not seen(first, -31.0, taken=20).fault
    light = seen(first, -31.0, taken=240)
    for after in (light, seen(light, 500.0), seen(light, 0.0, Status.DEGRADED)):
        assert (after.report.level, after.report.cause) == (Level.SUSPECTED, SensorFault.NEGATIVE_WEIGHT)
        assert after.report.follows
    assert seen(light, -29.0).report == NOTHING_SUSPECTED


def test_until_a_return_told_of_the_drift_cold_oil_may_make_a_bucket_light(machine):
    """Of 10 kg of standard error 8 by a drift that may be five times as large: 49 kg is below three, 150 kg is not."""
    core, *_ = machine
    lift, size = core.load.new_lift(), len(core.model.parameters) + len(core.model.changing)
    gram = np.zeros((4, size))
    gram[0, -1] = 8.0
    lift.numbers = lift_numbers(lift.root, gram, (np.zeros(4), np.diag([1.0, 0.0, 0.0, 0.0])))
    drift = DriftFilter.start(core.drift)
    drift.covariance = np.diag([0.0] * (len(core.model.changing) - 1) + [1.0])
    for kilograms, returned, light in ((-49.0, False, False), (-150.0, False, True), (-49.0, True, True)):
        drift.returned = returned
        gross, bucket = Quantity(kilograms, 10.0, Status.OK, Reason.NONE), EmptyBucket.start(core.monitor)
        for lift.taken in (200, 240):
            bucket.take(gross, lift, drift)
        assert bool(bucket.fault) is light


@pytest.mark.parametrize(
    ("moments", "error", "returned", "cause"),
    [
        ((0.0, 0.0, 60.0), 4.0, True, SensorFault.IMPOSSIBLE_MOMENTS),
        ((0.0, 0.0, 10.0), 1.0, True, SensorFault.NONE),  # harmless: 1 % of the rated payload where a load lies is more
        ((45.0, 0.0, 60.0), 4.0, True, SensorFault.NONE),  # mud in the corner of the bucket
        ((0.0, 0.0, 60.0), 40.0, True, SensorFault.NONE),  # not known
        ((0.0, 0.0, 60.0), 4.0, False, SensorFault.NONE),  # cold oil, of which no return has told
    ],
)
def test_an_empty_bucket_has_no_moments_without_a_mass(machine, moments, error, returned, cause):
    core, *_ = machine
    lift, size = core.load.new_lift(), len(core.model.parameters) + len(core.model.changing)
    gram = np.zeros((4, size))
    gram[2, -1] = 6.0 / error**2  # a drift of one standard error moves z by 6 kg m
    covariance = np.diag([4.0, error**2, error**2, 100.0])
    lift.numbers = lift_numbers(lift.root, gram, (np.array([*moments, 0.0]), covariance))
    drift = DriftFilter.start(core.drift)
    drift.covariance = np.diag([0.0] * (len(core.model.changing) - 1) + [1.0])
    drift.returned = returned
    gross, bucket = Quantity(moments[0], 5.0, Status.OK, Reason.NONE), EmptyBucket.start(core.monitor)
    for lift.taken in (200, 240):
        bucket.on_sample(SimpleNamespace(now=SimpleNamespace(gross=gross, lift=lift, drift=drift)))
        assert bucket.unsure is (cause is SensorFault.IMPOSSIBLE_MOMENTS)
    assert bucket.fault is bucket.report.cause is cause
    assert not bucket.report.follows or cause is SensorFault.NONE


@pytest.mark.parametrize(
    ("cause", "confirmed", "stays"),
    [
        (SensorFault.BURST, False, True),
        (SensorFault.CONTRADICTS_MOTION, True, True),
        (SensorFault.CONTRADICTS_MOTION, False, False),
        (SensorFault.SLIPPED, True, True),
        (SensorFault.SLIPPED, False, False),
        (SensorFault.OFFSET, True, False),
    ],
)
def test_nothing_statistical_is_latched_that_is_not_confirmed_in_both_directions_of_motion(cause, confirmed, stays):
    rejected = SensorSuspicion(Level.REJECTED, cause, confirmed=confirmed)
    assert rejected.latched is stays
    assert not replace(rejected, level=Level.SUSPECTED).latched


def test_the_tool_must_be_driven_in_both_directions_to_be_confirmed():
    tool = DrivenTool.start(monitored(rig(), 200.0))
    for _ in range(20):
        tool.take(acting(30e3, 0.0), 0.5 + 0j, np.array([1e4]))
    assert tool.level is Level.REJECTED
    assert not tool.confirmed
    for _ in range(4):
        assert not tool.confirmed
        tool.take(acting(-30e3, 0.0), -0.1 + 0j, np.array([1e4]))
    for _ in range(30):
        tool.take(acting(-30e3, 0.0), -0.1 + 0j, np.array([1e4]))
    assert tool.confirmed


def test_exchanged_pressures_are_believed_again_when_seconds_in_the_air_are_explained(machine):
    """They push the tool in one direction of motion only: that nothing pushes in the other refutes nothing."""
    core, *_ = machine
    monitor = Monitor.start(core.monitor)
    pushed = SensorSuspicion(Level.REJECTED, SensorFault.CONTRADICTS_MOTION, (0, 1))
    monitor.suspicion = monitor.combined((pushed,))
    assert monitor.suspicion == pushed
    for monitor.in_air, level in ((0, Level.REJECTED), (VOTES - 1, Level.REJECTED), (VOTES, Level.FINE)):
        assert monitor.combined((NOTHING_SUSPECTED,)).level is level
    assert monitor.combined((pushed,)).level is Level.REJECTED


def test_the_faults_of_the_table_change_what_they_name(machine):
    core, *_ = machine
    values = np.random.default_rng(0).normal(50e5, 1e5, (200, len(core.service.machine.signals)))
    for fault in named(core.service.machine, 1.0).values():
        changed = edited(values, 100.0, fault, core.service.machine)
        where = set(np.flatnonzero((changed.values != values).any(axis=0)).tolist())
        assert where == set(changed.signals)
        assert np.array_equal(changed.values[:100], values[:100])
    with pytest.raises(ValueError, match="is no fault"):
        edited(values, 100.0, Fault("other", 0), core.service.machine)


def test_a_constant_with_noise_seldom_seems_to_change():
    """The limit is the quantile that it is said to be."""
    assert chi2.sf(CONSTANT * (GROUPS - 1), GROUPS - 1) == pytest.approx(0.02, rel=1e-4)
    assert f.sf(COLOURED, GROUP - 1, 12.1) == pytest.approx(0.02, rel=1e-3)
    assert chi2.sf(CHANGES * (GROUPS - 1), GROUPS - 1) == pytest.approx(1.0 / (36000.0 * 4 * 6), rel=1e-3)
