"""What is suspected: which signals, of which fault, how surely."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum


class SensorFault(IntEnum):
    """What is wrong with a signal."""

    NONE = 0
    STUCK = 1  # does not change while its cylinder moves both ways
    BURST = 2  # fell to nothing at once
    OFFSET = 3  # a pressure that is off by a constant
    SLIPPED = 4  # an angle that is off by a constant
    EXCHANGED = 5  # the forces do not belong to the motion: connected to the wrong place, or dead
    LEAPT = 6  # an angle that leapt farther than a joint can turn, and stayed there
    IMPOSSIBLE = 7  # a pressure below vacuum
    LIGHT = 8  # the bucket weighs less than nothing
    STEPPED = 9  # a pressure that leapt alone, and stayed there
    SWAPPED = 10  # pressures that leapt to where the others were
    STRAYED = 11  # a pressure that was outside its sensor's range, and then inside again
    MISPLACED = 12  # the empty bucket has moments that no mass in it has


class Level(IntEnum):
    """How surely: values are DEGRADED when a signal is suspected (DOUBTED), INVALID when it is REJECTED."""

    FINE = 0
    DOUBTED = 1
    REJECTED = 2

    @classmethod
    def of(cls, value: float, limits: Mapping["Level", float]) -> "Level":
        """Return the highest level whose limit the value exceeds."""
        return max((level for level, limit in limits.items() if value > limit), default=cls.FINE)


# Latched once rejected, until the service is started again: what a pressure itself shows
LATCHED = (SensorFault.BURST, SensorFault.IMPOSSIBLE)
# Latched once both directions of motion have confirmed it: what is concluded from many samples
LATCHED_IF_CONFIRMED = (SensorFault.SLIPPED, SensorFault.EXCHANGED)
# Suspected at a moment, to be confirmed or refuted by the next motion in the air
WAITING = (SensorFault.STEPPED, SensorFault.SWAPPED, SensorFault.STRAYED)


@dataclass(frozen=True, slots=True)
class SensorDoubt:
    """A suspicion.

    level:     how surely
    cause:     the fault
    signals:   numbers of the signals of which one is wrong
    size:      by how much [Pa, rad]; 0: not known
    confirmed: whether motion in both directions has confirmed it
    """

    level: Level = Level.FINE
    cause: SensorFault = SensorFault.NONE
    signals: tuple[int, ...] = ()
    size: float = 0.0
    confirmed: bool = False

    @property
    def latched(self) -> bool:
        """Whether it stays until the service is started again."""
        latches = self.cause in LATCHED or (self.confirmed and self.cause in LATCHED_IF_CONFIRMED)
        return self.level is Level.REJECTED and latches

    @property
    def stays(self) -> bool:
        """Whether it stays although no detector reports it any more: until it is refuted by seconds in the air, or,
        where it is latched, until the service is started again. Exchanged pressures push in one direction of motion
        only."""
        return self.latched or (self.level is Level.REJECTED and self.cause is SensorFault.EXCHANGED)

    @property
    def waits(self) -> bool:
        """Whether the next motion in the air decides: bookings wait for it."""
        return self.cause in WAITING

    @property
    def follows(self) -> bool:
        """Whether friction and zeros are still adapted: an empty bucket below nothing may be a drift."""
        return self.level is Level.FINE or self.cause is SensorFault.LIGHT


NOTHING_SUSPECTED = SensorDoubt()
