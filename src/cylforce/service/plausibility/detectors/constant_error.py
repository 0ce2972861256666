"""Detector of signals with a constant error, by votes of blocks of motion (generalised likelihood ratio).

No load explains a block in contact with the ground, whatever signal is suspected: it has no vote. A block in the air
that a load explains only with an error x of a signal votes for that error. A block that a load explains without it
votes against it. Errors that change the weight by less than HARMLESS are left to the slow adaptation. The vote of one
block is limited, so that several must agree. They must agree with two models: friction of its own in each block, and
one friction in all blocks (`common_friction`). Blocks at rest have no vote, because the force of the ground may then
resemble a constant error."""

from dataclasses import dataclass
from statistics import NormalDist
from typing import Self

import numpy as np

from cylforce.estimation.residual import GOOD_ENOUGH
from cylforce.mechanics.machine import FORCE_KINDS
from cylforce.service.plausibility.blocks import BAR, SLOWEST, Block, cost, no_blocks
from cylforce.service.plausibility.common_friction import OneFriction
from cylforce.service.plausibility.detector import Detector, Features, Interruption, MonitoredMachine
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.service.snapshot import Constants
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

KEPT = 48  # blocks that vote
# False alarms in an hour of motion, if the residual torque has the variance of commissioning: each signal is tested
# once a second.
FALSE_PER_HOUR = {Level.SUSPECTED: 1.0, Level.REJECTED: 0.01}
VOTES = 4  # least number of blocks for a rejection
# Evidence of an error of a signal, from which on nothing is OK: chi-squared, exceeded by 1 %; healthy machines: 6.4
UNSURE = 6.635
HARMLESS = GOOD_ENOUGH  # times the rated payload: an error of the weight with which it may be booked
LARGEST_ANGLE = 0.3  # rad: a larger error of an angle is no slip; chosen
MOVED = SLOWEST  # m in a block of one second, from which on a cylinder has moved one way
LARGEST_BARS = 400.0  # beyond the range of any such sensor


@dataclass(frozen=True, slots=True)
class ConstantOffset:
    """Most likely constant error of a signal.

    signal:    number of the signal in the blocks
    size:      of the error, positive where the signal reads too large [bar over the head area, rad]
    evidence:  twice the log likelihood ratio, summed over the votes
    unsure:    whether the evidence is too large for status OK, with friction of its own in each block
    confirmed: whether, of every cylinder, blocks in which it extends and blocks in which it retracts are evidence, each
               by themselves. Friction, which reverses with the motion, is evidence in one direction only
    """

    signal: int
    size: float
    evidence: float
    unsure: bool = False
    confirmed: bool = False


NO_OFFSET = ConstantOffset(0, 0.0, 0.0)


class VoteConstants(Constants):
    """Constants of the votes of one machine's blocks.

    blocks:  constants of the seconds of motion
    limits:  evidence from which on a signal is suspected or rejected: chi-squared with one degree of freedom
    largest: (H,) largest size of an error [bar, rad]
    """

    def __init__(self, machine: MonitoredMachine) -> None:
        """Compute the limits of the evidence from the allowed false alarms per hour, and the largest errors to try.

        The errors are those of cylinder forces [bar over the head area] and joint angles [rad]. Each signal is tested
        once a second.

        machine: constants of the machine, with those of its blocks of motion
        """
        blocks = self.blocks = machine.blocks
        tests = 3600.0 * blocks.size
        self.limits = {level: NormalDist().inv_cdf(0.5 * rate / tests) ** 2 for level, rate in FALSE_PER_HOUR.items()}
        self.largest = np.repeat([LARGEST_BARS, LARGEST_ANGLE], (len(blocks.pressed), len(blocks.turned)))

    @property
    def most(self) -> float:
        """Largest vote of one block."""
        return self.limits[Level.REJECTED] / VOTES

    def likeliest(self, blocks: Block) -> ConstantOffset:
        """Return the most likely constant error of a signal with its evidence, from the last B blocks of motion.

        For each of H signals the best size of each block is tried on all blocks. A block votes for the error by twice
        the log likelihood ratio to an error that does no harm. Votes are summed from the block on that gives the
        largest evidence. Evidence above UNSURE is computed with one friction of all blocks, too; the smaller one
        counts.

        blocks: (B, ...) evidence of each block about the errors [bar of a cylinder's force over its head area, rad]
        """
        rated, most = self.blocks.rated, self.most
        sizes = np.clip(blocks.linear / blocks.square, -self.largest, self.largest)  # (B, H)
        x = sizes[:, None, :]
        harmless = HARMLESS * rated / np.maximum(np.abs(blocks.slope), 1e-9)
        as_is = np.minimum(cost(blocks, 0.0, rated), cost(blocks, np.clip(x, -harmless, harmless), rated))
        # votes (B, B, H) of each block for the best size of each block, and their sums (B, H) from the block on that
        # gives the largest evidence
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

    def suspicion(self, offset: ConstantOffset) -> SensorSuspicion:
        """Return the suspicion of a constant error: its level by the evidence, and the signals of which one is wrong.

        These are the pressures of a cylinder (OFFSET, in Pa), or the angle sensor of a joint (SLIPPED, in rad).

        offset: most likely error, in the units of the blocks [bar, rad]
        """
        if offset.evidence <= self.limits[Level.SUSPECTED]:
            return NOTHING_SUSPECTED
        level = Level.REJECTED if offset.evidence > self.limits[Level.REJECTED] else Level.SUSPECTED
        blocks, signals = self.blocks, self.blocks.model.machine.signals
        if offset.signal < len(blocks.pressed):
            cylinder = blocks.pressed[offset.signal]
            own = tuple(k for k, s in enumerate(signals) if s.kind in FORCE_KINDS and s.index == cylinder)
            return SensorSuspicion(level, SensorFault.OFFSET, own, BAR * offset.size)
        joint = blocks.turned[offset.signal - len(blocks.pressed)]
        own = tuple(k for k, s in enumerate(signals) if s.kind is Kind.JOINT_ANGLE and s.index == joint)
        return SensorSuspicion(level, SensorFault.SLIPPED, own, offset.size, offset.confirmed)


def scatter(blocks: Block) -> Array:
    """Return the factor (B, 1), 1 or more, by which each block is less evidence (Birge ratio, squared).

    It is the mean square of an independent sample that remains with the best error of a signal, in units of its
    variance: above 1 the torques scatter more than at commissioning.

    blocks: (B, ...) with their squared residuals as parabolas in the errors of the signals
    """
    most = (blocks.linear**2 / blocks.square).max(axis=1, keepdims=True)
    return np.asarray(np.maximum((blocks.residual - most) / blocks.weight, 1.0))


def begins(votes: Array) -> int:
    """Return the number of the block from which on, up to the last one, the sum of `votes` (B,) is largest."""
    return len(votes) - 1 - int(votes[::-1].cumsum().argmax())


def both_ways(blocks: Block, votes: Array) -> bool:
    """Return whether both directions of motion of every cylinder are evidence, each by itself.

    For each cylinder, the votes of the blocks in which it extends must sum to more than UNSURE, and those of the blocks
    in which it retracts, too.

    blocks: B blocks, with the motion of the cylinders
    votes:  (B,) votes for the error; those before the block at which the error begins do not count
    """
    if not blocks.ways.size:
        return False
    own, ways = np.where(np.arange(len(votes)) >= begins(votes), votes, 0.0), blocks.ways
    each = [(own @ (ways * sign > MOVED)).min() for sign in (1.0, -1.0)]
    return bool(min(each) > UNSURE)


@dataclass(slots=True)
class ConstantError(Detector):
    """Signals with a constant error.

    constants: of the votes
    blocks:    the last KEPT blocks
    offset:    the most likely error
    report:    present suspicion
    """

    constants: VoteConstants
    blocks: Block
    offset: ConstantOffset = NO_OFFSET
    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any block."""
        return cls(machine.constants(VoteConstants), no_blocks(machine.blocks.size))

    @property
    def unsure(self) -> bool:
        """Return whether there is evidence of an error that makes a weight, and the force, wrong."""
        return self.offset.unsure

    def interrupt(self, why: Interruption) -> None:
        """Discard votes without a suspicion when a signal was frozen, because that signal caused them."""
        if why.frozen:
            self.blocks, self.offset = no_blocks(self.constants.blocks.size), NO_OFFSET

    def on_sample(self, features: Features) -> None:
        """Append a block of motion that ended at this sample; update the most likely constant error and the report."""
        if features.blocks.block is not None:
            self.blocks = self.blocks.followed_by(features.blocks.block, KEPT)
            self.offset = self.constants.likeliest(self.blocks)
            self.report = self.constants.suspicion(self.offset)
