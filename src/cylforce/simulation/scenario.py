"""Scenarios of the simulated machine: commissioning moves with an empty bucket, and digging cycles.

Random numbers come from a generator that the caller passes.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import drive, driven, is_loader, stroke_time, working_range
from cylforce.signals.estimate import Array
from cylforce.simulation.soil import carried, draw_dig
from cylforce.simulation.trajectory import JointCourse, Move, Phase, Scene

FASTEST = 0.30  # m/s, highest speed of a cylinder; chosen
CLEAR = 0.3  # lower part of the lifting joints' range that empty moves avoid, to keep the tool off the ground; chosen
ALONE = 0.45  # share of the duration in which the joints move one by one; chosen
SHAKE = 0.02  # largest random change of a target from cycle to cycle, times the joint's range; chosen
TURN = 4.0  # s for a swing of the house; chosen
HEADWAY = 2.4  # s of empty motion before the first cycle; chosen


class Sweep(NamedTuple):
    """A stroke of one angle of `drive` in the nominal cycle.

    start, stop: time from the begin of the cycle [s]
    target: angle at its end, as a fraction of the working range of that angle
    """

    start: float
    stop: float
    target: float


# The nominal cycle of 14.6 s. Strokes overlap, so that the arm is never at rest while it carries the load.
LIFT = (
    Sweep(0.0, 2.4, 0.40),
    Sweep(2.7, 6.2, 0.46),
    Sweep(6.2, 11.0, 0.80),
    Sweep(12.2, 14.5, 0.50),
)
STICK = (
    Sweep(0.2, 2.4, 0.90),
    Sweep(2.5, 6.8, 0.36),
    Sweep(7.0, 10.9, 0.50),
    Sweep(11.0, 14.2, 0.66),
)
# Where no other joint lifts, the stick reaches out: near the vertical its torque would not depend on the weight.
STICK_ALONE = (*STICK[:2], Sweep(6.9, 10.9, 0.86), Sweep(11.2, 14.3, 0.66))
TOOL = (
    Sweep(0.2, 2.4, 0.66),
    Sweep(3.0, 6.9, 0.14),
    Sweep(7.0, 10.3, 0.06),
    Sweep(10.4, 12.6, 0.80),
    Sweep(12.8, 14.5, 0.66),
)
HOME = (0.50, 0.66, 0.66)  # posture before the first cycle (lifting joints, stick, tool), fractions of working ranges
# A wheel loader's cycle, of the same length: arm down, bucket level; into the heap while the arm rises and the bucket
# curls; lift; dump at height; back. Its tilt angle is measured from the chassis, and a larger one curls.
LOADER_LIFT = (
    Sweep(0.0, 2.4, 0.06),
    Sweep(2.7, 6.2, 0.20),
    Sweep(6.2, 11.0, 0.85),
    Sweep(12.2, 14.5, 0.45),
)
LOADER_TOOL = (
    Sweep(0.2, 2.4, 0.50),
    Sweep(3.0, 6.9, 0.90),
    Sweep(7.0, 9.3, 0.97),
    Sweep(9.4, 12.5, 0.06),
    Sweep(12.6, 14.5, 0.50),
)
LOADER_HOME = (0.45, 0.50, 0.50)
SWING = (Sweep(6.9, 10.7, 1.0), Sweep(12.0, 14.5, 0.0))  # of the house, to the dump and back
DIGGING = (2.6, 6.5, 11.0, 12.5)  # s: teeth in the soil from, to; material falls from, to
PHASES = ((0.0, Phase.REACH), (2.6, Phase.DIG), (6.5, Phase.LIFT), (10.8, Phase.DUMP), (12.5, Phase.RETURN))
NOMINAL = 14.6  # s, duration of the nominal cycle


def _role(machine: Machine, j: int) -> int:
    """Return the role of joint j: 0 a lifting joint, 1 the stick, 2 the tool."""
    role = max(0, 2 - (machine.size - 1 - j))
    return 0 if role == 1 and is_loader(machine) else role


def _nominal(machine: Machine, j: int) -> tuple[Sweep, ...]:
    """Return the strokes of joint j in the nominal cycle; empty for a locked joint."""
    moved = driven(machine)
    if is_loader(machine):
        return (LOADER_LIFT, (), LOADER_TOOL)[_role(machine, j)] if j in moved else ()
    lifts = any(_role(machine, k) == 0 for k in moved)
    return (LIFT, STICK if lifts else STICK_ALONE, TOOL)[_role(machine, j)] if j in moved else ()


def posture_at(machine: Machine, fractions: tuple[float, float, float]) -> Array:
    """Return the angles (N,) [rad] of `drive` at fractions of the working ranges (lifting joints, stick, tool)."""
    low, high = working_range(machine).T
    share = np.array([fractions[_role(machine, j)] for j in range(machine.size)])
    return np.asarray(low + share * (high - low))


def cycles(machine: Machine, rng: np.random.Generator, count: int, swing: bool) -> Iterator[Scene]:
    """Yield motion in the air with an empty bucket for 2.4 s, then `count` digging cycles of at most 15 s.

    Each cycle begins at the posture in which the one before ended.

    swing: the house turns while the load is lifted, and back afterwards
    """
    ranges = working_range(machine)
    scene = _headway(machine, ranges)
    yield of_joints(machine, scene)
    for _ in range(count):
        scene = _cycle(machine, ranges, rng, np.array([course.end for course in scene.joints]), swing)
        yield of_joints(machine, scene)


def of_joints(machine: Machine, scene: Scene) -> Scene:
    """Return the scene with courses of the joints, from one with courses of the angles of `drive`."""
    D = drive(machine)
    if np.array_equal(D, machine.identity):
        return scene
    begin = D @ np.array([course.begin for course in scene.joints])
    moves = [
        tuple(
            Move(move.start, move.stop, float(share) * move.rise)
            for share, course in zip(row, scene.joints, strict=True)
            for move in course.moves
            if share
        )
        for row in D
    ]
    return scene._replace(joints=tuple(map(JointCourse, begin.tolist(), moves)))


def _headway(machine: Machine, ranges: Array) -> Scene:
    """Return the scene before the first cycle: an empty move to HOME (to LOADER_HOME on a wheel loader).

    Its courses are of the angles of `drive`.

    ranges: (N, 2) working ranges of the angles of `drive` [rad]
    """
    begin, courses = posture_at(machine, (0.55, 0.5, 0.5)), []
    home = LOADER_HOME if is_loader(machine) else HOME
    for j in range(machine.size):
        strokes = (Sweep(0.1, HEADWAY - 0.2, home[_role(machine, j)]),)
        courses.append(_course(machine, ranges, begin, j, strokes if j in driven(machine) else ()))
    return Scene(duration=HEADWAY, joints=tuple(courses), slew=JointCourse(0.0), phases=((0.0, Phase.AIR),), dig=None)


def _cycle(machine: Machine, ranges: Array, rng: np.random.Generator, begin: Array, swing: bool) -> Scene:
    """Return one random digging cycle, with courses of the angles of `drive`.

    ranges: (N, 2) working ranges of these angles [rad]
    begin: (N,) these angles at its start [rad]
    swing: the house turns while the load is lifted, and back afterwards: by 1 to 1.5 rad to a random side
    """
    stretch = float(rng.uniform(0.96, 15.0 / NOMINAL))
    courses = []
    for j in range(machine.size):
        nominal = _nominal(machine, j)
        shaken = tuple(
            Sweep(s.start * stretch, s.stop * stretch, s.target + float(rng.uniform(-SHAKE, SHAKE))) for s in nominal
        )
        courses.append(_course(machine, ranges, begin, j, shaken))
    angle = float(rng.uniform(1.0, 1.5)) * (1 if rng.uniform() < 0.5 else -1) if swing else 0.0
    turns = (
        Move(SWING[0].start * stretch, SWING[0].stop * stretch, angle),
        Move(SWING[1].start * stretch, SWING[1].stop * stretch, -angle),
    )
    start, stop, dump_start, dump_stop = (stretch * t for t in DIGGING)
    dig = draw_dig(rng, (start, stop, dump_start, dump_stop), machine.rated_payload, machine.payload_reach)
    phases = tuple((stretch * t, phase) for t, phase in PHASES)
    return Scene(
        duration=NOMINAL * stretch,
        joints=tuple(courses),
        slew=JointCourse(0.0, turns if swing else ()),
        phases=phases,
        dig=dig,
    )


def _course(machine: Machine, ranges: Array, begin: Array, j: int, strokes: tuple[Sweep, ...]) -> JointCourse:
    """Return the course of joint j's angle of `drive`: its strokes to targets given as fractions of its range.

    A stroke that its cylinder cannot make in time is shortened, so that it does not reach its target.

    ranges: (N, 2) working ranges of the angles of `drive` [rad]
    begin: (N,) these angles at the start [rad]
    """
    low, high = ranges[j]
    posture, steps = begin.copy(), []
    for stroke in strokes:
        target = float(low + np.clip(stroke.target, 0.0, 1.0) * (high - low))
        needed = stroke_time(machine, posture, j, target, FASTEST)
        rise = (target - float(posture[j])) * min(1.0, (stroke.stop - stroke.start) / max(needed, 1e-9))
        steps.append(Move(stroke.start, stroke.stop, rise))
        posture[j] += rise
    return JointCourse(float(begin[j]), tuple(steps))


def moves(
    machine: Machine, rng: np.random.Generator, duration: float, *, payload: float = 0.0, turning: bool = False
) -> Scene:
    """Return commissioning moves.

    For the share ALONE of the time one joint after the other moves, slowly and fast, in both directions (the paper's
    procedure). Then all joints move at once at random speeds between random postures.

    duration: [s]
    payload: mass in the bucket all the time [kg]
    turning: in the second part the house turns to and fro as well
    """
    ranges = working_range(machine)
    begin = posture_at(machine, (0.6, 0.5, 0.5))
    for j in range(machine.size):
        if _role(machine, j) == 0:
            ranges[j, 0] += CLEAR * (ranges[j, 1] - ranges[j, 0])
    steps = _one_by_one(machine, ranges, rng, begin, ALONE * duration)
    pose = begin + np.array([sum(step.rise for step in strokes) for strokes in steps])
    for j in driven(machine):
        steps[j] += _wander(machine, ranges, rng, pose, j=j, window=(ALONE * duration, duration - 0.5))
    courses = tuple(JointCourse(float(begin[j]), tuple(steps[j])) for j in range(machine.size))
    house = JointCourse(0.0, _turns(rng, ALONE * duration, duration) if turning else ())
    dig = carried(payload, (0.65 * machine.payload_reach, 0.1 * machine.payload_reach)) if payload else None
    return of_joints(machine, Scene(duration, courses, house, ((0.0, Phase.AIR),), dig))


def _turns(rng: np.random.Generator, start: float, stop: float) -> tuple[Move, ...]:
    """Return swings of the house by 1 to 1.5 rad and back, to one side and then the other, with rests.

    start, stop: time in which they lie [s]
    """
    steps: list[Move] = []
    t, side = start + 1.0, 1.0
    while t + 2 * TURN + 1.0 < stop:
        angle = side * float(rng.uniform(1.0, 1.5))
        steps += [Move(t, t + TURN, angle), Move(t + TURN + 1.0, t + 2 * TURN + 1.0, -angle)]
        t, side = t + 2 * TURN + 3.0, -side
    return tuple(steps)


def _one_by_one(
    machine: Machine, ranges: Array, rng: np.random.Generator, begin: Array, stop: float
) -> list[list[Move]]:
    """Return the strokes of each joint's angle of `drive`, one joint after the other.

    A joint moves fast to a random angle in the lower part of its range, slowly to one in the upper part, and back at
    medium speed. A stroke for which there is no time is omitted.

    ranges: (N, 2) ranges of the strokes [rad]
    begin: (N,) angles of `drive` at the start [rad]
    stop: time at which the last stroke has ended [s]
    """
    steps: list[list[Move]] = [[] for _ in machine.links]
    pose, t = begin.copy(), 0.5
    while t < stop:
        for j in driven(machine):
            low, high = ranges[j]
            ends = low + (high - low) * rng.uniform((0.1, 0.6), (0.4, 0.9))
            for target, speed in zip((*ends, begin[j]), (1.0, 0.35, 0.7), strict=True):
                duration = stroke_time(machine, pose, j, float(target), speed * FASTEST)
                if 0.0 < duration < stop - t:
                    steps[j].append(Move(t, t + duration, float(target - pose[j])))
                    pose[j] = target
                    t += duration + 0.2
        t += 0.5
    return steps


def _wander(
    machine: Machine,
    ranges: Array,
    rng: np.random.Generator,
    begin: Array,
    *,
    j: int,
    window: tuple[float, float],
) -> list[Move]:
    """Return strokes of joint j's angle of `drive` between random angles at random speeds, with short pauses.

    They go to and fro between the lower and the upper half of the range.

    ranges: (N, 2) ranges of the strokes [rad]
    begin: (N,) angles of `drive` at the start [rad]
    window: start and end [s]
    """
    low, high = ranges[j]
    posture, (t, stop) = begin.copy(), window
    t += float(rng.uniform(0.2, 1.0))
    steps: list[Move] = []
    while True:
        share = (posture[j] - low) / (high - low)
        target_share = float(rng.uniform(0.5, 1.0)) if share < 0.5 else float(rng.uniform(0.0, 0.5))
        target = float(low + target_share * (high - low))
        duration = stroke_time(machine, posture, j, target, float(rng.uniform(0.25, 1.0)) * FASTEST)
        if t + duration > stop:
            return steps
        steps.append(Move(t, t + duration, target - float(posture[j])))
        posture[j] = target
        t += duration + float(rng.uniform(0.0, 0.5))
