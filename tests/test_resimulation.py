"""Effects switched on in the identified machine, which is led along recorded motion: laws of it."""

from pathlib import Path

import numpy as np
import pytest

from cylforce.diagnosis.answer.resimulation import Resimulation, read_blocks
from cylforce.diagnosis.columns.floor import fitted_tares
from cylforce.diagnosis.columns.problem import Problem, Seen, looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.effects.imposed import distorted, undistorted
from cylforce.estimation.model import FRICTION, Model
from cylforce.programs.common.gap_answer import bars, measured
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth

SERVICE = load(Path(__file__).resolve().parents[1] / "config/excavator_20t.toml").service
MACHINE = SERVICE.machine
SECONDS, LOAD = 60.0, 1000.0

# One of every kind in which an effect acts, with a value that shows: name, place, value, and what else.
BLOCKS = {
    "force law": {"name": "coulomb_friction", "at": "boom", "value": 4000.0},
    "share": {"name": "friction_level_change", "at": "stick", "value": 0.5},
    "pressure": {"name": "pressure_gain", "at": "stick_head_pressure", "value": 0.04},
    "angle": {"name": "angle_offset", "at": "stick_angle", "value": 0.03},
    "delay": {"name": "sensor_delay", "at": "bucket_angle", "value": 0.08},
    "tilt": {"name": "tilt_ignored", "at": "machine", "value": [0.04, 0.02]},
    "geometry": {"name": "linkage_geometry", "at": "boom", "value": [0.03, 0.01], "shape": {"part": 0}},
    "flexibility": {"name": "compliance", "at": "stick", "value": 6e-7},
    "weight": {"name": "first_moment_change", "at": "stick", "value": [400.0, 100.0, 200.0]},
    "contact": {"name": "soil_contact", "at": "bucket", "value": [4e3, 8e3], "from_s": 20.0, "until_s": 30.0},
    "slew": {"name": "slew_centrifugal", "at": "machine", "value": 0.3, "from_s": 20.0, "until_s": 30.0},
    "spill": {"name": "payload_spill", "at": "bucket", "value": [-300.0, -300.0, -50.0], "from_s": 25.0},
    "clock": {"name": "clock_fault", "at": "machine", "value": [0.08, 0.0], "from_s": 25.0},
}
ONE_SIGN = {"delay", "slew", "spill", "flexibility"}  # whose other sign the simulated machine refuses


def recording(seed, *blocks, load=LOAD):
    """A run of the machine, its motion and noise drawn from `seed`."""
    effects = read_blocks(MACHINE, blocks)
    truth = draw_truth(MACHINE, np.random.default_rng(0), 0.05)._replace(effects=effects)
    scene = moves(MACHINE, np.random.default_rng(seed), SECONDS, payload=load, turning=True)
    made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((seed, 9))
    (record,) = run(MACHINE, truth, made, [scene], dt=1.0 / SERVICE.filters.rate_hz, rng=rng)
    return Recorded(f"{seed}", record.values, load)


@pytest.fixture(scope="module")
def viewer():
    """Who looks, with what clean recordings tell: empty ones, and one with the load, whose place is known."""
    model = Model(MACHINE, SERVICE.filters, FRICTION)
    return Viewer(model, fitted_tares(model, [recording(1, load=0.0), recording(2), recording(3, load=0.0)]))


def carried(viewer, seen):
    """Mass, moments and inertia of the load, by least squares of what is left of a clean recording."""
    columns, left = seen.rows.base @ viewer.model.load, seen.rows.left
    scale, good = np.sqrt(np.nanmean(left**2, axis=0)), np.isfinite(left)
    rest = ((left - columns[..., 0] * LOAD) / scale)[good]
    return np.array([LOAD, *np.linalg.lstsq((columns[..., 1:] / scale[:, None])[good], rest, rcond=None)[0]])


@pytest.fixture(scope="module")
def clean(viewer):
    """The motion that is looked at, of the machine in order, and its load."""
    (seen,) = looked_at(viewer, [recording(4)], ())
    return seen, carried(viewer, seen)


def left(viewer, clean, seen, *blocks):
    """What the machine with these blocks leaves of a recording (T, R) [N m]."""
    load = clean[1]
    machine = Resimulation(viewer, read_blocks(MACHINE, blocks), viewer.tares + viewer.model.load @ load, load)
    return machine.seen(seen).rows, load


def size(viewer, clean, seen, *blocks):
    """The same, the load taken off, in units of what a clean recording leaves, rms of all joints."""
    rows, load = left(viewer, clean, seen, *blocks)
    plain = clean[0].rows
    usual = np.nanmean((plain.left - plain.base @ viewer.model.load @ load) ** 2, axis=0)
    squares = np.nanmean((rows.left - rows.base @ viewer.model.load @ load) ** 2, axis=0)
    return float(np.sqrt(np.mean(squares / usual)))


@pytest.mark.parametrize("kind", BLOCKS)
def test_what_has_no_size_changes_nothing(viewer, clean, kind):
    none = BLOCKS[kind] | {"value": (np.array(BLOCKS[kind]["value"]) * 0.0).tolist()}
    rows, _ = left(viewer, clean, clean[0], none)
    np.testing.assert_allclose(rows.left, clean[0].rows.left, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(rows.base, clean[0].rows.base, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("kind", BLOCKS)
def test_the_block_of_a_fault_takes_it_away_and_a_wrong_one_does_not(viewer, clean, kind):
    """Down to what a machine in order leaves; half of it, its opposite, or another time leave more."""
    block = BLOCKS[kind]
    (seen,) = looked_at(viewer, [recording(4, block)], ())
    fault, right = size(viewer, clean, seen), size(viewer, clean, seen, block)
    assert fault > 2.0
    assert right < 1.0 + 0.1 * (fault - 1.0)
    half = block | {"value": (np.array(block["value"]) * 0.5).tolist()}
    assert right < size(viewer, clean, seen, half) < fault
    if kind not in ONE_SIGN:
        opposite = block | {"value": (-np.array(block["value"])).tolist()}
        assert size(viewer, clean, seen, opposite) > fault
    if "from_s" in block:
        late = block | {"from_s": block["from_s"] + 5.0}
        assert size(viewer, clean, seen, late) > right + 0.1 * (fault - 1.0)


def test_readings_are_freed_of_what_distorts_them():
    """Distorted again they are what was recorded, to the second order of the errors."""
    values = recording(4).values
    t = np.arange(len(values)) / SERVICE.filters.rate_hz
    effects = read_blocks(MACHINE, [BLOCKS[kind] for kind in ("pressure", "angle", "tilt", "flexibility")])
    again = distorted(MACHINE, effects, undistorted(MACHINE, effects, values, t), t)
    moved = np.abs(distorted(MACHINE, effects, values, t) - values).max(axis=0)
    assert np.all(np.abs(again - values).max(axis=0) <= 0.01 * moved)


def test_a_torque_as_pressure_is_newton_metres_by_lever_by_area(viewer, clean):
    seen: Seen = clean[0]
    problem = Problem(viewer.model, np.ones(len(viewer.tares)), (), (), (seen,))
    (found,) = bars(problem, [seen], [seen.rows.left])
    lever = MACHINE.geometry(seen.rows.posture).lever
    for k, c in enumerate(measured(MACHINE)):
        (joint,) = MACHINE.spans[c]
        torque = seen.rows.left[:, MACHINE.rows.index(joint)]
        expected = torque / lever[:, c, joint] / MACHINE.cylinders[c].area_head / 1e5
        np.testing.assert_allclose(found[:, k], expected, rtol=1e-9)
