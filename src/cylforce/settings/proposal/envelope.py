"""Derive the first joint's angle range from the working envelope of a data sheet."""

from collections.abc import Collection, Mapping, Sequence
from math import asin, degrees
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cylforce.settings.proposal.types import MachineType, Range

STEEPEST = 80.0  # deg, largest inclination of a first link, up or down; chosen
GRID = 61  # angles of each further joint; chosen
HINGES = "hinge_low_m", "hinge_height_m"  # figures of the arm lowered and raised
AGREE = 0.03  # difference between heights and angles of data sheets, times the arm's length: 1 to 2 degrees; chosen


def first_range(
    kind: MachineType, lengths: Sequence[float], ranges: Sequence[Range], values: Mapping[str, Any], s: float
) -> Range:
    """Return the angle range [deg] of the first joint: `ranges[0]`, or one that follows from the envelope.

    The lower end follows from the digging depth or the lowered hinge's height, the upper end from the cutting height or
    the raised hinge's height. Raises ValueError, in a sentence, for heights that the links do not reach, or that leave
    a range of less than 10 degrees.

    lengths: of all links [m]
    ranges: angle ranges of all links [deg]
    values: figures by key
    s: size of the machine, times the example's
    """
    low, high = ranges[0]
    height = values.get("pin_height_m") or kind.pin_height * s
    if values.get("dig_depth_m") is not None:
        low = _downwards(values["dig_depth_m"] + height - sum(lengths[1:]), lengths[0], values["dig_depth_m"])
    if values.get("cut_height_m") is not None:
        high = _cutting(values["cut_height_m"] - height, lengths, ranges, values["cut_height_m"])
    hinges = [values.get(key) for key in HINGES]
    low, high = (
        old if hinge is None else _towards(key, hinge, height, lengths[0])
        for key, hinge, old in zip(HINGES, hinges, (low, high), strict=True)
    )
    if high - low < 10.0:
        name = "dig_depth_m" if values.get("dig_depth_m") is not None else "the working envelope"
        raise ValueError(f"{name} leaves a first joint that turns from {low:.0f} to {high:.0f} deg: check the heights")
    return round(low, 1), round(high, 1)


def _downwards(depth: float, length: float, given: float) -> float:
    """Return the angle [deg], negative, at which the first link's end is `depth` [m] below its pin. Raises ValueError.

    Stick and tool point straight down then, and reach the digging depth.

    length: length of the first link [m]
    given: the digging depth of the data sheet, for the error's text [m]
    """
    if not 0.0 < depth < np.sin(np.radians(STEEPEST)) * length:
        raise ValueError(
            f"dig_depth_m is {given:g}, which links of these lengths do not reach with the first one pointing 0 to "
            f"{STEEPEST:g} deg down: check it, the lengths, and pin_height_m"
        )
    return -degrees(asin(depth / length))


def _towards(key: str, hinge: float, height: float, length: float) -> float:
    """Return the angle [deg] at which the outer end of an arm is at the height `hinge` [m]. Raises ValueError.

    key: figure of that height
    height: height of the arm's pin [m]
    length: length of the arm [m]
    """
    most = np.sin(np.radians(STEEPEST)) * length
    if not abs(hinge - height) < most:
        raise ValueError(
            f"{key} is {hinge:g}, an arm of {length:g} m with its pin at {height:g} m reaches "
            f"{height - most:.2f} to {height + most:.2f}: check it, the arm's length, and pin_height_m"
        )
    return degrees(asin((hinge - height) / length))


def check_hinges(arm: Range, length: float, values: Mapping[str, Any], given: Collection[str]) -> None:
    """Raise ValueError where heights of the arm's ends contradict its angle range.

    A height of its inner pin that is not `given` follows from the first of them.

    arm: angle range of the arm [deg]
    length: its length [m]
    values: figures by key
    given: keys that came from the data sheet
    """
    pin = values["pin_height_m"] if "pin_height_m" in given else None
    hinges = [values.get(key) for key in HINGES]
    for key, hinge, angle in zip(HINGES, hinges, arm, strict=True):
        if hinge is None:
            continue
        rise = length * float(np.sin(np.radians(angle)))
        pin = hinge - rise if pin is None else pin
        if abs(pin + rise - hinge) > AGREE * length:
            raise ValueError(
                f"{key} is {hinge:g}, but the arm's end is at {pin + rise:.2f} m when its angle is {angle:g} deg and "
                f"its pin at {pin:.2f} m: leave out angle_range_deg or that height, or correct them"
            )


def _cutting(rise: float, lengths: Sequence[float], ranges: Sequence[Range], given: float) -> float:
    """Return the angle [deg] of the first link at which the teeth come `rise` [m] above its pin. Raises ValueError.

    Stick and tool are at the best angles of their ranges.

    lengths: of all links [m]
    ranges: angle ranges of all links [deg]
    given: the cutting height of the data sheet, above the ground, for the error's text [m]
    """

    def above(angle: float) -> float:
        """Return by how much the teeth come above the wanted height [m]."""
        return highest(angle, lengths, ranges) - rise

    if not above(0.0) < 0.0 < above(STEEPEST):
        most = rise - given
        limits = f"{highest(0.0, lengths, ranges) - most:.1f} to {highest(STEEPEST, lengths, ranges) - most:.1f}"
        raise ValueError(
            f"cut_height_m is {given:g}, links of these lengths and ranges reach {limits}: check it and pin_height_m"
        )
    return float(brentq(above, 0.0, STEEPEST))


def highest(angle: float, lengths: Sequence[float], ranges: Sequence[Range]) -> float:
    """Return how far [m] the last link's end comes at most above the first pin, with the first joint at `angle` [deg].

    lengths: of all links [m]
    ranges: angle ranges of all links [deg], within which all but the first joint may turn
    """
    grids = np.meshgrid(*(np.linspace(*r, GRID) for r in ranges[1:]), indexing="ij")
    q, height = np.radians(angle), lengths[0] * np.sin(np.radians(angle))
    for length, turned in zip(lengths[1:], grids, strict=True):
        q = q + np.radians(turned)
        height = height + length * np.sin(q)
    return float(np.max(height))
