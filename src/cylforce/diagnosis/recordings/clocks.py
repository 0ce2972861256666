"""Whether pressures and angles are on one clock: asked before any effect is looked for, because all of them are fitted
to forces and motion that are taken to belong together; where they do not, what bends most explains most.

Every pressure sensor may have a clock of its own. Pressures shown at rate t + offset are taken to belong to the motion
at t, for rates and offsets far to either side of one clock, or for an offset from some instant on; at each joint those
of the pressures of its cylinders that fit best, or none. Joints with the same clock are told together. Motion that
repeats itself fits at other lags nearly as well: those are told beside."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import RATE_HZ
from cylforce.diagnosis.numbers import HALF, IN_ORDER, MASS, ODD, UNSAID
from cylforce.diagnosis.recordings.shifted import EDGE_S, Clock, JointRows, pieces
from cylforce.effects.library import LIBRARY
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

OFFSET_S = 2.0  # at a piece's beginning, at most; lags that are nearer to each other are one, badly known
FASTEST = 2.5  # of one clock as the other tells it: beyond the factor of two of two sampling periods
STEP_S = 0.5  # between lags that are tried; then refined
JUMP_S = 5.0  # between instants of a jump that are tried; then refined
REFINED = 10  # rounds
HILLS = 6  # best lags of all that are refined
LEAST = 0.3  # of the rows must have a pressure on a clock: beyond the factor FASTEST of rates
LATE_S = 0.1  # up to which the library's effects, linear in the lag, do as well
ODDS = (1.0 - IN_ORDER - ODD) / len({group[0].about.name for group in LIBRARY})  # of one effect of the library
SURE = float(np.log((1.0 - ODDS) / ODDS / UNSAID))  # nats that make a clock sure enough to be named
OWN = float(np.log(MASS / (1.0 - MASS)))  # nats that make a joint sure to be on that clock


class Slip(NamedTuple):
    """A piece of the recording `name`, `begins` to `ends` [s], in which the pressures of `sensors` are not on the clock
    of the angles: they are `first` [s] late at its beginning, `last` [s] at its end, standard errors `errors` (2,);
    putting that right takes the share `closed` of the energy away that masses and friction leave unexplained at their
    joints. `whole`: whether these are all pressures that move; `others`: lags (first, last) [s] that fit nearly as
    well; the evidence in `nats`."""

    name: str
    begins: float
    ends: float
    first: float
    last: float
    errors: Array
    closed: float
    sensors: tuple[str, ...]
    whole: bool = True
    others: tuple[tuple[float, float], ...] = ()
    nats: float = 0.0

    @property
    def largest(self) -> tuple[float, float]:
        """The larger of the lags [s] and its standard error."""
        return max((self.first, float(self.errors[0])), (self.last, float(self.errors[1])), key=lambda lag: abs(lag[0]))

    @property
    def probability(self) -> float:
        """That it is so, by Bayes' rule."""
        return float(1.0 / (1.0 + np.exp(-self.nats) * (1.0 - ODDS) / ODDS))


There = tuple[JointRows, tuple[int, ...]]  # a joint, and which of its sensors are on a clock
Hill = tuple[Clock, float]  # a clock that fits better than those beside it, and its evidence [nats]


def slips(model: Model, recordings: Sequence[Recorded]) -> list[Slip]:
    """Pieces of recordings some of whose pressures are not on the clock of the angles, the largest lag first."""
    found = ((recorded, *piece) for recorded in recordings for piece in pieces(model, recorded))
    return sorted((slip for piece in found for slip in of_piece(*piece)), key=lambda s: -abs(s.largest[0]))


def of_piece(recorded: Recorded, begins: float, joints: Sequence[JointRows]) -> Iterator[Slip]:
    """The clocks of a piece, the surest first; each joint has one."""
    left = list(joints)
    while left:
        hills = _hills(left)
        chosen = [(joint, *joint.best(hills[0][0])) for joint in left]
        there = [(joint, joint.choices[int(which[0])]) for joint, gain, which in chosen if gain[0] > OWN]
        if not there:
            return
        slip = _slip(recorded.name, begins, there, hills)
        if slip.nats < SURE:
            return
        if max(abs(slip.first), abs(slip.last)) >= LATE_S and slip.closed > HALF:
            known = [joint for joint in joints if np.isfinite(joint.best(hills[0][0])[0][0])]
            yield slip._replace(whole=len(slip.sensors) == sum(len(joint.names) for joint in known))
        left = [joint for joint in left if all(joint is not found for found, _ in there)]


def _slip(name: str, begins: float, there: Sequence[There], hills: Sequence[Hill]) -> Slip:
    """The best hill in words, with the others that may be it."""
    clock, best = hills[0]
    one, other = np.sum([joint.energy(own, clock) for joint, own in there], axis=0).tolist()
    span = EDGE_S, min(there[0][0].ends - EDGE_S, float((there[0][0].ends - clock.offset[0]) / clock.rate[0]))
    lags = np.array([c.lags(*span)[0] for c, _ in hills])
    near = np.max(np.abs(lags - lags[0]), axis=1) <= OFFSET_S
    likely = np.array([height > best - OWN for _, height in hills])
    return Slip(
        name,
        begins + span[0],
        begins + span[1],
        float(lags[0, 0]),
        float(lags[0, 1]),
        _errors(there, hills, span, lags[near], near),
        1.0 - other / one,
        tuple(joint.names[s] for joint, own in there for s in own),
        others=tuple((float(a), float(b)) for a, b in lags[likely & ~near]),
        nats=float(np.sum([joint.gains(own, clock) for joint, own in there])),
    )


def _hills(joints: Sequence[JointRows]) -> list[Hill]:
    """The clocks that fit better than all beside them, refined, with their evidence, the best first."""
    found: list[Hill] = []
    for lattice in _lattices(joints[0].ends):
        shape, clock = lattice.rate.shape, Clock(*(part.ravel() for part in lattice))
        height = _height(joints, clock).reshape(shape)
        around = np.pad(height, 1, constant_values=-np.inf)
        near = [around[1 + i : 1 + i + shape[0], 1 + j : 1 + j + shape[1]] for i in (-1, 0, 1) for j in (-1, 0, 1)]
        tops = np.flatnonzero(height >= np.max(near, axis=0))
        found += [(clock.only(np.array([k])), float(height.flat[k])) for k in tops]
    best = sorted(found, key=lambda hill: -hill[1])[:HILLS]
    return sorted((_refined(joints, hill) for hill, _ in best), key=lambda hill: -hill[1])


def _height(joints: Sequence[JointRows], clock: Clock) -> Array:
    """Evidence (K,) for each clock, that of the joints that are on it; as if all rows had a pressure on it, so that
    clocks compare that have different rows."""
    found = np.sum([np.maximum(joint.best(clock)[0], 0.0) for joint in joints], axis=0)
    share = np.sum([joint.rows(clock) for joint in joints], axis=0) / sum(len(joint.t) for joint in joints)
    return np.asarray(np.where(share > LEAST, found / np.maximum(share, LEAST), 0.0))


def _lattices(ends: float) -> tuple[Clock, Clock]:
    """All clocks that are tried (A, B): rates and offsets, or offsets from an instant on."""
    step = STEP_S / ends
    rates = np.concatenate(
        [np.arange(1.0 - step, 1.0 / FASTEST, -step)[::-1], np.exp(np.arange(0.0, np.log(FASTEST), step))]
    )
    offsets = np.arange(-OFFSET_S, OFFSET_S + STEP_S / 2.0, STEP_S)
    rate, offset = np.meshgrid(rates, offsets)
    since, jump = np.meshgrid(np.arange(JUMP_S, ends, JUMP_S), offsets)
    return Clock(rate, offset, np.zeros_like(rate)), Clock(np.ones_like(since), jump, since)


def _refined(joints: Sequence[JointRows], clock: Clock) -> Hill:
    """The best clock near one, by smaller and smaller steps, and its evidence; the rate turns about the middle of the
    rows, or it is the jump that moves."""
    near, middle = np.array([-1.0, 0.0, 1.0]), float(np.median(joints[0].t / clock.rate))
    jumps, best = bool(clock.since[0] > 0.0), -np.inf
    short, other = STEP_S / 2.0, (JUMP_S if jumps else STEP_S / joints[0].ends) / 2.0
    for _ in range(REFINED):
        turned, moved = (x.ravel() for x in np.meshgrid(other * near, short * near))
        rate = clock.rate + turned * (not jumps)
        offset = np.clip(clock.offset + moved - (rate - clock.rate) * middle, -OFFSET_S, OFFSET_S)
        some = Clock(rate, offset, np.maximum(clock.since + turned * jumps, 0.0))
        height = _height(joints, some)
        k = int(np.argmax(height))
        clock, best = some.only(np.array([k])), float(height[k])
        if k == len(turned) // 2:
            short, other = short / 2.0, other / 2.0
    return clock, best


def _errors(
    there: Sequence[There], hills: Sequence[Hill], span: tuple[float, float], lags: Array, near: NDArray[np.bool_]
) -> Array:
    """Standard errors (2,) [s] of the lags at both ends: by the curvature of the evidence, and by how far the hills
    `near` are from the best of them, with `lags` (H, 2)."""
    clock, (first, last), h = hills[0][0], span, 1.0 / RATE_HZ
    steps = h * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (-1, -1)], dtype=np.float64)
    jumps, turned = clock.since > 0.0, (steps[:, 1] - steps[:, 0]) / (last - first)
    rate = clock.rate + np.where(jumps, 0.0, turned)
    offset = clock.offset + np.where(jumps, steps[:, 1], steps[:, 0] - turned * first)
    f = np.sum([j.gains(own, Clock(rate, offset, np.repeat(clock.since, 7))) for j, own in there], axis=0)
    straight = 2.0 * f[0] - f[[1, 3]] - f[[2, 4]]
    mixed = f[0] - 0.5 * (f[5] + f[6] + np.sum(straight))
    value, vector = np.linalg.eigh(np.array([[straight[0], mixed], [mixed, straight[1]]]) / h**2)
    known = np.diag((vector / np.maximum(value, OFFSET_S**-2)) @ vector.T) * np.where(jumps, [0.0, 1.0], 1.0)
    weights = np.exp(np.array([height for _, height in hills])[near] - hills[0][1])
    return np.asarray(np.sqrt(known + np.average((lags - lags[0]) ** 2, axis=0, weights=weights)))
