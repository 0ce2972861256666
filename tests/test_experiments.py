"""Which motion to record next: motions that can be made, and distances between candidates that mean what they say."""

from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.diagnosis.search import NO_GAP
from cylforce.mechanics.workspace import drive_angles, driven, working_range
from cylforce.programs.experiments.catalogue import SECONDS, catalogue
from cylforce.programs.experiments.separation import AGAIN, Candidate, Separation, Told, _worth, said
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
        assert np.max(made.load.mass) == pytest.approx(motion.load)
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


def separation(*candidates):
    found = Separation(SimpleNamespace(), candidates)
    found.__dict__["_unit"] = np.ones(sum(len(c.sizes) for c in candidates))
    return found


ONE = Candidate(("friction", "stick"), 0.6, SimpleNamespace(), np.array([2.0]))
OTHER = Candidate(("gain", "stick"), 0.3, SimpleNamespace(), np.array([3.0]))
NONE = Candidate(NO_GAP, 0.1, None, np.zeros(0))


def test_orthogonal_signatures_are_as_far_apart_as_they_are_large():
    """4 * 25 and 9 * 16, the mean of both."""
    assert separation(ONE, OTHER).information(np.diag([25.0, 16.0])) == pytest.approx((100.0 + 144.0) / 2.0)


def test_equal_signatures_are_not_told_apart():
    """One takes up of the other all but what its prior forbids."""
    told = 1e6 * np.ones((2, 2))
    assert separation(ONE, OTHER).information(told) < 20.0 < 1e-5 * 4.0 * told[0, 0]


def test_a_fault_is_as_far_from_none_as_it_is_large():
    assert separation(ONE, NONE).information(np.array([[25.0]])) == pytest.approx(100.0 / 2.0)


def test_the_rival_that_is_confused_most_counts():
    """Of two rivals the nearer one decides."""
    several = separation(ONE, OTHER, NONE)
    told = np.array([[25.0, 19.9], [19.9, 16.0]])
    assert several.information(told) < separation(ONE, NONE).information(told[:1, :1])


def test_a_load_that_tells_hardly_more_is_not_asked_for():
    plain, loaded, warm = Told("move", 4.0), Told("move, loaded", 4.5), Told("move, warm", 9.0)
    assert _worth([plain, loaded, warm]) == [plain, warm]


def test_what_is_said():
    assert said([Told("move", 3.81), Told("hold", np.inf)]) == [
        "move: tells 3.8 times as much as this recording does in the same time",
        "hold: tells more than 100 times as much as this recording does in the same time",
    ]
    assert said([Told(AGAIN, 2.0)]) == [f"{AGAIN}: tells 2 times as much"]
