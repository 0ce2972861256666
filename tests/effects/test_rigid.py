"""regressor @ parameters equals the inverse dynamics of an independent rigid-body library (pinocchio) at random
states."""

import numpy as np
import pinocchio as pin
import pytest

from chains import chain, machine, oracle
from cylforce.effects.effect import Halves
from cylforce.effects.loads.rigid import Rigid
from cylforce.mechanics.machine import Link, base_parameters
from cylforce.mechanics.motion import Attitude, motion


def torque(links: tuple[Link, ...], state: np.ndarray, pitch: float, roll: float) -> np.ndarray:
    """d/dt(momentum) @ Phi + static @ Phi by central differences of fourth order along the parabola of the motion."""
    m, h = machine(links), 1e-3
    theta, thetad, thetadd = state
    level = Attitude(pitch, roll)

    def halves(t: float) -> Halves:
        moving = motion(m, theta + thetad * t + thetadd * t**2 / 2, thetad + thetadd * t, np.zeros(0), level)
        return Rigid().halves(m, moving)

    near = halves(h).momentum - halves(-h).momentum
    far = halves(2 * h).momentum - halves(-2 * h).momentum
    return ((8 * near - far) / (12 * h) + halves(0.0).static) @ base_parameters(links)


@pytest.mark.parametrize("n", [2, 3, 4])
def test_regressor_times_parameters_is_inverse_dynamics(n: int) -> None:
    """d/dt(momentum) @ Phi + static @ Phi == RNEA(q, v, a), pitch and roll included, at 1000 random states."""
    rng = np.random.default_rng(n)
    worst = 0.0
    for _ in range(1000):
        links, state = chain(rng, n), rng.uniform(-2, 2, (3, n))
        pitch, roll = rng.uniform(-0.3, 0.3, 2)
        model, data = oracle(links, 9.80665 * np.cos(roll))
        along = state[0].copy()
        along[0] += pitch
        expected = pin.rnea(model, data, along, state[1], state[2])
        error = np.max(np.abs(torque(links, state, pitch, roll) - expected))
        worst = max(worst, error / np.max(np.abs(expected)))
    assert worst < 1e-9
