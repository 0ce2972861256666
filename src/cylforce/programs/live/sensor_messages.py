"""Messages on contradictory sensors: an emergency message, and the signals' names in the journal."""

from structlog.typing import FilteringBoundLogger

from cylforce.canopen.emergency import Emergencies
from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion

CODES = {  # EMCY codes (manufacturer's)
    SensorFault.CONTRADICTS_MOTION: 0xFF10,
    SensorFault.FROZEN: 0xFF20,
    SensorFault.BURST: 0xFF22,
    SensorFault.OFFSET: 0xFF23,
    SensorFault.SLIPPED: 0xFF24,
    SensorFault.ANGLE_STEPPED: 0xFF24,
    SensorFault.BELOW_VACUUM: 0xFF23,
    SensorFault.NEGATIVE_WEIGHT: 0xFF23,
    SensorFault.IMPOSSIBLE_MOMENTS: 0xFF24,
    SensorFault.STEPPED: 0xFF23,
    SensorFault.SWAPPED: 0xFF10,
    SensorFault.BACK_IN_RANGE: 0xFF21,
}
WHY = {
    SensorFault.CONTRADICTS_MOTION: "the forces do not belong to the motion: sensors swapped, or one is dead",
    SensorFault.FROZEN: "it does not change while its cylinder moves to and fro",
    SensorFault.BURST: "it fell to nothing at once: a burst hose, or a broken line",
    SensorFault.OFFSET: "no load explains the torques of all joints unless it is off by a constant",
    SensorFault.SLIPPED: "no load explains the torques of all joints unless this angle is off by a constant",
    SensorFault.ANGLE_STEPPED: "it stepped farther than the machine can move, and stayed there: it has slipped",
    SensorFault.BELOW_VACUUM: "it is below vacuum",
    SensorFault.NEGATIVE_WEIGHT: "the empty bucket weighs less than nothing",
    SensorFault.IMPOSSIBLE_MOMENTS: "the empty bucket's weight is where no mass in it can be: has an angle slipped?",
    SensorFault.STEPPED: "it stepped by itself, and stayed there: the next motion in the air decides whether it is off",
    SensorFault.BACK_IN_RANGE: "it was outside its range, and is back: the next motion in the air decides if it is off",
    SensorFault.SWAPPED: "they stepped to each other's values: swapped? The next motion in the air decides",
}
LEVELS = {Level.SUSPECTED: "doubted", Level.REJECTED: "rejected"}  # words of the journal, which do not change


class SensorMessages:
    """Messages on changes of the suspected sensors.

    machine:     names the signals
    emergencies: of our node
    journal:     log of the service
    """

    def __init__(self, machine: Machine, emergencies: Emergencies, journal: FilteringBoundLogger) -> None:
        self._machine, self._emergencies, self._journal = machine, emergencies, journal
        self._reported = NOTHING_SUSPECTED

    def report(self, now: SensorSuspicion) -> None:
        """Report a change of the suspicion, after every step."""
        before, self._reported = self._reported, now
        if (now.level, now.cause, now.signals) == (before.level, before.cause, before.signals):
            return
        if before.cause is not SensorFault.NONE and now.cause is not before.cause:
            self._emergencies.repair(CODES[before.cause])
        if now.level is Level.FINE:
            self._journal.info("the sensors agree again")
            return
        self._emergencies.occur(CODES[now.cause], info=bytes([now.signals[0] + 1, now.level]))
        names = [self._machine.signals[k].name for k in now.signals]
        self._journal.warning("sensors disagree", signals=names, level=LEVELS[now.level], why=WHY[now.cause])
