"""Is a signal off by a constant? Blocks of motion vote (generalised likelihood ratio).

A block in contact with the ground is explained by no load, whatever signal is suspected: it has no vote. A block in the
air that a load explains only if a signal is off by x votes for that error; one that a load explains as it is votes
against it. Errors that change the weight by less than HARMLESS do not matter: they are left to the slow adaptation. No
block has more than a share of what is needed: several must agree. They must agree on the error whether friction is
another one in each block, or one in all of them (`common_friction`). At rest nothing votes: there the ground may push
as a constant error does."""

from dataclasses import dataclass
from statistics import NormalDist
from typing import ClassVar, Self

import numpy as np

from cylforce.estimation.residual import GOOD_ENOUGH
from cylforce.mechanics.machine import FORCE_KINDS
from cylforce.service.plausibility.blocks import BAR, SLOWEST, Block, cost, no_blocks
from cylforce.service.plausibility.common_friction import OneFriction
from cylforce.service.plausibility.detector import Description, Detector, Features, Interruption, MonitoredMachine
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault
from cylforce.service.snapshot import Constants
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

KEPT = 48  # blocks that vote
# False alarms in an hour of motion, if the residual torque were as it was at commissioning: every second each signal is
# tested once.
FALSE_PER_HOUR = {Level.DOUBTED: 1.0, Level.REJECTED: 0.01}
VOTES = 4  # blocks at least that a rejection takes
# Evidence that a signal is off, from which on nothing is OK: chi-squared, exceeded by 1 %; in order: 6.4
UNSURE = 6.635
HARMLESS = GOOD_ENOUGH  # times the rated payload: an error of the weight with which it may be booked
LARGEST_ANGLE = 0.3  # rad: an angle that is farther off is no slip; chosen
MOVED = SLOWEST  # m in a block, of one second, from which on a cylinder moved one way
LARGEST_BARS = 400.0  # beyond the range of any such sensor


@dataclass(frozen=True, slots=True)
class ConstantOffset:
    """The signal that is most likely off.

    signal:    its number in the blocks
    size:      of its error [bar, rad]
    evidence:  twice the log likelihood ratio, as counted by votes
    unsure:    whether the evidence is so large that nothing is certain any more, be friction another one in each block
    confirmed: whether blocks in which a cylinder extends and blocks in which it retracts are evidence, each by
               themselves, of every cylinder. Friction, which turns round with the motion, is evidence one way
    """

    signal: int
    size: float
    evidence: float
    unsure: bool = False
    confirmed: bool = False


NO_OFFSET = ConstantOffset(0, 0.0, 0.0)


class VoteConstants(Constants):
    """The votes of one machine's blocks.

    blocks:  seconds of motion
    limits:  evidence from which on a signal is suspected or rejected: chi-squared with one degree of freedom
    largest: (H,) size of an error [bar, rad]
    """

    def __init__(self, machine: MonitoredMachine) -> None:
        blocks = self.blocks = machine.blocks
        tests = 3600.0 * blocks.size
        self.limits = {level: NormalDist().inv_cdf(0.5 * rate / tests) ** 2 for level, rate in FALSE_PER_HOUR.items()}
        self.largest = np.repeat([LARGEST_BARS, LARGEST_ANGLE], (len(blocks.pressed), len(blocks.turned)))

    @property
    def most(self) -> float:
        """Largest vote of one block."""
        return self.limits[Level.REJECTED] / VOTES

    def likeliest(self, blocks: Block) -> ConstantOffset:
        """Return the most likely error with its evidence, from blocks (B, ...).

        What every block would choose is tried on all; they are counted from the moment on that is most evidence."""
        rated, most = self.blocks.rated, self.most
        sizes = np.clip(blocks.linear / blocks.square, -self.largest, self.largest)  # (B, H)
        x = sizes[:, None, :]
        harmless = HARMLESS * rated / np.maximum(np.abs(blocks.slope), 1e-9)
        as_is = np.minimum(cost(blocks, 0.0, rated), cost(blocks, np.clip(x, -harmless, harmless), rated))
        # votes (B, B, H) of each block for the size that each block would choose, and their sum (B, H) from the moment
        # on that is most evidence
        votes = np.clip((as_is - cost(blocks, x, rated)) / scatter(blocks), -most, most)
        since = votes[:, ::-1].cumsum(axis=1).max(axis=1)
        unsure = bool(since.max() > UNSURE or since.max() >= most)
        chosen = since.argmax(axis=0)
        evidence = [float(since[k, h]) for h, k in enumerate(chosen.tolist())]
        if blocks.rows.size:
            one, scattered = OneFriction(blocks, rated), scatter(blocks)[:, 0]
            for h, k in enumerate(chosen.tolist()):
                if evidence[h] > UNSURE:
                    size, begin = float(sizes[k, h]), begins(votes[k, :, h])
                    shared = one.evidence(h, size, begin, harmless[:, h], scattered, most)
                    evidence[h] = min(evidence[h], shared)
        signal = int(np.argmax(evidence))
        k = int(chosen[signal])
        confirmed = evidence[signal] > UNSURE and both_ways(blocks, votes[k, :, signal])
        return ConstantOffset(signal, float(sizes[k, signal]), evidence[signal], unsure, confirmed)

    def doubt(self, offset: ConstantOffset) -> SensorDoubt:
        """Return the suspicion of an error."""
        if offset.evidence <= self.limits[Level.DOUBTED]:
            return NOTHING_SUSPECTED
        level = Level.REJECTED if offset.evidence > self.limits[Level.REJECTED] else Level.DOUBTED
        blocks, signals = self.blocks, self.blocks.model.machine.signals
        if offset.signal < len(blocks.pressed):
            cylinder = blocks.pressed[offset.signal]
            own = tuple(k for k, s in enumerate(signals) if s.kind in FORCE_KINDS and s.index == cylinder)
            return SensorDoubt(level, SensorFault.OFFSET, own, BAR * offset.size)
        joint = blocks.turned[offset.signal - len(blocks.pressed)]
        own = tuple(k for k, s in enumerate(signals) if s.kind is Kind.JOINT_ANGLE and s.index == joint)
        return SensorDoubt(level, SensorFault.SLIPPED, own, offset.size, offset.confirmed)


def scatter(blocks: Block) -> Array:
    """Return the mean square of each independent sample of blocks (B, 1), beside the best error of a signal, in units
    of its variance, if that is more than one: such torques are that much less evidence (Birge ratio)."""
    most = (blocks.linear**2 / blocks.square).max(axis=1, keepdims=True)
    return np.asarray(np.maximum((blocks.left - most) / blocks.weight, 1.0))


def begins(votes: Array) -> int:
    """Return the block from which on `votes` (B,) are most evidence for an error."""
    return len(votes) - 1 - int(votes[::-1].cumsum().argmax())


def both_ways(blocks: Block, votes: Array) -> bool:
    """Return whether `votes` (B,) of blocks in which a cylinder extends, and of those in which it retracts, are
    evidence each, of every cylinder."""
    if not blocks.ways.size:
        return False
    own, ways = np.where(np.arange(len(votes)) >= begins(votes), votes, 0.0), blocks.ways
    each = [(own @ (ways * sign > MOVED)).min() for sign in (1.0, -1.0)]
    return bool(min(each) > UNSURE)


@dataclass(slots=True)
class ConstantError(Detector):
    """Signals that are off by a constant.

    constants: of the votes
    blocks:    the last KEPT ones
    offset:    the most likely error
    """

    constants: VoteConstants
    blocks: Block
    offset: ConstantOffset = NO_OFFSET
    doubt: SensorDoubt = NOTHING_SUSPECTED

    DESCRIPTION: ClassVar[Description] = Description(
        faults=(SensorFault.OFFSET, SensorFault.SLIPPED),
        looks_at="the torques of all joints in the air: one load must explain them",
        residual="votes of the last 48 seconds of motion: twice the log likelihood ratio of an error and of none",
        threshold="chi-squared: one suspicion in an hour, one rejection in a hundred hours; four seconds must agree",
        levels="rejected after 4 s or more of motion; an angle is latched if both directions of motion confirm it",
        recovery="when they agree again",
    )

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any block."""
        return cls(machine.constants(VoteConstants), no_blocks(machine.blocks.size))

    @property
    def unsure(self) -> bool:
        """Whether there is some evidence that a signal is off by so much that a weight would be wrong; the force would
        be, too."""
        return self.offset.unsure

    def interrupt(self, why: Interruption) -> None:
        """Drop votes that led to nothing when a signal was frozen meanwhile: that is what they were about."""
        if why.frozen:
            self.blocks, self.offset = no_blocks(self.constants.blocks.size), NO_OFFSET

    def on_sample(self, features: Features) -> None:
        """Let a block vote."""
        if features.blocks.block is not None:
            self.blocks = self.blocks.followed_by(features.blocks.block, KEPT)
            self.offset = self.constants.likeliest(self.blocks)
            self.doubt = self.constants.doubt(self.offset)
