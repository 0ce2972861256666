"""The reference machine is right by formulas that it does not use, and knows nothing of cylforce."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cylforce.files.recording import open_recording
from cylforce.service.assembler import assembler
from cylforce.service.samples import samples
from cylforce.settings.machine_file import load
from cylforce.signals.events import Frame, Tick
from reference_machine import draw
from reference_machine.arm import GRAVITY, Arm, up_vector
from reference_machine.datasheet import JOINTS
from reference_machine.engine import Engine
from reference_machine.friction import LuGre
from reference_machine.oil import viscosity, warming
from reference_machine.plan import empty
from reference_machine.sensors import PARTS, PRESSURES, SIGNALS
from reference_machine.truth import links_parameters
from structure import imported, modules

TOOLS = Path(__file__).resolve().parents[2] / "tools"
PHI = [f"{joint}.{symbol}" for joint in JOINTS for symbol in "JXZ"]


def physics(lengths, phi, a, rates, turns, up, slew=(0.0, 0.0, None)):
    """Joint torques by mechanics/README.md, sections 3 and 4: Q_j of absolute angles, summed outwards.

    `up` = (s_x, s_z): specific force in the axes of `a`; `slew` = (rate, distance of the boom pin, (D, E) per link)."""
    J, X, Z = np.reshape(phi, (3, 3)).T
    s_x, s_z = up
    Q = np.zeros(3)
    for j in range(3):
        Q[j] = J[j] * turns[j]
        Q[j] += X[j] * (-s_x * np.sin(a[j]) + s_z * np.cos(a[j])) - Z[j] * (s_x * np.cos(a[j]) + s_z * np.sin(a[j]))
        for i, k in [(i, j) for i in range(j)] + [(j, k) for k in range(j + 1, 3)]:
            A = X[k] * np.cos(a[k] - a[i]) - Z[k] * np.sin(a[k] - a[i])
            B = X[k] * np.sin(a[k] - a[i]) + Z[k] * np.cos(a[k] - a[i])
            Q[j] += lengths[i] * ((A * turns[i] + B * rates[i] ** 2) if k == j else (A * turns[k] - B * rates[k] ** 2))
    Omega, rho, DE = slew
    for j in range(3) if Omega else ():
        D, E = DE[j]
        r = rho + sum(lengths[i] * np.cos(a[i]) for i in range(j))
        beyond = sum(X[k] * np.cos(a[k]) - Z[k] * np.sin(a[k]) for k in range(j + 1, 3))
        centrifugal = r * (X[j] * np.sin(a[j]) + Z[j] * np.cos(a[j])) + D / 2 * np.sin(2 * a[j]) + E * np.cos(2 * a[j])
        Q[j] += Omega**2 * (centrifugal + lengths[j] * np.sin(a[j]) * beyond)
    return np.cumsum(Q[::-1])[::-1]


def loaded_phi(specimen, mass, x, z, gyration):
    """mechanics/README.md, section 9: the links' parameters with a payload in the bucket."""
    phi, load = links_parameters(specimen), mass * (x * x + z * z + gyration**2)
    for joint in ("boom", "stick"):
        phi[f"{joint}.J"] += mass * specimen.lengths[joint] ** 2
        phi[f"{joint}.X"] += mass * specimen.lengths[joint]
    for symbol, value in zip("JXZ", (load, mass * x, mass * z), strict=True):
        phi[f"bucket.{symbol}"] += value
    return [phi[name] for name in PHI]


def spread(specimen, payload):
    """(D, E) of mechanics/README.md, section 4 for each link, the payload in the bucket's."""
    mass, x, z, gyration = payload
    found = []
    phi = loaded_phi(specimen, *payload)
    for k, joint in reversed(list(enumerate(JOINTS))):
        body = specimen.bodies[joint]
        zz, xz = body.zz + body.mass * body.centre[1] ** 2, body.xz + body.mass * body.centre[0] * body.centre[1]
        if joint == "bucket":
            zz, xz = zz + mass * (z * z + gyration**2 / 2), xz + mass * x * z
        found.insert(0, (phi[3 * k] - 2 * zz, xz))
    return found


def lengths_of(machine):
    return [machine.specimen.lengths[joint] for joint in JOINTS]


def test_it_imports_nothing_of_cylforce():
    """Nor of the other tools: what it says of a machine depends on no code that is tested with it."""
    tools = modules(TOOLS)
    known = {module.name for module in (*modules(), *tools)}
    own = [module for module in tools if module.name.split(".")[0] == "reference_machine"]
    names = {name for module in own for name in imported(module, known)}
    assert {"cylforce", "reference_machine.engine", "trial.cases"} < known
    assert names
    assert [name for name in names if name.split(".")[0] != "reference_machine"] == []


@pytest.mark.parametrize("slew_rate", [0.0, 0.8])
def test_bodies_obey_the_equations_of_motion(slew_rate):
    """Random states, slope, payload, slewing: MuJoCo's accelerations balance the torques that were applied."""
    rng = np.random.default_rng(5)
    machine = draw(5, linkage_masses=False)
    s, pitch, roll = machine.specimen, 0.06, -0.05
    arm = Arm(s, pitch=pitch, roll=roll)
    up = up_vector(pitch, roll)
    for _ in range(20):
        payload = (rng.uniform(0, 1500), rng.uniform(0.5, 0.9), rng.uniform(0, 0.3), 0.3)
        angles, rates, torque = rng.uniform((0, -2, -2), (1, -1, 0.4)), rng.normal(0, 0.3, 3), rng.normal(0, 1e5, 3)
        arm.place(0.0, angles)
        arm.drive(slew_rate, rates)
        arm.load(*payload)
        arm.data.qfrc_applied[:4] = (0.0, *torque)
        arm.forward()
        a, w, dw = np.cumsum(angles), np.cumsum(rates), np.cumsum(arm.data.qacc[1:4])
        slew = (slew_rate, s.slew_axis, spread(s, payload))
        phi = loaded_phi(s, *payload)
        found = physics(lengths_of(machine), phi, a, w, dw, (GRAVITY * up[0], GRAVITY * up[2]), slew)
        assert found == pytest.approx(torque, abs=1e-6 * np.abs(torque).max())


def test_energy_of_the_bodies_is_the_work_done_on_them():
    """With barrels, rods, rocker and link in their loops; 3 s under torques that swing them by tens of degrees."""
    machine = draw(2, friction="none")
    arm = Arm(machine.specimen, 1e-3)
    arm.place(0.0, (0.5, -1.6, -0.8))
    arm.forward()
    bias = arm.data.qfrc_bias[1:4].copy()

    def energy():
        mujoco.mj_energyPos(arm.model, arm.data)
        mujoco.mj_energyVel(arm.model, arm.data)
        return arm.data.energy.sum()

    energies, work, done = [energy()], [0.0], 0.0
    start = arm.data.qpos[1:4].copy()
    for k in range(3000):
        torque = 1.05 * bias + np.array([5e3, 4e3, 1e3]) * np.sin(0.002 * k + np.arange(3))
        before = arm.data.qpos[1:4].copy()
        arm.data.qfrc_applied[1:4] = torque
        arm.step()
        done += torque @ (arm.data.qpos[1:4] - before)
        arm.forward()
        energies.append(energy())
        work.append(done)
    exchanged = np.ptp(work)
    assert np.degrees(np.abs(arm.data.qpos[1:4] - start).max()) > 10
    assert np.array(energies) - energies[0] == pytest.approx(np.array(work), abs=2e-3 * exchanged)


def test_loops_stay_closed():
    """The rods' travel in MuJoCo is the length that trigonometry gives, after two seconds of motion."""
    arm = Arm(draw(2).specimen, 1e-3)
    arm.place(0.0, (0.5, -1.6, -0.8))
    arm.drive(0.0, (0.1, -0.2, 0.3))
    arm.forward()
    balance = 1.02 * arm.data.qfrc_bias[1:4]
    for _ in range(2000):
        arm.data.qfrc_applied[1:4] = balance
        arm.step()
    for joint, linkage in zip(JOINTS, arm.linkages, strict=True):
        angle = float(arm.data.joint(joint).qpos[0])
        assert float(arm.data.joint(f"{joint}_rod").qpos[0]) == pytest.approx(linkage.span(angle)[0], abs=2e-5)


@pytest.mark.parametrize("joint", JOINTS)
def test_lever_is_the_derivative_of_the_length(joint):
    machine = draw(4)
    linkage = machine.specimen.linkage(joint)
    low, high = np.radians(machine.specimen.sheet.links[joint].range_deg)
    for angle in np.linspace(low, high, 15).tolist():
        difference = (linkage.span(angle + 1e-6)[0] - linkage.span(angle - 1e-6)[0]) / 2e-6
        assert linkage.span(angle)[1] == pytest.approx(difference, abs=1e-7)
        difference = (linkage.axis(angle + 1e-6)[0] - linkage.axis(angle - 1e-6)[0]) / 2e-6
        assert linkage.axis(angle)[1] == pytest.approx(difference, abs=1e-7)


def test_a_pose_is_held_by_gravity_over_lever():
    """Without friction the cylinders carry the weights, summed by hand."""
    machine = draw(6, friction="none", linkage_masses=False)
    s, angles = machine.specimen, np.radians([30.0, -80.0, -40.0])
    plan = empty(np.tile(machine.geometry.lengths(angles), (300, 1)), 313.0)
    true = Engine(machine.plant(), plan).run().true[-100:].mean(axis=0)
    a = np.cumsum(angles)
    pins = np.cumsum([0.0] + [s.lengths[j] * np.cos(q) for j, q in zip(JOINTS[:2], a[:2], strict=True)])
    centres = [
        pin + b.centre[0] * np.cos(q) - b.centre[1] * np.sin(q)
        for pin, q, b in zip(pins, a, (s.bodies[j] for j in JOINTS), strict=True)
    ]
    masses = [s.bodies[j].mass for j in JOINTS]
    for k in range(3):
        by_hand = GRAVITY * sum(m * (x - pins[k]) for m, x in zip(masses[k:], centres[k:], strict=True))
        length, lever, force = (true[9 + 3 * n + k] for n in range(3))
        assert length == pytest.approx(plan.lengths[0, k], abs=0.01)
        assert force * lever == pytest.approx(by_hand, rel=0.01)


@pytest.mark.parametrize(("friction", "limit_nm"), [("own", (12, 8, 3)), ("foreign", (12, 8, 3))])
def test_pressures_less_friction_are_the_torques_of_the_motion(friction, limit_nm):
    """Along a run with a load, on a slope, everything that truth reports together obeys the equations of motion."""
    machine = draw(7, friction=friction, sensors="perfect", linkage_masses=False)
    run = machine.run("commissioning", duration_s=24, payload_kg=700.0, pitch_deg=2.0, roll_deg=1.0)
    true = run.truth
    payload = tuple(float(true[name][0]) for name in ("payload", "payload_x", "payload_z", "payload_gyration"))
    phi, (x, _, z) = loaded_phi(machine.specimen, *payload), up_vector(np.radians(2), np.radians(1))
    left = []
    for k in range(len(run.t_s)):
        a, w, dw = (
            np.cumsum([true[f"{what}.{j}"][k] for j in JOINTS])
            for what in ("theta", "theta_rate", "theta_acceleration")
        )
        torque = physics(lengths_of(machine), phi, a, w, dw, (GRAVITY * x, GRAVITY * z))
        left.append(torque - [true[f"torque.{j}"][k] for j in JOINTS])
    assert np.all(np.sqrt(np.mean(np.square(left), axis=0)) < limit_nm)
    for j in JOINTS:
        head, rod = machine.specimen.areas(j)
        force = run.column(f"{j}_head_pressure") * head - run.column(f"{j}_rod_pressure") * rod
        assert force == pytest.approx(true[f"force.{j}"], abs=1.0)


def test_known_force_at_the_teeth_is_what_the_torques_lack():
    machine = draw(8, friction="none", sensors="perfect", linkage_masses=False)
    run = machine.run("tip_load", duration_s=40, pitch_deg=0.0, roll_deg=0.0)
    true, phi = run.truth, [links_parameters(machine.specimen)[name] for name in PHI]
    lengths, (tx, tz) = lengths_of(machine), machine.specimen.tool
    assert np.hypot(true["tip_force_x"], true["tip_force_z"]).max() > 5e3
    left = []
    for k in range(0, len(run.t_s), 7):
        a, w, dw = (
            np.cumsum([true[f"{what}.{j}"][k] for j in JOINTS])
            for what in ("theta", "theta_rate", "theta_acceleration")
        )
        torque = physics(lengths, phi, a, w, dw, (0.0, GRAVITY))
        arms = np.cumsum(
            [
                (tx + 1j * tz) * np.exp(1j * a[2]),
                lengths[1] * np.exp(1j * a[1]),
                lengths[0] * np.exp(1j * a[0]),
            ]
        )[::-1]
        outside = (np.conj(arms) * (true["tip_force_x"][k] + 1j * true["tip_force_z"][k])).imag
        left.append(torque - outside - [true[f"torque.{j}"][k] for j in JOINTS])
    assert np.sqrt(np.mean(np.square(left), axis=0)).max() < 15.0


def test_own_friction_is_what_it_says():
    machine = draw(9)
    true = machine.run("commissioning", duration_s=20).truth
    for j, law in zip(JOINTS, machine.friction, strict=True):
        speed, force = true[f"lever.{j}"] * true[f"theta_rate.{j}"], true[f"force.{j}"]
        dry = np.where(speed > 0, law.coulomb_extend, law.coulomb_retract) + law.load * np.abs(force)
        slides = np.abs(speed) > 0.02
        assert slides.sum() > 50
        expected = dry * np.sign(speed) + law.viscous * speed
        assert np.median(np.abs(true[f"friction.{j}"] - expected)[slides] / dry[slides]) < 0.01
        assert np.all(np.abs(true[f"friction.{j}"]) <= dry + law.viscous * np.abs(speed) + 300.0)


def test_bristles_are_integrated_exactly():
    """Steps of 1 ms and of 0.1 ms meet; sliding they give g(v) + s2 v, and 20 micrometres are held by s0 z."""
    law = next(f for f in draw(3, friction="foreign").friction if isinstance(f, LuGre))
    coarse, fine = replace(law, dt=1e-3), replace(law, dt=1e-4)
    for _ in range(30):
        a, _ = coarse.step(0.004, 1e5, 2e5, 1e5)
        for _ in range(10):
            fine.step(0.004, 1e5, 2e5, 1e5)
    assert coarse.bristle == pytest.approx(fine.bristle, rel=1e-12)
    for _ in range(1000):
        a, dry = coarse.step(0.2, 1e5, 2e5, 1e5)
    steady = law.coulomb + law.difference / 2 + law.seal_head * 2e5 + law.seal_rod * 1e5
    assert (a, dry) == (pytest.approx(steady + law.viscous * 0.2, rel=1e-3), 0.0)
    held = replace(law, bristle=0.0, dt=1e-3)
    held.step(0.02, 0.0, 0.0, 0.0)
    assert held.bristle == pytest.approx(2e-5, rel=0.2)


def test_oil_thins_as_its_grade_says():
    assert viscosity(313.15) == pytest.approx(46.0, rel=1e-6)
    assert viscosity(373.15) == pytest.approx(6.8, rel=1e-6)
    assert [warming(10.0, 60.0, 3600.0, t) for t in (0.0, 3600.0)] == pytest.approx([10.0, 60.0])


@pytest.fixture(scope="module")
def cycles():
    return draw(11, friction="foreign").run("cycles", payloads_kg=(900.0,), duration_s=None)


def test_cycle_digs_carries_and_dumps(cycles):
    true, (piece,) = cycles.truth, cycles.header["pieces"]
    (cycle,) = piece["cycles"]
    free = (cycles.t_s > cycle["free_s"][0]) & (cycles.t_s < cycle["free_s"][1])
    assert cycle["payload_kg"] == 900.0
    assert true["payload"][free] == pytest.approx(900.0)
    assert true["payload"][0] == true["payload"][-1] == 0.0
    assert not np.any(true["tip_force_x"][free])
    assert true["tip_force_x"].max() > 8e3  # the soil pushes the teeth away from the machine
    assert np.ptp(true["slew"]) > 0.8


def test_pressures_stay_positive_and_moderate(cycles):
    pressures = np.array([cycles.truth[f"{side}.{j}"] for side in ("head", "rod") for j in JOINTS])
    assert pressures.min() >= 0.0
    assert 60e5 < pressures.max() < 343e5


def test_operator_gets_roughly_what_he_asks_for(cycles):
    """Tracking need not be perfect; the bucket's path must be a digging."""
    for j in JOINTS:
        speed = cycles.truth[f"lever.{j}"] * cycles.truth[f"theta_rate.{j}"]
        assert 0.05 < np.abs(speed).max() < 0.45


def test_seeds_decide_everything(cycles):
    again = draw(11, friction="foreign").run("cycles", payloads_kg=(900.0,))
    assert np.array_equal(again.values, cycles.values)
    assert again.header == cycles.header
    assert draw(11, friction="own", sensors="perfect").specimen == draw(11).specimen
    assert draw(12).specimen != draw(11).specimen
    assert np.ptp([draw(seed).specimen.bodies["boom"].mass for seed in range(20)]) > 100.0
    one, other = (draw(11).run("commissioning", duration_s=2, seed=seed) for seed in (0, 1))
    assert not np.array_equal(one.values, other.values)


def test_sensors_stay_within_their_class():
    """Zero, span and curvature within 0.5 % of 400 bar, angles within 0.05 degrees; each part can be switched off."""
    for seed in range(10):
        for channel in draw(seed).sensors.channels:
            if channel.name in PRESSURES:
                worst = abs(channel.offset) + abs(channel.gain) * 400e5 + abs(channel.nonlinearity)
                assert 0 < worst < 0.005 * 400e5
            elif channel.name != "slew_rate":
                assert abs(channel.offset) + channel.harmonic < np.radians(0.05)
            assert 0.002 <= channel.lag <= 0.015
    one = {channel.name: channel for channel in draw(1, sensors=("offset",)).sensors.channels}["boom_head_pressure"]
    assert one.offset == draw(1).sensors.channels[0].offset
    assert (one.gain, one.lag, one.noise, one.quantum) == (0.0, 0.0, 0.0, 0.0)
    for part in PARTS:
        assert draw(1, sensors=(part,)).sensors != draw(1, sensors="perfect").sensors


def test_parked_machine_stands_still():
    run = draw(1, sensors=("noise",)).run("parked", duration_s=120)
    assert run.t_s[-1] == pytest.approx(119.99)
    standing = run.values[6000:]
    assert np.ptp(run.truth["theta.boom"][6000:]) == 0.0
    assert standing.std(axis=0)[:6] == pytest.approx(0.1e5, rel=0.1)


def test_oil_warms_and_friction_falls():
    machine = draw(1, friction="foreign")
    run = machine.run("warm_up", pieces=2, degc=(10.0, 60.0), slew=False)
    begin, later = (piece["begin_s"] for piece in run.header["pieces"])
    assert (begin, later) == (0.0, 1800.0)
    warm = run.t_s >= later
    assert run.truth["oil"][0] == pytest.approx(283.15)
    assert 310.0 < run.truth["oil"][warm][0] < 325.0
    rough = np.abs(run.truth["friction.stick"])
    assert rough[warm].mean() < 0.95 * rough[~warm].mean()


def test_effects_come_in_from_outside():
    """An extra torque, an edited plan and a distorted signal, without a change of the machine's code."""

    def late(signal, t, values, truth):
        return np.interp(t - 0.05, t, truth[signal]) if signal == "boom_angle" else values

    machine = draw(1, friction="none", sensors="perfect")
    pushed = replace(
        machine,
        extra=(lambda t, angles, rates: (-2e4, 0.0, 0.0),),
        edits=(lambda plan: replace(plan, wear=plan.wear * 0.5),),
        sensors=replace(machine.sensors, analog=(late,)),
    )
    plain, other = (m.run("commissioning", duration_s=6) for m in (machine, pushed))
    more = (other.truth["torque.boom"] - plain.truth["torque.boom"])[:50]
    assert more.mean() == pytest.approx(2e4, rel=0.1)
    assert other.truth["wear"][0] == 0.5
    assert np.abs(other.column("boom_angle") - other.truth["theta.boom"]).max() > 1e-4


@pytest.mark.parametrize("form", ["csv", "parquet", "log"])
def test_files_are_the_projects_own(form, tmp_path):
    machine = draw(1, geometry=False)
    run = machine.run("commissioning", duration_s=3)
    path = run.write(tmp_path, form)
    loaded = load(tmp_path / "machine.toml")
    assert tuple(signal.name for signal in loaded.service.machine.signals) == SIGNALS
    angles = np.radians([[20.0, -90.0, -40.0], [45.0, -60.0, -100.0]])
    assert loaded.service.machine.geometry(angles).length == pytest.approx(machine.geometry.lengths(angles), abs=1e-5)
    found = open_recording(path, loaded.service, loaded.columns)
    if form == "log":
        events = (event for event in found.events if isinstance(event, Frame | Tick))
        rows = np.concatenate(list(samples(assembler(loaded.service), events, 10_000)))
        assert rows[-1] == pytest.approx(run.values[-1], abs=1e-6)
    else:
        assert np.array_equal(found.values, run.values)
    header = json.loads((tmp_path / "truth" / "commissioning.json").read_text())
    assert set(PHI) <= set(header["base_parameters"])
    assert header["friction"]["boom"]["coulomb_extend"] > 500.0


def test_linkage_masses_cost_the_three_parameters_little():
    """What (J, X, Z) cannot say of barrels, rods and bars is well below a percent of the weight's torque."""
    left = draw(1).describe()["base_parameters_rms_nm"]
    assert 50.0 < left["boom"] < 800.0
    massless = draw(1, linkage_masses=False).describe()
    assert max(massless["base_parameters_rms_nm"].values()) < 1e-6
    alone = massless["base_parameters_of_links_alone"]
    assert all(massless["base_parameters"][name] == pytest.approx(alone[name], rel=1e-8) for name in PHI)


def test_commissioning_shows_every_joint_both_ways_at_several_speeds():
    true = draw(2).run("commissioning", duration_s=60).truth
    for j in JOINTS:
        speed = true[f"lever.{j}"] * true[f"theta_rate.{j}"]
        for low, high in pairwise((0.02, 0.06, 0.12, 0.35)):
            assert np.sum((speed > low) & (speed < high)) > 20
            assert np.sum((speed < -low) & (speed > -high)) > 20
        assert np.degrees(np.ptp(true[f"theta.{j}"])) > 20.0
    assert not np.any(true["tip_force_z"])


def test_states_to_be_refused():
    touching = draw(2).run("commissioning", duration_s=25, touching=True).truth
    assert touching["tip_force_z"].max() > 3e3
    assert np.all(draw(2).run("commissioning", duration_s=3, payload_kg=400.0).truth["payload"] == 400.0)


def test_command_line(tmp_path):
    def ask(*words):
        command = [sys.executable, "-m", "reference_machine", *words, "-o", tmp_path]
        environment = {**os.environ, "PYTHONPATH": str(TOOLS)}
        return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)

    done = ask(
        "--seed", "3", "--scenario", "holds", "--duration", "3", "--option", "payload_kg = 300.0", "--form", "csv"
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["holds.csv", "machine.toml", "truth"]
    wrong = ask("--scenario", "holds", "--option", "payload = 3")
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("reference_machine: scenario holds: ")
