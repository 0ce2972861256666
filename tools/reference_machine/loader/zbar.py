"""The Z-bar's kinematics by complex numbers: x forward, z up (the imaginary part), from the arm's pin in the base's
axes. Scalars, because the inner step of the simulation lives here."""

from cmath import phase, rect
from math import acos, cos, sin
from typing import NamedTuple

from reference_machine.linkage import Direct

from .specimen import Specimen


class Closed(NamedTuple):
    """The Z-bar at angles of arm and bucket [rad]: directions of crank and link (common pin to bucket), the cylinder's
    line from foot to eye [m], the crank's turn per bucket angle, and the cylinder's d(length) per arm and per bucket
    angle [m/rad]."""

    crank: float
    link: float
    line: complex
    turn: float
    levers: tuple[float, float]


class Zbar:
    """The tilt cylinder. `lifted`: the arm's angle that `span` uses; after `span`, `arm_lever`: d(length)/d(arm
    angle)."""

    def __init__(self, specimen: Specimen) -> None:
        s = specimen
        self._tip, self._bars = complex(s.lengths["arm"]), s.zbar
        pins = (s.cylinders["tilt"].foot, s.zbar.crank_pin, s.zbar.link_pin, s.zbar.eye)
        self._foot, self._pin, self._link_pin, self._eye = (complex(*pin) for pin in pins)
        self.lifted = self.arm_lever = 0.0

    def closed(self, arm: float, bucket: float) -> Closed:
        """All of it. Raises ValueError where the bars do not meet."""
        raised = rect(1.0, arm)
        pin, on_bucket = raised * self._pin, rect(1.0, arm + bucket) * self._link_pin
        apart = raised * self._tip + on_bucket - pin
        gap, r, bar = abs(apart), self._bars.crank, self._bars.link
        crank = phase(apart) - acos((gap * gap + r * r - bar * bar) / (2.0 * gap * r))
        along = rect(r, crank)
        link = along - apart  # bucket's pin -> common pin
        # the link stays as long as it is: it is perpendicular to the difference of its ends' motions
        turn = _dot(link, 1j * on_bucket) / _dot(link, 1j * along)
        eye = rect(1.0, crank) * self._eye
        line = pin + eye - self._foot
        levers = (_dot(line, 1j * (pin + eye)) / abs(line), _dot(line, 1j * eye) * turn / abs(line))
        return Closed(crank, phase(-link), line, turn, levers)

    def span(self, angle: float) -> tuple[float, float]:
        """Length [m] and d(length)/d(bucket angle) [m/rad] with the arm at `lifted`."""
        found = self.closed(self.lifted, angle)
        self.arm_lever = found.levers[0]
        return abs(found.line), found.levers[1]

    def bucket_angle(self, arm: float, length: float, low: float, high: float) -> float:
        """The bucket's angle at which the cylinder has a length, by bisection between two angles within which it
        grows. Raises ValueError where it lies beyond them."""
        self.lifted = arm
        if not self.span(low)[0] <= length <= self.span(high)[0]:
            raise ValueError(f"{length:.3f} m is not reached with the arm at {arm:.3f} rad")
        for _ in range(50):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.span(middle)[0] < length else (low, middle)
        return 0.5 * (low + high)


class Lift(Direct):
    """The lift cylinders."""

    __slots__ = ()

    def __init__(self, specimen: Specimen) -> None:
        cylinder = specimen.cylinders["lift"]
        super().__init__(cylinder.foot, cylinder.eye, (0.0, 0.0))


def tip(specimen: Specimen, arm: float, bucket: float) -> tuple[float, float]:
    """Place of the teeth [m]."""
    x, z = specimen.tool
    c, s, length = cos(arm + bucket), sin(arm + bucket), specimen.lengths["arm"]
    return length * cos(arm) + x * c - z * s, length * sin(arm) + x * s + z * c


def _dot(a: complex, b: complex) -> float:
    return a.real * b.real + a.imag * b.imag
