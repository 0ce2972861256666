"""The shape of what no effect explains: a residual made as a function of one quantity is told as that."""

from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.diagnosis.answer.shape import unexplained
from cylforce.diagnosis.numbers import HALF, SLIGHT

RATE_HZ, NOISE, SEED = 20.0, 50.0, 3


def moved(seconds=300.0):
    """A joint that goes to and fro at changing speed, its cylinder's load rising with its angle and with what swings
    beside it; white noise is left. A second joint is still."""
    rng, t = np.random.default_rng(SEED), np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phase = np.cumsum(1.0 + 0.6 * np.sin(0.11 * t + rng.uniform(0.0, 6.0))) / RATE_HZ
    position = -1.5 + 0.8 * np.sin(0.5 * phase) + 0.1 * np.sin(0.031 * t)
    speed = np.gradient(position, t) * 0.4
    other = np.sin(0.23 * t + rng.uniform(0.0, 6.0))
    force = np.stack([1e5 * other, 5e4 * (position + 1.5) + 6e4 * other], axis=1)
    still = np.zeros_like(t)
    rows = SimpleNamespace(
        t=t, posture=np.stack([still, position], axis=1), speed=np.stack([still, speed], axis=1), force=force
    )
    machine = SimpleNamespace(
        rows=(0, 1),
        links=[SimpleNamespace(name="boom"), SimpleNamespace(name="stick")],
        cylinders=[SimpleNamespace(name="boom"), SimpleNamespace(name="stick")],
    )
    model = SimpleNamespace(machine=machine, acting=((0,), (1,)))
    return SimpleNamespace(model=model, faulty=[SimpleNamespace(rows=rows)]), rng.normal(0.0, NOISE, (len(t), 2))


def told(torque):
    """The shape of what is left at the stick with a torque in excess."""
    problem, left = moved()
    rows = problem.faulty[0].rows
    left[:, 1] += torque(rows.posture[:, 1], rows.speed[:, 1], rows.force, rows.t)
    left[::50] = np.nan
    return unexplained(problem, [left], np.full(2, NOISE))


MADE = {
    "position": lambda q, v, f, t: 600.0 * np.exp(-(((q + 1.2) / 0.3) ** 2)) * np.tanh(v / 0.01),
    "speed": lambda q, v, f, t: 4000.0 * v,
    "load": lambda q, v, f, t: 4e-3 * np.abs(f[:, 0]),
    "time": lambda q, v, f, t: 300.0 * np.sin(2.0 * np.pi * t / 400.0) ** 2 * np.tanh(v / 0.01),
    "moments": lambda q, v, f, t: 3000.0 * np.sin(t) * (np.mod(t * 0.01 * np.sqrt(2.0), 0.3) < 0.01),
}


@pytest.mark.parametrize("of", MADE)
def test_a_function_of_one_quantity_is_told_as_that(of):
    found = told(MADE[of])
    assert (found["at"], found["of"]) == ("stick", of), found
    assert found["share"] > HALF
    assert found["detail"] == ("force of the boom cylinder" if of == "load" else "")
    assert all(0.0 < other["share"] <= 1.0 for other in found["alternatives"])


def test_white_noise_is_a_function_of_nothing():
    noise = np.random.default_rng(SEED).normal(0.0, 5.0 * NOISE, len(moved()[1]))
    found = told(lambda *_: noise)
    assert (found["of"], found["share"]) == ("none", 0.0)
    assert max((other["share"] for other in found["alternatives"]), default=0.0) < SLIGHT / 3.0
