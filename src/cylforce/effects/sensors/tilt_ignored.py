"""A slope of the ground that the measured pitch does not contain."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


@dataclass(frozen=True, slots=True)
class TiltIgnored:
    """The measured pitch is too high by a slope `size` [rad] of the ground.

    The slope is along the tracks as they stood at the start, or `across` them. The pitch contains the part of it in the
    arm's plane, which turns with the slew angle.
    """

    across: bool = False  # whether the slope is across the tracks, not along them

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="tilt_ignored",
            unit="rad",
            low=0.004,
            high=0.12,
            place=Place.MACHINE,
            shows="with the posture, in all joints alike, changing as the house turns",
            confirm="the same moves with the house turned by half a turn",
            axes=2,
        )

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with pitch + size cos(psi), or with `across` pitch + size sin(psi).

        psi is the slew angle [rad] since the start of the recording. The same object when the machine has no pitch
        sensor.

        values: (T, S) signals without the error [SI]
        t:      (T,) time since the start of the recording [s]
        size:   slope of the ground [rad]
        """
        columns = {s.kind: k for k, s in enumerate(machine.signals)}
        if Kind.PITCH not in columns:
            return values
        psi = _slewed(values, t, columns)
        found = values.copy()
        found[:, columns[Kind.PITCH]] += size * (np.sin(psi) if self.across else np.cos(psi))
        return found


def _slewed(values: Array, t: Array, columns: dict[Kind, int]) -> Array:
    """Return the slew angle (T,) since the first sample [rad], from a sensor of the angle or the rate, else zeros.

    values:  (T, S) signals [SI]
    t:       (T,) time [s]
    columns: number of the signal of each kind
    """
    if Kind.SLEW_ANGLE in columns:
        return np.asarray(values[:, columns[Kind.SLEW_ANGLE]] - values[0, columns[Kind.SLEW_ANGLE]])
    if Kind.SLEW_RATE in columns:
        return np.asarray(np.cumsum(values[:, columns[Kind.SLEW_RATE]] * np.gradient(t)))
    return np.zeros_like(t)
