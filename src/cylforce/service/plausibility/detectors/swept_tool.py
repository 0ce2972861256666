"""Detector of slewing that no load explains.

The house's motor cannot sweep the tool sideways through the ground. While the house slews the tool is in the air, where
a load explains the torques of all joints. Successive seconds of slewing that no load explains mean that a signal is
wrong, but do not show which one. A bucket that is dumped during a part of a swing also causes such seconds."""

from dataclasses import dataclass
from typing import Self

from cylforce.service.plausibility.detector import (
    EVERY,
    Detector,
    Features,
    Interruption,
    MonitoredMachine,
)
from cylforce.service.plausibility.pressure_groups import pressures
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.service.snapshot import Constants
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

# rad of slewing that no load explains, from which on the signals are suspected or rejected; chosen: more than one and a
# half times the largest of healthy machines, 0.60, which dump meanwhile; two swings, out and back
FARTHEST = {Level.SUSPECTED: 1.0, Level.REJECTED: 3.0}
FAST = 0.2  # rad/s of the house, above which the tool has no contact; chosen: a fifth of its full speed


class SweptConstants(Constants):
    """Constants of the slewing of one machine.

    measured:  kinds of the signals
    pressures: numbers of the signals that are suspected
    rate_hz:   steps per second [Hz]
    """

    def __init__(self, monitored: MonitoredMachine) -> None:
        """Collect the kinds of the signals, which show how slewing is measured, and the pressures to suspect.

        monitored: constants of the machine
        """
        machine = monitored.model.machine
        self.measured, self.rate_hz = {s.kind for s in machine.signals}, monitored.model.filters.rate_hz
        self.pressures = tuple(pressures(machine))


@dataclass(slots=True)
class SweptTool(Detector):
    """Slewing that no load explains. Without a slew sensor it is always 0.

    constants: of the machine
    running:   angle of slewing in the running block [rad]
    angle:     angle of slewing in earlier blocks without an explanation, since the last one that a load explains [rad]
    fast:      whether the house slews too fast for contact of the tool with the ground
    report:    present suspicion
    """

    constants: SweptConstants
    running: float = 0.0
    angle: float = 0.0
    fast: bool = False
    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any slewing."""
        return cls(machine.constants(SweptConstants))

    @property
    def level(self) -> Level:
        """Level of the suspicion that a signal is wrong."""
        return Level.of(self.angle, FARTHEST)

    def interrupt(self, why: Interruption) -> None:
        """Discard the running block."""
        self.running = 0.0

    def on_sample(self, features: Features) -> None:
        """Update the angle of slewing that no load explains with a sample; a large angle suspects all pressures."""
        self.slew(features.now.pipeline.smooth)
        if features.blocks.ended:
            self.end_block(features.blocks.explained)
        level = self.level
        if level is Level.FINE:
            self.report = NOTHING_SUSPECTED
        elif level is not self.report.level:
            self.report = SensorSuspicion(level, SensorFault.CONTRADICTS_MOTION, self.constants.pressures)

    def slew(self, smooth: Array) -> None:
        """Add the angle by which the house slewed since the last sample, either way, to the running block [rad].

        `fast` is updated, too. Without a slew sensor nothing changes.

        smooth: (3, D) last three smoothed channels, the slew rate [rad/s] or slew angle [rad] last
        """
        c = self.constants
        if Kind.SLEW_RATE in c.measured:
            rate = float(smooth[-1, -1])
        elif Kind.SLEW_ANGLE in c.measured:
            rate = float(smooth[-1, -1] - smooth[0, -1]) * c.rate_hz / 2.0
        else:
            return
        self.running += abs(rate) * (EVERY / c.rate_hz)
        self.fast = abs(rate) > FAST

    def end_block(self, explained: bool | None) -> None:
        """End the running block: its slewing counts, unless a load explains the block, which resets the sum to 0.

        explained: whether a load explains the block; None: the machine hardly moved, and the block does not count
        """
        if explained is not None:
            self.angle = 0.0 if explained else self.angle + self.running
        self.running = 0.0
