"""A slope of the ground that the measured pitch does not contain."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


@dataclass(frozen=True, slots=True)
class TiltIgnored:
    """The measured pitch is too high by a slope of the ground: along the tracks as they stood at the start, or `across`
    them. The house sees it according to its slew angle."""

    across: bool = False

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            "tilt_ignored",
            "rad",
            0.004,
            0.12,
            Place.MACHINE,
            "with the posture, in all joints alike, changing as the house turns",
            "the same moves with the house turned by half a turn",
            axes=2,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with pitch + size cos(psi), or with `across` pitch + size sin(psi).

        psi is the slew angle since the start of the recording. The same object when the machine has no pitch sensor.
        """
        place = {s.kind: k for k, s in enumerate(machine.signals)}
        if Kind.PITCH not in place:
            return values
        turned = _turned(values, t, place)
        found = values.copy()
        found[:, place[Kind.PITCH]] += size * (np.sin(turned) if self.across else np.cos(turned))
        return found


def _turned(values: Array, t: Array, place: dict[Kind, int]) -> Array:
    if Kind.SLEW_ANGLE in place:
        return np.asarray(values[:, place[Kind.SLEW_ANGLE]] - values[0, place[Kind.SLEW_ANGLE]])
    if Kind.SLEW_RATE in place:
        return np.asarray(np.cumsum(values[:, place[Kind.SLEW_RATE]] * np.gradient(t)))
    return np.zeros_like(t)
