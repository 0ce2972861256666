"""The reference loader is right by formulas that it does not use: differences, potential energy, the machine file."""

import numpy as np
import pytest

from cylforce.files.recording import open_recording
from cylforce.service.assembler import assembler
from cylforce.service.samples import samples
from cylforce.settings.machine_file import load
from cylforce.signals.events import Frame, Tick
from reference_machine.arm import GRAVITY
from reference_machine.loader import draw
from reference_machine.loader.bodies import Bodies
from reference_machine.loader.engine import TRUE_COLUMNS, Engine, Plant
from reference_machine.loader.machine import SIGNALS
from reference_machine.loader.sheet import JOINTS
from reference_machine.loader.work import planned
from reference_machine.plan import empty

POSES = np.radians([(arm, attitude - arm) for arm in (-38, -15, 10, 38) for attitude in (-40, 0, 40)])
STEP = 1e-6


def lengths(machine, arm, bucket):
    geometry = machine.geometry
    return np.array([geometry.lift.span(arm)[0], abs(geometry.zbar.closed(arm, bucket).line)])


def test_levers_are_derivatives_of_lengths():
    machine = draw(4)
    zbar, lift = machine.geometry.zbar, machine.geometry.lift
    for arm, bucket in POSES:
        by_arm, by_bucket = (
            (lengths(machine, arm + a, bucket + b) - lengths(machine, arm - a, bucket - b)) / (2 * STEP)
            for a, b in ((STEP, 0.0), (0.0, STEP))
        )
        zbar.lifted = arm
        assert zbar.span(bucket)[1] == pytest.approx(by_bucket[1], abs=1e-7)
        assert (lift.span(arm)[1], zbar.arm_lever) == pytest.approx(tuple(by_arm), abs=1e-7)


def test_the_bars_close():
    """Crank, link and cylinder end where they should, by rotating pins."""
    machine = draw(4)
    s = machine.specimen
    for arm, bucket in POSES:
        closed = machine.geometry.zbar.closed(arm, bucket)
        turned = np.exp(1j * arm)
        pin = turned * complex(*s.zbar.crank_pin)
        common = pin + s.zbar.crank * np.exp(1j * closed.crank)
        on_bucket = turned * s.lengths["arm"] + np.exp(1j * (arm + bucket)) * complex(*s.zbar.link_pin)
        assert common + s.zbar.link * np.exp(1j * closed.link) == pytest.approx(on_bucket, abs=1e-12)
        eye = pin + complex(*s.zbar.eye) * np.exp(1j * closed.crank)
        assert complex(*s.cylinders["tilt"].foot) + closed.line == pytest.approx(eye, abs=1e-12)


def test_angles_come_back_from_lengths():
    machine = draw(4)
    for arm, bucket in POSES:
        assert machine.geometry.angles(lengths(machine, arm, bucket)) == pytest.approx((arm, bucket), abs=1e-9)


def test_energy_of_the_bodies_is_the_work_done_on_them():
    """With all bars in their loops, the base held; 1 s under torques that swing them by some degrees."""
    mujoco = pytest.importorskip("mujoco")
    bodies = Bodies(draw(2).specimen)
    bodies.place(0.2, -0.1)
    bodies.forward()
    data, joints = bodies.data, bodies.joints
    bias, start = data.qfrc_bias[joints].copy(), data.qpos[joints].copy()
    energies, work, done = [], [], 0.0
    for k in range(1000):
        mujoco.mj_energyPos(bodies.model, data)
        mujoco.mj_energyVel(bodies.model, data)
        energies.append(data.energy.sum())
        work.append(done)
        torque = 1.1 * bias + np.array([8e3, 3e3]) * np.sin(0.003 * k + np.arange(2))
        before = data.qpos[joints].copy()
        data.qfrc_applied[joints] = torque
        bodies.carry((0.0, 0.0), (0.0, 0.0, 0.0))
        bodies.step()
        done += torque @ (data.qpos[joints] - before)
        bodies.forward()
    assert np.degrees(np.abs(data.qpos[joints] - start).max()) > 5
    assert np.array(energies) - energies[0] == pytest.approx(np.array(work), abs=4e-3 * np.ptp(work))


def test_loops_stay_closed():
    """The rods' travel in MuJoCo is the length that the kinematics give, after two seconds of motion."""
    bodies = Bodies(draw(2).specimen)
    bodies.place(0.2, -0.1)
    bodies.forward()
    torque = 1.1 * bodies.data.qfrc_bias[bodies.joints]
    for _ in range(1500):
        bodies.data.qfrc_applied[bodies.joints] = torque
        bodies.carry((0.0, 0.0), (0.0, 0.0, 0.0))
        bodies.step()
    arm, bucket = bodies.data.qpos[bodies.joints].tolist()
    expected = [bodies.lift.span(arm)[0], abs(bodies.zbar.closed(arm, bucket).line)]
    assert abs(arm - 0.2) > 0.05
    assert bodies.data.qpos[bodies.rods] == pytest.approx(expected, abs=5e-5)


def forces_by_virtual_work(machine, arm, bucket, forward):
    """Forces (lift, tilt) that hold the arm on a base that accelerates forward, from the bodies' places in two
    neighbouring poses."""
    bodies = Bodies(machine.specimen)

    def potential(*angles):
        bodies.place(*angles)
        bodies.forward()
        x, _, z = (bodies.model.body_mass[:, None] * bodies.data.xipos).sum(axis=0)
        return GRAVITY * z + forward * x

    torque = [
        (potential(arm + a, bucket + b) - potential(arm - a, bucket - b)) / 2e-5 for a, b in ((1e-5, 0), (0, 1e-5))
    ]
    step = np.array([lengths(machine, arm + a, bucket + b) for a, b in ((1e-5, 0), (0, 1e-5))])
    return np.linalg.solve((step - lengths(machine, arm, bucket)) / 1e-5, torque)


@pytest.mark.parametrize("forward", [0.0, 0.8])
def test_a_pose_is_held_by_the_work_of_gravity_and_of_the_base(forward):
    machine, (arm, bucket) = draw(6, friction="none"), np.radians([5.0, 15.0])
    still = empty(np.tile(lengths(machine, arm, bucket), (400, 1)), 313.0)
    base = np.zeros((still.rows, 5))
    base[:, 0], base[:, 1] = forward * np.arange(still.rows) / 100, forward
    plant = Plant(machine.specimen, list(machine.friction), list(machine.pins), machine.hydraulics)
    last = Engine(plant, planned(still, base)).run().true[-100:].mean(axis=0)
    true = dict(zip(TRUE_COLUMNS, last, strict=True))
    expected = forces_by_virtual_work(machine, true["theta.arm"], true["theta.bucket"], forward)
    assert (true["force.lift"], true["force.tilt"]) == pytest.approx(tuple(expected), rel=5e-3)
    assert true["drive_acceleration"] == pytest.approx(forward, abs=2e-3)


@pytest.fixture(scope="module")
def cycle():
    return draw(11, friction="foreign").run("cycles", payloads_kg=(3000.0,), rock_deg=0.5, drive=0.6)


def test_a_cycle_digs_carries_and_dumps(cycle):
    true, ((note,),) = cycle.truth, [piece["cycles"] for piece in cycle.header["pieces"]]
    free = (cycle.t_s > note["free_s"][0] + 2.0) & (cycle.t_s < note["free_s"][1])
    assert true["payload"][free] == pytest.approx(3000.0)
    assert true["payload"][0] == true["payload"][-1] == 0.0
    assert not np.any(true["tip_force_x"][free])
    assert true["tip_force_x"].min() < -8e3
    assert np.degrees(np.ptp(true["theta.arm"])) > 60.0
    assert np.degrees(np.std(true["rock"])) == pytest.approx(0.5, rel=0.2)
    assert np.abs(true["drive_acceleration"]).max() == pytest.approx(0.6, rel=0.05)
    assert true["force.lift"].max() < 340e5 * draw(11).specimen.areas("lift")[0]


def test_seeds_decide_everything(cycle):
    again = draw(11, friction="foreign").run("cycles", payloads_kg=(3000.0,), rock_deg=0.5, drive=0.6)
    assert np.array_equal(again.values, cycle.values)
    assert draw(12).specimen != draw(11).specimen


@pytest.mark.parametrize("form", ["parquet", "log"])
def test_files_are_the_projects_own(form, tmp_path):
    """The machine file gives the lengths that the loader's own kinematics give."""
    machine = draw(1, geometry=False)
    run = machine.run("commissioning", duration_s=3)
    path = run.write(tmp_path, form)
    loaded = load(tmp_path / "machine.toml")
    assert tuple(signal.name for signal in loaded.service.machine.signals) == SIGNALS
    found = loaded.service.machine.geometry(POSES).length
    assert found == pytest.approx(np.array([lengths(machine, *pose) for pose in POSES]), abs=1e-9)
    recording = open_recording(path, loaded.service, loaded.columns)
    if form == "log":
        events = (event for event in recording.events if isinstance(event, Frame | Tick))
        rows = np.concatenate(list(samples(assembler(loaded.service), events, 10_000)))
        assert rows[-1] == pytest.approx(run.values[-1], abs=1e-6)
    else:
        assert np.array_equal(recording.values, run.values)


def test_commissioning_moves_both_joints_and_touches_nothing():
    true = draw(2).run("commissioning", duration_s=60).truth
    for joint in JOINTS:
        assert np.degrees(np.ptp(true[f"theta.{joint}"])) > 30.0
    assert not np.any(true["tip_force_z"])
    assert true["tip_z"].min() > -1.8


def test_an_unknown_scenario_is_refused():
    with pytest.raises(ValueError, match="choose one of commissioning"):
        draw(1).run("swim")
