"""Friction that is larger in one direction than in the other."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cylforce.effects.fault import About, Place, RunToRun
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class AsymmetricFriction:
    """Friction that is larger in one direction than in the other.

    With `way` 0 the mean of both directions is unchanged: force f |sgn(v)|, added to the symmetric f_c sgn(v). With
    f > 0 friction is then larger while extending, smaller while retracting. With `way` 1 or -1 only extending or only
    retracting changes: force f sgn(v) in that direction, none in the other; with f > 0 friction is larger there. Forces
    are those that the cylinder supplies, positive: it pushes. Lip seals have more friction in one direction.
    """

    depends_on: ClassVar[tuple[str, ...]] = ("speed", "lever")

    rounding: float = 0.0005  # m/s, speed scale of the smooth sgn(v)
    way: int = 0  # 1: only extending, -1: only retracting, 0: more one way, less the other

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="asymmetric_friction",
            unit="N",
            low=100.0 * self._directions,
            high=1.8e3 * self._directions,
            place=Place.CYLINDER,
            shows=f"in motion {'one way only' if self.way else 'either way, the same sign'}; nothing at rest",
            confirm="slow strokes both ways, then hold each pose reached from either side: at rest it must vanish",
            varies=RunToRun.VARYING,
        )

    @property
    def of_dry(self) -> float:
        """Largest plausible |f| as a multiple of the dry friction f_c, the mean of both directions: 1, or 2 with `way`.

        Friction of neither direction can be less than none: half the difference is at most the mean, a change of one
        direction alone at most twice the mean."""
        return float(self._directions)

    @property
    def _directions(self) -> int:
        """Factor on the plausible sizes: 2 if only one direction changes, as the difference is not shared by both."""
        return 2 if self.way else 1

    def force(self, speed: Array, force: Array, t: Array) -> Array:
        """Return the force [N] per newton of f, shaped as `speed` v [m/s].

        It is |sgn(v)|, or sgn(v) in the direction `way` alone. sgn(v) is rounded as tanh(v / rounding).
        """
        turned = np.tanh(speed / self.rounding)
        return np.asarray(np.where(self.way * speed > 0.0, turned, 0.0) if self.way else np.abs(turned))
