"""Parts of a step that are arithmetic only: as the same laws in arrays say, in both forms of the kernel."""

from array import array

import numpy as np
import pytest

from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.heard import EACH_WAY, GROUP, GROUPS
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.solving import room, solver
from cylforce.estimation.model import Model
from cylforce.service.assembler import Assembler
from cylforce.service.contact.noise import SHOWN
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Reason
from cylforce.signals.events import Frame
from cylforce.signals.kinds import Kind
from scenarios import CONFIG, EXCAVATOR

SEED = 83


@pytest.fixture(params=["interpreted", "compiled"])
def kernel(request, monkeypatch):
    """Each form of the kernel."""
    found = choice.INTERPRETED if request.param == "interpreted" else choice.choice().kernel
    monkeypatch.setattr(choice, "chosen", lambda: found)
    return found


@pytest.mark.parametrize("name", ["excavator_20t", "excavator_stick_bucket", "wheel_loader"])
def test_channels_of_a_sample_are_those_of_a_recording(kernel, name):
    service = load(CONFIG / f"{name}.toml").service
    model, rng = Model(service.machine, service.filters, ()), np.random.default_rng(SEED)
    sensors, found = making.sensors(model, kernel.KernelSensors, 1e9), []
    values = rng.normal(size=(20, len(service.machine.signals))) * 10.0 ** rng.uniform(-2.0, 6.0, 20)[:, None]
    for row in values:
        here = room(model.channels.read(row).size)
        assert kernel.sense(sensors, row, here) == 0
        found.append(here.tolist())
    np.testing.assert_array_equal(found, model.channels.read(values))


def test_a_chassis_that_is_tilted_too_far_is_told(kernel):
    service = load(EXCAVATOR).service
    model = Model(service.machine, service.filters, ())
    sensors = making.sensors(model, kernel.KernelSensors, 0.1)
    for k, signal in enumerate(service.machine.signals):
        values = np.zeros(len(service.machine.signals))
        values[k] = -0.2
        told = kernel.sense(sensors, values, room(model.channels.read(values).size))
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
    kernel.show(made, numbers(found), numbers(load_in), numbers(unsure.ravel()), int(hangs), 3.0, *shown)
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


def test_groups_are_compared_as_by_an_analysis_of_variance(kernel):
    """Of pressures that were seen either way often enough."""
    rng = np.random.default_rng(SEED)
    readings, groups = rng.normal(size=(GROUP * GROUPS, 2)), room(4 * GROUPS * 2)
    ways = np.where(np.arange(GROUPS) < GROUPS - EACH_WAY, 1.0, -1.0)
    for k, way in enumerate(ways):
        kernel.group(2, numbers(readings.ravel()), GROUP * k, numbers([way, 1.0]), 0.5, groups)
    each = readings.reshape(GROUPS, GROUP, 2)
    wanted = np.stack([each.mean(axis=1), each.var(axis=1, ddof=1), np.stack([ways, np.ones(GROUPS)], axis=1)])
    np.testing.assert_allclose(np.reshape(groups, (4, GROUPS, 2))[:3], wanted, rtol=1e-12)
    white = (np.diff(each, 2, axis=1) ** 2).mean(axis=1) / 6.0
    np.testing.assert_allclose(np.reshape(groups, (4, GROUPS, 2))[3], white, rtol=1e-12)
    ratios = room(4)
    assert kernel.compare(2, groups, room(GROUPS), ratios) == 1
    noise = np.sort(wanted[1, :, 0])[GROUPS // 2]
    assert ratios[0] == pytest.approx(wanted[0, :, 0].var(ddof=1) * GROUP / max(noise, 1.0))
    assert ratios[2] == pytest.approx(noise / max(np.sort(white[:, 0])[GROUPS // 2], 1.0))
    assert ratios[1] == -1.0


def test_frames_that_are_judged_together_are_judged_as_one_by_one(kernel):
    """Whole, short, long and foreign ones, in any order: the same array; more at once than come in a tick, too."""
    service, rng = load(EXCAVATOR).service, np.random.default_rng(SEED)
    assembler = Assembler(service)
    pdos, moving = [pdo for node in service.nodes for pdo in node.pdos], assembler.still
    values = {s.name: (s.low + s.high) / 2.0 for s in service.machine.signals}
    frames = []
    for k in range(400):
        pdo = pdos[k % len(pdos) if k < 200 else int(rng.integers(len(pdos)))]
        data = encode(pdo, {name: value * rng.uniform(0.9, 1.1) for name, value in values.items()})
        if k % 41 == 40:
            data = data[:1] if k % 2 else data + b"\0"
        can_id = pdo.can_id if k % 53 else int(rng.choice([0x123, 0x700 + service.nodes[0].node_id]))
        frames.append(Frame(1_000_000 + 1250 * k, can_id, data if k % 53 else b"\x05"))
    together = singly = assembler.begin()
    for first in range(0, len(frames), 8):
        together = assembler.receive(together, frames[first : first + 8], moving)
    for frame in frames:
        singly = assembler.receive(singly, [frame], moving)
    assert together.kept == singly.kept == assembler.receive(assembler.begin(), frames, moving).kept
    assert all(together.counters)
    assert any(channel.reason is Reason.NONE for channel in together.channels)
    assert isinstance(together.kept, array)
