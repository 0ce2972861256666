"""Where the gap lies, before any effect is thought of: excess energy by joint and regime, tested by exchanging blocks
of clean and faulty recordings (permutation), the false-discovery rate under control (Benjamini and Hochberg 1995)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.core.gap.diagnosis import Search
from cylforce.core.gap.problem import Seen
from cylforce.core.gap.residuals import fixed, rms
from cylforce.core.gap.rows import BLOCK
from cylforce.words.estimate import Array

SLOW, FAST = 0.03, 0.10  # m/s
EXCHANGES = 499
FALSE = 0.05  # share of false discoveries
Regime = Callable[[Seen, int], NDArray[np.bool_]]


class Spot(NamedTuple):
    """A joint's row in a regime: rms [N m] of the faulty and of the clean recordings there, its `share` of all excess
    energy of that joint, `p` that chance alone would make as much, whether it is `found` at the rate FALSE."""

    channel: str
    regime: str
    faulty: float
    clean: float
    share: float
    p: float
    found: bool


REGIMES: dict[str, Regime] = {
    "extending": lambda seen, c: seen.rows.speed[:, c] > 0.0,
    "retracting": lambda seen, c: seen.rows.speed[:, c] < 0.0,
    "slow": lambda seen, c: np.abs(seen.rows.speed[:, c]) < SLOW,
    "fast": lambda seen, c: np.abs(seen.rows.speed[:, c]) > FAST,
    "empty": lambda seen, _: np.full(len(seen.rows.t), seen.recorded.load == 0.0),
    "loaded": lambda seen, _: np.full(len(seen.rows.t), seen.recorded.load > 0.0),
    "first half": lambda seen, _: seen.rows.t < np.median(seen.rows.t),
    "second half": lambda seen, _: seen.rows.t >= np.median(seen.rows.t),
    "angle low": lambda seen, c: _angle(seen, c) < np.median(_angle(seen, c)),
    "angle high": lambda seen, c: _angle(seen, c) >= np.median(_angle(seen, c)),
}


def _angle(seen: Seen, c: int) -> Array:
    return np.asarray(seen.rows.posture[:, min(c, seen.rows.posture.shape[1] - 1)])


def where(search: Search, rng: np.random.Generator) -> list[Spot]:
    """All joints and regimes, most certain first."""
    problem = search.original
    clean, faulty = fixed(search)
    spots = []
    for r, j in enumerate(problem.model.machine.rows):
        c = problem.model.acting[r][0]
        excess = float(rms(faulty)[r] ** 2 - search.floor.rms[r] ** 2)
        rows = float(sum(np.sum(np.isfinite(e[:, r])) for e in faulty))
        for name, regime in REGIMES.items():
            there = [
                [np.where(regime(seen, c), e[:, r], np.nan) for seen, e in zip(group, each, strict=True)]
                for group, each in ((problem.clean, clean), (problem.faulty, faulty))
            ]
            found = _spot(problem.model.machine.links[j].name, name, there[0], there[1], excess, rows, rng)
            spots += [found] if found else []
    return sorted(_discoveries(spots), key=lambda s: (s.p, -s.share))


def _spot(
    channel: str,
    regime: str,
    clean: list[Array],
    faulty: list[Array],
    excess: float,
    rows: float,
    rng: np.random.Generator,
) -> Spot | None:
    a, b = (np.concatenate([_blocks(e) for e in each]) if each else np.zeros((0, 2)) for each in (clean, faulty))
    if len(b) < 3 or len(a) < 3:
        return None
    usual, here = (float(x[:, 0].sum() / x[:, 1].sum()) for x in (a, b))
    both = np.log(np.concatenate([b, a])[:, 0] / np.concatenate([b, a])[:, 1] + 1e-12)
    real = both[: len(b)].mean() - both[len(b) :].mean()
    chance = [_exchanged(both, len(b), rng) for _ in range(EXCHANGES)]
    p = (1 + sum(x >= real for x in chance)) / (1 + EXCHANGES)
    share = (here - usual) * float(b[:, 1].sum()) / rows / excess if excess > 0.0 else 0.0
    return Spot(channel, regime, here**0.5, usual**0.5, float(np.clip(share, 0.0, 1.0)), p, found=False)


def _exchanged(values: Array, count: int, rng: np.random.Generator) -> float:
    mixed = rng.permutation(values)
    return float(mixed[:count].sum() / count - mixed[count:].sum() / (len(values) - count))


def _blocks(residual: Array) -> Array:
    """(sum of squares, number) (B, 2) of the blocks that have any."""
    found = []
    for k in range(0, len(residual), BLOCK):
        part = residual[k : k + BLOCK]
        good = part[np.isfinite(part)]
        if good.size > BLOCK // 10:
            found.append((float(np.sum(good**2)), float(good.size)))
    return np.array(found).reshape(-1, 2)


def _discoveries(spots: list[Spot]) -> list[Spot]:
    order = sorted(spots, key=lambda s: s.p)
    last = max((k for k, s in enumerate(order, 1) if s.p <= FALSE * k / len(order)), default=0)
    return [s._replace(found=k < last) for k, s in enumerate(order)]
