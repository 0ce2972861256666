"""The simulated excavator obeys laws that know nothing of the product: energy balance, an independent
rigid-body library, levers by hand; its trajectories keep to the machine's limits; a seed gives the same
run."""

import tracemalloc
from itertools import pairwise
from math import pi, radians

import numpy as np
import pinocchio as pin
import pytest

from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.imposed import Imposed
from cylforce.effects.loads.carried import CarriedLoad
from cylforce.mechanics.linkages import FourBar, Triangle
from cylforce.mechanics.machine import Cylinder, Link, Machine
from cylforce.mechanics.motion import Attitude, joint_torque
from cylforce.mechanics.workspace import working_range
from cylforce.signals.kinds import Kind, Signal
from cylforce.simulation.scenario import cycles, moves
from cylforce.simulation.sensing import lag_filter, perfect, run, true_values
from cylforce.simulation.simulator import (
    ROUNDING,
    Truth,
    base_values,
    draw_truth,
    pressures,
    rigid_torque,
    simulate,
    standing,
)
from cylforce.simulation.soil import draw_dig, load
from cylforce.simulation.trajectory import JointCourse, Kinematics, Move, Phase, Scene, follow

G = 9.80665
KINDS = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.CYLINDER_LENGTH, Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
HOUSE = (Kind.PITCH, Kind.ROLL, Kind.SLEW_RATE)


def areas(bore, rod, count=1):
    return count * pi / 4 * bore**2, count * pi / 4 * (bore**2 - rod**2)


def excavator():
    """A 20 t class excavator with every kind of sensor."""
    errors = (100.0, 0.1, 100.0)
    links = (
        Link("boom", 5.7, 1950.0, 2.7, 0.45, 7200.0, radians(-25), radians(58), *errors),
        Link("stick", 2.9, 1050.0, 0.95, 0.12, 1150.0, radians(-150), radians(-38), *errors),
        Link("bucket", 1.5, 900.0, 0.68, 0.20, 320.0, radians(-140), radians(22), *errors),
    )
    linkage = FourBar((2, 0.4 + 0.5j), (2, 2.45 + 0.02j), (3, 0.42 * np.exp(1j * radians(100))), 0.62, 0.60, 1)
    cylinders = (
        Cylinder("lift", Triangle((0, 0.5 - 0.6j), (1, 2.4 + 0.35j)), *areas(0.12, 0.085, 2), 1.78, 2.95),
        Cylinder("crowd", Triangle((1, 3.2 + 0.9j), (2, -0.75 + 0.3j)), *areas(0.135, 0.095), 2.05, 3.42),
        Cylinder("curl", linkage, *areas(0.115, 0.08), 1.66, 2.64),
    )
    signals = [Signal(f"{kind}_{k}", kind, k, -1e9, 1e9, 0.01, 0.0) for kind in KINDS for k in range(3)]
    signals += [Signal(kind, kind, 0, -9, 9, 0.01, 0.0) for kind in HOUSE]
    return Machine("excavator", links, cylinders, tuple(signals), 1.5 + 0j, 1500.0, 0.75, 0.2)


def two_links():
    """Stick and bucket of the same excavator, the boom still."""
    whole = excavator()
    boom = whole.pose([0.2, 0.0, 0.0])
    foot = boom.turn[1] * (3.2 + 0.9j - 5.7)
    crowd = Cylinder("crowd", Triangle((0, foot), (1, -0.75 + 0.3j)), *areas(0.135, 0.095), 2.05, 3.42)
    bar = whole.cylinders[2].linkage
    shifted = FourBar((1, bar.foot[1]), (1, bar.rocker_pin[1]), (2, bar.link_pin[1]), 0.62, 0.60, 1)
    bucket = whole.links[2]
    turned = Link("stick", 2.9, 1050.0, 0.95, 0.12, 1150.0, radians(-138), radians(-27), 100.0, 0.1, 100.0)
    curl = Cylinder("curl", shifted, *areas(0.115, 0.08), 1.66, 2.64)
    return Machine("two", (turned, bucket), (crowd, curl), (), 1.5 + 0j, 1500.0, 0.75, 0.0)


def frictionless(machine, pitch=0.0, roll=0.0):
    return Truth(machine.links, (), np.zeros(len(machine.cylinders)), pitch, roll)


def scenes(machine, seed, swing=True, count=2):
    return list(cycles(machine, np.random.default_rng(seed), count, swing))


def grid(scene, dt=0.01):
    return np.arange(0.0, scene.duration, dt)


def heap(carried, t):
    """A load as a chunk of pinocchio's inertia: mass, centre in the last link's axes, inertia about that
    centre."""
    x, z = carried.centre[t]
    return pin.Inertia(
        max(float(carried.mass[t]), 1e-12),
        np.array([x, 0.0, z]),
        np.diag([0.0, float(carried.inertia[t] - carried.mass[t] * (x**2 + z**2)), 0.0]),
    )


def oracle(machine, extra, yaw):
    """The chain for pinocchio; with a yawing house as its first joint if asked for."""
    model = pin.Model()
    parent, offset = 0, 0.0
    if yaw:
        parent = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "house")
        offset = machine.slew_axis
    for k in machine.links:
        place = pin.SE3(np.eye(3), np.array([offset, 0, 0]))
        axis = pin.JointModelRevoluteUnaligned(np.array([0.0, -1.0, 0.0]))
        parent = model.addJoint(parent, axis, place, k.name)
        # the data sheet's figures: int z^2 = m cz^2, that is, thin about the centre's line
        inertia = pin.Inertia(k.mass, np.array([k.cx, 0, k.cz]), np.diag([0.0, k.inertia, k.inertia]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        offset = k.length
    model.appendBodyToJoint(parent, extra, pin.SE3.Identity())
    return model, model.createData()


@pytest.mark.parametrize("make", [excavator, two_links])
def test_needed_torque_is_that_of_an_independent_library(make):
    """Links, load, motion of a digging cycle, pitch and roll: RNEA of pinocchio, to 1e-8 of the largest
    torque."""
    machine = make()
    scene = scenes(machine, 1, swing=False)[1]
    t = grid(scene, 0.2)
    course, carried, attitude = follow(scene, t), load(scene.dig, t), standing(0.05, -0.03, np.zeros_like(t))
    value = base_values(machine.links, carried)
    tau = rigid_torque(machine, value, course, attitude._replace(slew=course.slew))
    expected = []
    for k in range(t.size):
        model, data = oracle(machine, heap(carried, k), yaw=False)
        model.gravity.linear = np.array([0, 0, -G * np.cos(attitude.roll[k])])
        theta = course.theta[k].copy()
        theta[0] += attitude.pitch[k]
        expected.append(pin.rnea(model, data, theta, course.thetad[k], course.thetadd[k]).copy())
    assert carried.mass.max() > 200
    assert np.max(np.abs(tau - expected)) < 1e-8 * np.max(np.abs(expected))


def test_swinging_house_on_a_slope_is_that_of_an_independent_library():
    """Centrifugal terms of links and load, and gravity seen from a house that turns on a slope."""
    machine = excavator()
    scene = scenes(machine, 2)[1]
    t = grid(scene, 0.2)
    pitch, roll = 0.06, -0.04
    course, carried = follow(scene, t), load(scene.dig, t)
    attitude = standing(pitch, roll, course.turn)._replace(slew=course.slew)
    tau = rigid_torque(machine, base_values(machine.links, carried), course, attitude)
    turn_acceleration = scene.slew.at(t)[2]
    expected = []
    for k in range(t.size):
        x, z = carried.centre[k]
        spread = float(carried.inertia[k] - carried.mass[k] * (x**2 + z**2))
        extra = pin.Inertia(
            max(float(carried.mass[k]), 1e-12), np.array([x, 0, z]), np.diag([spread / 2, spread, spread / 2])
        )
        model, data = oracle(machine, extra, yaw=True)
        up = np.array([np.cos(roll) * np.sin(pitch), np.sin(roll), np.cos(roll) * np.cos(pitch)])
        model.gravity.linear = -G * up
        states = [
            np.concatenate([[house], joints[k]])
            for house, joints in zip(
                (course.turn[k], course.slew[k], turn_acceleration[k]),
                (course.theta, course.thetad, course.thetadd),
                strict=True,
            )
        ]
        expected.append(pin.rnea(model, data, *states)[1:].copy())
    assert np.max(np.abs(course.slew)) > 0.3
    assert np.max(np.abs(tau - expected)) < 1e-8 * np.max(np.abs(expected))


def energy(machine, course, carried, pitch):
    """Kinetic plus potential energy (T,) [J] of links and load by the motion of each centre of gravity."""
    turn = np.exp(1j * (np.cumsum(course.theta, axis=-1) + pitch))
    rate = np.cumsum(course.thetad, axis=-1)
    pin_place, pin_speed, total = 0.0, 0.0, 0.0
    bodies = [(k.mass, complex(k.cx, k.cz), k.inertia) for k in machine.links]
    for j, (mass, centre, inertia) in enumerate(bodies):
        parts = [(mass, centre, inertia)]
        if j == machine.size - 1:
            c = carried.centre[:, 0] + 1j * carried.centre[:, 1]
            parts.append((carried.mass, c, carried.inertia - carried.mass * np.abs(c) ** 2))
        for m, c, about in parts:
            place = pin_place + turn[:, j] * c
            speed = pin_speed + 1j * rate[:, j] * turn[:, j] * c
            total = total + m * np.abs(speed) ** 2 / 2 + about * rate[:, j] ** 2 / 2 + m * G * place.imag
        length = machine.links[j].length
        pin_place = pin_place + turn[:, j] * length
        pin_speed = pin_speed + 1j * rate[:, j] * turn[:, j] * length
    return total


def test_power_of_the_cylinders_is_stored_or_spent():
    """sum F v = d/dt(kinetic + potential) - soil's power, the load's mass and place in the bucket frozen at
    each instant (material joins and leaves at the bucket's own velocity)."""
    machine, pitch = excavator(), 0.03
    scene = scenes(machine, 3, swing=False)[1]
    t = grid(scene)
    found = simulate(machine, frictionless(machine, pitch), scene, t)
    h = 1e-4
    rate = (
        energy(machine, follow(scene, t + h), found.load, pitch)
        - energy(machine, follow(scene, t - h), found.load, pitch)
    ) / (2 * h)
    supplied = np.sum(found.moving.force * found.moving.speed, axis=-1)
    soil = np.sum(found.soil * found.tip_velocity, axis=-1)
    assert np.max(np.abs(soil)) > 5e3
    assert np.max(np.abs(supplied - (rate - soil))) < 1e-5 * np.max(np.abs(supplied))


def test_at_rest_with_a_load_the_joints_hold_weights_by_hand():
    """Stick level, bucket hanging straight down from it: moments of all weights by hand."""
    machine = two_links()
    still = np.zeros((1, 2))
    course = Kinematics(np.array([[0.0, -pi / 2]]), still, still, np.zeros(1), np.zeros(1), np.zeros(1))
    carried = CarriedLoad(np.array([800.0]), np.array([[0.7, 0.1]]), np.array([500.0]))
    tau = rigid_torque(machine, base_values(machine.links, carried), course, Attitude())[0]
    stick, bucket = machine.links
    # the bucket's x axis points down, its z axis forward
    second = G * (bucket.mass * bucket.cz + 800.0 * 0.1)
    first = G * (stick.mass * stick.cx + (bucket.mass + 800.0) * stick.length) + second
    np.testing.assert_allclose(tau, [first, second], rtol=1e-9)


def test_load_changes_the_base_parameters_as_one_more_body_would():
    machine = excavator()
    carried = CarriedLoad(np.array([600.0]), np.array([[0.7, 0.1]]), np.array([400.0]))
    values = base_values(machine.links, carried)[0]
    empty = base_values(machine.links, CarriedLoad(np.zeros(1), np.zeros((1, 2)), np.zeros(1)))[0]
    difference = (values - empty)[:, :3]
    expected = [[600 * 5.7**2, 600 * 5.7, 0], [600 * 2.9**2, 600 * 2.9, 0], [400, 420, 60]]
    np.testing.assert_allclose(difference, expected, rtol=1e-12, atol=1e-9)


def test_pressures_give_the_force_and_never_fall_below_the_supply():
    machine = excavator()
    rng = np.random.default_rng(0)
    force, speed = rng.uniform(-3e5, 6e5, (1000, 3)), rng.uniform(-0.3, 0.3, (1000, 3))
    head, rod = pressures(machine, np.full(3, 3e7), force, speed)
    found = np.stack([machine.cylinder_force(c, head[:, c], rod[:, c]) for c in range(3)], axis=-1)
    np.testing.assert_allclose(found, force, rtol=0, atol=1e-6)
    returning = np.where(speed > 0, rod, head)
    assert np.all(returning >= 4e5 + 3e7 * speed**2 - 1e-3)
    assert np.all(np.minimum(head, rod) >= 4e5 - 1e-3)


def test_cylinders_supply_torque_friction_and_soil():
    """lever^T (F - friction) is the torque of links, load and soil; friction works against the motion."""
    machine = excavator()
    rng = np.random.default_rng(4)
    extra = (Imposed((LoadDependentFriction(ROUNDING),), "lift", 0, (0.05,)),)
    truth = draw_truth(machine, rng, 0.1, extra)
    scene = scenes(machine, 4)[1]
    found = simulate(machine, truth, scene, grid(scene))
    free = simulate(machine, truth._replace(friction=(), effects=()), scene, grid(scene))
    bare = found.moving._replace(force=found.moving.force - found.friction)
    np.testing.assert_allclose(joint_torque(bare), joint_torque(free.moving), atol=1e-4)
    assert np.all(found.friction * found.moving.speed >= -1e-9)
    moving = np.abs(found.moving.speed[:, 0]) > 0.05
    assert [c.law.about.unit for c in truth.friction] == ["N", "N s/m", "N"]
    coulomb, viscous = truth.friction[0].value[0], truth.friction[1].value[0]
    law = (coulomb + 0.05 * np.abs(found.moving.force[:, 0])) * np.sign(found.moving.speed[:, 0])
    law += viscous * found.moving.speed[:, 0]
    np.testing.assert_allclose(found.friction[moving, 0], law[moving], rtol=1e-3)


@pytest.mark.parametrize("make", [excavator, two_links])
@pytest.mark.parametrize("seed", range(5))
def test_trajectories_keep_to_the_machine(make, seed):
    """Joint ranges, end stops, cylinder speeds; no jump from scene to scene; cycles of at most 15 s."""
    machine = make()
    low, high = working_range(machine).T
    rng = np.random.default_rng(seed)
    played = [*cycles(machine, rng, 3, True), moves(machine, rng, 120.0)]
    for before, after in pairwise(played[:4]):
        assert after.duration <= 15.0
        ends = follow(before, np.array([before.duration])).theta[0]
        np.testing.assert_allclose(ends, follow(after, np.zeros(1)).theta[0], atol=1e-12)
    for scene in played:
        found = simulate(machine, frictionless(machine), scene, grid(scene))
        assert np.all((found.course.theta >= low - 1e-9) & (found.course.theta <= high + 1e-9))
        assert np.max(np.abs(found.moving.speed)) < 0.31
        for c, cylinder in enumerate(machine.cylinders):
            assert np.all(found.moving.length[:, c] > cylinder.length_low)
            assert np.all(found.moving.length[:, c] < cylinder.length_high)


def test_analytic_derivatives_are_those_of_the_positions():
    scene = moves(excavator(), np.random.default_rng(0), 60.0)
    t, h = np.linspace(1, 59, 500), 1e-5
    now, before, after = (follow(scene, t + s) for s in (0, -h, h))
    np.testing.assert_allclose((after.theta - before.theta) / (2 * h), now.thetad, atol=1e-6)
    np.testing.assert_allclose((after.thetad - before.thetad) / (2 * h), now.thetadd, atol=1e-5)


def test_moves_excite_every_joint_both_ways_alone_and_together():
    machine = excavator()
    found = follow(moves(machine, np.random.default_rng(5), 120.0), np.arange(0, 120, 0.01))
    turning = np.abs(found.thetad) > 0.02
    assert np.all(np.mean(found.thetad > 0.02, axis=0) > 0.05)
    assert np.all(np.mean(found.thetad < -0.02, axis=0) > 0.05)
    assert np.all([np.any(turning[:, j] & (turning.sum(axis=1) == 1)) for j in range(3)])
    assert np.mean(turning.sum(axis=1) >= 2) > 0.2


@pytest.mark.parametrize("seed", range(5))
def test_a_cycle_digs_lifts_and_dumps(seed):
    """Soil acts while digging only, 10 to 70 kN, against the tip; the load is 0.2..1 of the rated one and
    constant while it hangs free; the tip is drawn towards the machine, then raised; pressures stay below a
    relief valve's."""
    machine = excavator()
    rng = np.random.default_rng(seed)
    scene = scenes(machine, seed)[1]
    found = simulate(machine, draw_truth(machine, rng, 0.1), scene, grid(scene))
    phase, size = found.course.phase, np.hypot(*found.soil.T)
    digging, lifting = phase == Phase.DIG, phase == Phase.LIFT
    assert np.all(size[~digging] == 0)
    assert 10e3 < size.max() < 80e3
    assert np.all(np.sum(found.soil * found.tip_velocity, axis=-1) <= 0)
    assert np.ptp(found.load.mass[lifting]) == 0
    assert 300.0 <= found.load.mass[lifting][0] <= 1500.0
    assert found.load.mass[-1] == 0.0
    assert found.load.mass[0] == 0.0
    assert np.ptp(found.tip[digging, 0]) > 2.0
    assert found.tip[digging, 0][-1] < found.tip[digging, 0][0]
    assert found.tip[lifting, 1][-1] > found.tip[lifting, 1][0] + 1.0
    assert np.mean(np.max(np.abs(found.moving.speed[lifting]), axis=-1) > 0.01) > 0.9
    assert max(found.head.max(), found.rod.max()) < 380e5


def test_sensors_read_what_they_are_made_for():
    """Head and rod pressure give the force, encoder and inclinometer differ by the links before and the
    pitch."""
    machine = excavator()
    scene = scenes(machine, 6)[1]
    found = simulate(machine, frictionless(machine, 0.02, 0.01), scene, grid(scene))
    values = true_values(machine, found)
    seen = {s.name: values[:, k] for k, s in enumerate(machine.signals)}
    force = machine.cylinder_force(1, seen["head_pressure_1"], seen["rod_pressure_1"])
    np.testing.assert_allclose(force, found.moving.force[:, 1], atol=1e-6)
    inclination = seen["pitch"] + seen["joint_angle_0"] + seen["joint_angle_1"]
    np.testing.assert_allclose(seen["link_inclination_1"], inclination, atol=1e-12)
    np.testing.assert_allclose(machine.joint_angle(2, seen["cylinder_length_2"]), seen["joint_angle_2"], atol=1e-9)
    assert np.ptp(seen["roll"]) > 0.001


def test_lag_is_exact_for_straight_lines():
    """A ramp comes out late by the time constant, whatever the sampling."""
    t = 0.01 * np.arange(200)
    made = lag_filter(0.004, 0.01)
    _, y = made.run(made.steady(np.array(0.0)), t)
    np.testing.assert_allclose(y[20:], t[20:] - 0.004, atol=1e-12)


def test_a_run_is_the_same_in_pieces_and_for_one_seed():
    """Scenes carry the sensors' lag over; one seed gives one run."""
    machine = excavator()
    truth = draw_truth(machine, np.random.default_rng(1), 0.1)

    def records(seed):
        made = perfect(machine)._replace(noise=np.full(len(machine.signals), 1e-3), lag=np.full(18, 0.01))
        rng = np.random.default_rng(seed)
        return list(run(machine, truth, made, scenes(machine, 7), dt=0.01, rng=rng))

    first, again, other = records(1), records(1), records(2)
    assert all(np.array_equal(a.values, b.values) for a, b in zip(first, again, strict=True))
    assert not np.array_equal(first[1].values, other[1].values)
    t = np.concatenate([record.t for record in first])
    np.testing.assert_allclose(np.diff(t), 0.01, atol=1e-9)
    angles = np.concatenate([record.analog[:, 9:12] for record in first])
    assert np.max(np.abs(np.diff(angles, n=2, axis=0))) < 2e-4


def test_a_course_without_strokes_stays():
    course = JointCourse(0.3)
    np.testing.assert_array_equal(course.at(np.arange(3.0)), [[0.3] * 3, [0] * 3, [0] * 3])
    scene = Scene(1.0, (course, JointCourse(0.1, (Move(0.0, 1.0, 0.5),))), JointCourse(0.0), ((0.0, Phase.AIR),))
    assert follow(scene, np.array([2.0])).theta[0].tolist() == [0.3, 0.6]


def test_hours_of_strokes_need_memory_in_proportion():
    """Forty thousand times and four thousand strokes: a table of one by the other would be 1.3 GB."""
    steps = tuple(Move(9.0 * k, 9.0 * k + 8.0, 0.5 if k % 2 == 0 else -0.5) for k in range(4000))
    t = np.arange(0.0, 36000.0, 0.9)
    tracemalloc.start()
    found = JointCourse(0.3, steps).at(t)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * found.nbytes
    up, down = (np.clip((t % 18.0 - start) / 8.0, 0.0, 1.0) for start in (0.0, 9.0))
    share = [u**3 * (10 - 15 * u + 6 * u**2) for u in (up, down)]
    np.testing.assert_allclose(found[0], 0.3 + 0.5 * (share[0] - share[1]), atol=1e-9)


def test_a_long_scene_comes_in_parts_that_join_without_a_step():
    machine = excavator()
    truth = draw_truth(machine, np.random.default_rng(1), 0.1)
    scene = moves(machine, np.random.default_rng(2), 30.0)

    def records(**options):
        made = perfect(machine)._replace(lag=np.full(len(machine.signals), 0.01))
        return list(run(machine, truth, made, [scene], dt=0.01, rng=np.random.default_rng(3), **options))

    whole, parts = records(), records(part_s=7.0)
    assert (len(whole), len(parts)) == (1, 5)
    assert {part.scene for part in parts} == {0}
    np.testing.assert_array_equal(np.concatenate([part.t for part in parts]), whole[0].t)
    joined = np.concatenate([part.values for part in parts])
    np.testing.assert_allclose(joined, whole[0].values, rtol=1e-9, atol=1e-9)


def test_no_bucket_carries_less_than_nothing():
    """Nor by rounding, whenever it is dumped: what falls out of it then would be more than there is."""
    rng, around = np.random.default_rng(5), np.linspace(-1e-3, 1e-3, 2001)
    for _ in range(200):
        begin = rng.uniform(2.0, 3.0)
        times = (begin, begin + rng.uniform(2.0, 4.0), begin + rng.uniform(7.0, 8.0), begin + rng.uniform(8.5, 10.0))
        assert load(draw_dig(rng, times, 1500.0, 1.2), times[-1] + around).mass.min() >= 0.0
