"""The next stroke of one joint that a commissioning needs, and the sentence that requests it from the operator."""

from itertools import product
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.coverage import BINS, Missing, Pace, Plan, Way, missing
from cylforce.commissioning.reaches import Reach
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven, joint_angles, lifting, working_range
from cylforce.signals.estimate import Array

CLEAR = 0.5  # lower part of a lifting joint's range without strokes, as the tool might reach the ground; chosen
HOLD_AT = (0.15, 0.5, 0.85)  # positions in which the other joints may wait, times their ranges; chosen
# Requested mean speed, times `Plan.fast`; chosen with a margin to 1, because no operator's speed is constant.
SPEED = {Pace.SLOW: 0.7, Pace.FAST: 2.0}
RUN_UP = 0.4  # distance before and after the part of a stroke that counts, times a bin; chosen
OTHER_JOINT = 0.5  # ranges added to the distance of a stroke of another joint, so that joints alternate less; chosen
AGAIN = 1.0  # ranges added to the distance of the stroke just made, so that it is not requested again at once; chosen
BEGUN, ENDED = 0.15, 0.95  # times a stroke: within the first it has begun, beyond the second it is complete; chosen


class Stroke(NamedTuple):
    """A stroke of one joint, while the other joints stay at a posture; all angles are those of `drive`.

    joint: number of the joint
    way: direction of its cylinder
    pace: slow or fast
    begin: first angle of the joint [rad]
    end: last angle of the joint [rad]
    seconds: duration [s]
    hold: (N,) posture of the other joints [rad]
    begun: whether the stroke is under way
    """

    joint: int
    way: Way
    pace: Pace
    begin: float
    end: float
    seconds: float
    hold: Array
    begun: bool = False

    @property
    def kind(self) -> tuple[int, Way, Pace]:
        """Return joint, direction and pace: the kind of motion that the stroke covers."""
        return self.joint, self.way, self.pace


def clear_range(machine: Machine) -> Array:
    """Return the range (N, 2) [rad] of every angle of `drive` in which a commissioning moves.

    These are the working ranges. The joints that lift all the others use the upper part only (CLEAR).
    """
    ranges = working_range(machine)
    up = list(lifting(machine))
    ranges[up, 0] += CLEAR * (ranges[up, 1] - ranges[up, 0])
    return ranges


def next_stroke(machine: Machine, plan: Plan, seconds: Array, posture: Array, last: Stroke | None) -> Stroke | None:
    """Return the next stroke; None when no motion is missing.

    The last stroke continues until its joint reaches its end. Otherwise it is the missing stroke that begins nearest to
    the present posture.

    seconds: coverage recorded so far, as from `coverage` (M, BINS, 2, 2) [s]
    posture: (N,) present angles of `drive` [rad]; NaN: unknown
    last: the stroke that was requested before
    """
    gaps = _together(missing(plan, seconds))
    unfinished = _under_way(last, float(posture[last.joint])) if last is not None and last.kind in gaps else None
    if unfinished is not None:
        return unfinished
    strokes = [_ends(machine, plan, gap) for gap in gaps.values()]
    if not strokes:
        return None
    nearest = min(strokes, key=lambda s: _distance(plan, s, posture, last))
    hold = _hold(machine, nearest)
    return nearest._replace(hold=hold, seconds=_seconds(machine, plan, nearest, hold))


def _under_way(stroke: Stroke, angle: float) -> Stroke | None:
    """Return the stroke, with `begun` updated, while its joint is under way; None when it is complete.

    angle: present angle of its joint [rad]
    """
    progress = (angle - stroke.begin) / (stroke.end - stroke.begin)
    begun = stroke.begun or abs(progress) < BEGUN
    return None if begun and progress > ENDED else stroke._replace(begun=begun)


def _together(gaps: tuple[Missing, ...]) -> dict[tuple[int, Way, Pace], Missing]:
    """Return the gaps of each joint, direction and pace combined into one gap."""
    combined: dict[tuple[int, Way, Pace], Missing] = {}
    for gap in gaps:
        kind = (gap.joint, gap.way, gap.pace)
        first = combined.setdefault(kind, gap)
        combined[kind] = first._replace(low=min(first.low, gap.low), high=max(first.high, gap.high))
    return combined


def _ends(machine: Machine, plan: Plan, gap: Missing) -> Stroke:
    """Return the stroke that fills a gap, longer by RUN_UP at both ends where the range allows it.

    `seconds` and `hold` are preliminary; `next_stroke` sets them.
    """
    k = plan.joints.index(gap.joint)
    edges = plan.edges[k]
    room = RUN_UP * (edges[-1] - edges[0]) / BINS
    low, high = max(gap.low - room, edges[0]), min(gap.high + room, edges[-1])
    middle = clear_range(machine).mean(axis=1)
    middle[gap.joint] = (low + high) / 2.0
    rising = (machine.geometry(joint_angles(machine, middle)).lever[plan.cylinders[k], gap.joint] > 0.0) == (
        gap.way is Way.EXTENDING
    )
    begin, end = (low, high) if rising else (high, low)
    return Stroke(
        joint=gap.joint, way=gap.way, pace=gap.pace, begin=float(begin), end=float(end), seconds=0.0, hold=middle
    )


def _distance(plan: Plan, stroke: Stroke, posture: Array, last: Stroke | None) -> float:
    """Return the distance from the present posture to the start of a stroke, in joint ranges, plus penalties.

    There are penalties for a fast stroke, for another joint than the last, and for repeating the last stroke.

    posture: (N,) present angles of `drive` [rad]; NaN: unknown, which counts as no distance
    last: the stroke that was requested before
    """
    edges = plan.edges[plan.joints.index(stroke.joint)]
    angle = posture[stroke.joint]
    distance = 0.0 if np.isnan(angle) else abs(float(angle) - stroke.begin) / float(edges[-1] - edges[0])
    if last is not None:
        distance += AGAIN * (last.kind == stroke.kind) + OTHER_JOINT * (last.joint != stroke.joint)
    return distance + 2.0 * OTHER_JOINT * stroke.pace


def _hold(machine: Machine, stroke: Stroke) -> Array:
    """Return the posture (N,) [rad] of the other joints with which the lowest height of the tool in the stroke is
    greatest.

    These are angles of `drive`; that of the stroke's own joint is at its begin.
    """
    ranges = clear_range(machine)
    others = [j for j in driven(machine) if j != stroke.joint]
    posts = np.array(list(product(HOLD_AT, repeat=len(others))))
    theta = np.tile(ranges.mean(axis=1), (len(posts), 5, 1))
    for column, j in enumerate(others):
        theta[..., j] = (ranges[j, 0] + posts[:, column] * (ranges[j, 1] - ranges[j, 0]))[:, None]
    theta[..., stroke.joint] = np.linspace(stroke.begin, stroke.end, 5)
    height = np.min(machine.tool_point(joint_angles(machine, theta)).place.imag, axis=1)
    return np.asarray(theta[int(np.argmax(height)), 0])


def _seconds(machine: Machine, plan: Plan, stroke: Stroke, hold: Array) -> float:
    """Return the duration of a stroke [s] at the speed of its pace.

    hold: (N,) angles of `drive` of the other joints [rad]
    """
    k = plan.joints.index(stroke.joint)
    begin, end = _lengths(machine, plan.cylinders[k], stroke, hold)
    return abs(end - begin) / (SPEED[stroke.pace] * float(plan.fast[k]))


def _lengths(machine: Machine, c: int, stroke: Stroke, hold: Array) -> tuple[float, float]:
    """Return the lengths [m] of cylinder c at start and end of the stroke.

    hold: (N,) angles of `drive` of the other joints [rad]
    """
    theta = np.array([hold, hold])
    theta[:, stroke.joint] = stroke.begin, stroke.end
    begin, end = machine.geometry(joint_angles(machine, theta)).length[:, c]
    return float(begin), float(end)


def sentence(machine: Machine, plan: Plan, stroke: Stroke) -> str:
    """Return the sentence that requests a stroke from the operator."""
    c = plan.cylinders[plan.joints.index(stroke.joint)]
    begin, end = (_share(machine, c, length) for length in _lengths(machine, c, stroke, stroke.hold))
    pace = "slowly" if stroke.pace is Pace.SLOW else "fast"
    way = "out" if stroke.way is Way.EXTENDING else "in"
    return (
        f"move the {machine.links[stroke.joint].name} {pace}: its cylinder {way} from {begin} to {end}, in about "
        f"{max(stroke.seconds, 1.0):.0f} s{_waiting(machine, plan, stroke)}"
    )


def _share(machine: Machine, c: int, length: float) -> str:
    """Return the position of cylinder c at a length [m] in words: an end, or per cent of its stroke."""
    cylinder = machine.cylinders[c]
    share = (length - cylinder.length_low) / (cylinder.length_high - cylinder.length_low)
    if share < 0.05:
        return "the inner end"
    return "the outer end" if share > 0.95 else f"{100 * share:.0f} %"


def reach_sentence(machine: Machine, plan: Plan, reach: Reach) -> str:
    """Return the sentence that requests a move of all joints from the operator."""
    lengths = machine.geometry(joint_angles(machine, reach.target)).length
    places = [
        f"the {machine.links[j].name}'s cylinder to {_share(machine, c, float(lengths[c]))}"
        for j, c in zip(plan.joints, plan.cylinders, strict=True)
    ]
    return f"move all joints at once, in about {reach.seconds:.0f} s: {', '.join(places)}"


def _waiting(machine: Machine, plan: Plan, stroke: Stroke) -> str:
    """Return the end of a sentence: where the other joints' cylinders wait during a stroke."""
    lengths = machine.geometry(joint_angles(machine, stroke.hold)).length
    others = [
        f"the {machine.links[j].name}'s at {_share(machine, c, float(lengths[c]))}"
        for j, c in zip(plan.joints, plan.cylinders, strict=True)
        if j != stroke.joint
    ]
    return f"; {', '.join(others)}" if others else ""
