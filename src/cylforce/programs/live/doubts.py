"""Messages on contradictory sensors: an emergency message, and the signals' names in the journal."""

from structlog.typing import FilteringBoundLogger

from cylforce.canopen.emergency import Emergencies
from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault

CODES = {  # EMCY codes (manufacturer's)
    SensorFault.EXCHANGED: 0xFF10,
    SensorFault.STUCK: 0xFF20,
    SensorFault.BURST: 0xFF22,
    SensorFault.OFFSET: 0xFF23,
    SensorFault.SLIPPED: 0xFF24,
    SensorFault.LEAPT: 0xFF24,
    SensorFault.IMPOSSIBLE: 0xFF23,
    SensorFault.LIGHT: 0xFF23,
    SensorFault.MISPLACED: 0xFF24,
    SensorFault.STEPPED: 0xFF23,
    SensorFault.SWAPPED: 0xFF10,
    SensorFault.STRAYED: 0xFF21,
}
WHY = {
    SensorFault.EXCHANGED: "the forces do not belong to the motion: sensors exchanged, or one is dead",
    SensorFault.STUCK: "it does not change while its cylinder moves to and fro",
    SensorFault.BURST: "it fell to nothing at once: a burst hose, or a broken line",
    SensorFault.OFFSET: "no load explains the torques of all joints unless it is off by a constant",
    SensorFault.SLIPPED: "no load explains the torques of all joints unless this angle is off by a constant",
    SensorFault.LEAPT: "it leapt farther than the machine can move, and stayed there: it has slipped",
    SensorFault.IMPOSSIBLE: "it is below vacuum",
    SensorFault.LIGHT: "the empty bucket weighs less than nothing",
    SensorFault.MISPLACED: "the empty bucket's weight is where no mass in it can be: has an angle slipped?",
    SensorFault.STEPPED: "it leapt by itself, and stayed there: the next motion in the air will say whether it is off",
    SensorFault.STRAYED: "it was outside its range, and is back: the next motion in the air will say if it is off",
    SensorFault.SWAPPED: "they leapt to each other's values: exchanged; the next motion in the air will say",
}


class Doubts:
    """Reporter of changes of the suspected sensors."""

    def __init__(self, machine: Machine, emergencies: Emergencies, tell: FilteringBoundLogger) -> None:
        self._machine, self._emergencies, self._tell = machine, emergencies, tell
        self._said = NOTHING_SUSPECTED

    def look(self, now: SensorDoubt) -> None:
        """Report a change of the suspicion, after every step."""
        before, self._said = self._said, now
        if (now.level, now.cause, now.signals) == (before.level, before.cause, before.signals):
            return
        if before.cause is not SensorFault.NONE and now.cause is not before.cause:
            self._emergencies.repair(CODES[before.cause])
        if now.level is Level.FINE:
            self._tell.info("the sensors agree again")
            return
        self._emergencies.occur(CODES[now.cause], info=bytes([now.signals[0] + 1, now.level]))
        names = [self._machine.signals[k].name for k in now.signals]
        self._tell.warning("sensors disagree", signals=names, level=now.level.name.lower(), why=WHY[now.cause])
