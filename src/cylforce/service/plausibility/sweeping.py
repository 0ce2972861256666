"""Is the tool swept sideways? In the ground it cannot be: the soil is stronger than the house's motor. While the house
slews the tool is in the air, where a load explains the torques of all joints. Seconds of slewing that no load explains,
one after the other, say that a signal is wrong, though not which one; a bucket that is dumped meanwhile is one, too,
for a part of a swing."""

from dataclasses import dataclass
from typing import NamedTuple

from cylforce.mechanics.machine import Machine
from cylforce.service.plausibility.suspicion import Level
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import once

# rad of slewing that no load explains, from which on the signals are doubted or rejected; chosen: more than one and a
# half times the largest of machines in order, 0.60, which dump meanwhile; two swings, out and back
FARTHEST = {Level.DOUBTED: 1.0, Level.REJECTED: 3.0}
FAST = 0.2  # rad/s of the house, at which nothing touches the ground; chosen: a fifth of its full speed


class Swept(NamedTuple):
    """State: by how much [rad] the house slewed in the `running` block, and in the blocks before that no load
    explained, since the last one that a load did (`angle`); whether it slews `fast`."""

    running: float = 0.0
    angle: float = 0.0
    fast: bool = False

    @property
    def level(self) -> Level:
        """How surely a signal is wrong."""
        return Level.of(self.angle, FARTHEST)


@dataclass(frozen=True)
class Sweeping:
    """The slewing of one machine; nothing is seen of it without a sensor of it."""

    machine: Machine
    seconds: float  # between two steps
    rate_hz: float

    @once
    def _measured(self) -> set[Kind]:
        return {s.kind for s in self.machine.signals}

    def step(self, state: Swept, smooth: Array) -> Swept:
        """One step, at the last three `smooth` channels (3, D)."""
        if Kind.SLEW_RATE in self._measured:
            rate = float(smooth[-1, -1])
        elif Kind.SLEW_ANGLE in self._measured:
            rate = float(smooth[-1, -1] - smooth[0, -1]) * self.rate_hz / 2.0
        else:
            return state
        return state._replace(running=state.running + abs(rate) * self.seconds, fast=abs(rate) > FAST)

    def ended(self, state: Swept, *, explained: bool | None) -> Swept:
        """The state after a block that a load explains, or not; None: that hardly moved."""
        angle = 0.0 if explained else state.angle + (0.0 if explained is None else state.running)
        return state._replace(running=0.0, angle=angle)
