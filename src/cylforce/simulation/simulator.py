"""The simulated machine: computes the cylinder forces and pressures that a given motion needs.

It uses the same effects as the estimator: results on it show that the programs work, not how accurate the method is.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cylforce.effects.effect import Halves
from cylforce.effects.fault import BaseMotion, ForceLaw
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.friction.viscous_friction import ViscousFriction
from cylforce.effects.imposed import (
    Imposed,
    added_parameters,
    altered,
    base_motions,
    changed_load,
    contact_force,
    excess_force,
    excess_torque,
    friction_level,
    unseen_slew,
)
from cylforce.effects.loads.carried import CarriedLoad
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.slew import Slew, slew_parameters
from cylforce.effects.loads.tip_force import tip_torque
from cylforce.effects.swing import Swing, swing
from cylforce.mechanics.chain import Complex
from cylforce.mechanics.machine import Link, Machine, base_parameters
from cylforce.mechanics.motion import Attitude, Motion, motion
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.simulation.soil import load, resistance, soil_force
from cylforce.simulation.trajectory import Kinematics, Scene, follow

H = 1e-3  # s, step of the fourth-order finite difference d/dt(momentum); chosen: relative error about 1e-11
ROUNDING = 1e-3  # m/s, speed scale of the smooth sgn(v) of friction; chosen
STRIBECK_SPEED = 0.015  # m/s, speed scale of the Stribeck friction; chosen
SUPPLY = 4e5  # Pa, lowest pressure in a chamber; chosen


class CylinderFriction(NamedTuple):
    """A friction law that acts on every cylinder.

    name: name of the law
    law: force per unit of the coefficient
    value: (C,) coefficient of each cylinder [N], of viscous friction [N s/m]
    """

    name: str
    law: ForceLaw
    value: Array


class Truth(NamedTuple):
    """The true machine, which the estimator does not have.

    links: the true links
    friction: the true friction laws
    back: (C,) pressure loss of the return line [Pa/(m/s)^2]
    pitch, roll: of the ground [rad], as measured by a house that looks along its tracks
    effects: further differences from the model
    """

    links: tuple[Link, ...]
    friction: tuple[CylinderFriction, ...]
    back: Array
    pitch: float
    roll: float
    effects: tuple[Imposed, ...] = ()


class Physics(NamedTuple):
    """The physics of a scene at T instants.

    t: (T,) time from the start of the scene [s]
    course: joint motion
    moving: motion with the true cylinder forces
    attitude: attitude of the chassis; its slew rate has no sign, and contains slewing that no sensor measures
    friction: (T, C) friction contained in those forces [N], with additional forces of cylinders by effects
    head, rod: (T, C) chamber pressures [Pa]
    soil: (T, 2) force of soil and obstacles on the teeth, x forward, z truly vertical [N]
    tip_velocity: (T, 2) velocity of the teeth relative to the chassis, in the same axes [m/s]
    tip: (T, 2) place of the teeth from the first pin in the same axes [m]
    load: the load in the bucket, with what effects change of it
    turning: (T,) rate of an inertial sensor on the base [rad/s]
    specific: (T,) its specific force, forwards + i upwards [m/s^2]
    """

    t: Array
    course: Kinematics
    moving: Motion
    attitude: Attitude
    friction: Array
    head: Array
    rod: Array
    soil: Array
    tip_velocity: Array
    tip: Array
    load: CarriedLoad
    turning: Array
    specific: Complex


def draw_truth(
    machine: Machine, rng: np.random.Generator, mass_error: float, effects: tuple[Imposed, ...] = ()
) -> Truth:
    """Return a true machine drawn at random.

    Friction is drawn in proportion to the head areas, the pressure loss of the return lines independently of them.
    Pitch and roll of the ground are within 0.03 rad, and zero where no sensor measures them.

    mass_error: share of its mass by which each link differs from the machine file, up or down; its inertia differs by
        the same share; its centre and inertia differ in addition by up to half of that share
    effects: further differences from the model
    """
    signs = rng.choice((-1.0, 1.0), machine.size)
    shape = rng.uniform(-0.5, 0.5, (machine.size, 3)) * mass_error
    links = tuple(
        _with_errors(link, 1 + sign * mass_error, of_link)
        for link, sign, of_link in zip(machine.links, signs, shape, strict=True)
    )
    area = np.array([c.area_head for c in machine.cylinders])
    coulomb, viscous = area * rng.uniform((1.0e5, 2e5), (1.6e5, 5e5), (area.size, 2)).T
    friction = (
        CylinderFriction("coulomb", CoulombFriction(ROUNDING), coulomb),
        CylinderFriction("viscous", ViscousFriction(), viscous),
        CylinderFriction("stribeck", Stribeck(STRIBECK_SPEED, ROUNDING), coulomb * rng.uniform(0.3, 0.6, area.size)),
    )
    measured = {signal.kind for signal in machine.signals}
    pitch, roll = rng.uniform(-0.03, 0.03, 2) * (Kind.PITCH in measured, Kind.ROLL in measured)
    return Truth(
        links=links,
        friction=friction,
        back=rng.uniform(2e7, 4e7, area.size),
        pitch=float(pitch),
        roll=float(roll),
        effects=effects,
    )


def _with_errors(link: Link, factor: float, shape: Array) -> Link:
    """Return the link with `factor` times its mass and inertia; cx, cz and inertia are in addition larger by shares.

    shape: (3,) these shares, of cx, cz and inertia
    """
    cx_error, cz_error, inertia_error = shape.tolist()
    return replace(
        link,
        mass=link.mass * factor,
        cx=link.cx * (1 + cx_error),
        cz=link.cz * (1 + cz_error),
        inertia=link.inertia * factor * (1 + inertia_error),
    )


def simulate(machine: Machine, truth: Truth, scene: Scene, t: Array, begin: float = 0.0) -> Physics:
    """Return the physics of a machine that follows a scene.

    machine: the machine of the machine file, without the errors of `truth`
    truth: masses, friction and ground of the true machine, and its other differences
    t: (T,) times from the start of the scene [s]
    begin: start of the scene after the start of the run [s]
    """
    clock, machine = t + begin, altered(machine, truth.effects)
    course, carried = follow(scene, t), changed_load(truth.effects, load(scene.dig, t), clock)
    slew = np.sqrt(course.slew**2 + unseen_slew(truth.effects, clock))
    stands, swung = standing(truth.pitch, truth.roll, course.turn), swing(truth.effects, clock)
    attitude = stands._replace(pitch=np.asarray(stands.pitch) + swung.angle, slew=slew)
    unknown = np.zeros((*t.shape, len(machine.cylinders)))
    moving = motion(machine, course.theta, course.thetad, unknown, attitude)
    tip = machine.tool_point(course.theta)
    turn = np.exp(1j * np.asarray(attitude.pitch))
    velocity = _plane(turn * np.sum(tip.gradient * course.thetad, axis=-1))
    soil = soil_force(resistance(scene.dig, t), velocity) + contact_force(truth.effects, clock)
    value = base_values(truth.links, carried)
    value[..., :3] += added_parameters(machine, truth.effects, clock)
    tau = rigid_torque(machine, value, course, attitude) + tip_torque(machine, moving, soil)
    tau += carrying_torque(machine, truth.effects, value, course, attitude, swung)
    moving, friction = balance(machine, truth, moving, tau, clock)
    head, rod = pressures(machine, truth.back, moving.force, moving.speed)
    place = _plane(turn * tip.place)
    return Physics(
        t=t,
        course=course,
        moving=moving,
        attitude=attitude,
        friction=friction,
        head=head,
        rod=rod,
        soil=soil,
        tip_velocity=velocity,
        tip=place,
        load=carried,
        turning=swung.rate,
        specific=specific_force(machine, truth.effects, attitude, swung),
    )


def specific_force(machine: Machine, effects: Sequence[Imposed], attitude: Attitude, swung: Swing) -> Complex:
    """Return the reading of an accelerometer at the machine's `inertial` place (T,), forwards + i upwards [m/s^2].

    It is the sum of gravity's counterforce (upwards while the machine rests), the acceleration of the swing about the
    pivot of the effects that move the chassis, and the centripetal acceleration of slewing.

    swung: the swing of the chassis, which the pitch of `attitude` contains
    """
    from_pivot = machine.inertial + sum(complex(*imposed.sizes[:2]) for _, imposed in base_motions(effects))
    gravity = 1j * machine.gravity * np.cos(attitude.roll) * np.exp(-1j * np.asarray(attitude.pitch))
    swings = (1j * swung.acceleration - swung.rate**2) * from_pivot
    return np.asarray(gravity + swings - np.square(attitude.slew) * (machine.slew_axis + machine.inertial.real))


def _plane(z: Complex) -> Array:
    """Return complex numbers x + i z (...) as vectors (..., 2), in the same unit."""
    return np.stack([z.real, z.imag], axis=-1)


def standing(pitch: float, roll: float, turn: Array) -> Attitude:
    """Return the attitude (T,) of a house turned on sloping ground.

    sin(roll) = a_y/g and pitch = atan2(a_x, a_z), with a what an accelerometer at rest would read in the house's axes,
    gravity's counterforce (mechanics/README.md, section 1).

    pitch, roll: of the ground [rad]
    turn: (T,) angle of the house from its tracks [rad]
    """
    x, y, z = np.cos(roll) * np.sin(pitch), np.sin(roll), np.cos(roll) * np.cos(pitch)
    ahead = x * np.cos(turn) + y * np.sin(turn)
    aside = y * np.cos(turn) - x * np.sin(turn)
    return Attitude(np.arctan2(ahead, z), np.arcsin(aside))


def base_values(links: tuple[Link, ...], carried: CarriedLoad) -> Array:
    """Return (J, X, Z, D_excess, E) of every link with the load (T, N, 5) [kg m^2, kg m, kg m, kg m^2, kg m^2].

    The load adds m l^2 to J and m l to X of all links but the last. It adds its own moments to the last link
    (mechanics/README.md, sections 4 and 9)."""
    n, mass, (x, z) = len(links), carried.mass, carried.centre.T
    lengths = np.array([link.length for link in links])[:-1]
    values = np.zeros((*mass.shape, n, 5))
    values[..., :3] = base_parameters(links).reshape(n, 3)
    values[..., 3:] = slew_parameters(links)
    values[..., :-1, 0] += mass[:, None] * lengths**2
    values[..., :-1, 1] += mass[:, None] * lengths
    # the heap's spread is shared evenly by both axes: int z^2 dm = m z^2 + (J - m |c|^2)/2
    spread = carried.inertia - mass * (x**2 + z**2)
    of_load = (carried.inertia, mass * x, mass * z, -2 * mass * z**2 - spread, mass * x * z)
    values[..., -1, :] += np.stack(of_load, axis=-1)
    return values


def rigid_torque(machine: Machine, value: Array, course: Kinematics, attitude: Attitude) -> Array:
    """Return tau = d/dt(momentum) @ value + static @ value (T, N) [N m].

    The momentum depends on angles and rates only. The angles, rates and accelerations of each instant give a parabola
    in time; finite differences along it give d/dt. `value` is not differentiated, because material is picked up and
    released at the bucket's own velocity.

    value: (T, N, 5) see `base_values`
    """
    columns = _columns(lambda s: Rigid().halves(machine, _later(machine, course, attitude, s)))
    flat = value.shape[:-2]
    torque = columns @ value[..., :3].reshape(*flat, -1, 1)
    centrifugal = Slew().halves(machine, _later(machine, course, attitude, 0.0)).static @ value.reshape(*flat, -1, 1)
    return np.asarray((torque + centrifugal)[..., 0])


def _columns(at: Callable[[float], Halves]) -> Array:
    """Return d/dt(momentum) + static (T, N, P), by a fourth-order finite difference.

    at: function of s that returns the halves s seconds after each instant
    """
    columns = at(0.0).static
    for weight, s in ((8.0, H), (-8.0, -H), (-1.0, 2 * H), (1.0, -2 * H)):
        momentum = at(s).momentum
        if momentum is not None:
            columns = columns + weight / (12.0 * H) * momentum
    return columns


def carrying_torque(
    machine: Machine, effects: Sequence[Imposed], value: Array, course: Kinematics, attitude: Attitude, swung: Swing
) -> Array:
    """Return the additional joint torques (T, N) [N m] by the effects that move the chassis (`BaseMotion`).

    value: (T, N, 5) see `base_values`
    swung: the swing of the chassis
    """
    torque = np.zeros_like(course.theta)
    for effect, imposed in base_motions(effects):
        columns = _columns(_carried(machine, effect, value[..., :3], course, attitude, swung))
        torque += columns @ np.array(imposed.sizes)
    return torque


def _carried(
    machine: Machine, effect: BaseMotion, base: Array, course: Kinematics, attitude: Attitude, swung: Swing
) -> Callable[[float], Halves]:
    """Return a function of s: the effect's halves s seconds after each instant, along its parabola.

    base: (T, N, 3) base parameters (J, X, Z) of the links [kg m^2, kg m, kg m]
    course: angles of the joints and their derivatives
    swung: the swing of the chassis
    """

    def at(s: float) -> Halves:
        """Return the halves s seconds after each instant."""
        pitch = np.asarray(attitude.pitch) + swung.rate * s + swung.acceleration * (s * s / 2)
        moving = _later(machine, course, attitude._replace(pitch=pitch), s)
        return effect.halves(machine, moving, swung.rate + swung.acceleration * s, base)

    return at


def _later(machine: Machine, course: Kinematics, attitude: Attitude, s: float) -> Motion:
    """Return the motion of the links s seconds after each instant, along its parabola, without cylinders.

    Rigid columns do not use the cylinders.

    course: (T, N) joint angles [rad] with their first and second derivatives
    """
    theta = course.theta + course.thetad * s + course.thetadd * (s * s / 2)
    none = np.zeros((*theta.shape[:-1], 0))
    a = np.cumsum(theta, axis=-1)
    qd = np.cumsum(course.thetad + course.thetadd * s, axis=-1)
    g = machine.gravity * np.cos(attitude.roll)
    q = a + np.asarray(attitude.pitch)[..., None]
    return Motion(
        a=a,
        q=q,
        qd=qd,
        g=np.asarray(g),
        slew=np.asarray(attitude.slew),
        length=none,
        lever=none,
        transmission=none,
        speed=none,
        force=none,
    )


def balance(machine: Machine, truth: Truth, moving: Motion, tau: Array, t: Array) -> tuple[Motion, Array]:
    """Return the motion with cylinder forces F, and the friction (T, C) [N] in them.

    lever^T F = tau + torques of the effects and of the friction. Effects and friction may depend on the force, so that
    F is found by iteration. The friction contains the additional forces of cylinders by effects.

    moving: motion, whose forces are not used
    tau: (T, N) torques that the motion needs [N m]
    t:   (T,) time from the start of the run [s]
    """
    inverse = np.linalg.pinv(np.swapaxes(moving.lever, -1, -2))
    frictionless = (inverse @ tau[..., None])[..., 0]
    levels = [friction_level(truth.effects, moving.speed.shape[1], t, c.name) for c in truth.friction]
    friction = np.zeros_like(frictionless)
    for _ in range(ITERATIONS):
        loaded = moving._replace(force=frictionless + friction)
        excess = tau + excess_torque(machine, truth.effects, loaded, t)
        frictionless = (inverse @ excess[..., None])[..., 0]
        by_law = [
            level * c.value * c.law.force(loaded.speed, loaded.force, t)
            for level, c in zip(levels, truth.friction, strict=True)
        ]
        friction = sum(by_law, excess_force(truth.effects, loaded, t))
        if np.max(np.abs(frictionless + friction - loaded.force), initial=0.0) < CONVERGED:
            break
    return moving._replace(force=frictionless + friction), friction


ITERATIONS = 30  # of forces and friction at most; chosen
CONVERGED = 1e-9  # N, change of all forces at which the iteration ends; chosen: far below any sensor


def pressures(machine: Machine, back: Array, force: Array, speed: Array) -> tuple[Array, Array]:
    """Return the lowest head and rod pressures (T, C) [Pa] with p_head A_head - p_rod A_rod = F exactly.

    Every chamber has at least SUPPLY, the return chamber (rod side when extending) at least SUPPLY + back v^2.

    back: (C,) pressure loss of the return line [Pa/(m/s)^2]
    force: (T, C) cylinder forces F [N]
    speed: (T, C) cylinder speeds v [m/s]
    """
    head_area = np.array([c.area_head for c in machine.cylinders])
    rod_area = np.array([c.area_rod for c in machine.cylinders])
    returning = SUPPLY + back * speed**2
    extends = speed > 0
    least_head, least_rod = np.where(extends, SUPPLY, returning), np.where(extends, returning, SUPPLY)
    head = np.maximum(least_head, (force + least_rod * rod_area) / head_area)
    return head, (head * head_area - force) / rod_area
