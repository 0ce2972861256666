"""Suspicion of a sensor fault: its signals, its cause, and its level."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum


class SensorFault(IntEnum):
    """Fault of a signal."""

    NONE = 0
    FROZEN = 1  # does not change while its cylinder moves both ways
    BURST = 2  # fell to zero within 50 ms
    OFFSET = 3  # a pressure that is off by a constant
    SLIPPED = 4  # an angle that is off by a constant
    CONTRADICTS_MOTION = 5  # the forces do not belong to the motion: connected to the wrong place, or dead
    ANGLE_STEPPED = 6  # an angle that stepped farther than a joint can turn
    BELOW_VACUUM = 7  # a pressure below vacuum
    NEGATIVE_WEIGHT = 8  # the empty bucket has a negative weight
    STEPPED = 9  # a pressure that stepped alone
    SWAPPED = 10  # pressures that each continue where another one was
    BACK_IN_RANGE = 11  # a pressure that was outside its sensor's range, and then inside again
    IMPOSSIBLE_MOMENTS = 12  # the empty bucket has moments that no mass in it has


class Level(IntEnum):
    """Level of a suspicion: values are DEGRADED when a signal is suspected (SUSPECTED), INVALID when it is REJECTED."""

    FINE = 0
    SUSPECTED = 1
    REJECTED = 2

    @classmethod
    def of(cls, value: float, limits: Mapping["Level", float]) -> "Level":
        """Return the highest level whose limit the value exceeds."""
        return max((level for level, limit in limits.items() if value > limit), default=cls.FINE)


# Latched once rejected, until the service is started again: faults that one pressure shows by itself
LATCHED = (SensorFault.BURST, SensorFault.BELOW_VACUUM)
# Latched once both directions of motion have confirmed it: faults that are concluded from many samples
LATCHED_IF_CONFIRMED = (SensorFault.SLIPPED, SensorFault.CONTRADICTS_MOTION)
# Suspected from one instant, to be confirmed or refuted by the next motion in the air
WAITING = (SensorFault.STEPPED, SensorFault.SWAPPED, SensorFault.BACK_IN_RANGE)


@dataclass(frozen=True, slots=True)
class SensorSuspicion:
    """Suspicion of a sensor fault.

    level:     of the suspicion
    cause:     suspected fault
    signals:   numbers of the signals of which one is wrong
    size:      error of the signal, positive where it reads too large, or size of its step [Pa, rad]; 0: not known
    confirmed: whether motion in both directions has confirmed the fault
    """

    level: Level = Level.FINE
    cause: SensorFault = SensorFault.NONE
    signals: tuple[int, ...] = ()
    size: float = 0.0
    confirmed: bool = False

    @property
    def latched(self) -> bool:
        """Return whether the suspicion stays until the service is started again."""
        latches = self.cause in LATCHED or (self.confirmed and self.cause in LATCHED_IF_CONFIRMED)
        return self.level is Level.REJECTED and latches

    @property
    def stays(self) -> bool:
        """Return whether the suspicion stays although no detector reports it any more.

        It stays until seconds in the air refute it, or, where it is latched, until the service is started again.
        Exchanged pressures drive the tool in one direction of motion only, so that their report may end by itself."""
        return self.latched or (self.level is Level.REJECTED and self.cause is SensorFault.CONTRADICTS_MOTION)

    @property
    def waits(self) -> bool:
        """Return whether bookings wait for the next motion in the air to decide."""
        return self.cause in WAITING

    @property
    def follows(self) -> bool:
        """Return whether friction and zeros are still adapted: a negative weight of the empty bucket may be a drift."""
        return self.level is Level.FINE or self.cause is SensorFault.NEGATIVE_WEIGHT


NOTHING_SUSPECTED = SensorSuspicion()
