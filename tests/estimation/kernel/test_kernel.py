"""The kernel of a step: equal to the laws of the effects, and compiled the same bits as interpreted."""

import re
import shutil
from dataclasses import replace
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.effects.effect import Halves, Parameter
from cylforce.estimation.channels import Moved
from cylforce.estimation.filters import mean, slope
from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.solving import room, solver
from cylforce.estimation.model import FRICTION, Model
from cylforce.estimation.recursive import Root, forget, solution, update
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.mechanics.linkages import FourBar
from cylforce.service.adaptation import OWN, USUAL, DriftConstants, DriftFilter
from cylforce.service.core import Core
from cylforce.service.loading.lift import lift_numbers
from cylforce.service.pipeline import Pipeline, PipelineConstants
from cylforce.service.publication import frames
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.events import Tick
from cylforce.signals.kinds import INERTIAL, Kind, Signal
from instants import ALL, unexplained_of
from machines import excavator, stick_and_bucket
from scenarios import CONFIG, cycles, fed, identified

SEED = 71
STEPS = 60
DT = 0.01


@pytest.fixture(params=["interpreted", pytest.param("compiled", marks=pytest.mark.compiled)])
def kernel(request):
    """Each form of the kernel; the tests need both."""
    found = choice.INTERPRETED if request.param == "interpreted" else choice.choice().kernel
    if request.param == "compiled" and found is choice.INTERPRETED:
        pytest.fail(f"there is no compiled kernel of this source: python hatch_build.py. {choice.choice().refused}")
    with choice.using(found):
        yield found


def machine_of(name):
    if name in ("excavator", "stick_and_bucket"):
        return {"excavator": excavator, "stick_and_bucket": stick_and_bucket}[name]()
    return load(CONFIG / f"{name}.toml").service.machine


MACHINES = ("excavator", "stick_and_bucket", "excavator_20t", "excavator_stick_bucket", "wheel_loader")


def jittered(machine, rng):
    """The machine with other lengths, bars and slew axis; some with a sensor on the base, some with a slew angle."""
    links = tuple(replace(k, length=k.length * rng.uniform(0.97, 1.03)) for k in machine.links)
    cylinders = []
    for c in machine.cylinders:
        bars = c.linkage
        if isinstance(bars, FourBar):
            eye = bars.eye * complex(rng.uniform(0.9, 1.1), rng.uniform(-0.1, 0.1))
            bars = replace(bars, rocker_length=bars.rocker_length * rng.uniform(0.98, 1.02), eye=eye)
        cylinders.append(replace(c, linkage=bars))
    signals = tuple(s for s in machine.signals if s.kind not in INERTIAL)
    if rng.random() < 0.5:
        signals += tuple(Signal(kind.value, kind, 0, -50.0, 50.0, DT, 0.01) for kind in INERTIAL)
    turned = Kind.SLEW_ANGLE if rng.random() < 0.5 else Kind.SLEW_RATE
    rate = {s.kind: s for s in signals}.get(Kind.SLEW_RATE)
    if rate is not None:
        signals = tuple(replace(s, kind=turned) if s is rate else s for s in signals)
    base = complex(*rng.uniform(-1.0, 1.0, 2))
    return replace(
        machine,
        links=links,
        cylinders=tuple(cylinders),
        signals=signals,
        slew_axis=rng.uniform(-1.0, 1.0),
        inertial=base,
    )


def motion(model, rng):
    """Channels (T, D) of a random motion of a random machine, beyond the linkages' limits, too."""
    machine, t = model.machine, DT * np.arange(STEPS)
    low, high = (np.array([getattr(k, f"angle_{end}") for k in machine.links]) for end in ("low", "high"))
    wide = 0.55 * (high - low)
    waves = np.sin(np.outer(t, rng.uniform(0.5, 6.0, low.size)) + rng.uniform(0.0, 7.0, low.size))
    force = rng.normal(size=(STEPS, len(machine.cylinders))) * 1e5
    shaken = rng.normal(size=(STEPS, 3)) * (0.2, 1.0, 1.0) + (0.0, 0.0, 9.8)
    base = shaken if model.channels.inertial else shaken[:, :0]
    house = np.outer(np.sin(3.0 * t), rng.uniform(-0.2, 0.2, 2))
    slew = np.cumsum(rng.normal(size=(STEPS, 1)), axis=0) * 0.05
    return np.concatenate([(low + high) / 2.0 + wide * waves, force, base, house, slew], axis=1)


def moves(model, channels):
    """The motion of each step, from the second one on, by the arrays' way."""
    smooth = model.channels.smoothed(channels)
    four = np.stack([smooth[k : len(smooth) - 3 + k] for k in range(4)])
    return model.channels.moved(mean(four), slope(four, model.channels.dt))


def instants(model, moved: Moved, forces):
    """(Columns, torque, change, reversing) of every instant, by filters of arrays: what `fast.py` says."""
    regressor, fast = model.filtered.regressor, model.fast
    momentum, static = regressor.both_halves(moved.motion)
    rows = list(model.machine.rows)
    quick, slow, soft = fast.quick.steady(forces[0]), fast.slow.zero(momentum[0].shape), fast.slow.zero(forces[0].shape)
    before, speed, last = momentum[0], moved.motion.speed[0], np.zeros_like(momentum[0])
    for k, m in enumerate(momentum):
        quick, force = fast.quick.step(quick, forces[k])
        slow, rate = fast.slow.step(slow, (m - before) / DT)
        soft, acceleration = fast.slow.step(soft, (moved.motion.speed[k] - speed) / DT)
        before, speed = m, moved.motion.speed[k]
        turns = (np.abs(acceleration) > 0.03) & (speed * (speed + 0.06 * acceleration) < 0.0)
        yield static[k] + rate, force @ moved.motion.lever[k][:, rows], (rate - last) / DT, turns
        last = rate


def column_sizes(model, columns):
    """The largest of each column (T, R, K); of friction at rest, lever (1 - |sgn|), the lever, which rounds it."""
    sizes = np.abs(columns).max(axis=(0, 1)) + 1e-300
    sizes[model.at_rest] = sizes[model.zero]
    return sizes


def assert_columns(found, wanted, scale):
    np.testing.assert_allclose(found / scale, wanted / scale, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("draw", range(4))
def test_rows_are_those_of_the_laws(kernel, name, draw):
    """Columns and torques of the weighing and of the instant, all effects that a service may use, to 1e-12 of each
    column's size; places where a linkage cannot be closed or is at its end included."""
    rng = np.random.default_rng((SEED, MACHINES.index(name), draw))
    model = Model(jittered(machine_of(name), rng), load(CONFIG / "excavator_20t.toml").service.filters, FRICTION)
    channels = motion(model, rng)
    moved = moves(model, channels)
    slow, quick = model.filtered.run(moved.motion), list(instants(model, moved, channels[1:, model.channels.forces]))
    sizes, now = column_sizes(model, slow.columns), column_sizes(model, np.array([q[0] for q in quick]))
    changing = np.abs([q[2] for q in quick]).max(axis=(0, 1)) + 1e-300
    force = np.abs(slow.torque).max()
    pipeline = Pipeline.start(PipelineConstants(model, kernel=kernel))
    pipeline.begin(making.numbers(channels[0]))
    for k, here in enumerate(channels[1:]):
        instant = pipeline.update(making.numbers(here))
        rows = instant.slow
        assert_columns(rows.columns, slow.columns[k], sizes)
        assert_columns(rows.torque, slow.torque[k], force)
        columns, torque, change, turns = quick[k]
        assert_columns(instant.rows.columns, columns, now)
        assert_columns(instant.rows.torque, torque, force)
        assert_columns(instant.change, change, changing)
        np.testing.assert_array_equal(instant.reversing, turns)
        np.testing.assert_allclose(instant.speed, moved.motion.speed[k], rtol=0, atol=1e-12)
    good = np.array([moved.usable[-1][list(acting)].all() for acting in model.acting])
    np.testing.assert_array_equal(pipeline.waiting == model.settle_steps, ~good)


def test_the_motion_leaves_the_linkages_range():
    """Of the test above: some instants are at a dead point, some are not."""
    usable = []
    for k, name in enumerate(MACHINES):
        rng = np.random.default_rng((SEED, k, 0))
        model = Model(jittered(machine_of(name), rng), load(CONFIG / "excavator_20t.toml").service.filters, FRICTION)
        usable.append(moves(model, motion(model, rng)).usable)
    share = np.concatenate([u.ravel() for u in usable]).mean()
    assert 0.3 < share < 0.95


def test_a_law_that_the_kernel_does_not_know_is_refused():
    class Wind:
        def parameters(self, machine):
            return (Parameter("wind", "N"),)

        def halves(self, machine, moving):
            return Halves(None, np.zeros((*moving.q.shape, 1)))

    model = Model(excavator(), load(CONFIG / "excavator_20t.toml").service.filters, ())
    known = model.filtered
    regressor = Regressor(model.machine, (*known.regressor.effects, Wind()))
    vars(model)["filtered"] = FilteredRegressor(regressor, known.dt, known.regressor_hz, known.smoothing_hz)
    with pytest.raises(TypeError, match="does not know the law of Wind"):
        making.plan(model, choice.INTERPRETED.KernelPlan)


def solving(kernel, rng):
    """A solver of random tares."""
    model = Model(excavator(), load(CONFIG / "excavator_20t.toml").service.filters, FRICTION)
    size = len(model.parameters)
    spread = rng.normal(size=(size, size))
    tares = model.data_sheet._replace(covariance=spread @ spread.T, values=rng.normal(size=size))
    return model, tares, kernel, rng


def test_an_instant_is_taken_in_as_by_least_squares(kernel):
    """Two rows of three: information, estimate and covariance of `recursive.update`; the gram adds up."""
    rng = np.random.default_rng(SEED)
    model, tares, *_ = solving(kernel, rng)
    made, size, drifts = solver(model, tares, kernel), len(model.parameters), len(model.changing)
    root = Root(np.triu(rng.normal(size=(4, 4))) + 4.0 * np.eye(4), rng.normal(size=4))
    own, columns, drifting = rng.normal(size=(3, size)), rng.normal(size=(3, 4)), rng.normal(size=(3, drifts))
    rows = np.concatenate([own, np.ones((3, len(model.filtered.regressor.names) - size))], axis=1)
    left = np.concatenate([np.ones(9), drifting.ravel()])
    torque, variance, used = rng.normal(size=3), rng.uniform(0.5, 2.0, 3), np.array([True, False, True])
    gram = rng.normal(size=(4, size + drifts))
    work, nothing = room(24), np.zeros(4)
    new = lift_numbers(root, gram, (nothing, np.zeros((4, 4))))
    np.frombuffer(work)[:] = np.concatenate([columns.ravel(), torque, variance, used, np.zeros(3)])
    kernel.take(made, rows, left, work, new)
    found, wanted = np.frombuffer(new), update(root, columns[used], torque[used], variance[used])
    factor = found[:16].reshape(4, 4)
    np.testing.assert_allclose(factor.T @ factor, wanted.factor.T @ wanted.factor, rtol=1e-12, atol=1e-12)
    values, covariance = solution(wanted)
    np.testing.assert_allclose(found[20:24], values, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(found[24:40].reshape(4, 4), covariance, rtol=1e-10, atol=1e-12)
    added = (columns[used] / variance[used, None]).T @ np.concatenate([own, drifting], axis=1)[used]
    np.testing.assert_allclose(found[40:].reshape(gram.shape), gram + added, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("usable", [(True, True, True), (True, False, True), (False, True, False)])
def test_the_force_is_that_of_weighted_least_squares(kernel, usable):
    """(A' N^-1 A + prior)^-1 A' N^-1 left, N: errors of the rows and those of the tares."""
    rng, good = np.random.default_rng(SEED), np.array(usable)
    model, tares, *_ = solving(kernel, rng)
    size, all_columns, cylinders = len(model.parameters), len(model.filtered.regressor.names), 3
    made = solver(model, tares, kernel, prior=np.diag([1e-4, 1e-4, 1e-3]))
    columns, torque = rng.normal(size=(3, all_columns)), 10.0 * rng.normal(size=3)
    drift = rng.normal(size=len(model.changing))
    unrest = np.concatenate([np.eye(3).ravel(), np.zeros(cylinders), rng.uniform(1.0, 2.0, 3)])
    new, found, wrong = room(unrest.size), room(35), rng.normal(size=(3, 2))
    before, after = np.zeros(columns.size + 3), (np.zeros(columns.size + cylinders), np.ones(9), np.zeros(4))
    rows = np.concatenate([before, columns.ravel(), torque, *after])
    kernel.tool_force(made, rows, good.astype(float), np.zeros(4), drift, wrong.ravel(), 2, unrest, new, found)
    own, tool = columns[good, :size], columns[good][:, model.tool]
    left = tares.scale * (torque - columns[:, :size] @ tares.values - columns[:, model.changing] @ drift)
    errors = np.diag(1.0 + unrest[-3:] + (0.01 * left) ** 2)[np.ix_(good, good)]
    weighted = np.linalg.solve(errors + own @ tares.covariance @ own.T, tool).T
    spread = np.linalg.inv(weighted @ tool + np.diag([1e-4, 1e-4, 1e-3]))
    got = np.frombuffer(found)
    np.testing.assert_allclose(got[:3], left, rtol=1e-12)
    np.testing.assert_allclose(got[8 - 2 : 8], (spread @ weighted @ left[good])[:2], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(got[8:12].reshape(2, 2), spread[:2, :2], rtol=1e-8, atol=1e-12)
    off = got[12:18].reshape(2, 3) @ wrong
    np.testing.assert_allclose(got[-3:], (off @ off.T)[np.triu_indices(2)], rtol=1e-12)
    weights = np.linspace(0.0, 1.0, 100_001)[:, None] * (0.0, 1.0)  # up to the heaviest of `NO_LIMITS`
    costs = np.einsum("ki,ij,kj->k", got[6:8] + weights, np.linalg.inv(spread[:2, :2]), got[6:8] + weights)
    assert got[-4] <= costs.min() * (1.0 + 1e-9)
    np.testing.assert_allclose(got[-5], weights[costs.argmin(), 1], atol=1e-4)


@pytest.mark.parametrize("limited", [False, True])
def test_a_drift_is_followed_as_by_least_squares_that_forget(kernel, limited):
    """Information of `recursive.forget` and `update`, drift and covariance by an inverse of it with the prior."""
    rng = np.random.default_rng(SEED)
    model, tares, *_ = solving(kernel, rng)
    constants = DriftConstants(model, tares._replace(values=tares.values * (0.1 if limited else 1e3)), kernel=kernel)
    drift, found = DriftFilter.start(constants), DriftFilter.start(constants)
    columns = rng.normal(size=(3, len(model.filtered.regressor.names)))
    columns[:, model.at_rest] = 0.0
    n, torque, variance = drift.root.right.size, 10.0 * rng.normal(size=3), rng.uniform(1.0, 2.0, 3)
    root = Root(np.triu(rng.normal(size=(n, n))) + np.diag(np.diag(drift.root.factor)), rng.normal(size=n))
    before = 0.1 * rng.normal(size=n - OWN)
    found.root, found.waited, found.values = root, 4, before
    found.update(unexplained_of(columns, torque, variance), ALL)
    load = columns[:, : len(model.parameters)] @ model.load
    rows = np.concatenate([load, load @ constants.usual[:, None], columns[..., model.changing]], 1)
    kept_root = forget(root, rows, KEEP)
    observed = torque + rows[:, OWN:] @ before
    wanted = update(kept_root, rows, observed, 60.0 * variance)
    information = wanted.factor.T @ wanted.factor
    np.testing.assert_allclose(found.root.factor.T @ found.root.factor, information, rtol=1e-9, atol=1e-9)
    prior, mean = np.zeros((n, n)), np.zeros(n)
    prior[OWN:, OWN:] = np.linalg.inv(drift.covariance)
    amount, wrong = (share * model.machine.rated_payload for share in USUAL)
    prior[OWN - 1, OWN - 1], mean[OWN - 1] = 1.0 / wrong**2, amount / wrong**2
    covariance = np.linalg.inv(information + prior)
    both = covariance @ (wanted.factor.T @ wanted.right + mean)
    low, high = constants.limits()
    np.testing.assert_allclose(found.values, np.clip(both[OWN:], low, high), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.covariance, covariance[OWN:, OWN:], rtol=1e-6, atol=1e-9)
    squares = np.split(
        (np.diagonal(covariance)[OWN:] + both[OWN:] ** 2) / np.diagonal(drift.covariance),
        [-len(model.machine.cylinders)],
    )
    np.testing.assert_allclose(found.scale, [(1.0 + x.sum()) / (1.0 + x.size) for x in squares], rtol=1e-6)
    assert limited is bool(np.any(np.isin(found.values, [low, high])))


KEEP = 1.0 - 5.0 / 3000.0  # five of the steps of half a minute


@pytest.mark.parametrize("name", MACHINES)
def test_what_a_slipped_angle_adds_is_that_of_gravity_and_levers(kernel, name):
    """The difference of lever force less gravity, g Re((X + i Z) exp(i q)) of the links beyond, as `mechanics` has
    them."""
    rng, by = np.random.default_rng(SEED), 1e-3
    model = Model(machine_of(name), load(CONFIG / "excavator_20t.toml").service.filters, FRICTION)
    machine, rows = model.machine, list(model.machine.rows)
    low, high = (np.array([getattr(k, f"angle_{end}") for k in machine.links]) for end in ("low", "high"))
    base = rng.normal(size=3) * model.channels.inertial
    forces, house = 1e5 * rng.normal(size=len(machine.cylinders)), (0.1, 0.05, 0.0)
    channels = np.concatenate([(low + high) / 2.0, forces, base[: 3 * model.channels.inertial], house])
    values, turned = rng.normal(size=len(model.parameters)) * 1e3, list(range(machine.size))
    moments = values[1 : 3 * machine.size : 3] + 1j * values[2 : 3 * machine.size : 3]

    def left(angles):
        held = machine.gravity * np.cos(0.05) * (moments * np.exp(1j * (np.cumsum(angles) + 0.1))).real
        return forces @ machine.geometry(angles).lever - held[::-1].cumsum()[::-1]

    unit = by * np.eye(machine.size)
    wanted = np.array([(left(channels[: machine.size] + each) - left(channels[: machine.size])) / by for each in unit])
    found = room(len(rows) * machine.size)
    plan = making.plan(model, kernel.KernelPlan)
    kernel.angle_error_torques(plan, channels, values, making.counts(turned), machine.size, by, found)
    np.testing.assert_allclose(np.reshape(found, (len(rows), -1)), wanted[:, rows].T, rtol=1e-9, atol=1e-3)


@pytest.mark.compiled
def test_both_forms_give_the_same_bits():
    """A digging cycle: every number of the state, and the bytes of every PDO."""
    loaded = load(CONFIG / "excavator_20t.toml")
    tares, (events, _) = identified(loaded), cycles(loaded, count=1)
    ways = []
    for form in (choice.INTERPRETED, choice.choice().kernel):
        with choice.using(form):
            core, found = Core(loaded.service, tares), []
            service = WeighingService.start(core)
            for event in events:
                out = fed(service, event)
                if isinstance(event, Tick):
                    whole = (
                        service.load.lift.numbers,
                        service.inputs.state,
                        service.force.noise.numbers,
                        service.recognizer.gram,
                        service.pipeline.state or b"",
                    )
                    sent = frames(core.service.publication, out.estimate)
                    found.append((sent, [bytes(memoryview(numbers)) for numbers in whole]))
        ways.append(found)
    assert choice.choice().kernel is not choice.INTERPRETED
    assert service.estimate.booking is not None
    assert ways[0] == ways[1]


def test_a_kernel_of_another_source_is_refused_with_a_sentence():
    found = choice.matching(SimpleNamespace(TEXT=1), 2)
    assert found.kernel is choice.INTERPRETED
    assert re.fullmatch(
        r"the compiled kernel was not taken, the interpreted one runs: .*another version.*", found.refused
    )


def test_a_kernel_for_another_processor_is_refused_with_a_sentence(tmp_path, monkeypatch):
    """Beside a copy of the source is a file that this processor cannot load."""
    source = Path(choice.__file__).parent
    shutil.copytree(source, tmp_path / "copied_kernel", ignore=shutil.ignore_patterns("__pycache__", "compiled.*"))
    (tmp_path / "copied_kernel" / f"{choice.COMPILED}{EXTENSION_SUFFIXES[0]}").write_bytes(b"foreign")
    monkeypatch.syspath_prepend(tmp_path)
    found = choice.choice_in("copied_kernel")
    assert found.kernel is choice.INTERPRETED
    assert f"{choice.COMPILED}{EXTENSION_SUFFIXES[0]} is for another processor or Python (" in found.refused
