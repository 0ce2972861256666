"""Clock faults: pressures and angles that were not recorded on one clock.

They are examined before any effect, because effects are fitted to forces and motion of the same instant. Every
pressure sensor may have a clock of its own. A clock shows the pressures of time t at `rate * t + offset`, or shifts
them by an offset from some instant on. At each joint the pressure sensors count that fit such a clock best, or none.
Joints with the same clock are one fault. Periodic motion fits other lags nearly as well; these are reported as
alternatives.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cylforce.effects.library import LIBRARY
from cylforce.estimation.model import Model
from cylforce.readings.clock_rows import EDGE_S, Clock, JointRows, pieces
from cylforce.readings.constants import CREDIBLE, HALF, HEALTHY, ROWS_HZ, SURE, UNKNOWN_EFFECT
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array
from cylforce.signals.parallel import ParallelMap, sequential_map

LARGEST_OFFSET_S = 2.0  # at the beginning of a piece; lags that are nearer to each other are one, badly known
FASTEST = 2.5  # largest ratio of two clocks: beyond the factor of two of two sampling periods
STEP_S = 0.5  # between lags that are tried; then refined
JUMP_S = 5.0  # between instants of a jump that are tried; then refined
REFINEMENTS = 10  # rounds
MOST_PEAKS = 6  # best clocks of all that are refined
LEAST_ROWS = 0.3  # share of the rows that must have a pressure on a clock: beyond the factor FASTEST
LATE_S = 0.1  # up to which the library's effects, linear in the lag, do as well
PRIOR = (1.0 - HEALTHY - UNKNOWN_EFFECT) / len({group[0].about.name for group in LIBRARY})  # of one effect
NAMED_NATS = float(np.log((1.0 - PRIOR) / PRIOR * SURE / (1.0 - SURE)))  # evidence from which on a clock is named
JOINT_NATS = float(np.log(CREDIBLE / (1.0 - CREDIBLE)))  # evidence that a joint is on that clock


@dataclass(frozen=True)
class ClockSlip:
    """Piece of a recording in which pressures are not on the clock of the angles.

    name:         of the recording
    begins:       beginning of the piece [s]
    ends:         end of the piece [s]
    first:        lag of the pressures at its beginning [s]
    last:         lag of the pressures at its end [s]
    errors:       (2,) standard errors of both lags [s]
    closed:       share of the energy of the residual at their joints that the right clock removes
    sensors:      names of the pressure sensors on that clock
    whole:        whether these are all pressure sensors of joints that move
    alternatives: lags (first, last) [s] that fit nearly as well
    nats:         evidence against one clock
    """

    name: str
    begins: float
    ends: float
    first: float
    last: float
    errors: Array
    closed: float
    sensors: tuple[str, ...]
    whole: bool = True
    alternatives: tuple[tuple[float, float], ...] = ()
    nats: float = 0.0

    @property
    def largest(self) -> tuple[float, float]:
        """Larger of both lags [s] and its standard error."""
        return max((self.first, float(self.errors[0])), (self.last, float(self.errors[1])), key=lambda lag: abs(lag[0]))

    @property
    def probability(self) -> float:
        """Posterior probability of the fault."""
        return float(1.0 / (1.0 + np.exp(-self.nats) * (1.0 - PRIOR) / PRIOR))


JointChoice = tuple[JointRows, tuple[int, ...]]  # a joint, and which of its sensors are on a clock
Peak = tuple[Clock, float]  # a clock that fits better than those beside it, and its evidence [nats]


def clock_faults(model: Model, recordings: Sequence[Recording]) -> list[ClockSlip]:
    """Return the clock faults of recordings, the one with the largest lag first."""
    return clock_faults_of_groups(model, (recordings,))[0]


def clock_faults_of_groups(
    model: Model, groups: Sequence[Sequence[Recording]], parallel_map: ParallelMap = sequential_map
) -> list[list[ClockSlip]]:
    """Return the clock faults of each group of recordings, the one with the largest lag first.

    parallel_map: maps a function, perhaps in parallel
    """
    numbered = [
        (n, (each, *piece)) for n, group in enumerate(groups) for each in group for piece in pieces(model, each)
    ]
    found: list[list[ClockSlip]] = [[] for _ in groups]
    faults = parallel_map(lambda piece: list(faults_of_piece(*piece)), [piece for _, piece in numbered])
    for (n, _), own in zip(numbered, faults, strict=True):
        found[n] += own
    return [sorted(own, key=lambda f: -abs(f.largest[0])) for own in found]


def faults_of_piece(recording: Recording, begins: float, joints: Sequence[JointRows]) -> Iterator[ClockSlip]:
    """Yield the clock faults of a piece, the most probable first; each joint belongs to one."""
    remaining = list(joints)
    while remaining:
        peaks = _peaks(remaining)
        best = [(joint, *joint.best(peaks[0][0])) for joint in remaining]
        shifted = [(joint, joint.choices[int(choice[0])]) for joint, gain, choice in best if gain[0] > JOINT_NATS]
        if not shifted:
            return
        fault = _fault(recording.name, begins, shifted, peaks)
        if fault.nats < NAMED_NATS:
            return
        if max(abs(fault.first), abs(fault.last)) >= LATE_S and fault.closed > HALF:
            moving = [joint for joint in joints if np.isfinite(joint.best(peaks[0][0])[0][0])]
            yield replace(fault, whole=len(fault.sensors) == sum(len(joint.names) for joint in moving))
        remaining = [joint for joint in remaining if all(joint is not other for other, _ in shifted)]


def _fault(name: str, begins: float, shifted: Sequence[JointChoice], peaks: Sequence[Peak]) -> ClockSlip:
    """Return the fault of the best peak, with alternative peaks."""
    clock, best = peaks[0]
    before, after = np.sum([joint.energy(sensors, clock) for joint, sensors in shifted], axis=0).tolist()
    span = EDGE_S, min(shifted[0][0].ends - EDGE_S, float((shifted[0][0].ends - clock.offset[0]) / clock.rate[0]))
    lags = np.array([c.lags(*span)[0] for c, _ in peaks])
    near = np.max(np.abs(lags - lags[0]), axis=1) <= LARGEST_OFFSET_S
    likely = np.array([height > best - JOINT_NATS for _, height in peaks])
    return ClockSlip(
        name,
        begins + span[0],
        begins + span[1],
        float(lags[0, 0]),
        float(lags[0, 1]),
        _errors(shifted, peaks, span, lags[near], near),
        1.0 - after / before,
        tuple(joint.names[s] for joint, sensors in shifted for s in sensors),
        alternatives=tuple((float(a), float(b)) for a, b in lags[likely & ~near]),
        nats=float(np.sum([joint.gains([sensors], clock)[0] for joint, sensors in shifted])),
    )


def _peaks(joints: Sequence[JointRows]) -> list[Peak]:
    """Return the clocks that fit better than all their neighbours, refined, the best first."""
    found: list[Peak] = []
    for lattice in _lattices(joints[0].ends):
        shape, clock = lattice.rate.shape, lattice.flat
        height = _height(joints, clock).reshape(shape)
        around = np.pad(height, 1, constant_values=-np.inf)
        beside = [around[1 + i : 1 + i + shape[0], 1 + j : 1 + j + shape[1]] for i in (-1, 0, 1) for j in (-1, 0, 1)]
        tops = np.flatnonzero(height >= np.max(beside, axis=0))
        found += [(clock.only(np.array([k])), float(height.flat[k])) for k in tops]
    best = sorted(found, key=lambda peak: -peak[1])[:MOST_PEAKS]
    return sorted((_refined(joints, clock) for clock, _ in best), key=lambda peak: -peak[1])


def _height(joints: Sequence[JointRows], clock: Clock) -> Array:
    """Return the evidence (K,) of each clock, summed over the joints that are on it.

    It is scaled as if all rows had a pressure on the clock, so that clocks with different rows compare.
    """
    evidence = np.sum([np.maximum(joint.best(clock)[0], 0.0) for joint in joints], axis=0)
    share = np.sum([joint.rows(clock) for joint in joints], axis=0) / sum(len(joint.t) for joint in joints)
    return np.asarray(np.where(share > LEAST_ROWS, evidence / np.maximum(share, LEAST_ROWS), 0.0))


def _lattices(ends: float) -> tuple[Clock, Clock]:
    """Return the clocks (A, B) that are tried: rates by offsets, and instants of a jump by offsets."""
    step = STEP_S / ends
    rates = np.concatenate(
        [np.arange(1.0 - step, 1.0 / FASTEST, -step)[::-1], np.exp(np.arange(0.0, np.log(FASTEST), step))]
    )
    offsets = np.arange(-LARGEST_OFFSET_S, LARGEST_OFFSET_S + STEP_S / 2.0, STEP_S)
    rate, offset = np.meshgrid(rates, offsets)
    since, jump = np.meshgrid(np.arange(JUMP_S, ends, JUMP_S), offsets)
    return Clock(rate, offset, np.zeros_like(rate)), Clock(np.ones_like(since), jump, since)


def _refined(joints: Sequence[JointRows], clock: Clock) -> Peak:
    """Return the best clock near one, by smaller and smaller steps, and its evidence.

    The rate turns about the median time of the rows; of a jump its instant moves instead.
    """
    steps, middle = np.array([-1.0, 0.0, 1.0]), float(np.median(joints[0].t / clock.rate))
    jumps, best = bool(clock.since[0] > 0.0), -np.inf
    offset_step, other_step = STEP_S / 2.0, (JUMP_S if jumps else STEP_S / joints[0].ends) / 2.0
    for _ in range(REFINEMENTS):
        turned, moved = (x.ravel() for x in np.meshgrid(other_step * steps, offset_step * steps))
        rate = clock.rate + turned * (not jumps)
        offset = clock.offset + moved - (rate - clock.rate) * middle
        offset = np.clip(offset, -LARGEST_OFFSET_S, LARGEST_OFFSET_S)
        tried = Clock(rate, offset, np.maximum(clock.since + turned * jumps, 0.0))
        height = _height(joints, tried)
        k = int(np.argmax(height))
        clock, best = tried.only(np.array([k])), float(height[k])
        if k == len(turned) // 2:
            offset_step, other_step = offset_step / 2.0, other_step / 2.0
    return clock, best


def _errors(
    shifted: Sequence[JointChoice],
    peaks: Sequence[Peak],
    span: tuple[float, float],
    lags: Array,
    near: NDArray[np.bool_],
) -> Array:
    """Return standard errors (2,) [s] of the lags at both ends of a span.

    They add the curvature of the evidence at the best peak and the distance of the near peaks from it.
    lags: (H, 2) lags of the near peaks [s]
    near: True for the peaks that are near
    """
    clock, (first, last), h = peaks[0][0], span, 1.0 / ROWS_HZ
    steps = h * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1)], dtype=np.float64)
    jumps, turned = clock.since > 0.0, (steps[:, 1] - steps[:, 0]) / (last - first)
    rate = clock.rate + np.where(jumps, 0.0, turned)
    offset = clock.offset + np.where(jumps, steps[:, 1], steps[:, 0] - turned * first)
    tried = Clock(rate, offset, np.repeat(clock.since, len(steps)))
    f = np.sum([joint.gains([sensors], tried)[0] for joint, sensors in shifted], axis=0)
    straight = 2.0 * f[0] - f[[1, 3]] - f[[2, 4]]  # second differences along both lags
    mixed = f[0] - 0.5 * (f[5] + f[6] + np.sum(straight))
    value, vector = np.linalg.eigh(np.array([[straight[0], mixed], [mixed, straight[1]]]) / h**2)
    variance = np.diag((vector / np.maximum(value, LARGEST_OFFSET_S**-2)) @ vector.T)
    variance = variance * np.where(jumps, [0.0, 1.0], 1.0)
    weights = np.exp(np.array([height for _, height in peaks])[near] - peaks[0][1])
    return np.asarray(np.sqrt(variance + np.average((lags - lags[0]) ** 2, axis=0, weights=weights)))
