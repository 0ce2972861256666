"""The next stroke of one joint that a commissioning needs, and the sentence that asks the operator for it."""

from itertools import product
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.coverage import BINS, Missing, Pace, Plan, Way, missing
from cylforce.commissioning.reaches import Reach
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven, joint_angles, lifting, working_range
from cylforce.signals.estimate import Array

CLEAR = 0.5  # times its range: below it no motion of a lifting joint is asked for, as the tool might reach the ground
AT = (0.15, 0.5, 0.85)  # times their ranges: positions in which the other joints may wait; chosen
SPEED = {
    Pace.SLOW: 0.7,
    Pace.FAST: 2.0,
}  # times `Plan.fast`: mean speed asked for; chosen with a margin, because no operator's speed is constant
RUN_UP = 0.4  # times a bin: distance before and after the part of a stroke that counts; chosen
OTHER_JOINT = 0.5  # ranges that are added to the distance of a stroke of another joint, so that joints alternate less
AGAIN = 1.0  # ranges that are added to the distance of the stroke just made, so that it is not asked for again at once
BEGUN, ENDED = 0.15, 0.95  # times a stroke: within the first it has begun, beyond the second it is complete; chosen


class Stroke(NamedTuple):
    """A stroke of `joint` from angle `begin` to `end` [rad] in `seconds` [s], its cylinder in direction `way` at
    `pace`; meanwhile the other joints stay at the posture `hold` (N,) [rad]; all are angles of `drive`. `begun`:
    whether it is under way."""

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
        """Joint, direction and pace, which the stroke covers."""
        return self.joint, self.way, self.pace


def clear_range(machine: Machine) -> Array:
    """Joint angles (N, 2) [rad] in which a commissioning moves: the working ranges, and of the joints that lift the
    stick only the upper half."""
    ranges = working_range(machine)
    up = list(lifting(machine))
    ranges[up, 0] += CLEAR * (ranges[up, 1] - ranges[up, 0])
    return ranges


def next_stroke(machine: Machine, plan: Plan, seconds: Array, posture: Array, last: Stroke | None) -> Stroke | None:
    """The next stroke after the `last` one, for the `seconds` of `coverage` recorded so far and the joints at `posture`
    (N,) [rad] (NaN: unknown); None when nothing is missing."""
    wanted = _together(missing(plan, seconds))
    going_on = _under_way(last, float(posture[last.joint])) if last is not None and last.kind in wanted else None
    if going_on is not None:
        return going_on
    strokes = [_ends(machine, plan, gap) for gap in wanted.values()]
    if not strokes:
        return None
    nearest = min(strokes, key=lambda s: _distance(plan, s, posture, last))
    hold = _hold(machine, nearest)
    return nearest._replace(hold=hold, seconds=_seconds(machine, plan, nearest, hold))


def _under_way(stroke: Stroke, here: float) -> Stroke | None:
    """The stroke, with its progress noted, while its joint is at the angle `here` [rad]; None when it is complete."""
    progress = (here - stroke.begin) / (stroke.end - stroke.begin)
    begun = stroke.begun or abs(progress) < BEGUN
    return None if begun and progress > ENDED else stroke._replace(begun=begun)


def _together(gaps: tuple[Missing, ...]) -> dict[tuple[int, Way, Pace], Missing]:
    """The gaps of each joint, direction and pace combined into one."""
    found: dict[tuple[int, Way, Pace], Missing] = {}
    for gap in gaps:
        there = found.setdefault((gap.joint, gap.way, gap.pace), gap)
        both = there._replace(low=min(there.low, gap.low), high=max(there.high, gap.high))
        found[gap.joint, gap.way, gap.pace] = both
    return found


def _ends(machine: Machine, plan: Plan, gap: Missing) -> Stroke:
    """The stroke that fills a gap, longer by RUN_UP at both ends where the range allows it; `seconds` and `hold` are
    set later."""
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
    return Stroke(gap.joint, gap.way, gap.pace, float(begin), float(end), 0.0, middle)


def _distance(plan: Plan, stroke: Stroke, posture: Array, last: Stroke | None) -> float:
    """Distance from the present `posture` (N,) [rad] to the start of a stroke, in joint ranges, plus penalties: for a
    fast stroke, for another joint than the last, for the same stroke again."""
    edges = plan.edges[plan.joints.index(stroke.joint)]
    here = posture[stroke.joint]
    way = 0.0 if np.isnan(here) else abs(float(here) - stroke.begin) / float(edges[-1] - edges[0])
    if last is not None:
        way += AGAIN * (last.kind == stroke.kind) + OTHER_JOINT * (last.joint != stroke.joint)
    return way + 2.0 * OTHER_JOINT * stroke.pace


def _hold(machine: Machine, stroke: Stroke) -> Array:
    """The posture (N,) [rad] of the other joints with which the tool stays as high as possible during the whole
    stroke."""
    ranges = clear_range(machine)
    others = [j for j in driven(machine) if j != stroke.joint]
    posts = np.array(list(product(AT, repeat=len(others))))
    theta = np.tile(ranges.mean(axis=1), (len(posts), 5, 1))
    for column, j in enumerate(others):
        theta[..., j] = (ranges[j, 0] + posts[:, column] * (ranges[j, 1] - ranges[j, 0]))[:, None]
    theta[..., stroke.joint] = np.linspace(stroke.begin, stroke.end, 5)
    height = np.min(machine.tool_point(joint_angles(machine, theta)).place.imag, axis=1)
    return np.asarray(theta[int(np.argmax(height)), 0])


def _seconds(machine: Machine, plan: Plan, stroke: Stroke, hold: Array) -> float:
    k = plan.joints.index(stroke.joint)
    begin, end = _lengths(machine, plan.cylinders[k], stroke, hold)
    return abs(end - begin) / (SPEED[stroke.pace] * float(plan.fast[k]))


def _lengths(machine: Machine, c: int, stroke: Stroke, hold: Array) -> tuple[float, float]:
    """Lengths [m] of cylinder `c` at start and end of the stroke."""
    theta = np.array([hold, hold])
    theta[:, stroke.joint] = stroke.begin, stroke.end
    begin, end = machine.geometry(joint_angles(machine, theta)).length[:, c]
    return float(begin), float(end)


def sentence(machine: Machine, plan: Plan, stroke: Stroke) -> str:
    """The sentence that asks the operator for a stroke."""
    c = plan.cylinders[plan.joints.index(stroke.joint)]
    begin, end = (_share(machine, c, length) for length in _lengths(machine, c, stroke, stroke.hold))
    pace = "slowly" if stroke.pace is Pace.SLOW else "fast"
    way = "out" if stroke.way is Way.EXTENDING else "in"
    return (
        f"move the {machine.links[stroke.joint].name} {pace}: its cylinder {way} from {begin} to {end}, in about "
        f"{max(stroke.seconds, 1.0):.0f} s{_waiting(machine, plan, stroke)}"
    )


def _share(machine: Machine, c: int, length: float) -> str:
    cylinder = machine.cylinders[c]
    share = (length - cylinder.length_low) / (cylinder.length_high - cylinder.length_low)
    if share < 0.05:
        return "the inner end"
    return "the outer end" if share > 0.95 else f"{100 * share:.0f} %"


def reach_sentence(machine: Machine, plan: Plan, reach: Reach) -> str:
    """The sentence that asks the operator for a move of all joints."""
    lengths = machine.geometry(joint_angles(machine, reach.target)).length
    places = [
        f"the {machine.links[j].name}'s cylinder to {_share(machine, c, float(lengths[c]))}"
        for j, c in zip(plan.joints, plan.cylinders, strict=True)
    ]
    return f"move all joints at once, in about {reach.seconds:.0f} s: {', '.join(places)}"


def _waiting(machine: Machine, plan: Plan, stroke: Stroke) -> str:
    lengths = machine.geometry(joint_angles(machine, stroke.hold)).length
    others = [
        f"the {machine.links[j].name}'s at {_share(machine, c, float(lengths[c]))}"
        for j, c in zip(plan.joints, plan.cylinders, strict=True)
        if j != stroke.joint
    ]
    return f"; {', '.join(others)}" if others else ""
