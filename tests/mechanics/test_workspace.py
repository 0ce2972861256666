"""Where an arm can be driven: a loader's tilt cylinder sets the bucket's angle from the frame."""

from pathlib import Path

import numpy as np
import pytest

from cylforce.mechanics.workspace import (
    drive,
    drive_angles,
    driven_lever,
    is_loader,
    joint_angles,
    lifting,
    stroke_time,
    working_range,
)
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import cycles, moves
from cylforce.simulation.trajectory import follow

CONFIG = Path(__file__).resolve().parents[2] / "config"
STEP = 1e-6


@pytest.fixture(scope="module")
def loader():
    return load(CONFIG / "wheel_loader.toml").service.machine


@pytest.fixture(scope="module")
def excavator():
    return load(CONFIG / "excavator_20t.toml").service.machine


def corners(ranges):
    return np.stack(np.meshgrid(*(np.linspace(*r, 15) for r in ranges), indexing="ij"), axis=-1)


def test_an_excavators_cylinders_set_its_joint_angles(excavator):
    assert np.array_equal(drive(excavator), np.eye(3))
    theta = np.array([[0.1, -1.5, -0.4]])
    assert drive_angles(excavator, theta) is theta
    assert joint_angles(excavator, theta) is theta
    assert not is_loader(excavator)
    assert lifting(excavator) == (0,)


def test_a_loaders_tilt_angle_counts_from_the_frame(loader):
    """Arm at 30 degrees, bucket at -50 degrees from the arm: it points 20 degrees downwards."""
    u = drive_angles(loader, np.radians([30.0, -50.0]))
    assert np.degrees(u) == pytest.approx([30.0, -20.0])
    assert np.degrees(joint_angles(loader, u)) == pytest.approx([30.0, -50.0])
    assert is_loader(loader)
    assert lifting(loader) == (0,)


def test_in_every_posture_of_a_loaders_working_range_both_cylinders_are_within_their_strokes(loader):
    ranges = working_range(loader)
    assert np.degrees(ranges[:, 1] - ranges[:, 0]) == pytest.approx([88, 90], abs=4)
    at = loader.geometry(joint_angles(loader, corners(ranges)))
    low, high = (np.array([getattr(c, key) for c in loader.cylinders]) for key in ("length_low", "length_high"))
    assert np.all((at.length > low) & (at.length < high))
    assert at.lever[..., 1, 1].min() > 0.15
    assert at.transmission.min() > 0.3


def test_driven_levers_are_derivatives_of_the_lengths(loader):
    u = corners(working_range(loader)).reshape(-1, 2)
    for j, step in enumerate(STEP * np.eye(2)):
        ahead, behind = (loader.geometry(joint_angles(loader, u + s * step)).length for s in (1, -1))
        np.testing.assert_allclose(driven_lever(loader, u)[..., j], (ahead - behind) / (2 * STEP), atol=1e-8)


def test_raising_a_loaders_arm_takes_as_long_as_its_lift_cylinders_need(loader):
    """At 0.05 m/s, minimum jerk: 1.875 times the mean speed; the bucket keeps its direction."""
    low, high = working_range(loader)[0]
    u = np.array([low, 0.0])
    poses = np.stack([np.linspace(low, high, 400), np.zeros(400)], axis=-1)
    fastest = np.abs(driven_lever(loader, poses)[:, :, 0]).max()
    assert stroke_time(loader, u, 0, high, 0.05) == pytest.approx(1.875 * (high - low) * fastest / 0.05, rel=0.01)


def scenes(machine):
    rng = np.random.default_rng(3)
    return [*cycles(machine, rng, 2, swing=False), moves(machine, rng, 60.0)]


def test_a_simulated_loader_stays_within_its_strokes(loader):
    for scene in scenes(loader):
        theta = follow(scene, np.arange(0.0, scene.duration, 0.05)).theta
        at = loader.geometry(theta)
        for c, cylinder in enumerate(loader.cylinders):
            assert at.length[:, c].min() > cylinder.length_low
            assert at.length[:, c].max() < cylinder.length_high


def test_a_simulated_loader_lifts_curled_and_dumps_at_height(loader):
    _, scene, _ = cycles(loader, np.random.default_rng(3), 2, swing=False)
    t = np.array([5.0, 9.4, 12.6])
    arm, bucket = np.degrees(drive_angles(loader, follow(scene, t).theta)).T
    assert arm[0] < -20.0
    assert bucket[1] > 35.0
    assert arm[2] > 25.0
    assert bucket[2] < -20.0
