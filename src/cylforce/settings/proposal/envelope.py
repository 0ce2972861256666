"""The first joint's angle range from the working envelope of a data sheet."""

from collections.abc import Mapping, Sequence
from math import asin, degrees
from typing import Any

import numpy as np
from scipy.optimize import brentq

from cylforce.settings.proposal.types import MachineType, Range

STEEPEST = 80.0  # deg, of a first link, up or down
GRID = 61


def first_range(
    kind: MachineType, lengths: Sequence[float], ranges: Sequence[Range], values: Mapping[str, Any], s: float
) -> Range:
    """Angle range [deg] of the first joint: `ranges[0]`, or what follows from the figures of the envelope in `values`.

    `lengths` [m] and `ranges` [deg] are those of all links. Raises ValueError with a sentence."""
    low, high = ranges[0]
    height = values.get("pin_height_m") or kind.pin_height * s
    if values.get("dig_depth_m") is not None:
        low = _downwards(values["dig_depth_m"] + height - sum(lengths[1:]), lengths[0], values["dig_depth_m"])
    if values.get("cut_height_m") is not None:
        high = _cutting(values["cut_height_m"] - height, lengths, ranges, values["cut_height_m"])
    if values.get("hinge_height_m") is not None:
        high = _upwards(values["hinge_height_m"] - height, lengths[0], values["hinge_height_m"])
    if high - low < 10.0:
        name = "dig_depth_m" if values.get("dig_depth_m") is not None else "the working envelope"
        raise ValueError(f"{name} leaves a first joint that turns from {low:.0f} to {high:.0f} deg: check the heights")
    return round(low, 1), round(high, 1)


def _downwards(depth: float, length: float, given: float) -> float:
    """Angle [deg] at which the first link's end is `depth` [m] below its pin, stick and tool hanging straight down."""
    if not 0.0 < depth < np.sin(np.radians(STEEPEST)) * length:
        raise ValueError(
            f"dig_depth_m is {given:g}, which links of these lengths do not reach with the first one pointing 0 to "
            f"{STEEPEST:g} deg down: check it, the lengths, and pin_height_m"
        )
    return -degrees(asin(depth / length))


def _upwards(rise: float, length: float, given: float) -> float:
    """Angle [deg] at which the first link's end is `rise` [m] above its pin."""
    if not 0.0 < rise < np.sin(np.radians(STEEPEST)) * length:
        raise ValueError(
            f"hinge_height_m is {given:g}, which an arm of {length:g} m does not reach between 0 and {STEEPEST:g} deg: "
            "check it, the arm's length, and pin_height_m"
        )
    return degrees(asin(rise / length))


def _cutting(rise: float, lengths: Sequence[float], ranges: Sequence[Range], given: float) -> float:
    """Angle [deg] of the first link at which the teeth come `rise` [m] above its pin, stick and tool at the best of
    their `ranges` [deg]."""

    def above(angle: float) -> float:
        return highest(angle, lengths, ranges) - rise

    if not above(0.0) < 0.0 < above(STEEPEST):
        most = rise - given
        limits = f"{highest(0.0, lengths, ranges) - most:.1f} to {highest(STEEPEST, lengths, ranges) - most:.1f}"
        raise ValueError(
            f"cut_height_m is {given:g}, links of these lengths and ranges reach {limits}: check it and pin_height_m"
        )
    return float(brentq(above, 0.0, STEEPEST))


def highest(angle: float, lengths: Sequence[float], ranges: Sequence[Range]) -> float:
    """How far [m] the last link's end comes above the first pin, with the first joint at `angle` [deg]."""
    grids = np.meshgrid(*(np.linspace(*r, GRID) for r in ranges[1:]), indexing="ij")
    q, height = np.radians(angle), lengths[0] * np.sin(np.radians(angle))
    for length, turned in zip(lengths[1:], grids, strict=True):
        q = q + np.radians(turned)
        height = height + length * np.sin(q)
    return float(np.max(height))
