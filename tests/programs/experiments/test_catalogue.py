"""Motions of the catalogue and of the check-up can be made."""

import numpy as np
import pytest

from cylforce.mechanics.workspace import drive_angles, driven, working_range
from cylforce.programs.experiments.catalogue import SECONDS, catalogue, checkup
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import FASTEST
from cylforce.simulation.simulator import draw_truth, simulate
from cylforce.simulation.trajectory import follow
from scenarios import CONFIG

T = np.arange(0.0, SECONDS, 0.02)


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.toml")), ids=lambda path: path.stem)
def test_every_motion_can_be_made(path):
    """Within the working range, no cylinder faster than the fastest; what is said to move moves, what stands stands."""
    machine = load(path).service.machine
    truth = draw_truth(machine, np.random.default_rng(0), 0.0)
    words = []
    for motion in catalogue(machine, driven(machine)):
        words.append(motion.words)
        made = simulate(machine, truth, motion.scene, T, 0.0)
        lengths = made.moving.length
        low, high = (np.array([getattr(c, f"length_{end}") for c in machine.cylinders]) for end in ("low", "high"))
        assert np.all((lengths > low) & (lengths < high)), motion.words
        assert np.max(np.abs(made.moving.speed)) < 1.5 * FASTEST, motion.words  # several joints may move one cylinder
        moves = np.ptp(drive_angles(machine, made.course.theta), axis=0) > 0.005
        assert np.sum(moves) == (1 if " alone" in motion.words else len(driven(machine))), motion.words
        assert np.max(made.load.mass) == pytest.approx(motion.load_kg)
        assert np.max(np.abs(np.diff(lengths[-50:], axis=0))) < 0.01
    assert len(set(words)) == len(words)


def test_slow_strokes_have_time_for_both_ways():
    machine = load(CONFIG / "excavator_20t.toml").service.machine
    for motion in catalogue(machine, driven(machine)):
        if "end to end" not in motion.words:
            continue
        theta = follow(motion.scene, T).theta
        moved = int(np.argmax(np.ptp(theta, axis=0)))
        assert np.ptp(theta[:, moved]) > 0.5 * np.ptp(working_range(machine)[moved])
        assert np.sum(np.diff(np.sign(np.diff(theta[:, moved])[np.diff(theta[:, moved]) != 0.0])) != 0.0) >= 1


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.toml")), ids=lambda path: path.stem)
def test_the_check_up_moves_every_joint_both_at_once_and_alone(path):
    machine = load(path).service.machine
    together, stairs = checkup(machine)
    for motion in (together, stairs):
        t = np.arange(0.0, motion.scene.duration, 0.05)
        made = simulate(machine, draw_truth(machine, np.random.default_rng(0), 0.0), motion.scene, t, 0.0)
        low, high = (np.array([getattr(c, f"length_{end}") for c in machine.cylinders]) for end in ("low", "high"))
        assert np.all((made.moving.length > low) & (made.moving.length < high))
        moved = drive_angles(machine, made.course.theta)
        assert np.sum(np.ptp(moved, axis=0) > 0.1) == len(driven(machine))
        moving = np.sum(np.abs(np.diff(moved, axis=0)) > 1e-4, axis=1)
        assert np.max(moving) == (len(driven(machine)) if motion is together else 1)
