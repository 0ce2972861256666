"""Every effect of the library acts on the simulated machine as its equation says; what cannot be is refused by name."""

from dataclasses import fields
from math import inf
from pathlib import Path

import numpy as np
import pytest

from cylforce.effects.fault import BEYOND, places
from cylforce.effects.imposed import imposed, units
from cylforce.effects.library import LIBRARY
from cylforce.mechanics.motion import joint_torque
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import perfect, run
from cylforce.simulation.simulator import draw_truth

MACHINE = load(Path(__file__).resolve().parents[2] / "config/excavator_20t.toml").service.machine
SECONDS, LOAD = 30.0, 800.0


def simulated(*effects, payload=LOAD):
    """The one scene of a run by perfect sensors."""
    truth = draw_truth(MACHINE, np.random.default_rng(1), 0.1)._replace(effects=effects)
    scene = moves(MACHINE, np.random.default_rng(2), SECONDS, payload=payload, turning=True)
    (record,) = run(MACHINE, truth, perfect(MACHINE), [scene], dt=0.01, rng=np.random.default_rng(3))
    return record


@pytest.fixture(scope="module")
def plain():
    return simulated()


def signal(record, name):
    return record.values[:, [s.name for s in MACHINE.signals].index(name)]


def torque(record):
    return joint_torque(record.physics.moving)


def test_a_force_law_acts_in_its_cylinder_and_shows_in_its_pressures(plain):
    found = simulated(
        imposed(MACHINE, "coulomb_friction", "stick", 900.0, shape={"rounding": 1e-3}, begin=5.0, end=20.0)
    )
    excess = found.physics.moving.force - plain.physics.moving.force
    during = (plain.t >= 5.0) & (plain.t < 20.0)
    law = 900.0 * np.tanh(plain.physics.moving.speed[:, 1] / 1e-3) * during
    np.testing.assert_allclose(excess, np.stack([0 * law, law, 0 * law], axis=-1), atol=1e-6)
    cylinder = MACHINE.cylinders[1]
    head, rod = (signal(found, f"stick_{side}_pressure") for side in ("head", "rod"))
    np.testing.assert_allclose(head * cylinder.area_head - rod * cylinder.area_rod, found.physics.moving.force[:, 1])


def test_a_drifting_law_knows_the_time_of_the_run(plain):
    share = -0.8 * (1.0 - np.exp(-plain.t / 900.0))
    for at, cylinders in (("boom", [0]), ("machine", [0, 1, 2])):
        found = simulated(imposed(MACHINE, "friction_temperature_drift", at, -0.8, shape={"settling": 900.0}))
        usual = plain.physics.friction
        expected = usual + share[:, None] * usual * np.isin(np.arange(3), cylinders)
        np.testing.assert_allclose(found.physics.friction, expected, atol=1e-6)


def test_a_drift_of_viscous_friction_leaves_the_dry_one(plain):
    found = simulated(
        imposed(MACHINE, "friction_temperature_drift", "boom", -0.8, shape={"settling": 900.0, "viscous": True})
    )
    truth = draw_truth(MACHINE, np.random.default_rng(1), 0.1)
    (viscous,) = (float(c.value[0]) for c in truth.friction if c.name == "viscous")
    excess = (found.physics.moving.force - plain.physics.moving.force)[:, 0]
    expected = -0.8 * viscous * plain.physics.moving.speed[:, 0] * (1.0 - np.exp(-plain.t / 900.0))
    np.testing.assert_allclose(excess, expected, atol=1e-6)


def test_a_distortion_is_seen_but_does_not_act(plain):
    found = simulated(imposed(MACHINE, "angle_offset", "stick_angle", 0.02, begin=10.0))
    np.testing.assert_array_equal(found.physics.moving.force, plain.physics.moving.force)
    np.testing.assert_allclose(signal(found, "stick_angle") - signal(plain, "stick_angle"), 0.02 * (plain.t >= 10.0))


def test_a_late_sensor_tells_of_the_scene_before():
    truth = draw_truth(MACHINE, np.random.default_rng(1), 0.1)
    late = truth._replace(effects=(imposed(MACHINE, "sensor_delay", "boom_angle", 0.1),))
    first, second = (moves(MACHINE, np.random.default_rng(seed), 12.0) for seed in (2, 3))
    first = first._replace(duration=6.005)  # breaks off while the boom moves
    whole, seen = (
        np.concatenate(
            [
                signal(r, "boom_angle")
                for r in run(MACHINE, t, perfect(MACHINE), [first, second], dt=0.01, rng=np.random.default_rng(0))
            ]
        )
        for t in (truth, late)
    )
    np.testing.assert_allclose(seen[10:], whole[:-10], atol=1e-12)


def test_all_pressures_are_late_from_an_instant_on_and_more_and_more(plain):
    found = simulated(imposed(MACHINE, "clock_fault", "machine", [0.05, 0.002], begin=8.0))
    t = plain.t
    late = np.where(t >= 8.0, 0.05 + 0.002 * (t - 8.0), 0.0)
    for name in ("boom_head_pressure", "bucket_rod_pressure"):
        np.testing.assert_allclose(signal(found, name), np.interp(t - late, t, signal(plain, name)))
    np.testing.assert_array_equal(signal(found, "boom_angle"), signal(plain, "boom_angle"))


def test_an_altered_linkage_moves_the_same_joints_by_other_levers(plain):
    found = simulated(imposed(MACHINE, "linkage_geometry", "stick", [0.0, 0.02], shape={"part": 0}))
    np.testing.assert_array_equal(found.physics.course.theta, plain.physics.course.theta)
    before, after = plain.physics.moving, found.physics.moving
    assert np.max(np.abs(after.lever[:, 1] - before.lever[:, 1])) > 1e-3
    np.testing.assert_array_equal(after.lever[:, [0, 2]], before.lever[:, [0, 2]])
    bare = [p.moving._replace(force=p.moving.force - p.friction) for p in (plain.physics, found.physics)]
    np.testing.assert_allclose(joint_torque(bare[1]), joint_torque(bare[0]), atol=1e-3)


def test_a_mass_on_a_link_loads_this_joint_and_those_before(plain):
    """At rest, 300 kg ask for their weight times its arm; their first moments are told about the link's centre."""
    link = MACHINE.links[1]
    besides = [300.0 * (1.2 - link.cx), 300.0 * (0.0 - link.cz), 0.0]
    found = simulated(imposed(MACHINE, "extra_mass", link.name, [300.0, *besides]))
    (still,) = (0,)
    q, excess = plain.physics.moving.q[still], (torque(found) - torque(plain))[still]
    g = plain.physics.moving.g[still]
    arm = 1.2 * np.cos(q[1])
    expected = 300.0 * g * np.array([MACHINE.links[0].length * np.cos(q[0]) + arm, arm, 0.0])
    np.testing.assert_allclose(excess, expected, rtol=1e-3, atol=1.0)


def test_what_falls_out_of_the_bucket_is_gone_from_then_on(plain):
    at = MACHINE.links[-1].name
    x, z = plain.physics.load.centre[0]
    found = simulated(imposed(MACHINE, "payload_spill", at, [-300.0, -300.0 * x, -300.0 * z], begin=12.0))
    lighter = simulated(payload=LOAD - 300.0)
    before, after = plain.t < 12.0, plain.t >= 12.0
    np.testing.assert_allclose(torque(found)[before], torque(plain)[before])
    np.testing.assert_allclose(torque(found)[after], torque(lighter)[after], atol=1e-6)


def test_a_load_that_moves_keeps_its_mass(plain):
    found = simulated(imposed(MACHINE, "payload_shift", MACHINE.links[-1].name, [120.0, 40.0], begin=12.0))
    np.testing.assert_array_equal(found.physics.load.mass, plain.physics.load.mass)
    shift = (found.physics.load.centre - plain.physics.load.centre)[-1]
    np.testing.assert_allclose(shift * LOAD, [120.0, 40.0])


def test_what_the_tool_touches_asks_for_its_force_at_the_teeth(plain):
    found = simulated(imposed(MACHINE, "soil_contact", MACHINE.links[-1].name, [2e3, 5e3], begin=10.0, end=14.0))
    force = found.physics.soil - plain.physics.soil
    np.testing.assert_allclose(force[(plain.t > 11.0) & (plain.t < 13.0)], [[2e3, 5e3]] * 199)
    assert not np.any(force[(plain.t < 10.0) | (plain.t >= 14.0)])


def test_an_unseen_turn_pulls_outwards_and_no_sensor_says_so(plain):
    found = simulated(imposed(MACHINE, "slew_centrifugal", "machine", 0.16, begin=1.0, end=4.0))
    during = (plain.t > 1.0) & (plain.t < 4.0)
    np.testing.assert_array_equal(signal(found, "slew_rate"), signal(plain, "slew_rate"))
    np.testing.assert_allclose(found.physics.moving.slew[during], 0.4)
    assert np.all(np.abs((torque(found) - torque(plain))[during, 0]) > 100.0)


def test_a_chassis_that_swings_asks_for_what_newton_says():
    """About every pin: sum of m r x (acceleration + g) + I d2q/dt2 of all bodies beyond, places and angles differenced
    in the frame of the ground; the tilt sensor reads the swing."""
    foot = 3.0 + 0.8j
    effect = imposed(MACHINE, "boom_motion", "machine", [foot.real, foot.imag, 1.0], begin=3.0, end=26.0)
    truth = draw_truth(MACHINE, np.random.default_rng(1), 0.1)._replace(effects=(effect,))
    scene = moves(MACHINE, np.random.default_rng(2), SECONDS)
    (found,) = run(MACHINE, truth, perfect(MACHINE), [scene], dt=0.01, rng=np.random.default_rng(3))
    moving = found.physics.moving
    pitch = signal(found, "pitch")
    assert np.ptp(pitch) > 0.2
    np.testing.assert_array_equal(pitch[(found.t < 3.0) | (found.t > 26.0)], truth.pitch)
    turn = np.exp(1j * moving.q)
    pins = (foot * np.exp(1j * pitch))[:, None] + np.cumsum(turn * MACHINE.lengths, axis=1) - turn * MACHINE.lengths
    centres = pins + turn * np.array([k.cx + 1j * k.cz for k in truth.links])
    pushed = np.array([k.mass for k in truth.links]) * (second_rate(centres) + 1j * moving.g[:, None])
    spun = np.array([k.inertia for k in truth.links]) * second_rate(moving.q)
    expected = [
        np.sum((np.conj(centres - pins[:, [j]]) * pushed).imag[:, j:] + spun[:, j:], axis=1)
        for j in range(len(truth.links))
    ]
    bare = joint_torque(moving._replace(force=moving.force - found.physics.friction))
    off = np.abs(bare - np.stack(expected, axis=-1))[4:-4]
    # strokes begin with a jump of jerk, at which differences are wrong
    np.testing.assert_array_less(np.percentile(off, 99.0, axis=0), 1e-4 * np.ptp(bare, axis=0))


def second_rate(x, dt=0.01):
    """Second derivative along time, by differences of fourth order; a few steps at the ends are wrong."""
    return sum(w * np.roll(x, -k, axis=0) for k, w in ((0, -30), (1, 16), (-1, 16), (2, -1), (-2, -1))) / (12.0 * dt**2)


@pytest.mark.parametrize("group", LIBRARY, ids=lambda g: repr(g[0]))
def test_every_effect_of_the_library_changes_what_is_seen(group, plain):
    """At every of its places some signal differs, and without a size nothing does."""
    about = group[0].about
    size = {"payload_spill": -100.0}.get(about.name, about.high / 4.0)
    shape = {f.name: getattr(group[0], f.name) for f in fields(group[0])}
    shape |= {"length": 0.15} if about.name == "end_cushion" else {}  # the bucket stays 5 and 8 cm away from its ends
    at = places(MACHINE, about.place)[-1][0]
    sizes = [size] + [0.0] * (len(units(group)) - 1)
    changed = simulated(imposed(MACHINE, about.name, at, sizes, shape=shape))
    nothing = simulated(imposed(MACHINE, about.name, at, [0.0] * len(sizes), shape=shape))
    assert np.max(np.abs(changed.values - plain.values) / np.std(plain.values, axis=0)) > 1e-5
    np.testing.assert_allclose(nothing.values, plain.values, atol=1e-9, rtol=1e-9)


@pytest.mark.parametrize(
    ("wish", "told"),
    [
        (("glue", "boom", 1.0, {}), "'glue' is not known: choose one of coulomb_friction"),
        (("stribeck", "tail", 1.0, {}), "'tail', which is no cylinder: choose one of boom, stick, bucket"),
        (("pressure_gain", "boom_angle", 0.01, {}), "no pressure sensor"),
        (("stribeck", "boom", -500.0, {}), "only the other sign"),
        (("angle_offset", "boom_angle", 3.0, {}), "plausible is up to 0.06"),
        (("angle_offset", "boom_angle", float("nan"), {}), "plausible"),
        (("extra_mass", "stick", 100.0, {}), r"wants 4 value\(s\) \(kg, kg m, kg m, kg m\^2\), not 1"),
        (("stribeck", "boom", 500.0, {"shape": {"breadth": 0.1}}), "no parameter 'breadth' of its shape: width"),
        (("linkage_geometry", "boom", [0.01, 0.0], {"shape": {"part": 4}}), "no such part"),
        (("soil_contact", "bucket", [1.0, 2.0], {"begin": 3.0, "end": 2.0}), "begin before it ends"),
    ],
)
def test_what_cannot_be_is_refused_by_name(wish, told):
    name, at, value, more = wish
    with pytest.raises(ValueError, match=told):
        imposed(MACHINE, name, at, value, **more)


def test_more_than_there_is_cannot_fall_out():
    spill = imposed(MACHINE, "payload_spill", MACHINE.links[-1].name, [-900.0, 0.0, 0.0], begin=5.0, end=inf)
    with pytest.raises(ValueError, match="more falls out of the bucket"):
        simulated(spill)


@pytest.mark.parametrize("group", LIBRARY, ids=lambda group: group[0].about.name)
def test_what_can_be_found_can_be_simulated(group):
    """The diagnosis finds sizes up to the end of its range; what it cannot simulate there it would refute."""
    about = group[0].about
    size = BEYOND * about.high * (about.sign or 1)
    at = places(MACHINE, about.place)[-1][0]
    wanted = [1.0] + [0.0] * (len(units(group)) - 1)
    assert imposed(MACHINE, about.name, at, [0.999 * size * w for w in wanted], library=(group,))
    with pytest.raises(ValueError, match="plausible is up to"):
        imposed(MACHINE, about.name, at, [1.001 * size * w for w in wanted], library=(group,))
