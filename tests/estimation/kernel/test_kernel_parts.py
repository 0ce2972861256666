"""Parts of a step that are arithmetic only: as the same laws in arrays say, in both forms of the kernel."""

from array import array
from dataclasses import astuple

import numpy as np
import pytest

from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.pressures import EACH_WAY, GROUP, GROUPS
from cylforce.estimation.kernel.solving import Limits, room, solver
from cylforce.estimation.model import FRICTION, Model
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import residual
from cylforce.service.assembler import assembler
from cylforce.service.contact.noise import SHOWN
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Reason
from cylforce.signals.events import Frame
from cylforce.signals.kinds import Kind
from scenarios import CONFIG, EXCAVATOR

SEED = 83


@pytest.fixture(params=["interpreted", pytest.param("compiled", marks=pytest.mark.compiled)])
def kernel(request):
    """Each form of the kernel."""
    found = choice.INTERPRETED if request.param == "interpreted" else choice.choice().kernel
    with choice.using(found):
        yield found


@pytest.mark.parametrize("name", ["excavator_20t", "excavator_stick_bucket", "wheel_loader"])
def test_channels_of_a_sample_are_those_of_a_recording(kernel, name):
    service = load(CONFIG / f"{name}.toml").service
    model, rng = Model(service.machine, service.filters, ()), np.random.default_rng(SEED)
    sensors, found = making.sensors(model, kernel.KernelSensors, 1e9), []
    values = rng.normal(size=(20, len(service.machine.signals))) * 10.0 ** rng.uniform(-2.0, 6.0, 20)[:, None]
    for row in values:
        here = room(model.channels.read(row).size)
        assert kernel.read_channels(sensors, row, here) == 0
        found.append(here.tolist())
    np.testing.assert_array_equal(found, model.channels.read(values))


def test_a_chassis_that_is_tilted_too_far_is_told(kernel):
    service = load(EXCAVATOR).service
    model = Model(service.machine, service.filters, ())
    sensors = making.sensors(model, kernel.KernelSensors, 0.1)
    for k, signal in enumerate(service.machine.signals):
        values = np.zeros(len(service.machine.signals))
        values[k] = -0.2
        told = kernel.read_channels(sensors, values, room(model.channels.read(values).size))
        assert bool(told) is (signal.kind in (Kind.PITCH, Kind.ROLL))


@pytest.mark.parametrize("hangs", [True, False])
def test_a_force_is_shown_with_the_errors_of_its_size_and_direction(kernel, hangs):
    """By the gradient of size and direction; of the soil's force less the load, or less the weight found before."""
    service, rng = load(EXCAVATOR).service, np.random.default_rng(SEED)
    model = Model(service.machine, service.filters, ())
    made = solver(model, model.data_sheet._replace(scale_error=0.02), kernel, prior=np.eye(3))
    r, found, root = 3, rng.normal(size=35), rng.normal(size=(2, 2))
    force, spread = np.array([3e4, -5e4]), 1e6 * root @ root.T
    found[6:8], found[8:12] = force, spread.ravel()
    gain, columns, wider = found[12:18].reshape(2, r), found[18:30].reshape(r, 4), np.array([4e4, 1e4, 9e4])
    found[30], found[32:35] = 2e4, wider
    load_in, unsure = rng.normal(size=4), np.diag(rng.uniform(1.0, 2.0, 4))
    shown = room(SHOWN), room(SHOWN)
    kernel.published_forces(made, numbers(found), numbers(load_in), numbers(unsure.ravel()), int(hangs), 3.0, *shown)
    more = np.array([[wider[0], wider[1]], [wider[1], wider[2]]])
    seen = gain @ columns
    soil = (
        (force - seen @ load_in, spread + seen @ unsure @ seen.T) if hangs else (force + np.array([0.0, 2e4]), spread)
    )
    for (value, covariance), got in zip(((force, spread), soil), shown, strict=True):
        whole = covariance + more + 0.02**2 * np.outer(value, value)
        size = np.linalg.norm(value)
        along, across = value / size, np.array([-value[1], value[0]]) / size
        assert got[:4].tolist() == pytest.approx([*value, size, np.arctan2(value[1], value[0])])
        assert got[4:6].tolist() == pytest.approx(np.sqrt(np.diag(whole)))
        assert got[7] == pytest.approx(np.sqrt(across @ whole @ across) / size)
        assert got[6] == pytest.approx(np.sqrt(along @ whole @ along))  # the direction is certain
        assert got[11] == 1.0
        assert got[8:11].tolist() == pytest.approx(whole[np.triu_indices(2)])
        assert got[12:14].tolist() == pytest.approx([max(got[4:7]), size])


def test_what_the_tares_leave_is_that_of_arrays_with_friction_at_rest_under_load(kernel):
    """A cylinder that carries more holds by more; one in motion by nothing."""
    rng = np.random.default_rng(SEED)
    model = Model(load(EXCAVATOR).service.machine, load(EXCAVATOR).service.filters, FRICTION)
    size, drifts = len(model.parameters), len(model.changing)
    tares = model.data_sheet._replace(values=rng.uniform(0.5, 1.5, size), covariance=np.eye(size))
    rows = Rows(rng.normal(size=(3, len(model.filtered.regressor.names))), 10.0 * rng.normal(size=3))
    rows.columns[:, model.at_rest] = rng.uniform(0.1, 1.0, (3, 3))
    rows.columns[0, model.at_rest] = 0.0
    found = room((3 + drifts) * 3)
    kernel.residual_torque(solver(model, tares, kernel), np.append(rows.columns, rows.torque), np.zeros(drifts), found)
    wanted = residual(model, tares, rows, np.zeros(3))
    for k, each in enumerate((wanted.torque, wanted.variance, wanted.rest)):
        np.testing.assert_allclose(np.frombuffer(found)[3 * k : 3 * k + 3], each, rtol=1e-12)
    heavy = residual(model, tares, rows._replace(torque=2.0 * rows.torque), np.zeros(3))
    assert wanted.rest[0] == heavy.rest[0] == 0.0
    assert np.all(heavy.rest[1:] > wanted.rest[1:])


def test_friction_at_rest_is_one_sample_however_noisy_the_speed_is(kernel):
    """One that is read as motion now and then is no new rest; as many steps of motion allow as many at rest."""
    rng, patience = np.random.default_rng(SEED), 50
    model = Model(load(EXCAVATOR).service.machine, load(EXCAVATOR).service.filters, FRICTION)
    made = solver(model, model.data_sheet, kernel, Limits(longest_rest=float(patience)))
    size, drifts = len(model.parameters), len(model.changing)
    rows, lift = np.ones((3, len(model.filtered.regressor.names) + 1)), np.zeros(40 + 4 * (size + drifts))
    known, unsure = np.zeros(drifts), np.zeros((drifts, drifts))
    rested, taken, moved = np.zeros(3), np.zeros(3), np.zeros(3)
    for _ in range(1000):
        still = rng.uniform(size=3) > 0.1
        left = np.concatenate([np.zeros(3), np.ones(3), 4.0 * still, np.zeros(3 * drifts)])
        work = room(24)
        kernel.gate(made, rows, left, np.zeros(3), np.ones(3), rested, known, unsure, work, lift)
        rested, used = np.frombuffer(work)[21:], np.frombuffer(work)[18:21] > 0.0
        taken, moved = taken + (used & still), moved + ~still
    assert np.all(taken >= patience)
    assert np.all(taken <= patience + moved)


def test_groups_are_compared_as_by_an_analysis_of_variance(kernel):
    """Of pressures that were seen either way often enough."""
    rng = np.random.default_rng(SEED)
    readings, groups = rng.normal(size=(GROUP * GROUPS, 2)), room(4 * GROUPS * 2)
    ways = np.where(np.arange(GROUPS) < GROUPS - EACH_WAY, 1.0, -1.0)
    for k, way in enumerate(ways):
        kernel.add_group(2, numbers(readings.ravel()), GROUP * k, numbers([way, 1.0]), 0.5, groups)
    each = readings.reshape(GROUPS, GROUP, 2)
    wanted = np.stack([each.mean(axis=1), each.var(axis=1, ddof=1), np.stack([ways, np.ones(GROUPS)], axis=1)])
    np.testing.assert_allclose(np.reshape(groups, (4, GROUPS, 2))[:3], wanted, rtol=1e-12)
    white = (np.diff(each, 2, axis=1) ** 2).mean(axis=1) / 6.0
    np.testing.assert_allclose(np.reshape(groups, (4, GROUPS, 2))[3], white, rtol=1e-12)
    ratios = room(4)
    assert kernel.compare_groups(2, groups, room(GROUPS), ratios) == 1
    noise = np.sort(wanted[1, :, 0])[GROUPS // 2]
    assert ratios[0] == pytest.approx(wanted[0, :, 0].var(ddof=1) * GROUP / max(noise, 1.0))
    assert ratios[2] == pytest.approx(noise / max(np.sort(white[:, 0])[GROUPS // 2], 1.0))
    assert ratios[1] == -1.0


def test_frames_that_are_judged_together_are_judged_as_one_by_one(kernel):
    """Whole, short, long and foreign ones, in any order: the same array; more at once than come in a tick, too."""
    service, rng = load(EXCAVATOR).service, np.random.default_rng(SEED)
    together, singly, whole = (assembler(service) for _ in range(3))
    pdos, moving = [pdo for node in service.nodes for pdo in node.pdos], together.constants.still
    values = {s.name: (s.low + s.high) / 2.0 for s in service.machine.signals}
    frames = []
    for k in range(400):
        pdo = pdos[k % len(pdos) if k < 200 else int(rng.integers(len(pdos)))]
        data = encode(pdo, {name: value * rng.uniform(0.9, 1.1) for name, value in values.items()})
        if k % 41 == 40:
            data = data[:1] if k % 2 else data + b"\0"
        can_id = pdo.can_id if k % 53 else int(rng.choice([0x123, 0x700 + service.nodes[0].node_id]))
        frames.append(Frame(1_000_000 + 1250 * k, can_id, data if k % 53 else b"\x05"))
    for first in range(0, len(frames), 8):
        together.receive(frames[first : first + 8], moving)
    for frame in frames:
        singly.receive([frame], moving)
    whole.receive(frames, moving)
    assert together.state == singly.state == whole.state
    assert all(astuple(together.counters))
    assert any(channel.reason == Reason.NONE for channel in together.channels)
    assert isinstance(together.state, array)


def test_what_is_sent_is_the_nearest_integer_of_two_the_even_one(kernel):
    rng = np.random.default_rng(SEED)
    low, high, missing = -1000.0, 2000.0, 65535.0
    values = np.concatenate(
        [rng.uniform(-1200.0, 2200.0, 500), 0.05 * np.arange(-60, 60), [np.nan, np.inf, -0.0499999]]
    )
    limits = numbers(np.tile([low, high, 0.1, missing], len(values)))
    found = making.counts([0] * len(values))
    kernel.quantise(len(values), limits, numbers(values), found)
    assert found.tolist() == [round(v / 0.1) if low <= v <= high else int(missing) for v in values.tolist()]
    halves = numbers([-2.5, -1.5, -0.5, 0.5, 1.5, 2.5])
    kernel.quantise(6, numbers([low, high, 1.0, missing] * 6), halves, found)
    assert found.tolist()[:6] == [-2, -2, 0, 0, 2, 2]


def identified_kernel(kernel, rng):
    """Plan and solver of the excavator with random tares, a step's rows, a drift that is known in part."""
    service = load(EXCAVATOR).service
    model = Model(service.machine, service.filters, FRICTION)
    size, drifts = len(model.parameters), len(model.changing)
    spread = rng.normal(size=(size, size))
    tares = model.data_sheet._replace(covariance=spread @ spread.T, values=rng.normal(size=size), scale=1.1)
    rows = rng.normal(size=3 * len(model.filtered.regressor.names) + 3)
    known = rng.uniform(0.1, 2.0, drifts)
    plan, made = making.plan(model, kernel.KernelPlan), solver(model, tares, kernel)
    return model, tares, plan, made, rows, rng.normal(size=drifts), np.diag(known)


def test_a_block_believes_friction_and_takes_it_as_sure_as_it_is(kernel):
    rng = np.random.default_rng(SEED)
    _, tares, _, made, rows, drift, known = identified_kernel(kernel, rng)
    before, frictions, unknown, errors = rng.uniform(0.5, 1.5, len(drift)), len(drift) - 3, 4.0, rng.normal(size=(3, 2))
    expected = np.where(np.arange(len(drift)) < frictions, drift, 0.0)
    change = before * (1.0 + 4.0 * np.sqrt(np.minimum(np.diag(known) / before**2, 1.0)) * (expected != 0.0))
    left, gram, size = room(3 * (3 + len(drift))), room((7 + len(drift)) ** 2), 7 + len(drift)
    kernel.residual_torque(made, rows, expected, left)
    told = kernel.gather(made, rows, left, numbers([1, 1, 0]), change, errors, 2, 2.0, gram)
    work, found = (room(len(left)), room(len(drift)), room(len(drift))), room(size**2)
    seen = (rows, numbers([1, 1, 0]), drift, known, before, frictions, unknown)
    assert told == kernel.gather_block(made, *seen, errors, 2, 2.0, *work, found)
    np.testing.assert_allclose(found, gram, rtol=1e-12)
    assert told == 2
    assert tares.scale != 1.0


def test_what_errors_of_signals_do_to_the_torques(kernel):
    """A bar is a force, whose columns are those of a pressure's zero; angles as of `slips`, with the load."""
    rng = np.random.default_rng(SEED)
    model, tares, plan, made, rows, *_ = identified_kernel(kernel, rng)
    channels, load_in = rng.normal(size=9), rng.normal(size=4)
    own, per_bar, turned = [model.zero.start, model.zero.start + 2], np.array([2.0, 3.0]), making.counts([0, 2])
    angles, values, work, found = room(6), tares.values + model.load @ load_in, room(6), room(12)
    kernel.angle_error_torques(plan, channels, values, turned, 2, 1e-3, angles)
    columns = rows[: 3 * len(model.filtered.regressor.names)].reshape(3, -1)
    told = (making.counts(own), 2, per_bar, turned, 2, 1e-3, room(len(values)), work, found)
    kernel.torque_per_error(plan, made, rows, channels, load_in, *told)
    wanted = 1.1 * np.concatenate([columns[:, own] * per_bar, np.reshape(angles, (3, 2))], axis=1)
    np.testing.assert_allclose(np.reshape(found, (3, 4)), wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("asked", [True, False])
def test_a_rocking_base_is_what_explains_the_remainder_best(kernel, asked):
    """Least squares with a prior, of the levers of the first pin: -Im and Re of the first moments."""
    rng = np.random.default_rng(SEED)
    _, tares, plan, made, rows, *_ = identified_kernel(kernel, rng)
    lift, channels = np.concatenate([np.zeros(20), rng.normal(size=188)]), rng.normal(size=9)
    left = np.concatenate([0.1 * rng.normal(size=3), rng.uniform(1.0, 2.0, 6), np.zeros(27)])
    over, values, levers, wider = room(3), room(len(tares.values)), room(6), room(3)
    kernel.unexplained_torque(made, rows, left, lift, over, values)
    moments = np.array(values[1:9:3]) + 1j * np.array(values[2:9:3])
    turned = (moments * np.exp(1j * (channels[-3] + np.cumsum(channels[:3]))))[::-1].cumsum()[::-1]
    each = np.stack([-turned.imag, turned.real], axis=1)
    swings, state = 0.01, numbers([0.2, 0.3])
    variances = left[3:6] + left[6:9] + swings * (each**2).sum(axis=1)
    spread = np.linalg.inv(each.T @ (each / variances[:, None]) + 0.25 * np.eye(2))
    best = spread @ each.T @ (np.array(over) / variances)
    wanted = np.array([0.2, 0.3]) + asked * 0.1 * (best**2 - np.diag(spread) - [0.2, 0.3])
    room_for = (room(3), room(len(tares.values)), levers)
    kernel.rocking_variance(
        plan, made, rows, left, lift, channels, asked, swings, 0.1, 1e9, 0.25, *room_for, state, wider
    )
    np.testing.assert_allclose(state, np.maximum(wanted, 0.0), rtol=1e-9)
    np.testing.assert_allclose(wider, each**2 @ np.maximum(state, swings), rtol=1e-9)
