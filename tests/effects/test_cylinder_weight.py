"""A cylinder weighs and resists as hand mechanics say: virtual work of masses on its line, from the pins of the machine
file."""

import numpy as np
import pytest

from cylforce.effects.loads.cylinder_weight import CylinderWeight
from cylforce.effects.loads.rigid import Rigid
from cylforce.estimation.priors.bars import ERROR, STEEL, of_cylinder
from cylforce.mechanics.motion import Attitude, motion
from cylforce.settings.machine_file import load
from rocker import ATTITUDES, DT, NAMES, ends, moved
from scenarios import EXCAVATOR
from statics import BODIES, FILE, G, H, place

MOMENT = 45.0  # kg m
JOINTS = {"stick": 1, "bucket": 2}  # whose cylinders a link carries
NEAR = 1e-3  # s


def line(joint, theta):
    """Foot and eye (2, 2) of a joint's cylinder, seen from the boom pin."""
    linkage = FILE["cylinders"][JOINTS[joint]]["linkage"]
    foot = place(theta, BODIES[linkage["foot"]["body"]], linkage["foot"]["at_m"])
    if joint == "bucket":
        return np.array([foot, ends(theta)[0]])
    return np.array([foot, place(theta, BODIES[linkage["eye"]["body"]], linkage["eye"]["at_m"])])


def along(joint, theta, distance):
    """The point of a cylinder's line at a distance from the foot, below zero from the eye towards the foot."""
    foot, eye = line(joint, theta)
    u = (eye - foot) / np.hypot(*(eye - foot))
    return foot + distance * u if distance >= 0.0 else eye + distance * u


def pushed(point, theta_of, t, attitude):
    """Joint torques of a unit mass at a point, by virtual work: (acceleration and gravity) . (slope of its place)."""
    theta, steps = theta_of(t), H * np.eye(3)
    slope = np.array([(point(theta + s) - point(theta - s)) / (2 * H) for s in steps])
    speeding = (point(theta_of(t + NEAR)) - 2 * point(theta) + point(theta_of(t - NEAR))) / NEAR**2
    up = G * np.cos(attitude.roll) * np.array([np.sin(attitude.pitch), np.cos(attitude.pitch)])
    rho = FILE["machine"]["slew_axis_m"] + point(theta)[0]
    return slope @ (speeding + up - np.array([attitude.slew**2 * rho, 0.0]))


def column(which, joint, t, attitude):
    """Torque by joints of the parameter of a joint's cylinder, per kg m."""
    theta = np.array([moved(x) for x in t + DT * np.arange(-1, 2)])
    thetad = np.array([(moved(x + DT) - moved(x - DT)) / (2 * DT) for x in t + DT * np.arange(-1, 2)])
    effect = CylinderWeight()
    k = [p.name for p in effect.parameters(which)].index(f"{joint}.cylinder")
    found = effect.halves(which, motion(which, theta, thetad, np.zeros((3, 3)), attitude))
    return ((found.momentum[2] - found.momentum[0]) / (2 * DT) + found.static[1])[:, k]


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("attitude", ATTITUDES, ids=NAMES)
@pytest.mark.parametrize("t", [0.3, 1.1, 2.0])
def test_its_torques_are_those_of_a_mass_on_its_line(joint, t, attitude):
    which = load(EXCAVATOR).service.machine
    middle = which.cylinders[JOINTS[joint]].length_low / 2.0
    far = pushed(lambda theta: along(joint, theta, middle), moved, t, attitude)
    near = pushed(lambda theta: along(joint, theta, 0.0), moved, t, attitude)
    by_hand = MOMENT * (far - near) / middle
    np.testing.assert_allclose(MOMENT * column(which, joint, t, attitude), by_hand, rtol=1e-4, atol=0.05)


@pytest.mark.parametrize("joint", JOINTS)
def test_barrel_and_rod_are_their_pins_masses_and_one_moment(joint):
    """At rest, on a slope: 150 kg 0.85 m from the foot and 95 kg 0.7 m from the eye weigh as 150 kg at the foot, 95 kg
    at the eye, and 150 * 0.85 - 95 * 0.7 kg m along the line."""
    which, attitude = load(EXCAVATOR).service.machine, Attitude(0.08, 0.1)
    for seconds in (0.3, 1.1, 2.0):
        theta = moved(seconds)

        def weight(distance, theta=theta):
            return pushed(lambda x: along(joint, x, distance), lambda _: theta, 0.0, attitude)

        eye = pushed(lambda x: line(joint, x)[1], lambda _, theta=theta: theta, 0.0, attitude)
        whole = 150.0 * weight(0.85) + 95.0 * weight(-0.7)
        still = CylinderWeight().halves(which, motion(which, theta, 0.0 * theta, np.zeros(3), attitude)).static
        k = [p.name for p in CylinderWeight().parameters(which)].index(f"{joint}.cylinder")
        rest = (150.0 * 0.85 - 95.0 * 0.7) * still[:, k]
        np.testing.assert_allclose(whole, 150.0 * weight(0.0) + 95.0 * eye + rest, rtol=1e-5, atol=0.01)


def test_one_on_the_chassis_is_in_its_link():
    """Level or on a slope of five degrees, what is left of 45 kg m beside the boom's (X, Z) is below 2 kg in the bucket
    at its reach of 8 m; and there is no parameter for it."""
    which = load(EXCAVATOR).service.machine
    assert [p.name for p in CylinderWeight().parameters(which)] == ["stick.cylinder", "bucket.cylinder"]
    pins = FILE["cylinders"][0]["linkage"]

    def direction(theta):
        foot = place(theta, BODIES[pins["foot"]["body"]], pins["foot"]["at_m"])
        eye = place(theta, BODIES[pins["eye"]["body"]], pins["eye"]["at_m"])
        return (eye - foot) / np.hypot(*(eye - foot))

    boom, step = np.radians(np.linspace(-30.0, 50.0, 40)), np.array([H, 0.0, 0.0])
    thetas = [np.array([angle, -1.5, -1.0]) for angle in boom]
    slopes = np.array([(direction(x + step) - direction(x - step)) / (2 * H) for x in thetas])
    torque, columns = [], []
    for pitch in np.radians([-5.0, 0.0, 5.0]):
        torque.append(MOMENT * G * slopes @ np.array([np.sin(pitch), np.cos(pitch)]))
        columns.append(np.column_stack([np.cos(boom + pitch), np.sin(boom + pitch)]))
    wanted, known = np.concatenate(torque), np.concatenate(columns)
    left = wanted - known @ np.linalg.lstsq(known, wanted, rcond=None)[0]
    assert np.abs(left).max() < 2.0 * G * 8.0


@pytest.mark.parametrize("moving", [False, True])
def test_one_instant_is_as_a_recording(moving):
    which = load(EXCAVATOR).service.machine
    theta = np.array([moved(t) for t in (0.3, 1.1)])
    thetad = np.full_like(theta, 0.2 * moving)
    attitude = Attitude(np.array([0.05, 0.05]), 0.0, 0.0, np.array([0.5, 0.5]))
    both = CylinderWeight().halves(which, motion(which, theta, thetad, np.zeros((2, 3)), attitude))
    one = motion(which, theta[1], thetad[1], np.zeros(3), Attitude(0.05, 0.0, 0.0, 0.5))
    found = CylinderWeight().halves(which, one)
    np.testing.assert_allclose(found.static, both.static[1], atol=1e-9)
    np.testing.assert_allclose(found.momentum, both.momentum[1], atol=1e-9)
    assert found.static.shape == (*Rigid().halves(which, one).static.shape[:1], 2)


def test_barrel_and_rod_weigh_alike_before_anything_is_seen():
    """By hand: a rod of 95 mm and 2.35 m about its eye, each of both known to a half."""
    cylinder = load(EXCAVATOR).service.machine.cylinders[1]
    rod = STEEL * np.pi / 4 * 0.095**2 * 2.35
    mean, spread = of_cylinder(cylinder)
    assert mean == 0.0
    assert spread == pytest.approx(np.sqrt(2.0) * ERROR * rod * 2.35 / 2.0)
