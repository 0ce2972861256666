"""Is a signal off by a constant? Blocks of motion vote.

A block in contact with the ground is explained by no load, whatever signal is doubted: it has no vote. A block in the
air that a load explains only if a signal is off by x votes for that error; one that a load explains as it is votes
against it. Errors that change the weight by less than HARMLESS do not matter: they are left to the slow adaptation. No
block has more than a share of what is needed: several must agree. They must agree on the error whether friction is
another one in each block, or one in all of them (`common_friction`)."""

from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from cylforce.estimation.residual import GOOD_ENOUGH
from cylforce.service.plausibility.blocks import SLOWEST, Block, Gatherer, cost
from cylforce.service.plausibility.common_friction import OneFriction
from cylforce.service.plausibility.suspicion import Level
from cylforce.signals.estimate import Array
from cylforce.signals.quick import once

KEPT = 48  # blocks that vote
# False alarms in an hour of motion, if the torque left were as it was at commissioning: every second each signal is
# tested once.
FALSE_PER_HOUR = {Level.DOUBTED: 1.0, Level.REJECTED: 0.01}
VOTES = 4  # blocks at least that a rejection takes
# Evidence that a signal is off, from which on nothing is OK: chi-squared, exceeded by 1 %; in order: 6.4
UNSURE = 6.635
HARMLESS = GOOD_ENOUGH  # times the rated payload: an error of the weight with which it may be booked
LARGEST_ANGLE = 0.3  # rad: an angle that is farther off is no slip; chosen
MOVED = SLOWEST  # m in a block, of one second, from which on a cylinder moved one way
LARGEST_BARS = 400.0  # beyond the range of any such sensor


class Offset(NamedTuple):
    """The signal (its number in the gatherer) that is most likely off, by `size` [bar, rad], and the `evidence` for it:
    twice the log likelihood ratio, as counted by votes; whether that is so much that nothing is certain any more, be
    friction another one in each block.

    confirmed: whether blocks in which a cylinder extends and blocks in which it retracts speak for it, each by
               themselves, of every cylinder. Friction, which turns round with the motion, speaks for it one way"""

    signal: int
    size: float
    evidence: float
    unsure: bool = False
    confirmed: bool = False


NO_OFFSET = Offset(0, 0.0, 0.0)


@dataclass(frozen=True)
class Voting:
    """The votes of one machine's blocks."""

    gatherer: Gatherer

    @once
    def limits(self) -> dict[Level, float]:
        """Evidence from which on a signal is doubted or rejected: chi-squared with one degree of freedom."""
        tests = 3600.0 * self.gatherer.size
        return {level: NormalDist().inv_cdf(0.5 * rate / tests) ** 2 for level, rate in FALSE_PER_HOUR.items()}

    @once
    def _largest(self) -> Array:
        pressed, turned = len(self.gatherer.pressed), len(self.gatherer.turned)
        return np.repeat([LARGEST_BARS, LARGEST_ANGLE], (pressed, turned))

    @property
    def _rated(self) -> float:
        return self.gatherer.model.machine.rated_payload

    def begin(self) -> Block:
        """No blocks."""
        return Block(*(np.zeros((0, 1)) for _ in range(4)), *(np.zeros((0, self.gatherer.size)) for _ in range(3)))

    def added(self, blocks: Block, new: Block) -> Block:
        """The last KEPT blocks with a new one."""
        if not len(blocks.left):
            return Block(*(one[None] for one in new))
        return Block(*(np.concatenate([old[1 - KEPT :], one[None]]) for old, one in zip(blocks, new, strict=True)))

    def _scatter(self, blocks: Block) -> Array:
        """What is left of each independent sample of blocks (B, 1), beside the best error of a signal, in units of its
        variance, if that is more than it: such torques say that much less (Birge ratio, as in `unnoticed`)."""
        most = (blocks.linear**2 / blocks.square).max(axis=1, keepdims=True)
        return np.asarray(np.maximum((blocks.left - most) / blocks.weight, 1.0))

    def result(self, blocks: Block) -> Offset:
        """The most likely error with its evidence. What every block would choose is tried on all; they are counted from
        the moment on that speaks most for it."""
        rated = self._rated
        sizes = np.clip(blocks.linear / blocks.square, -self._largest, self._largest)  # (B, H)
        x = sizes[:, None, :]
        harmless = HARMLESS * rated / np.maximum(np.abs(blocks.slope), 1e-9)
        as_is = np.minimum(cost(blocks, 0.0, rated), cost(blocks, np.clip(x, -harmless, harmless), rated))
        most = self.limits[Level.REJECTED] / VOTES
        votes = np.clip((as_is - cost(blocks, x, rated)) / self._scatter(blocks), -most, most)
        since = votes[:, ::-1].cumsum(axis=1).max(axis=1)  # (B, H)
        unsure = bool(since.max() > UNSURE or since.max() >= most)
        signal, k, evidence = self._likeliest(blocks, sizes, votes, since, harmless)
        confirmed = evidence > UNSURE and self._both_ways(blocks, votes[k, :, signal])
        return Offset(signal, float(sizes[k, signal]), evidence, unsure, confirmed)

    def _likeliest(
        self, blocks: Block, sizes: Array, votes: Array, since: Array, harmless: Array
    ) -> tuple[int, int, float]:
        """Return the signal and the block whose size, of `sizes` (B, H), has most evidence, and that evidence.

        votes: (B, B, H) of each block for the size that each block would choose
        since: (B, H) their sum from the moment on that speaks most for it"""
        chosen = since.argmax(axis=0)
        found = [float(since[k, h]) for h, k in enumerate(chosen.tolist())]
        if blocks.rows.size:
            most, one = self.limits[Level.REJECTED] / VOTES, OneFriction(blocks, self._rated)
            scatter = self._scatter(blocks)[:, 0]
            for h, k in enumerate(chosen.tolist()):
                if found[h] > UNSURE:
                    size, begin = float(sizes[k, h]), begins(votes[k, :, h])
                    found[h] = min(found[h], one.better(h, size, begin, harmless[:, h], scatter, most))
        signal = int(np.argmax(found))
        return signal, int(chosen[signal]), found[signal]

    @staticmethod
    def _both_ways(blocks: Block, votes: Array) -> bool:
        """Return whether `votes` (B,) of blocks in which a cylinder extends, and of those in which it retracts, are
        evidence each, of every cylinder."""
        if not blocks.ways.size:
            return False
        own, ways = np.where(np.arange(len(votes)) >= begins(votes), votes, 0.0), blocks.ways
        each = [(own @ (ways * sign > MOVED)).min() for sign in (1.0, -1.0)]
        return bool(min(each) > UNSURE)


def begins(votes: Array) -> int:
    """Return the block from which on `votes` (B,) speak most for an error."""
    return len(votes) - 1 - int(votes[::-1].cumsum().argmax())
