"""Was a leap that is doubted a fault? The next seconds in the air say: then one load must explain the torques of all
joints. If a signal stepped, it must explain them better without that step; if signals were exchanged, it hardly ever
explains them at all, so that some seconds in a row that a load explains take the doubt back.

A step that is not confirmed ends by itself: when as many seconds of motion as `offsets` keeps have been of the time
after it, some of them in the air, there is no older evidence to wait for."""

from dataclasses import dataclass
from math import log

import numpy as np

from cylforce.service.plausibility.blocks import BAR, EVERY, SAMPLES, Block, Gatherer, cost, explained
from cylforce.service.plausibility.leaping import Leaps
from cylforce.service.plausibility.offsets import KEPT, VOTES
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import once

WRONGLY = 0.01  # probability with which a doubt of a fault is taken back (Wald's sequential test); by convention
ENOUGH = -2.0 * log(WRONGLY)  # votes, twice the log likelihood ratio, that take it back
MOST = ENOUGH / VOTES  # of one second: several must agree


@dataclass(frozen=True)
class Returning:
    """What blocks say about the leaps of one machine's pressures."""

    gatherer: Gatherer

    @once
    def _settled(self) -> int:
        """Steps after a leap from which on a block is of the time after it."""
        return EVERY * SAMPLES + self.gatherer.model.settle_steps

    def judged(self, state: Leaps, block: Block) -> Leaps:
        """The state after a block."""
        if state.doubt.level is Level.FINE or state.steps - state.since <= self._settled:
            return state
        stepped = state.doubt.cause is SensorFault.STEPPED
        votes = self._stepped(state, block) if stepped else self._swapped(state, block)
        seconds, in_air = state.seconds + 1, state.in_air + explained(block, self.gatherer.model.machine.rated_payload)
        unconfirmed = stepped and seconds >= KEPT and in_air >= VOTES and votes > -ENOUGH
        if votes >= ENOUGH or unconfirmed:
            return state._replace(doubt=NOTHING_SUSPECTED, votes=0.0, seconds=0, in_air=0)
        return state._replace(votes=max(votes, -ENOUGH), seconds=seconds, in_air=in_air)

    def _swapped(self, state: Leaps, block: Block) -> float:
        return state.votes + MOST if explained(block, self.gatherer.model.machine.rated_payload) else 0.0

    def _stepped(self, state: Leaps, block: Block) -> float:
        x, rated = np.zeros(self.gatherer.size), self.gatherer.model.machine.rated_payload
        h, x[h] = self._error(state.doubt)
        better = float(cost(block, x, rated)[h] - cost(block, 0.0, rated)[h])
        return state.votes + min(max(better, -MOST), MOST)

    def _error(self, doubt: SensorDoubt) -> tuple[int, float]:
        """The signal of the gatherer that is off, and by how much [bar on the head side]."""
        signal = self.gatherer.model.machine.signals[doubt.signals[0]]
        cylinder = self.gatherer.model.machine.cylinders[signal.index]
        side = 1.0 if signal.kind is Kind.HEAD_PRESSURE else -cylinder.area_rod / cylinder.area_head
        return self.gatherer.pressed.index(signal.index), side * doubt.size / BAR
