"""Linkages: the lever is the derivative of the length, the length gives the angle back, dead points show."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cylforce.mechanics.chain import pose
from cylforce.mechanics.linkages import FourBar, Triangle
from cylforce.mechanics.machine import Machine
from cylforce.settings.machine_file import load

CONFIG = Path(__file__).resolve().parents[2] / "config"
LENGTHS = np.array([5.7, 2.9, 1.5])
STEP = 1e-6
# Each with the range of every joint over which it closes.
ALL = np.array([[-0.7, 1.0], [-2.6, -0.6], [-2.4, 0.4]])
BUCKET = {"rocker_pin": (2, 2.5 - 0.04j), "link_pin": (3, -0.13 + 0.41j), "rocker_length": 0.68, "link_length": 0.66}
MADE_UP = {
    "triangle": (LENGTHS, Triangle((0, 0.55 - 0.62j), (1, 2.4 + 0.7j)), ALL),
    "triangle over two joints": (LENGTHS, Triangle((0, 0.3 + 1.0j), (2, 0.4 + 0.5j)), ALL),
    "four-bar": (LENGTHS, FourBar((2, 0.2 + 0.7j), side=1, **BUCKET), ALL),
    "four-bar, eye aside": (LENGTHS, FourBar((2, 0.2 + 0.7j), side=1, eye=0.7 + 0.2j, **BUCKET), ALL),
    "dogbone": (
        LENGTHS,
        FourBar((0, 0.45 - 1.4j), (0, -0.12 - 0.08j), (1, 0.34 + 0.02j), 0.49, 0.17, -1),
        np.array([[-0.8, 1.4], [-2.6, -0.6], [-2.4, 0.4]]),
    ),
    # a loader's tilt cylinder: foot on the frame, bell crank on the boom, link to the bucket
    "Z-bar": (
        np.array([2.6, 1.2]),
        FourBar((0, 0.2 + 0.6j), (1, 1.5 + 0.35j), (2, -0.12 - 0.33j), 0.6, 0.9, -1, eye=-0.9 + 0.15j),
        np.array([[-0.6, 0.8], [-0.6, 0.6]]),
    ),
}


def of_config(name):
    machine = load(CONFIG / name).service.machine
    return machine, np.array([[link.angle_low, link.angle_high] for link in machine.links])


def cases():
    found = [(name, *case) for name, case in MADE_UP.items()]
    for path in sorted(CONFIG.glob("*.toml")):
        machine, ranges = of_config(path.name)
        found += [(f"{path.stem}.{c.name}", machine.lengths, c.linkage, ranges) for c in machine.cylinders]
    return [pytest.param(*rest, id=name) for name, *rest in found]


def states(ranges, count=500):
    return np.random.default_rng(7).uniform(ranges[:, 0], ranges[:, 1], (count, len(ranges)))


@pytest.mark.parametrize(("lengths", "linkage", "ranges"), cases())
def test_lever_is_derivative_of_length(lengths, linkage, ranges):
    theta = states(ranges)
    found = linkage.stretch(pose(lengths, theta))
    assert np.all(np.isfinite(found.length))
    assert np.all(found.transmission > 0.1)
    for joint in range(len(lengths)):
        step = np.zeros(len(lengths))
        step[joint] = STEP
        ahead, behind = (linkage.stretch(pose(lengths, theta + s * step)).length for s in (1, -1))
        np.testing.assert_allclose(found.gradient[:, joint], (ahead - behind) / (2 * STEP), rtol=1e-7, atol=2e-9)


def test_z_bar_acts_on_two_joints():
    lengths, linkage, ranges = MADE_UP["Z-bar"]
    lever = linkage.stretch(pose(lengths, states(ranges))).gradient
    assert np.all(np.abs(lever).max(axis=0) > 0.1)


@given(st.floats(0.2, 3.0), st.floats(0.2, 3.0), st.floats(0.02, 3.12), st.floats(-3.0, 3.0), st.sampled_from([1, -1]))
def test_triangle_is_the_textbook_formula(far, near, enclosed, mounting, side):
    """ell^2 = L2^2 + f^2 - 2 L2 f cos t', d(ell)/dt' = L2 f sin t' / ell = L2 sin(t' + phi) with phi by atan2;
    t' differs from theta by a mounting angle and a sign."""
    assume(abs(far - near) > 1e-3 or enclosed > 0.1)
    eye = near * np.exp(1j * (mounting + side * enclosed))
    linkage = Triangle((0, far * np.exp(1j * mounting)), (1, eye))
    found = linkage.stretch(pose(LENGTHS[:1], np.zeros(1)))
    length = np.sqrt(far**2 + near**2 - 2 * far * near * np.cos(enclosed))
    phi = np.arctan2(far * np.sin(enclosed), near - far * np.cos(enclosed))
    assert found.length == pytest.approx(length, rel=1e-9)
    assert side * found.gradient[0] == pytest.approx(far * near * np.sin(enclosed) / length, rel=1e-7)
    assert side * found.gradient[0] == pytest.approx(far * np.sin(enclosed + phi), rel=1e-7, abs=1e-9)


@given(
    st.floats(0.1, 1.5),
    st.floats(0.1, 1.5),
    st.floats(0.2, 1.5),
    st.floats(0.1, 1.0),
    st.floats(-3.0, 3.0),
    st.sampled_from([1, -1]),
    st.complex_numbers(max_magnitude=1.5, allow_nan=False, allow_infinity=False),
)
def test_any_four_bar_keeps_its_lengths_and_its_lever(rocker, link, base, pin, theta, side, eye):
    linkage = FourBar((0, -1.0 + 2.0j), (0, -base + 0j), (1, pin + 0j), rocker, link, side, eye)
    found = linkage.stretch(pose(LENGTHS[:1], np.array([theta])))
    assume(np.isfinite(found.length) and found.transmission > 0.2 and found.length > 0.1)
    ahead, behind = (linkage.stretch(pose(LENGTHS[:1], np.array([theta + s * STEP]))).length for s in (1, -1))
    assume(np.isfinite(ahead - behind))
    assert found.gradient[0] == pytest.approx((ahead - behind) / (2 * STEP), rel=1e-5, abs=1e-7)


def machines():
    return [pytest.param(*of_config(path.name), id=path.stem) for path in sorted(CONFIG.glob("*.toml"))]


def over_one_joint(machine):
    return [(c, span[0]) for c, span in enumerate(machine.spans) if len(span) == 1]


@pytest.mark.parametrize(("machine", "ranges"), machines())
def test_length_gives_the_angle_back(machine, ranges):
    theta = states(ranges)
    length = machine.geometry(theta).length
    for c, joint in over_one_joint(machine):
        np.testing.assert_allclose(machine.joint_angle(c, length[:, c]), theta[:, joint], atol=1e-11)


@pytest.mark.parametrize(("machine", "ranges"), machines())
def test_one_length_gives_the_angle_of_an_array_of_lengths(machine, ranges):
    """Within the range and beyond it."""
    length = machine.geometry(states(ranges)).length
    for c, _ in over_one_joint(machine):
        many = np.append(length[:50, c], (length[:, c].min() - 1.0, length[:, c].max() + 1.0))
        one = [machine.joint_angle(c, float(each)) for each in many]
        np.testing.assert_allclose(one, machine.joint_angle(c, many), atol=1e-13)


@pytest.mark.parametrize(("machine", "ranges"), machines())
def test_length_outside_the_range_gives_no_angle(machine, ranges):
    for c, joint in over_one_joint(machine):
        theta = np.tile(ranges.mean(axis=1), (2, 1))
        theta[:, joint] = ranges[joint]
        ends = np.sort(machine.geometry(theta).length[:, c])
        assert np.all(np.isnan(machine.joint_angle(c, ends + np.array([-0.001, 0.001]))))


@pytest.mark.parametrize(("machine", "ranges"), machines())
def test_shipped_machines_have_good_levers_and_real_cylinders(machine, ranges):
    """Over the whole range: one way, within the cylinder, with a lever and far from a dead point."""
    for c, joint in over_one_joint(machine):
        theta = np.tile(ranges.mean(axis=1), (721, 1))
        theta[:, joint] = np.linspace(*ranges[joint], 721)
        at, cylinder = machine.geometry(theta), machine.cylinders[c]
        lever = at.lever[:, c, joint]
        assert np.all(lever > 0) or np.all(lever < 0)
        assert 0.19 < np.abs(lever).min() < np.abs(lever).max() < 0.9
        assert np.all(at.transmission[:, c] > 0.3)
        # the joint's range is what the cylinder allows, to a few centimetres, and no rod is longer than its barrel
        assert cylinder.length_low < at.length[:, c].min() < cylinder.length_low + 0.05
        assert cylinder.length_high - 0.05 < at.length[:, c].max() < cylinder.length_high
        assert cylinder.length_high - cylinder.length_low < cylinder.length_low - 0.3


@pytest.mark.parametrize(("apart", "expected"), [(5.0, 1.0), ((25.0 - 24.0 * 0.75**0.5) ** 0.5, 0.5)])
def test_transmission_is_the_sine_between_rocker_and_link(apart, expected):
    """A rocker of 3 m and a link of 4 m span 5 m at a right angle, and sqrt(25 - 24 cos 30) at 30 degrees."""
    linkage = FourBar((0, -1.0 + 2.0j), (0, 0j), (1, apart + 0j), 3.0, 4.0, 1)
    assert linkage.stretch(pose(LENGTHS[:1], np.zeros(1))).transmission == pytest.approx(expected)


def test_dead_points_of_a_four_bar():
    """Where rocker and link come into line the transmission vanishes and the lever grows without bound; where the link
    points at the joint the lever vanishes; beyond the first, the linkage does not close."""
    rocker, link, base, pin = 0.6, 0.3, 0.7, 0.6
    linkage = FourBar((0, -2.0 + 0.8j), (0, -base + 0j), (1, pin + 0j), rocker, link, -1)

    def stretch(theta):
        return linkage.stretch(pose(LENGTHS[:1], np.asarray(theta)[..., None]))

    # in line: the pins are rocker + link apart
    in_line = np.pi - np.arccos((base**2 + pin**2 - (rocker + link) ** 2) / (2 * base * pin))
    near = stretch(in_line + np.array([1e-2, 1e-4, 1e-6]))
    assert np.all(np.diff(near.transmission) < 0)
    assert near.transmission[-1] < 0.01
    assert np.all(np.diff(np.abs(near.gradient[:, 0])) > 0)
    assert np.abs(near.gradient[-1, 0]) > 50
    assert np.isnan(stretch(in_line - 1e-3).length)

    # towards the joint: the rocker's end is pin -+ link away from it; its direction follows from the three distances
    towards = np.arccos((base**2 + (pin - link) ** 2 - rocker**2) / (2 * base * (pin - link)))
    dead = stretch(np.array([np.pi - towards]))
    assert np.abs(dead.gradient[0, 0]) < 1e-9
    assert dead.transmission[0] > 0.1


def test_machine_is_told_the_joints_of_a_z_bar():
    machine, _ = of_config("excavator_20t.toml")
    linkage = MADE_UP["Z-bar"][1]
    tilt = type(machine.cylinders[0])("tilt", linkage, 1.0, 0.5, 1.0, 4.0)
    assert Machine(machine.name, machine.links, (tilt,), (), machine.tool, 1.0, 1.0, 0.0).spans == ((0, 1),)
