"""A base that moves: its torques are those of a chain with one more link, its rate comes from the tilt sensor."""

import numpy as np
import pytest

from chains import chain, machine
from cylforce.effects.geometry.boom_motion import BoomMotion
from cylforce.effects.loads.rigid import Rigid
from cylforce.estimation.channels import Channels
from cylforce.estimation.filters import denoised
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import base_parameters
from cylforce.mechanics.motion import Attitude, motion
from cylforce.signals.kinds import Kind
from cylforce.simulation.simulator import standing
from machines import excavator

DEGREE = np.pi / 180.0


@pytest.mark.parametrize("n", [2, 3, 4])
def test_links_on_a_boom_that_moves_are_a_chain_with_one_link_more(n: int) -> None:
    """Both halves, at random states, with the boom's length as the way of the pin."""
    rng = np.random.default_rng(n)
    links = chain(rng, n + 1)
    states = rng.uniform(-2.0, 2.0, (2, 50, n + 1))
    whole = motion(machine(links), *states, np.zeros(0))
    outer = machine(links[1:])
    seen = motion(outer, states[0, :, 1:], states[1, :, 1:], np.zeros(0), Attitude(states[0, :, 0]))
    base = base_parameters(links[1:])
    sizes = np.array([links[0].length, 0.0, 1.0])
    full, own = Rigid().halves(machine(links), whole), Rigid().halves(outer, seen)
    more = BoomMotion().halves(outer, seen, states[1, :, 0], base.reshape(n, 3))
    for expected, known, besides in zip(full, own, more, strict=True):
        torque = known @ base + besides @ sizes
        np.testing.assert_allclose(torque, (expected @ base_parameters(links))[:, 1:], rtol=1e-12, atol=1e-6)


def test_a_turned_frame_turns_the_way_of_the_pin() -> None:
    """The same motion, told by a tilt sensor that is mounted at another angle."""
    links, other, rng = chain(np.random.default_rng(1), 2), 0.4, np.random.default_rng(2)
    m, (theta, thetad) = machine(links), rng.uniform(-2.0, 2.0, (2, 20, 2))
    pitch, turning, base = *rng.uniform(-1.0, 1.0, (2, 20)), base_parameters(links).reshape(2, 3)
    way = 3.0 + 1.0j
    found = []
    for angle in (0.0, other):
        joints = theta - np.array([angle, 0.0])
        moving = motion(m, joints, thetad, np.zeros(0), Attitude(pitch + angle))
        turned = way * np.exp(-1j * angle)
        found.append(BoomMotion().halves(m, moving, turning, base).static @ [turned.real, turned.imag, 1.0])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)


def test_noise_goes_and_what_is_slow_stays_where_it_is() -> None:
    t, rng = np.arange(0.0, 80.0, 0.01), np.random.default_rng(3)
    true = 0.1 * np.sin(2 * np.pi * t / 7.0) + 0.02 * np.sin(2 * np.pi * 1.3 * t) + 0.001 * t
    noise = 0.02 * DEGREE * rng.standard_normal(len(t))
    left = denoised(true + noise, 100.0) - true
    assert np.std(left) < 0.3 * np.std(noise)
    assert np.std(np.diff(left)) < 0.2 * np.std(np.diff(noise))
    assert np.std(np.diff(denoised(noise, 100.0))) < 0.2 * np.std(np.diff(noise))
    np.testing.assert_allclose(denoised(true, 100.0), true, atol=1e-6)


def test_a_house_that_slews_on_a_slope_does_not_turn_its_arm() -> None:
    """Its pitch changes by ten degrees; with 0.2 rad/s of its own on top only that is left."""
    channels = Channels(excavator(), Filters(20.0, 5.0, 2.0, 2.0, 0.002))
    t = np.arange(0.0, 30.0, 0.05)
    slew, own = 0.8 * np.sin(2 * np.pi * t / 9.0), 0.05 * np.sin(4.0 * t) * (t > 15.0)
    turn = 0.8 * 9.0 / (2 * np.pi) * (1.0 - np.cos(2 * np.pi * t / 9.0))
    slope = standing(5.0 * DEGREE, 3.0 * DEGREE, turn)
    place = {s.kind: k for k, s in enumerate(channels.machine.signals)}
    values = np.zeros((len(t), len(channels.machine.signals)))
    values[:, place[Kind.PITCH]] = np.asarray(slope.pitch) + own
    values[:, place[Kind.ROLL]], values[:, place[Kind.SLEW_RATE]] = slope.roll, slew
    found = channels.turning(values)
    still, moving = t[:-1] < 14.0, t[:-1] > 17.0
    assert np.ptp(np.asarray(slope.pitch)) > 4.0 * DEGREE
    assert np.max(np.abs(found[still])) < 0.05 * np.max(np.abs(np.gradient(np.asarray(slope.pitch), t)))
    assert 0.17 < np.max(np.abs(found[moving])) < 0.21
