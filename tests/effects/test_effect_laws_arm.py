"""Laws of the arm as a whole - a springy link, soft ground, friction of pins, load-holding valves - pinned to numbers
worked out by hand or to an integration of their differential equations."""

from dataclasses import replace
from math import cos, hypot, pi, radians, sin

import numpy as np
import pytest

from cylforce.effects.friction.counterbalance_pressure import CounterbalancePressure
from cylforce.effects.friction.pin_friction import PinFriction
from cylforce.effects.geometry.ringing_compliance import RingingCompliance
from cylforce.effects.geometry.soft_ground import SoftGround
from cylforce.effects.loads.carried import smooth
from cylforce.effects.loads.rigid import Rigid
from cylforce.mechanics.bodies import bodies, resonance
from cylforce.mechanics.machine import base_parameters
from cylforce.mechanics.motion import Attitude, motion
from machines import excavator
from rig import LEVER, rig, turning

G = 9.80665  # m/s^2
INERTIA = 500.0 * 2.0**2  # kg m^2, of the rig's link about its pin


def moved(machine, t, angle):
    """Motion of the rig with its link at `angle` (T,) [rad], without cylinder force."""
    theta = np.broadcast_to(angle, t.shape)[:, None]
    return motion(machine, theta, np.gradient(theta[:, 0], t)[:, None], 0.0 * theta)


def two_masses(angle, t, frequency, damping):
    """Torque (T,) [N m] beyond the rigid one on a base that turns by `angle` (T,) [rad], of a link without weight on a
    spring: d'' + 2 D w d' + w^2 d = -angle'', integrated by Heun's method."""
    w, wanted = 2 * pi * frequency, np.gradient(np.gradient(angle, t), t)
    step, bent, rate, found = t[1] - t[0], 0.0, 0.0, np.zeros(len(t))
    for k in range(len(t)):

        def pull(b, r, k=k):
            return -wanted[min(k, len(t) - 1)] - 2 * damping * w * r - w * w * b

        found[k] = INERTIA * pull(bent, rate)
        ahead = bent + step * rate, rate + step * found[k] / INERTIA
        rate_mean = (rate + ahead[1]) / 2
        rate += step * (found[k] / INERTIA + pull(*ahead, k=k + 1)) / 2
        bent += step * rate_mean
    return found


@pytest.mark.parametrize("damping", [0.05, 0.3])
def test_a_springy_link_is_the_exact_answer_of_two_masses_on_a_spring(damping):
    """0.5 rad within 0.8 s, without gravity. The spring of 2 Hz has the compliance 1 / (I w^2)."""
    machine, t = replace(rig(), gravity=0.0), np.arange(0.0, 4.0, 1e-3)
    angle = 0.5 * smooth(t, 0.5, 1.3)
    size = 1.0 / (INERTIA * (2 * pi * 2.0) ** 2)
    found = size * RingingCompliance(2.0, damping).torque(machine, moved(machine, t, angle), t, 0)[:, 0]
    expected = two_masses(angle, t, 2.0, damping)
    assert np.max(np.abs(found - expected)) < 0.01 * np.max(np.abs(expected))
    ringing = np.abs(found[t > 2.0]).max() / np.abs(found).max()
    assert (ringing > 0.2) == (damping == 0.05)


def test_a_springy_link_sags_under_its_weight():
    """At 60 degrees the weight's torque 500 g 2 cos 60 bends 1e-6 rad/(N m) by 4.9 mrad, downwards, where its arm is
    longer: 500 g 2 sin 60 more per radian."""
    t = np.arange(0.0, 1.0, 0.01)
    found = 1e-6 * RingingCompliance().torque(rig(), moved(rig(), t, radians(60)), t, 0)[:, 0]
    bent = 1e-6 * 500 * G * 2 * cos(radians(60))
    np.testing.assert_allclose(found, 500 * G * 2 * sin(radians(60)) * bent, rtol=1e-9)


def test_a_springy_link_rings_only_after_its_cause_and_needs_no_more_than_one_sample():
    """Causal but for the sample beside, of which the acceleration is made; a single sample has none."""
    t = np.arange(0.0, 3.0, 0.01)
    angle = 0.3 * smooth(t, 0.5, 1.0)
    other = np.where(t < 1.5, angle, angle + 0.1 * smooth(t, 1.5, 1.7))
    early, late = (RingingCompliance().torque(rig(), moved(rig(), t, each), t, 0)[:, 0] for each in (angle, other))
    np.testing.assert_allclose(early[t < 1.48], late[t < 1.48], rtol=1e-12)
    assert np.all(np.isfinite(RingingCompliance().torque(rig(), turning(rig(), [0.0]), t[:1], 0)))


def test_a_spring_answers_a_slow_course_by_following_it():
    t = np.arange(0.0, 20.0, 0.05)
    bent, quickened = resonance(np.sin(0.2 * t), t, 3.0, 0.3)
    np.testing.assert_allclose(bent[60:-1], np.sin(0.2 * t)[60:-1], atol=0.01)
    np.testing.assert_allclose(quickened[60:-1], -0.04 * np.sin(0.2 * t)[60:-1], atol=0.002)


def test_a_gap_in_the_readings_does_not_make_a_spring_ring():
    t = np.arange(0.0, 4.0, 0.05)
    gap = np.where((t > 1.0) & (t < 1.5), np.nan, 5.0)
    bent, quickened = resonance(gap, t, 2.0, 0.05)
    np.testing.assert_allclose(bent, 5.0)
    np.testing.assert_allclose(quickened, 0.0, atol=1e-9)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_bodies_have_the_torques_of_the_model(joint):
    """Weight, inertia and centrifugal torques of an excavator in motion on a slope, as by its base parameters; what a
    further turn of its outer links adds is the model's mass matrix, and the change of its weight's torques."""
    machine, t = excavator(), np.arange(0.0, 2.0, 1e-3)
    theta = np.array([0.5, -1.4, -0.9]) + 0.2 * np.sin(np.outer(t, [2.0, 3.0, 4.0]))
    rates = 0.2 * np.array([2.0, 3.0, 4.0]) * np.cos(np.outer(t, [2.0, 3.0, 4.0]))
    slope, none = Attitude(pitch=0.1), np.zeros((len(t), len(machine.cylinders)))
    moving = motion(machine, theta, rates, none, slope)
    arm, base = bodies(machine, moving), base_parameters(machine.links)
    halves = Rigid().halves(machine, moving)
    expected = np.gradient(halves.momentum @ base, t, axis=0) + halves.static @ base
    np.testing.assert_allclose(arm.torque(t, joint)[2:-2], expected[2:-2, joint], atol=1e-4 * np.ptp(expected))
    unit = np.zeros((len(t), machine.size))
    unit[:, joint] = 1.0
    mass = Rigid().halves(machine, motion(machine, theta, unit, none, slope)).momentum @ base
    np.testing.assert_allclose(arm.inertia(joint, arm.pins[:, joint]), mass, rtol=1e-9)
    weights = [
        Rigid().halves(machine, motion(machine, theta + way * 1e-5 * unit, 0 * unit, none, slope)).static @ base
        for way in (1, -1)
    ]
    change = (weights[0] - weights[1]) / 2e-5
    np.testing.assert_allclose(arm.lowering(joint, arm.pins[:, joint]), change, atol=1e-3)


def test_soft_ground_tips_the_arm_by_its_own_moment():
    """500 kg 2 m out, at 60 degrees: the moment about tracks below the pin is 500 g 1 m; 1e-6 rad/(N m) tip by it. The
    arm of the weight grows by its height, 2 sin 60, times that angle."""
    t = np.arange(0.0, 1.0, 0.01)
    found = 1e-6 * SoftGround().torque(rig(), moved(rig(), t, radians(60)), t, 0)[:, 0]
    tipped = 1e-6 * 500 * G * 2 * cos(radians(60))
    np.testing.assert_allclose(found, 500 * G * 2 * sin(radians(60)) * tipped, rtol=1e-9)


def test_soft_ground_swings_the_first_pin_as_well():
    """The link turns about the pin from the vertical on, its moment falls as -500 g 2 sin; the mass, 2 m above the pin
    and 4 m above the tracks, is moved by 4 m per radian, at 2 m of lever: 500 * 2 * 4 N m per rad/s^2. At the vertical
    the moment's second derivative is that of the angle, times -500 g 2."""
    t = np.arange(0.0, 2.0, 0.01)
    angle = pi / 2 + 0.05 * (t - 1.0) ** 2
    found = 1e-6 * SoftGround(height=2.0).torque(rig(), moved(rig(), t, angle), t, 0)[100, 0]
    quickened = -500 * G * 2 * 0.1
    assert found == pytest.approx(-1e-6 * 500 * 2 * 4 * quickened, rel=1e-3)


def test_a_pin_rubs_by_the_force_that_presses_it():
    """The cylinder pushes 10 kN along (3, 4)/5 at the level link of 500 kg: the pin carries 4903 N upwards less 8000 N,
    and 6000 N sideways, 6752 N; with 10 mm of friction radius 67.5 N m against the turn, nothing at rest."""
    moving = turning(rig(), [0.2, -0.2, 0.0])._replace(force=np.full((3, 1), 10e3))
    found = 0.010 * PinFriction().torque(rig(), moving, np.zeros(3), 0)[:, 0]
    pressed = hypot(6000.0, 500 * G - 8000.0)
    np.testing.assert_allclose(found, [0.010 * pressed, -0.010 * pressed, 0.0], rtol=1e-6)


def test_the_pin_of_a_four_bar_linkage_carries_its_bar_not_its_cylinder():
    """By virtual work: of a weightless bucket the force on its pin times its lever is the cylinder's torque, so that
    it is that of the bar."""
    machine = excavator()
    links = tuple(replace(link, mass=1e-9) for link in machine.links)
    machine, theta = replace(machine, links=links), np.array([[0.5, -1.4, -0.9]])
    c = next(c for c, span in enumerate(machine.spans) if span == (2,))
    force = np.zeros((1, len(machine.cylinders)))
    force[0, c] = 50e3
    moving = motion(machine, theta, np.array([[0.0, 0.0, 0.3]]), force)
    found = PinFriction().torque(machine, moving, np.zeros(1), 2)[0, 2]
    places = machine.cylinders[c].linkage.places(machine.pose(theta))
    bar = places["link pin"] - places["rocker end"]
    lever = abs((np.conj(places["link pin"] - machine.pose(theta).origin[:, 3]) * bar / abs(bar)).imag[0])
    expected = abs(50e3 * moving.lever[0, c, 2]) / lever
    assert found == pytest.approx(expected, rel=1e-4)


def test_a_load_holding_valve_brakes_only_what_lowers_its_load():
    """4 kN at 2.4 m while the pushing cylinder retracts, or the pulling one extends; at half of the force that opens
    the valve alone half of it, beyond that force none."""
    rates = np.array([-0.2, 0.2, 0.0, 0.2, -0.2])
    force = np.array([50e3, 50e3, 50e3, -50e3, -50e3])[:, None]
    moving, t = turning(rig(), rates)._replace(force=force), np.zeros(5)
    full = 4000.0 * LEVER
    for relief, share in ((0.0, 1.0), (1e-5, 0.5), (3e-5, 0.0)):
        found = 4000.0 * CounterbalancePressure(relief).torque(rig(), moving, t, 0)[:, 0]
        np.testing.assert_allclose(found, share * np.array([full, 0.0, 0.0, -full, 0.0]), atol=1e-6)
