"""A rocker's weight is the derivative of its potential energy, whatever the chassis stands on."""

import numpy as np
import pytest

from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.motion import Attitude, motion
from machines import excavator, stick_and_bucket
from test_rigid import chain, machine

MOMENT, H = 60.0, 1e-5  # kg m, rad


def energy(which, theta, pitch, roll):
    """w g sin(angle of the rocker) (T,): the rocker's end is where link and rocker meet."""
    (bars,) = [c.linkage for c in which.cylinders if isinstance(c.linkage, FourBar)]
    at = which.pose(theta)
    pin, link = (at.origin[:, body] + at.turn[:, body] * local for body, local in bars.pins[1:])
    apart = link - pin
    cosine = (np.abs(apart) ** 2 + bars.rocker_length**2 - bars.link_length**2) / (
        2 * np.abs(apart) * bars.rocker_length
    )
    angle = np.angle(apart) + bars.side * np.arccos(cosine) + pitch
    return MOMENT * 9.80665 * np.cos(roll) * np.sin(angle)


@pytest.mark.parametrize("which", [excavator(), stick_and_bucket()], ids=lambda m: m.name)
def test_its_torques_are_the_slopes_of_its_energy(which):
    rng, n = np.random.default_rng(1), which.size
    low, high = np.array([[k.angle_low, k.angle_high] for k in which.links]).T
    theta = rng.uniform(low, high, (200, n))
    pitch, roll = rng.uniform(-0.5, 0.5, 200), 0.1
    moving = motion(which, theta, 0.0 * theta, np.zeros((200, len(which.cylinders))), Attitude(pitch, roll))
    found = MOMENT * RockerWeight().halves(which, moving).static[..., 0]
    slopes = [energy(which, theta + s, pitch, roll) - energy(which, theta - s, pitch, roll) for s in H * np.eye(n)]
    expected = np.stack(slopes, axis=-1) / (2 * H)
    closed = np.all(np.isfinite(expected), axis=1) & (np.abs(expected[:, -1]) < 2000.0)
    assert np.sum(closed) > 100
    np.testing.assert_allclose(found[closed], expected[closed], rtol=1e-6, atol=1e-3)
    assert np.all(np.isfinite(found))


def test_a_machine_without_four_bars_has_none():
    assert RockerWeight().parameters(machine(chain(np.random.default_rng(0), 2))) == ()
    assert [p.name for p in RockerWeight().parameters(excavator())] == ["bucket.rocker"]
