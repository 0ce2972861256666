"""What the simulated machine does: empty commissioning moves, digging cycles. Drawn from a generator that is
handed in."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven, stroke_time, working_range
from cylforce.signals.estimate import Array
from cylforce.simulation.soil import carried, draw_dig
from cylforce.simulation.trajectory import JointCourse, Move, Phase, Scene

FASTEST = 0.30  # m/s, of any cylinder
CLEAR = 0.3  # of their range: lifting joints stay above it in empty moves, which keeps the tool off the ground
ALONE = 0.45  # of the time, joints move one by one
SHAKE = 0.02  # how far a via point of one cycle lies from another's, in ranges
TURN = 4.0  # s for a swing of the house
HEADWAY = 2.4  # s of empty motion before the first cycle


class Sweep(NamedTuple):
    """A stroke of the nominal cycle: from `start` to `stop` [s] to `target`, a fraction of the joint's
    working range."""

    start: float
    stop: float
    target: float


# The nominal cycle of 14.6 s. Strokes overlap, so that while the load hangs free something always moves.
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
# Where nothing else lifts, the stick does: by reaching out, away from the vertical, where it could not feel the weight.
STICK_ALONE = (*STICK[:2], Sweep(6.9, 10.9, 0.86), Sweep(11.2, 14.3, 0.66))
TOOL = (
    Sweep(0.2, 2.4, 0.66),
    Sweep(3.0, 6.9, 0.14),
    Sweep(7.0, 10.3, 0.06),
    Sweep(10.4, 12.6, 0.80),
    Sweep(12.8, 14.5, 0.66),
)
HOME = (0.50, 0.66, 0.66)
SWING = (Sweep(6.9, 10.7, 1.0), Sweep(12.0, 14.5, 0.0))
DIGGING = (2.6, 6.5, 11.0, 12.5)  # s: teeth in the soil from, to; material falls from, to
PHASES = ((0.0, Phase.REACH), (2.6, Phase.DIG), (6.5, Phase.LIFT), (10.8, Phase.DUMP), (12.5, Phase.RETURN))
NOMINAL = 14.6


def _role(machine: Machine, j: int) -> int:
    """0: a lifting joint, 1: the stick, 2: the tool."""
    return max(0, 2 - (machine.size - 1 - j))


def _nominal(machine: Machine, j: int) -> tuple[Sweep, ...]:
    """The strokes of joint j in the nominal cycle; none for a locked joint."""
    moved = driven(machine)
    lifts = any(_role(machine, k) == 0 for k in moved)
    return (LIFT, STICK if lifts else STICK_ALONE, TOOL)[_role(machine, j)] if j in moved else ()


def _begin(machine: Machine, fractions: tuple[float, float, float]) -> Array:
    """A pose (N,) [rad] at fractions of the working ranges; locked joints midway."""
    low, high = working_range(machine).T
    share = np.array([fractions[_role(machine, j)] for j in range(machine.size)])
    return np.asarray(low + share * (high - low))


def cycles(machine: Machine, rng: np.random.Generator, count: int, swing: bool) -> Iterator[Scene]:
    """Empty air motion of 2.4 s, then `count` digging cycles of at most 15 s, each beginning where the last
    ended.

    `swing`: the house turns while the load is lifted, and back."""
    ranges = working_range(machine)
    scene = _headway(machine, ranges)
    yield scene
    for _ in range(count):
        scene = _cycle(machine, ranges, rng, np.array([course.end for course in scene.joints]), swing)
        yield scene


def _headway(machine: Machine, ranges: Array) -> Scene:
    begin, courses = _begin(machine, (0.55, 0.5, 0.5)), []
    for j in range(machine.size):
        strokes = (Sweep(0.1, HEADWAY - 0.2, HOME[_role(machine, j)]),)
        courses.append(_course(machine, ranges, begin, j, strokes if j in driven(machine) else ()))
    return Scene(HEADWAY, tuple(courses), JointCourse(0.0), ((0.0, Phase.AIR),))


def _cycle(machine: Machine, ranges: Array, rng: np.random.Generator, begin: Array, swing: bool) -> Scene:
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
    return Scene(NOMINAL * stretch, tuple(courses), JointCourse(0.0, turns if swing else ()), phases, dig)


def _course(machine: Machine, ranges: Array, begin: Array, j: int, strokes: tuple[Sweep, ...]) -> JointCourse:
    """Strokes to fractions of the range; one that its cylinder cannot make in time is cut short."""
    low, high = ranges[j]
    now, steps = begin.copy(), []
    for stroke in strokes:
        target = float(low + np.clip(stroke.target, 0.0, 1.0) * (high - low))
        needed = stroke_time(machine, now, j, target, FASTEST)
        rise = (target - float(now[j])) * min(1.0, (stroke.stop - stroke.start) / max(needed, 1e-9))
        steps.append(Move(stroke.start, stroke.stop, rise))
        now[j] += rise
    return JointCourse(float(begin[j]), tuple(steps))


def moves(
    machine: Machine, rng: np.random.Generator, duration: float, *, payload: float = 0.0, turning: bool = False
) -> Scene:
    """Commissioning moves of `duration` [s]: first one joint after the other, slow and fast, both ways
    (the paper's procedure), then, from the share ALONE of the time on, all at once at drawn speeds between
    drawn postures. `payload` [kg] lies in the bucket all the time; `turning`: the house turns to and fro as well, from
    the share ALONE on."""
    ranges = working_range(machine)
    begin = _begin(machine, (0.6, 0.5, 0.5))
    for j in range(machine.size):
        if _role(machine, j) == 0:
            ranges[j, 0] += CLEAR * (ranges[j, 1] - ranges[j, 0])
    steps = _one_by_one(machine, ranges, rng, begin, ALONE * duration)
    pose = begin + np.array([sum(step.rise for step in strokes) for strokes in steps])
    for j in driven(machine):
        steps[j] += _wander(machine, ranges, rng, pose, j=j, window=(ALONE * duration, duration - 0.5))
    courses = tuple(JointCourse(float(begin[j]), tuple(steps[j])) for j in range(machine.size))
    house = JointCourse(0.0, _turns(rng, ALONE * duration, duration) if turning else ())
    held = carried(payload, (0.65 * machine.payload_reach, 0.1 * machine.payload_reach)) if payload else None
    return Scene(duration, courses, house, ((0.0, Phase.AIR),), held)


def _turns(rng: np.random.Generator, start: float, stop: float) -> tuple[Move, ...]:
    """Swings of the house to either side and back, with rests, from `start` to `stop` [s]."""
    steps: list[Move] = []
    clock, side = start + 1.0, 1.0
    while clock + 2 * TURN + 1.0 < stop:
        angle = side * float(rng.uniform(1.0, 1.5))
        steps += [Move(clock, clock + TURN, angle), Move(clock + TURN + 1.0, clock + 2 * TURN + 1.0, -angle)]
        clock, side = clock + 2 * TURN + 3.0, -side
    return tuple(steps)


def _one_by_one(
    machine: Machine, ranges: Array, rng: np.random.Generator, begin: Array, stop: float
) -> list[list[Move]]:
    """Strokes of one joint after the other until `stop` [s]: one fast, one slow, one back between the two."""
    steps: list[list[Move]] = [[] for _ in machine.links]
    pose, clock = begin.copy(), 0.5
    while clock < stop:
        for j in driven(machine):
            low, high = ranges[j]
            ends = low + (high - low) * rng.uniform((0.1, 0.6), (0.4, 0.9))
            for target, speed in zip((*ends, begin[j]), (1.0, 0.35, 0.7), strict=True):
                time = stroke_time(machine, pose, j, float(target), speed * FASTEST)
                if 0.0 < time < stop - clock:
                    steps[j].append(Move(clock, clock + time, float(target - pose[j])))
                    pose[j] = target
                    clock += time + 0.2
        clock += 0.5
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
    """Strokes of joint j between drawn postures at drawn speeds, with short rests."""
    low, high = ranges[j]
    now, (clock, stop) = begin.copy(), window
    clock += float(rng.uniform(0.2, 1.0))
    steps: list[Move] = []
    while True:
        share = (now[j] - low) / (high - low)
        far = float(rng.uniform(0.5, 1.0)) if share < 0.5 else float(rng.uniform(0.0, 0.5))
        target = float(low + far * (high - low))
        time = stroke_time(machine, now, j, target, float(rng.uniform(0.25, 1.0)) * FASTEST)
        if clock + time > stop:
            return steps
        steps.append(Move(clock, clock + time, target - float(now[j])))
        now[j] = target
        clock += time + float(rng.uniform(0.0, 0.5))
