"""Joint angle -> cylinder: trigonometry of triangles, one loop closed by the law of cosines.

Every joint of this machine has one cylinder, so all of this is functions of one angle. Scalars, because the inner step
of the simulation lives here. Angles are positive from x (forward) towards z (up).
"""

from math import acos, atan2, cos, hypot, sin, sqrt

from .datasheet import Point


class Direct:
    """A cylinder straight from `foot` on the inner body to `eye` on the outer one; `pin` is the joint, seen from the
    inner body."""

    __slots__ = ("_foot", "_ray", "_reach", "_sum", "_turn", "_twice")

    def __init__(self, foot: Point, eye: Point, pin: Point) -> None:
        x, z = foot[0] - pin[0], foot[1] - pin[1]
        self._foot = (x, z)
        self._ray, self._reach = hypot(x, z), hypot(*eye)
        self._turn = atan2(eye[1], eye[0]) - atan2(z, x)  # angle between the two rays at joint angle zero
        self._sum = self._ray**2 + self._reach**2
        self._twice = 2.0 * self._ray * self._reach

    def span(self, angle: float) -> tuple[float, float]:
        """Length [m] and d(length)/d(angle) [m/rad]: l^2 = a^2 + r^2 - 2 a r cos t, l l' = a r sin t."""
        t = angle + self._turn
        length = sqrt(self._sum - self._twice * cos(t))
        return length, 0.5 * self._twice * sin(t) / length

    def axis(self, angle: float) -> tuple[float, float]:
        """Direction of the cylinder in the inner body [rad] and its derivative by the joint angle."""
        length, _ = self.span(angle)
        swing = angle + self._turn + atan2(self._foot[1], self._foot[0])
        ex, ez = self._reach * cos(swing), self._reach * sin(swing)
        dx, dz = ex - self._foot[0], ez - self._foot[1]
        return atan2(dz, dx), (dx * ex + dz * ez) / (length * length)


class Bars:
    """A cylinder from `foot` on the stick to the common pin of rocker and link that turn the bucket about `pin`."""

    __slots__ = ("_arm", "_arm_turn", "_diff", "_foot", "_link", "_rocker", "_rocker_pin")

    def __init__(self, foot: Point, rocker_pin: Point, link_pin: Point, bars: tuple[float, float], pin: Point) -> None:
        self._foot = (foot[0] - pin[0], foot[1] - pin[1])
        self._rocker_pin = (rocker_pin[0] - pin[0], rocker_pin[1] - pin[1])
        self._arm, self._arm_turn = hypot(*link_pin), atan2(link_pin[1], link_pin[0])
        self._rocker, self._link = bars
        self._diff = bars[0] ** 2 - bars[1] ** 2

    def _closed(self, angle: float) -> tuple[float, float, float, float, float]:
        """Rocker's angle and its derivative, the rocker's vector, and the derivative of the link's angle."""
        t = angle + self._arm_turn
        bx, bz = self._arm * cos(t), self._arm * sin(t)
        dx, dz = bx - self._rocker_pin[0], bz - self._rocker_pin[1]
        gap = hypot(dx, dz)
        rocker = atan2(dz, dx) + acos((gap * gap + self._diff) / (2.0 * gap * self._rocker))
        rx, rz = self._rocker * cos(rocker), self._rocker * sin(rocker)
        lx, lz = rx - dx, rz - dz  # link pin -> common pin
        # the link stays as long as it is: (lx, lz) is perpendicular to the difference of its ends' motions
        rate = (bx * lz - bz * lx) / (rx * lz - rz * lx)
        link_rate = ((rx * lx + rz * lz) * rate - (bx * lx + bz * lz)) / (self._link * self._link)
        return rocker, rate, rx, rz, link_rate

    def span(self, angle: float) -> tuple[float, float]:
        """Length [m] of the cylinder and d(length)/d(bucket angle) [m/rad]."""
        _, rate, rx, rz, _ = self._closed(angle)
        ex = self._rocker_pin[0] + rx - self._foot[0]
        ez = self._rocker_pin[1] + rz - self._foot[1]
        length = sqrt(ex * ex + ez * ez)
        return length, (ez * rx - ex * rz) * rate / length

    def axis(self, angle: float) -> tuple[float, float]:
        """Direction of the cylinder in the stick [rad] and its derivative by the bucket angle."""
        _, rate, rx, rz, _ = self._closed(angle)
        ex = self._rocker_pin[0] + rx - self._foot[0]
        ez = self._rocker_pin[1] + rz - self._foot[1]
        return atan2(ez, ex), (ex * rx + ez * rz) * rate / (ex * ex + ez * ez)

    def rocker(self, angle: float) -> tuple[float, float]:
        """Direction of the rocker in the stick [rad] and its derivative by the bucket angle."""
        found = self._closed(angle)
        return found[0], found[1]

    def link(self, angle: float) -> tuple[float, float]:
        """Direction common pin -> link pin in the stick [rad] and its derivative by the bucket angle."""
        _, _, rx, rz, rate = self._closed(angle)
        t = angle + self._arm_turn
        x = self._arm * cos(t) - self._rocker_pin[0] - rx
        z = self._arm * sin(t) - self._rocker_pin[1] - rz
        return atan2(z, x), rate


def inverse(linkage: "Direct | Bars", length: float, low: float, high: float) -> float:
    """Joint angle of a length by bisection between two angles within which the length is monotone."""
    rising = linkage.span(high)[0] > linkage.span(low)[0]
    for _ in range(60):
        middle = 0.5 * (low + high)
        if (linkage.span(middle)[0] < length) == rising:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
