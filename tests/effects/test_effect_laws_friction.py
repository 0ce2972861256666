"""Laws of friction: each pinned to numbers worked out by hand."""

from dataclasses import replace
from math import pi, tanh

import numpy as np
import pytest

from cylforce.effects.friction.asymmetric_friction import AsymmetricFriction
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.end_cushion import EndCushion
from cylforce.effects.friction.friction import AtRest, Friction
from cylforce.effects.friction.friction_level_change import FrictionLevelChange
from cylforce.effects.friction.friction_temperature_drift import FrictionTemperatureDrift
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.presliding_hysteresis import PreslidingHysteresis
from cylforce.effects.friction.return_line_loss import ReturnLineLoss
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.friction.viscous_friction import ViscousFriction
from cylforce.effects.imposed import Imposed, excess_force, friction_level
from cylforce.effects.library import LIBRARY, proposals
from cylforce.estimation.model import Model
from cylforce.mechanics.installation import Filters
from cylforce.settings.machine_file import load
from rig import BAR, LEVER, ROD, rig, turning
from scenarios import EXCAVATOR

E_1 = 0.3678794  # 1/e


def law(effect, speed, force=0.0, t=0.0):
    """Force per unit of size at each speed [m/s]."""
    speeds = np.atleast_1d(np.asarray(speed, dtype=np.float64))
    return effect.force(speeds, np.broadcast_to(np.float64(force), speeds.shape), np.broadcast_to(t, speeds.shape))


def test_coulomb_friction_opposes_the_motion_with_one_force_at_any_speed():
    found = 2500.0 * law(CoulombFriction(rounding=0.002), [0.1, 0.2, -0.1, 0.0])
    np.testing.assert_allclose(found, [2500.0, 2500.0, -2500.0, 0.0])
    assert law(CoulombFriction(0.002), 0.002)[0] == pytest.approx(0.7615942)  # tanh(1)


def test_viscous_friction_is_in_proportion_to_the_speed():
    # 12 kN s/m at 0.25 m/s
    np.testing.assert_allclose(12e3 * law(ViscousFriction(), [0.25, 0.5, -0.25]), [3000.0, 6000.0, -3000.0])


def test_stribeck_friction_has_fallen_to_one_over_e_at_its_speed():
    found = 1500.0 * law(Stribeck(width=0.015), [0.015, -0.015, 0.030, 0.002, 0.3])
    slow = 1500.0 * 0.9823799 * 0.9993293  # exp(-(2/15)^2) tanh(2/0.5)
    np.testing.assert_allclose(found, [551.8192, -551.8192, 27.47346, slow, 0.0], rtol=1e-6, atol=1e-9)


def test_load_dependent_friction_is_a_share_of_the_force_whichever_way_it_pushes():
    # 3 % of 50 kN
    for force in (50e3, -50e3):
        np.testing.assert_allclose(0.03 * law(LoadDependentFriction(), [0.1, -0.1], force), [1500.0, -1500.0])
    assert 0.03 * law(LoadDependentFriction(), 0.2, 100e3)[0] == pytest.approx(3000.0)
    # at the force 1/e where it eases: 0.03 * 250 kN * (1 - 1/e)
    assert 0.03 * law(LoadDependentFriction(easing=4e-6), 0.1, -250e3)[0] == pytest.approx(7500.0 * 0.6321206)


def test_asymmetric_friction_has_the_same_sign_both_ways_and_none_at_rest():
    np.testing.assert_allclose(1500.0 * law(AsymmetricFriction(), [0.1, -0.1, 0.0]), [1500.0, 1500.0, 0.0])


def test_friction_larger_one_way_only_is_none_the_other_way():
    """Extending it opposes the motion with 1500 N more, retracting likewise with the other sign; twice as much as the
    symmetric part of the same difference is plausible."""
    for way, expected in ((1, [1500.0, 0.0, 0.0]), (-1, [0.0, -1500.0, 0.0])):
        np.testing.assert_allclose(1500.0 * law(AsymmetricFriction(way=way), [0.1, -0.1, 0.0]), expected)
        assert AsymmetricFriction(way=way).about.high == 2.0 * AsymmetricFriction().about.high
        assert AsymmetricFriction(way=way).of_dry == 2.0 * AsymmetricFriction().of_dry == 2.0


def test_a_cushion_stops_the_motion_into_its_end_only():
    """5 m of 5.06 m, with a cushion of 0.12 m: half entered. At 0.2 m/s, twice the speed at which it is told, four
    times the force: 2 of 1 kN, at 2.4 m 4800 N m. Out of the end, and at the other end, nothing."""
    machine = rig()
    cylinder = replace(machine.cylinders[0], length_low=3.0, length_high=5.06)
    near = replace(machine, cylinders=(cylinder,))
    moving, t = turning(near, [0.2 / LEVER, -0.2 / LEVER, 0.0]), np.zeros(3)
    for end in (1, 0):
        found = 1000.0 * EndCushion(0.12, end).torque(near, moving, t, 0)[:, 0]
        np.testing.assert_allclose(found, [4800.0, 0.0, 0.0], atol=1e-9)
    assert not np.any(EndCushion(0.12, -1).torque(near, moving, t, 0))
    short = replace(machine, cylinders=(replace(cylinder, length_low=4.94, length_high=7.0),))
    found = 1000.0 * EndCushion(0.12, -1).torque(short, moving, t, 0)[:, 0]
    np.testing.assert_allclose(found, [0.0, -4800.0, 0.0], atol=1e-9)


def test_presliding_friction_builds_up_over_its_way_and_twice_as_much_after_a_reversal():
    """5 kN over 1 mm. From rest at 1 mm/s it lacks 1/e after 1 mm. After ten times the way it lacks nothing. Reversed,
    the bristle still pushes the old way: 1 mm later twice 1/e is missing."""
    dt, effect = 1e-3, PreslidingHysteresis(way=0.001, slack=0.0, rounding=1e-9)
    speed = np.repeat([0.001, -0.001], 10_000)
    found = 5000.0 * effect.force(speed, 0.0 * speed, dt * np.arange(len(speed)))
    assert found[999] == pytest.approx(-5000.0 * 0.3678794)
    assert found[9999] == pytest.approx(0.0, abs=0.3)  # 5000 exp(-10) = 0.227
    # np.gradient gives the step at the reversal no way at all (the mean of both speeds), nor the one before it
    moved = 1000 - 1
    assert found[10_000 + moved] == pytest.approx(2 * 5000.0 * 0.3678794, rel=2e-3)


def test_presliding_friction_does_not_follow_a_sensors_noise():
    """A tremble of less than the slack bends no bristle."""
    t = np.arange(0.0, 1.0, 1e-3)
    speed = 0.0001 * 2 * pi * 20.0 * np.cos(2 * pi * 20.0 * t)  # 0.1 mm to and fro
    found = PreslidingHysteresis(way=0.001, slack=0.0002).force(speed, 0.0 * t, t)
    np.testing.assert_allclose(found + np.tanh(speed / 0.0005), 0.0, atol=1e-12)


def test_the_loss_of_two_bar_at_the_return_grows_with_the_square_of_the_speed():
    """2 bar on 60 cm^2 at 0.3 m/s are 1200 N. At twice the speed 4800 N, or with Blasius' power 2^1.75 = 3.3636 times
    as much, or twice as much where the flow is laminar; the loss opposes the motion."""
    size = 2 * BAR * ROD
    both = sum(law(ReturnLineLoss(way, 2.0), [0.3, 0.6, -0.3]) for way in (1, -1))
    np.testing.assert_allclose(size * both, [1200.0, 4800.0, -1200.0])
    np.testing.assert_allclose(size * law(ReturnLineLoss(power=1.0), [0.3, 0.6]), [1200.0, 2400.0])
    blasius = law(ReturnLineLoss(power=1.75), [0.6, 0.3])
    assert blasius[0] / blasius[1] == pytest.approx(3.363586)


def test_a_loss_on_the_rod_side_acts_when_the_cylinder_extends():
    """Oil leaves the rod side while the cylinder extends: one size for each direction."""
    size = 2 * BAR * ROD
    np.testing.assert_allclose(size * law(ReturnLineLoss(1), [0.3, -0.3]), [1200.0, 0.0])
    np.testing.assert_allclose(size * law(ReturnLineLoss(-1), [0.3, -0.3]), [0.0, -1200.0])


def test_a_law_is_switched_on_for_a_time_and_in_newtons():
    """12 kN s/m at 0.1 rad/s * 2.4 m = 0.24 m/s: 2880 N from second 1 to second 3."""
    t = np.array([0.5, 1.0, 2.9, 3.0])
    effect = Imposed((ViscousFriction(),), "lift", 0, (12e3,), 1.0, 3.0)
    np.testing.assert_allclose(excess_force([effect], turning(rig(), [0.1] * 4), t)[:, 0], [0.0, 2880.0, 2880.0, 0.0])


def test_friction_of_a_larger_level_is_the_known_one_times_that():
    effect = Imposed((FrictionLevelChange(),), "lift", 0, (0.3,))
    for name in ("coulomb", "viscous", "load_dependent"):
        np.testing.assert_allclose(friction_level([effect], 1, np.zeros(2), name), 1.3)


def test_friction_falls_as_the_oil_warms():
    """Half of it in the end: after the oil's time of 900 s 1 - 1/e of the way, in both cylinders; alone, in one. Where
    only the viscous part falls, dry friction stays. After a cold start half as much again is left of it by 1/e."""
    t, way = np.array([0.0, 900.0, 1e6]), np.array([0.0, 1.0 - E_1, 1.0])
    for effect, name, both, size, course in [
        (FrictionTemperatureDrift(), "coulomb", True, -0.5, way),
        (FrictionTemperatureDrift(viscous=True), "viscous", True, -0.5, way),
        (FrictionTemperatureDrift(viscous=True), "coulomb", True, -0.5, 0.0 * way),
        (FrictionTemperatureDrift(alone=True), "coulomb", False, -0.5, way),
        (FrictionTemperatureDrift(cold=True), "coulomb", True, 0.5, 1.0 - way),
    ]:
        found = friction_level([Imposed((effect,), "any", 0, (size,))], 2, t, name)
        np.testing.assert_allclose(found[:, 0], 1.0 + size * course, rtol=1e-6)
        np.testing.assert_allclose(found[:, 1], 1.0 + size * course * both, rtol=1e-6)


@pytest.mark.parametrize("foot", [-4j, 4j], ids=["lever +2.4 m", "lever -2.4 m"])
def test_friction_loads_the_joint_against_its_turn_whatever_the_sign_of_the_lever(foot):
    """3 kN at 2.4 m: 7200 N m against a turn either way."""
    column = Friction("coulomb", CoulombFriction(0.002)).halves(rig(foot), turning(rig(foot), [0.1, -0.1]))
    assert column.momentum is None
    np.testing.assert_allclose(3000.0 * column.static[:, 0, 0], [7200.0, -7200.0])


@pytest.mark.parametrize("foot", [-4j, 4j], ids=["lever +2.4 m", "lever -2.4 m"])
def test_at_rest_all_of_the_friction_is_unknown_whatever_the_sign_of_the_lever(foot):
    """At rest +- 3 kN at 2.4 m; at 0.24 m/s, where its direction is known, nothing; at the rounding's speed 1 - tanh 1
    of it."""
    rates = [0.0, 0.1, 0.002 / 2.4]
    column = AtRest(0.002).halves(rig(foot), turning(rig(foot), rates)).static[:, 0, 0]
    np.testing.assert_allclose(3000.0 * column, [7200.0, 0.0, 7200.0 * (1.0 - tanh(1.0))], atol=1e-9)


@pytest.mark.parametrize("foot", [-4j, 4j], ids=["lever +2.4 m", "lever -2.4 m"])
def test_a_row_at_rest_is_known_as_such_whatever_the_sign_of_the_lever(foot):
    """What keeps rows at rest out of the adaptation: all of the friction's lever is unknown at rest, none in motion."""
    model = Model(rig(foot), Filters(100.0, 5.0, 2.0, 2.0, 0.002), ("coulomb",))
    _, columns = model.filtered.regressor.both_halves(turning(rig(foot), [0.0, 0.1]))
    np.testing.assert_allclose(model.share_at_rest(columns)[:, 0], [1.0, 0.0], atol=1e-9)


def test_bristles_keep_their_bend_where_a_sensor_is_noisy_at_rest():
    t, rng = np.arange(0.0, 12.0, 0.05), np.random.default_rng(3)
    bristles, noise = PreslidingHysteresis(way=0.001), np.diff(rng.normal(0.0, 5e-5, len(t) + 1)) / 0.05
    for way, lacking in ((1.0, 0.0), (-1.0, 2.0)):
        speed = np.where(t < 4.0, 0.005, np.where(t < 8.0, 0.0, way * 0.005)) + noise
        force = bristles.force(speed, np.zeros_like(t), t)
        assert abs(way * force[t >= 8.0][1] + lacking) < 0.7
        assert np.max(np.abs(force[t > 10.0])) < 0.05


def test_friction_that_saturates_grows_with_small_loads_alone():
    loads = np.array([1e3, -1e3, 1e8])
    force = LoadDependentFriction(easing=3e-6).force(np.full(3, 0.5), loads, np.arange(3.0))
    np.testing.assert_allclose(force, [1e3, 1e3, 1.0 / 3e-6], rtol=0.01)


def test_masses_and_friction_while_moving_are_what_parameters_of_a_model_describe():
    machine = load(EXCAVATOR).service.machine
    assert {p.name for p in proposals(machine, LIBRARY) if p.of_parameters} == {
        "extra_mass",
        "first_moment_change",
        "mud",
        "coulomb_friction",
        "viscous_friction",
        "load_dependent_friction",
        "asymmetric_friction",
        "friction_level_change",
    }
