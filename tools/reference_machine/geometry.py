"""Where the arm is: postures, tip, clearance, and cylinder lengths by tables. For planning, vectorised."""

from functools import cached_property
from math import acos, atan2, hypot

import numpy as np
from numpy.typing import NDArray

from .datasheet import JOINTS
from .linkage import inverse
from .specimen import Specimen

Array = NDArray[np.float64]
HEEL = (0.75, 0.85)  # the bucket's lowest point when its teeth look back, in its frame
NODES = 600


class Geometry:
    """Angles <-> lengths, tip of the teeth, postures of a specimen. Lengths are of (boom, stick, bucket) [m]."""

    def __init__(self, specimen: Specimen) -> None:
        self.specimen = specimen
        self.linkages = [specimen.linkage(joint) for joint in JOINTS]
        self._grid = [_angles(*specimen.sheet.links[j].range_deg) for j in JOINTS]
        self._length = [
            np.array([link.span(float(a))[0] for a in grid])
            for link, grid in zip(self.linkages, self._grid, strict=True)
        ]

    @cached_property
    def working(self) -> Array:
        """Lengths (3, 2) that are used: 4 % of the stroke away from stops and from the joints' limits."""
        found = []
        for joint, length in zip(JOINTS, self._length, strict=True):
            low, high = self.specimen.cylinders[joint].lengths
            low, high = max(low, float(length.min())), min(high, float(length.max()))
            found.append((low + 0.04 * (high - low), high - 0.04 * (high - low)))
        return np.array(found)

    def angles(self, lengths: Array) -> Array:
        """Joint angles (..., 3) of lengths (..., 3)."""
        columns = []
        for k, (grid, table) in enumerate(zip(self._grid, self._length, strict=True)):
            order = np.argsort(table)
            columns.append(np.interp(lengths[..., k], table[order], grid[order]))
        return np.stack(columns, axis=-1)

    def lengths(self, angles: Array) -> Array:
        """Lengths (..., 3) of joint angles (..., 3)."""
        tables = zip(self._grid, self._length, strict=True)
        return np.stack([np.interp(angles[..., k], g, t) for k, (g, t) in enumerate(tables)], axis=-1)

    def exact_angles(self, lengths: Array) -> list[float]:
        """Joint angles of one set of lengths, exact to rounding."""
        ends = [(float(g[0]), float(g[-1])) for g in self._grid]
        return [inverse(link, float(x), *e) for link, x, e in zip(self.linkages, lengths, ends, strict=True)]

    def points(self, lengths: Array) -> tuple[Array, Array]:
        """Places (..., 2) of teeth and heel, seen from the boom pin in the house's axes [m]."""
        turned = np.cumsum(self.angles(lengths), axis=-1)
        s = self.specimen
        pin = s.lengths["boom"] * _ray(turned[..., 0]) + s.lengths["stick"] * _ray(turned[..., 1])
        along, across = _ray(turned[..., 2]), _ray(turned[..., 2] + np.pi / 2.0)
        return pin + s.tool[0] * along + s.tool[1] * across, pin + HEEL[0] * along + HEEL[1] * across

    def clearance(self, lengths: Array) -> float:
        """Least height of teeth and heel above the ground along a path (..., 3); the cab counts as ground."""
        tip, heel = self.points(lengths)
        height = np.minimum(tip[..., 1], heel[..., 1]) + self.specimen.sheet.pin_height
        before_cab = np.minimum(tip[..., 0], heel[..., 0]) - 1.2
        return float(np.min(np.minimum(height, before_cab)))

    def posture(self, x: float, z: float, attitude: float) -> Array:
        """Angles (3,) that bring the teeth to (x, z) from the boom pin with the bucket's line at `attitude` [rad].
        Raises ValueError when the arm does not reach."""
        s = self.specimen
        ray, across = _ray(np.array(attitude)), _ray(np.array(attitude + np.pi / 2.0))
        pin = np.array([x, z]) - s.tool[0] * ray - s.tool[1] * across
        far, a, b = hypot(*pin), s.lengths["boom"], s.lengths["stick"]
        if not abs(a - b) < far < a + b:
            raise ValueError(f"the arm does not reach ({x:.2f}, {z:.2f}) m")
        boom = atan2(pin[1], pin[0]) + acos((a * a + far * far - b * b) / (2.0 * a * far))
        stick = -np.pi + acos((a * a + b * b - far * far) / (2.0 * a * b))
        bucket = (attitude - boom - stick + np.pi) % (2.0 * np.pi) - np.pi
        return np.array([boom, stick, bucket])


def _ray(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _angles(low_deg: float, high_deg: float) -> Array:
    """Angles (NODES,) [rad] of a joint's range."""
    low, high = np.radians((low_deg, high_deg)).tolist()
    return np.linspace(low, high, NODES)
