"""Motions that an operator can make, as scenes of the simulated machine, with the words that ask for them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven, lifting, stroke_time, working_range
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.simulation.scenario import CLEAR, FASTEST, of_joints
from cylforce.simulation.soil import carried
from cylforce.simulation.trajectory import JointCourse, Move, Phase, Scene

SECONDS = 60.0  # of each motion: its information is proportional to its duration
SLOW = 0.25  # of the highest speed; chosen: some 7 cm/s, so that there is time for both ways
WHOLE = (0.1, 0.9)  # of the working range: from end to end
PART = (0.38, 0.62)  # of the working range: a quarter of it
LITTLE = (0.02, 0.03)  # of the working range, to and fro: some centimetres of a cylinder
HOLD_S, REST_S = 3.0, 0.3  # a hold long enough to be read; a rest at the end of a stroke
PACES = np.array(
    [0.9, 0.55, 0.35]
)  # of the highest speed, of joints that move at once, so that they never repeat together
LOAD = 0.5  # of the rated payload: a known load with which a machine can swing about
SLOPE = 0.1  # rad, a slope on which a machine still works
WARM_S = 1800.0  # of work, after which the oil is warm
TURN, TURN_S = 1.2, 4.0  # rad and s of a swing of the house
TOGETHER_S, STAIRS_S = 120.0, 150.0  # of the check-up; measured: with these a machine is decided (see the chapter)
STILL_S = 10.0  # without pressure; convention: the mean of a reading is then exact to a tenth of its noise
STAIR_HOLD_S = 1.0  # on each stair
BACK_S = 8.0  # in which a joint returns to the middle of its range; the longest stroke at full speed takes less
STAIRS = (0.1, 0.3, 0.5, 0.7, 0.9, 0.7, 0.5, 0.3)  # of the working range, up and down again


@dataclass(frozen=True)
class RecommendedMotion:
    """A motion that can be recorded.

    words:    that ask for it
    scene:    its strokes
    load_kg:  known load in the bucket [kg]; 0: empty
    pitch:    pitch of the ground [rad]
    worked_s: for how long the machine has worked before [s]
    """

    words: str
    scene: Scene
    load_kg: float = 0.0
    pitch: float = 0.0
    worked_s: float = 0.0

    @property
    def conditions(self) -> tuple[str, ...]:
        """Load, slope and temperature in words."""
        return (
            f"a known load of {self.load_kg:.0f} kg in the bucket" if self.load_kg else "an empty bucket",
            f"ground with a slope of {np.degrees(self.pitch):.0f} degrees" if self.pitch else "level ground",
            f"warm oil, after {self.worked_s / 60.0:.0f} minutes of work" if self.worked_s else "oil as it is",
        )


def checkup(machine: Machine) -> tuple[RecommendedMotion, RecommendedMotion]:
    """Return the motions of the check-up: all joints at once, then single joints in stairs; both empty."""
    middle = _middle(machine)
    together = _together(machine, middle, WHOLE, PACES, TOGETHER_S)
    words = "move all joints at once to and fro through their ranges, each at a speed of its own, for two minutes"
    stairs = "move one joint after the other up and down in stairs, for two and a half minutes"
    return RecommendedMotion(f"{words}, with an empty bucket", together), RecommendedMotion(
        f"{stairs}, with an empty bucket", _single_stairs(machine, middle)
    )


def catalogue(machine: Machine, joints: Sequence[int]) -> Iterator[RecommendedMotion]:
    """Yield all motions; `joints`: those that are moved alone."""
    middle = _middle(machine)
    for j in joints:
        name = machine.links[j].name
        slow, two = (
            _scene(machine, middle, {j: _strokes(machine, middle, j, speeds)}) for speeds in ((SLOW,), (SLOW, 1.0))
        )
        little = _scene(machine, middle, {j: _little(machine, middle, j)})
        yield RecommendedMotion(f"move the {name} alone, slowly, from end to end and back", slow)
        yield RecommendedMotion(f"move the {name} alone, from end to end and back, in turns slowly and fast", two)
        yield RecommendedMotion(
            f"move the {name} alone a few centimetres to and fro, slowly, at several angles", little
        )
        yield _loaded(machine, f"move the {name} alone, slowly, from end to end and back", slow)
        brisk = _scene(machine, middle, {j: _along(machine, middle, j, cycle(PART), cycle((1.0,)), REST_S)})
        yield RecommendedMotion(
            f"move the {name} alone, with quick starts and stops, to and fro by a quarter of its way", brisk
        )
    stairs, together, slowly = (
        _stairs(machine, middle),
        _together(machine, middle, WHOLE, PACES),
        _together(machine, middle, PART, SLOW * PACES),
    )
    postures = "go to a dozen very different postures and hold each for three seconds"
    whole = "move all joints at once to and fro, each at a speed of its own"
    yield RecommendedMotion(postures, stairs)
    yield _loaded(machine, postures, stairs)
    yield RecommendedMotion(whole, together)
    yield RecommendedMotion("move all joints at once to and fro by a quarter of their way, slowly", slowly)
    yield _loaded(machine, whole, together)
    yield RecommendedMotion(f"{whole}, once the machine has worked for half an hour", together, worked_s=WARM_S)
    yield RecommendedMotion(f"{whole}, while the house turns to and fro", together._replace(slew=_turns()))
    if any(s.kind is Kind.PITCH for s in machine.signals):
        yield RecommendedMotion(
            f"{whole}, with the machine on a slope of {np.degrees(SLOPE):.0f} degrees", together, pitch=SLOPE
        )


def _loaded(machine: Machine, words: str, scene: Scene) -> RecommendedMotion:
    load = LOAD * machine.rated_payload
    dig = carried(load, (0.65 * machine.payload_reach, 0.1 * machine.payload_reach))
    return RecommendedMotion(f"{words}, carrying a known load of about {load:.0f} kg", scene._replace(dig=dig), load)


def _middle(machine: Machine) -> Array:
    """Return the angles (N,) [rad] of `drive` of joints that do not move: those that lift are above the ground."""
    low, high = _range(machine).T
    return np.asarray((low + high) / 2.0)


def _range(machine: Machine) -> Array:
    found = working_range(machine)
    for j in lifting(machine):
        found[j, 0] += CLEAR * (found[j, 1] - found[j, 0])
    return found


def _scene(machine: Machine, begin: Array, steps: dict[int, tuple[Move, ...]], seconds: float = SECONDS) -> Scene:
    courses = tuple(JointCourse(float(u), steps.get(j, ())) for j, u in enumerate(begin))
    return of_joints(machine, Scene(seconds, courses, JointCourse(0.0), ((0.0, Phase.AIR),)))


def _along(
    machine: Machine,
    begin: Array,
    j: int,
    targets: Iterator[float],
    speeds: Iterator[float],
    rest: float,
    window: tuple[float, float] = (0.5, SECONDS),
) -> tuple[Move, ...]:
    """Return strokes of joint j to one target [share of its range] after the other, within a time window [s]."""
    (low, high), now = _range(machine)[j], begin.copy()
    (clock, end), steps = window, list[Move]()
    for share, speed in zip(targets, speeds, strict=False):
        target = float(low + share * (high - low))
        time = stroke_time(machine, now, j, target, speed * FASTEST)
        if clock + time > end:
            break
        steps.append(Move(clock, clock + time, target - float(now[j])))
        now[j] = target
        clock += time + rest
    return tuple(steps)


def _single_stairs(machine: Machine, begin: Array) -> Scene:
    """Return one joint after the other in stairs; each returns to the middle before the next one moves."""
    joints, steps = driven(machine), dict[int, tuple[Move, ...]]()
    share = (STAIRS_S - 1.0) / max(len(joints), 1)
    for k, j in enumerate(joints):
        first = 0.5 + k * share
        up = _along(machine, begin, j, cycle(STAIRS), cycle((0.8, 0.4)), STAIR_HOLD_S, (first, first + share - BACK_S))
        now = begin.copy()
        now[j] += sum(step.rise for step in up)
        clock = up[-1].stop + STAIR_HOLD_S if up else first
        time = stroke_time(machine, now, j, float(begin[j]), FASTEST)
        steps[j] = (*up, Move(clock, clock + time, float(begin[j] - now[j])))
    return _scene(machine, begin, steps, STAIRS_S)


def _strokes(machine: Machine, begin: Array, j: int, speeds: Sequence[float]) -> tuple[Move, ...]:
    """Return strokes from end to end, both ways at each speed."""
    each = (speed for speed in cycle(speeds) for _ in WHOLE)
    return _along(machine, begin, j, cycle(WHOLE), each, REST_S)


def _little(machine: Machine, begin: Array, j: int) -> tuple[Move, ...]:
    """Return short strokes to and fro at five angles in turn, longer and shorter ones."""
    targets = (at + way for at in cycle(np.linspace(*WHOLE, 5)) for step in LITTLE for way in (step, 0.0) * 3)
    return _along(machine, begin, j, targets, cycle((SLOW,)), REST_S)


def _stairs(machine: Machine, begin: Array) -> Scene:
    """Return all joints from posture to posture, with holds.

    The postures are evenly spread shares of the ranges (van der Corput).
    """
    steps = {
        j: _along(machine, begin, j, (_spread(k, base) for k in range(2, 100)), cycle((0.8,)), HOLD_S)
        for j, base in zip(driven(machine), (2, 3, 5, 7, 11, 13), strict=False)
    }
    return _scene(machine, begin, steps)


def _spread(k: int, base: int) -> float:
    found, share = 0.0, 1.0 / base
    while k:
        k, digit = divmod(k, base)
        found += digit * share
        share /= base
    return WHOLE[0] + (WHOLE[1] - WHOLE[0]) * found


def _together(machine: Machine, begin: Array, ends: Sequence[float], paces: Array, seconds: float = SECONDS) -> Scene:
    """Return strokes of all joints at once, each at a pace [share of the highest speed] of its own."""
    each, window = zip(driven(machine), cycle(paces.tolist()), strict=False), (0.5, seconds)
    steps = {j: _along(machine, begin, j, cycle(ends), cycle((v,)), REST_S, window) for j, v in each}
    return _scene(machine, begin, steps, seconds)


def _turns() -> JointCourse:
    starts = np.arange(1.0, SECONDS - TURN_S, TURN_S + REST_S)
    return JointCourse(0.0, tuple(Move(t, t + TURN_S, TURN * (-1.0) ** k) for k, t in enumerate(starts.tolist())))
