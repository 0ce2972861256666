"""The filtered regressor needs no accelerations, from the first sample on; live and recorded give the same rows."""

import numpy as np
import pytest

from cylforce.effects.loads.rigid import Rigid
from cylforce.estimation.filters import fours
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.model import Model
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import base_parameters
from cylforce.mechanics.motion import Motion, motion
from cylforce.service.pipeline import Pipeline, PipelineConstants
from machines import excavator
from rig import BAR, HEAD, LEVER, readings, rig

SEED = 7
DT = 0.01
FILTERS = Filters(100.0, 5.0, 2.0, 2.0, 0.002)


def wave(rng: np.random.Generator, t: np.ndarray, fastest_hz: float) -> np.ndarray:
    """Smooth joint angles (3, T, N): angle, rate, acceleration."""
    amplitude, phase = rng.uniform(0.03, 0.12, (3, 5)), rng.uniform(0, 2 * np.pi, (3, 5))
    omega = 2 * np.pi * rng.uniform(0.05, fastest_hz, (3, 5))
    turn = omega * t[:, None, None] + phase
    middle = np.array([0.2, -1.6, -1.0])
    return np.stack(
        [
            middle + np.sum(amplitude * np.sin(turn), axis=-1),
            np.sum(amplitude * omega * np.cos(turn), axis=-1),
            -np.sum(amplitude * omega**2 * np.sin(turn), axis=-1),
        ]
    )


def inverse_dynamics(theta: np.ndarray, thetad: np.ndarray, thetadd: np.ndarray) -> np.ndarray:
    """Joint torque (T, N) from accelerations, by pinocchio."""
    import pinocchio as pin

    from chains import oracle

    model, data = oracle(excavator().links, 9.80665)
    return np.array([pin.rnea(model, data, *state) for state in zip(theta, thetad, thetadd, strict=True)])


def test_filtered_identity_holds_from_the_first_sample() -> None:
    """S L Q = S (d/dt L p + L static): rms error below 1e-6 of rms S L Q for motion up to 0.5 Hz at 100 Hz, and within
    the first 0.2 s below 1e-3 of it."""
    machine, t = excavator(), np.arange(0, 12, DT)
    theta, thetad, thetadd = wave(np.random.default_rng(SEED), t, 0.5)
    tau = inverse_dynamics(theta, thetad, thetadd)
    filtered = FilteredRegressor(Regressor(machine, (Rigid(),)), DT, 2.0, 20.0)
    rows = filtered.run(driven(theta, thetad, tau))
    error = rows.torque - rows.columns @ base_parameters(machine.links)
    size = np.sqrt(np.mean(rows.torque**2, axis=0))
    assert np.all(np.sqrt(np.mean(error[100:] ** 2, axis=0)) < 1e-6 * size)
    assert np.all(np.abs(error[:20]) < 1e-3 * size)


def test_sampling_keeps_the_inertia_of_quick_moves() -> None:
    """Angles and forces alone, sampled at 100 Hz, of a bucket that swings at 3 Hz with J q'' + g X cos q = Q: the J
    found is right to 1e-4. Means and differences of two samples make it 0.6 % too small."""
    machine, t = excavator(), np.arange(0, 12, DT)
    model, true = Model(machine, FILTERS, ()), base_parameters(machine.links)
    theta, thetad, thetadd = np.zeros((3, t.size, 3))
    omega = 2 * np.pi * 3.0
    theta += (0.2, -1.6, -1.0)
    theta[:, 2] += 0.01 * np.sin(omega * t)
    thetad[:, 2], thetadd[:, 2] = 0.01 * omega * np.cos(omega * t), -0.01 * omega**2 * np.sin(omega * t)
    force = driven(theta, thetad, inverse_dynamics(theta, thetad, thetadd)).force
    channels = np.concatenate([theta, force, np.zeros((t.size, 3))], axis=1)
    rows = model.filtered.run(model.channels.between(fours(model.channels.smoothed(channels))).motion)
    late, inertia = slice(200, None), 6  # the bucket's J
    rest = rows.torque - rows.columns[..., :9] @ true
    column = rows.columns[late, 2, inertia]
    assert abs(column @ rest[late, 2] / (column @ column)) < 1e-4 * true[inertia]


def driven(theta: np.ndarray, thetad: np.ndarray, tau: np.ndarray) -> Motion:
    """A motion whose cylinder forces give exactly the torques tau."""
    machine = excavator()
    still = motion(machine, theta, thetad, np.zeros(theta.shape))
    return still._replace(force=np.linalg.solve(np.swapaxes(still.lever, -1, -2), tau[..., None])[..., 0])


def test_live_equals_recorded() -> None:
    """One step at a time gives the rows of the whole recording to 1e-12."""
    machine = excavator()
    model = Model(machine, FILTERS, ("coulomb", "viscous", "load_dependent"))
    rng = np.random.default_rng(SEED)
    theta = wave(rng, np.arange(0, 4, DT), 0.4)[0]
    values = np.concatenate([rng.uniform(1e5, 2e7, (400, 6)), theta, rng.uniform(-0.1, 0.1, (400, 3))], axis=1)
    moved = model.channels.run(values)
    expected = model.filtered.run(moved.motion)
    pipeline = Pipeline.start(PipelineConstants(model))
    channels = [model.channels.read(v) for v in values]
    pipeline.begin(numbers(channels[0]))
    for k, x in enumerate(channels[1:]):
        rows = pipeline.update(numbers(x)).slow
        scale = np.abs(expected.columns).max(axis=(0, 1)) + 1e-300
        np.testing.assert_allclose(rows.columns / scale, expected.columns[k] / scale, rtol=0, atol=1e-12)
        np.testing.assert_allclose(rows.torque, expected.torque[k], rtol=0, atol=1e-12 * np.abs(expected.torque).max())


def test_what_was_before_is_forgotten_when_rows_count() -> None:
    """After seven time constants of the slowest poles a first-order low-pass has forgotten all but e^-7, Butterworth's
    pair, whose poles lie at 45 degrees, all but sqrt(2) e^(-7/sqrt(2)) = 1.0 %. One after the other, and after the
    channels' quicker pair, they leave at most twice that."""
    model = Model(rig(), FILTERS, ("coulomb",))
    before, after = 300, model.settle_steps
    head = np.where(np.arange(2 * before) < before, 100 * BAR, 0.0)
    torque = model.filtered.run(model.channels.run(readings(2 * before, head=head)).motion).torque[:, 0]
    torque /= 100 * BAR * HEAD * LEVER
    assert torque[before - 10] == pytest.approx(1.0)
    assert abs(torque[before + after]) < 2.0 * 2.0**0.5 * np.exp(-7.0 / 2.0**0.5)


def test_missing_steps_are_filled_along_a_line() -> None:
    """On a straight line of channels, skipping two steps gives what taking them gives."""
    model = Model(excavator(), FILTERS, ("coulomb", "viscous"))
    rng = np.random.default_rng(SEED)
    begin = np.array([0.2, -1.6, -1.0, 1e5, 2e5, 3e4, 0.0, 0.0, 0.1])
    slope = rng.normal(size=9) * np.array([1e-3] * 3 + [100.0] * 3 + [0.0, 0.0, 1e-3])
    constants = PipelineConstants(model)
    one, other = Pipeline.start(constants), Pipeline.start(constants)
    one.begin(numbers(begin))
    other.begin(numbers(begin))
    for k in range(1, 31):
        rows = one.update(numbers(begin + k * slope)).slow
        if k % 3 == 0:
            sparse = other.update(numbers(begin + k * slope), 3).slow
            np.testing.assert_allclose(sparse.columns, rows.columns, atol=1e-9 * np.abs(rows.columns).max())


def test_slew_equals_an_independent_library() -> None:
    """Centrifugal torques of a turning house against pinocchio with a yaw joint, at 200 random states: 1e-9, with each
    link's exact D = J - 2 int z^2 dm and E = int x z dm."""
    from cylforce.effects.loads.slew import Slew
    from slew_oracle import yaw_torque

    machine, rng = excavator(), np.random.default_rng(SEED)
    for _ in range(200):
        a = rng.uniform(-1.5, 1.0, 3)
        thin, rate = rng.uniform(0.1, 0.4, 3), float(rng.uniform(0.2, 1.2))
        expected, values = yaw_torque(machine, a, rate, thin)
        moving = motion(machine, np.diff(a, prepend=0.0), np.zeros(3), np.zeros(3))._replace(slew=np.asarray(rate))
        found = Slew().halves(machine, moving).static @ values
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-6)


def test_paper_equation_1_is_the_special_case_at_rest() -> None:
    """At rest, two links, a weight W at (l_x, alpha_x): the torques beyond the tares are the paper's (1) with the
    term that
    its second row drops (mechanics/README.md, section 12): tau_2 = W l_x sin(..), tau_1 = tau_2 + W l_B sin(..)."""
    from machines import stick_and_bucket

    machine = stick_and_bucket()
    model = Model(machine, FILTERS, ("coulomb", "viscous"))
    rng = np.random.default_rng(SEED)
    g = 9.80665
    for _ in range(50):
        theta = np.array([rng.uniform(-2.5, -0.7), rng.uniform(-2.0, 0.3)])
        weight, reach = rng.uniform(1e3, 2e4), rng.uniform(0.3, 1.2)
        q1, q2 = theta[0], theta.sum()
        moving = motion(machine, theta, np.zeros(2), np.zeros(2))
        static = Rigid().halves(machine, moving).static
        load = static @ model.load[:6] @ np.array([weight / g, weight / g * reach, 0.0, 0.0])
        # angles from the vertical, as in the paper: the horizontal arm of a weight is l cos(q) = l sin(alpha)
        expected = np.array(
            [
                weight * (machine.links[0].length * np.cos(q1) + reach * np.cos(q2)),
                weight * reach * np.cos(q2),
            ]
        )
        np.testing.assert_allclose(load, expected, rtol=1e-12)
        # the other reading of (1): a force of known arm (the tooth line), unknown size and direction
        from cylforce.effects.loads.tip_force import TipForce

        tool = TipForce().halves(machine, moving).static[:, :2]
        force = rng.uniform(-2e4, 2e4, 2)
        point = machine.tool_point(theta)
        moment = -np.array([np.real(np.conj(d) * complex(*force)) for d in point.gradient])
        np.testing.assert_allclose(tool @ force, moment, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("pitch", [-0.3, 0.0, 0.2])
def test_tool_columns_are_the_tool_jacobian(pitch: float) -> None:
    """r = -(dP/dq)^T F, with F in true horizontal and vertical."""
    from cylforce.effects.loads.tip_force import TipForce
    from cylforce.mechanics.motion import Attitude

    machine, rng = excavator(), np.random.default_rng(SEED)
    theta, force = np.array([0.3, -1.4, -0.8]), rng.normal(size=2)
    moving = motion(machine, theta, np.zeros(3), np.zeros(3), Attitude(pitch))
    gradient = machine.tool_point(theta).gradient * np.exp(1j * pitch)
    expected = -np.real(np.conj(gradient) * complex(*force))
    np.testing.assert_allclose(TipForce().halves(machine, moving).static[:, :2] @ force, expected, rtol=1e-12)
