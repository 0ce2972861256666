"""The shape of what no effect explains: a residual made as a function of one quantity is told as that."""

import numpy as np
import pytest

from cylforce.diagnosis.shape import MOST, WORTH, lie, shapes
from cylforce.diagnosis.track import Track

RATE_HZ, NOISE, SEED = 20.0, 50.0, 3


def moved(seed, seconds=300.0):
    """A joint that goes to and fro at changing speed, its cylinder's load rising with its angle and with what swings
    beside it; white noise is left."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phase = np.cumsum(1.0 + 0.6 * np.sin(0.11 * t + rng.uniform(0.0, 6.0))) / RATE_HZ
    position = -1.5 + 0.8 * np.sin(0.5 * phase) + 0.1 * np.sin(0.031 * t)
    speed = np.gradient(position, t) * 0.4
    other = np.sin(0.23 * t + rng.uniform(0.0, 6.0))
    loads = np.stack([1e5 * other, 5e4 * (position + 1.5) + 6e4 * other], axis=1)
    turned = np.flatnonzero(np.diff(np.sign(speed), prepend=0.0) != 0.0)
    reversal = t - t[turned[np.searchsorted(turned, np.arange(len(t)), side="right") - 1]]
    left = NOISE * rng.standard_normal(len(t))
    return Track(left, position, speed, loads, t, reversal, np.zeros_like(t), np.zeros(len(t), dtype=np.int64), 1)


def with_(track, torque):
    return track._replace(left=track.left + torque)


def told(torque):
    """The shapes of a joint whose residual has a torque in excess; the first is the one that is told."""
    faulty = moved(SEED)
    return shapes(with_(faulty, torque(faulty)), moved(SEED + 1), NOISE)


MADE = {
    "constant": lambda t: np.full_like(t.left, 300.0),
    "position": lambda t: 600.0 * np.exp(-(((t.position + 1.2) / 0.15) ** 2)) * np.tanh(t.speed / 0.01),
    "speed": lambda t: 4000.0 * t.speed,
    "load": lambda t: 2e-3 * np.abs(t.loads[:, 0]),
    "time": lambda t: 300.0 * np.sin(2.0 * np.pi * t.time / 400.0) ** 2 * np.tanh(t.speed / 0.01),
    "reversal": lambda t: 500.0 * np.exp(-t.reversal / 0.5),
    "periodic": lambda t: 300.0 * np.sin(20.0 * t.position + 1.0),
    "swinging": lambda t: 300.0 * np.sin(2.0 * np.pi * 1.3 * t.time) * (t.time % 40.0 < 25.0),
    "moments": lambda t: 3000.0 * np.sin(t.time) * (np.mod(t.time * 0.01 * np.sqrt(2.0), 0.3) < 0.01),
}


@pytest.mark.parametrize("of", MADE)
def test_a_function_of_one_quantity_is_told_as_that(of):
    first, *others = told(MADE[of])
    assert first.of == of, [first, *others]
    assert first.share > (MOST if of == "moments" else 0.5)
    assert all(0.0 <= s.share <= 1.0 for s in others)


def test_numbers_tell_what_the_word_leaves_open():
    assert told(MADE["periodic"])[0].number == pytest.approx(20.0, rel=0.05)
    assert told(MADE["swinging"])[0].number == pytest.approx(1.3, rel=0.05)
    assert told(MADE["load"])[0].whose == 0  # the other cylinder


def test_white_noise_is_a_function_of_nothing():
    noise = 5.0 * NOISE * np.random.default_rng(SEED).standard_normal(len(moved(SEED).left))
    first, *others = told(lambda _: noise)
    assert first.of == "none"
    assert max(s.share for s in others) < WORTH / 3.0


def test_what_is_always_left_has_no_shape():
    assert [s.of for s in told(lambda t: 0.0 * t.left)] == ["none"]


def test_what_a_clean_machine_leaves_as_well_is_no_shape_of_the_gap():
    both = [with_(moved(k), 400.0 * np.sin(2.0 * moved(k).position)) for k in (SEED, SEED + 1)]
    faulty = with_(both[0], MADE["swinging"](both[0]) * 3.0)
    assert next(s for s in shapes(faulty, both[1], float(np.std(both[1].left))) if s.of == "position").share < WORTH


def test_the_joint_is_the_one_with_the_gap():
    clean, faulty = [moved(5), moved(6)], [moved(7), moved(8)]
    faulty[1] = with_(faulty[1], MADE["position"](faulty[1]))
    found = lie(faulty, clean, np.array([NOISE, NOISE]))
    assert found is not None
    assert (found.at, found.shapes[0].of) == (1, "position")
