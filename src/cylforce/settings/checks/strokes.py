"""Check whether a linkage fits its cylinder: it closes, keeps between the end stops, and has no dead point in its
range.

A flipped or swapped pin shows here.
"""

import numpy as np

from cylforce.mechanics.linkages import Stretch
from cylforce.mechanics.machine import Machine
from cylforce.settings.error import Inspection, Key
from cylforce.signals.estimate import Array
from cylforce.signals.units import DEGREE, MILLIMETRE

SCAN = 361  # postures over one joint; chosen
GRID = 61  # postures over each of two joints; chosen
# Shares of the stroke beyond an end stop. An angle range that was read off to one degree is off by 10 mm at a lever of
# 0.6 m, 1 % of the typical stroke; a pin with a wrong sign is off by more than a tenth.
BEYOND_WARN, BEYOND_REFUSE = 0.02, 0.15
UNUSED_WARN = 0.2  # share of the stroke that is not used
LEVER_NOISE = 0.02  # lever of the other sign, over the largest: a range may end at a dead point, as a loader crane's
NEAR_DEAD = 0.15  # sine of the angle between the bars: 9 degrees; linkages are built to stay above 20 to 30
# Shares of a joint's range that a cylinder over two joints can reach: all of it, if the range was read off the machine.
REACHED_WARN, REACHED_REFUSE = 0.95, 0.25
RETRACTED_LENGTH = 4.0  # retracted length over the stroke: data sheets have 1.2 to 2


def check_cylinder(machine: Machine, c: int, findings: Inspection) -> None:
    """Check a cylinder's linkage in the ranges of the one or two joints on which it acts.

    Refuses a cylinder that moves no joint. Warns of a stroke that is short for the retracted length.
    """
    span, key = machine.spans[c], ("cylinders", c, "linkage")
    cylinder = machine.cylinders[c]
    stroke = cylinder.length_high - cylinder.length_low
    if cylinder.length_low > RETRACTED_LENGTH * stroke:
        problem = (
            f"has a stroke of {stroke:.3g} m, little for a retracted length of {cylinder.length_low:.3g} m: check it"
        )
        findings.warn(("cylinders", c, "length_range_m"), problem)
    if not span:
        findings.refuse(key, "has all its pins on one body: it moves no joint; correct the bodies of its pins")
    elif len(span) == 1:
        _check_single(machine, c, findings)
    elif len(span) == 2:
        _check_double(machine, c, findings)


def _check_single(machine: Machine, c: int, findings: Inspection) -> None:
    """Check a cylinder that acts on one joint: closing of its linkage, lever, and length against the end stops.

    Refuses a linkage that cannot be closed at an angle of the joint's range; the rest is not checked then.
    """
    (j,) = machine.spans[c]
    joint, key = machine.links[j], ("cylinders", c, "linkage")
    theta = np.zeros((SCAN, machine.size))
    theta[:, j] = np.linspace(joint.angle_low, joint.angle_high, SCAN)
    at = machine.cylinders[c].linkage.stretch(machine.pose(theta))
    degrees = theta[:, j] / DEGREE
    open_at = np.flatnonzero(np.isnan(at.length))
    if open_at.size:
        problem = f"cannot be closed at {degrees[open_at[0]]:.1f} deg: correct its dimensions or {joint.name}'s"
        findings.refuse(key, f"{problem} angle_range_deg")
        return
    _check_lever(at, j, degrees, joint.name, key, findings)
    _check_ends(machine, c, at.length, degrees, findings)


def _check_lever(stretch: Stretch, j: int, degrees: Array, joint: str, key: Key, findings: Inspection) -> None:
    """Check that the lever of joint j keeps its sign over the range, away from a dead point.

    Refuses a change of sign. Warns where the linkage comes near its dead point (NEAR_DEAD).

    stretch: length, lever [m/rad] and transmission of the cylinder at SCAN angles of the joint
    degrees: (SCAN,) these angles [deg]
    joint: name of the joint's link
    """
    lever = stretch.gradient[:, j]
    change = np.flatnonzero(np.diff(np.sign(lever)) != 0)
    if change.size and min(-lever.min(), lever.max()) > LEVER_NOISE * np.abs(lever).max():
        problem = f"has a lever that changes its sign at {degrees[change[0]]:.1f} deg, a dead point"
        findings.refuse(key, f"{problem}: check the signs of its pins, its side, and {joint}'s angle_range_deg")
    transmission = np.broadcast_to(stretch.transmission, degrees.shape)
    worst = int(np.argmin(transmission))
    if transmission[worst] < NEAR_DEAD:
        problem = (
            f"is {np.arcsin(transmission[worst]) / DEGREE:.0f} deg away from its dead point at {degrees[worst]:.1f} deg"
        )
        findings.warn(key, f"{problem}: check its dimensions and {joint}'s angle_range_deg")


def _check_ends(machine: Machine, c: int, length: Array, degrees: Array, findings: Inspection) -> None:
    """Check the cylinder's length over the joint's range against its end stops.

    Refuses a length far beyond an end stop (BEYOND_REFUSE). Warns of one a little beyond (BEYOND_WARN), and of a part
    of the stroke that is not used (UNUSED_WARN).

    length: (SCAN,) length of cylinder c [m]
    degrees: (SCAN,) angles of the joint [deg]
    """
    cylinder, key = machine.cylinders[c], ("cylinders", c, "linkage")
    joint = machine.links[machine.spans[c][0]].name
    low, high = cylinder.length_low, cylinder.length_high
    cure = f"correct the pins, length_range_m or {joint}'s angle_range_deg"
    if length.max() < low or length.min() > high:
        span = f"{length.min():.3f}-{length.max():.3f} m"
        findings.refuse(key, f"makes lengths of {span}, all outside length_range_m = [{low:g}, {high:g}]: {cure}")
        return
    ends = (
        (int(np.argmin(length)), low - length.min(), "shorter than retracted"),
        (int(np.argmax(length)), length.max() - high, "longer than extended"),
    )
    for worst, beyond, what in ends:
        share = beyond / (high - low)
        problem = f"makes the cylinder {beyond / MILLIMETRE:.0f} mm {what} at {degrees[worst]:.1f} deg: {cure}"
        if share > BEYOND_REFUSE:
            findings.refuse(key, problem)
        elif share > BEYOND_WARN:
            findings.warn(key, problem)
        elif share < -UNUSED_WARN:
            problem = f"leaves {-beyond / MILLIMETRE:.0f} mm of the stroke unused at {degrees[worst]:.1f} deg: {cure}"
            findings.warn(key, problem)


def _check_reached(joint: str, degrees: Array, share: float, key: Key, findings: Inspection) -> None:
    """Check that the angles at which some posture fits the cylinder are a large enough share of a joint's range.

    Refuses a share below REACHED_REFUSE, warns of one below REACHED_WARN.

    joint: name of the joint's link
    degrees: (n,) these angles [deg]
    share: their share of the joint's range
    """
    between = f"between {round(degrees.min())} and {round(degrees.max())} deg"
    problem = (
        f"fits its cylinder only with {joint} {between}, {share:.0%} of its angle_range_deg: check the pins, "
        "length_range_m and the range"
    )
    if share < REACHED_REFUSE:
        findings.refuse(key, problem)
    elif share < REACHED_WARN:
        findings.warn(key, problem)


def _check_double(machine: Machine, c: int, findings: Inspection) -> None:
    """Check a cylinder over two joints.

    The file does not contain which of their angles occur together. Therefore only a linkage is refused that fits in no
    posture, or in a small share of a joint's range only (`_check_reached`). A lever of the outer joint that changes its
    sign gives a warning.
    """
    cylinder, key = machine.cylinders[c], ("cylinders", c, "linkage")
    first, second = machine.spans[c]
    ranges = [np.linspace(machine.links[j].angle_low, machine.links[j].angle_high, GRID) for j in (first, second)]
    theta = np.zeros((GRID, GRID, machine.size))
    theta[..., first], theta[..., second] = np.meshgrid(*ranges, indexing="ij")
    at = cylinder.linkage.stretch(machine.pose(theta))
    inside = (at.length >= cylinder.length_low) & (at.length <= cylinder.length_high)  # NaN is neither
    low, high = cylinder.length_low, cylinder.length_high
    if not inside.any():
        problem = f"fits its cylinder, length_range_m = [{low:g}, {high:g}], in no posture of its joints"
        findings.refuse(key, f"{problem}: correct the pins or the range")
        return
    for joint, angles, reached in ((first, ranges[0], inside.any(axis=1)), (second, ranges[1], inside.any(axis=0))):
        _check_reached(machine.links[joint].name, angles[reached] / DEGREE, float(reached.mean()), key, findings)
    lever = at.gradient[..., second][inside]
    if min(-lever.min(), lever.max()) > LEVER_NOISE * np.abs(lever).max():
        problem = f"has a lever at {machine.links[second].name} that changes its sign within its stroke"
        findings.warn(key, f"{problem}: check the signs of its pins and its side")
