"""Where the gap lies, before any effect is thought of: excess energy by joint and regime, tested by exchanging spans of
clean and faulty recordings (permutation), the false-discovery rate under control (Benjamini and Hochberg 1995).

To be exchangeable, clean spans have to be as unseen by the fit of the parameters as the faulty ones, long against what
correlates in them, and to carry the same: only empty ones are exchanged with empty ones, loaded with loaded."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.answer.shrinkage import Gap
from cylforce.diagnosis.columns.problem import Problem, Seen
from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.inference.residuals import SPAN as BLOCKS
from cylforce.diagnosis.inference.residuals import rms
from cylforce.diagnosis.numbers import FALSE, MARGIN
from cylforce.signals.estimate import Array

SLOW, FAST = 0.03, 0.10  # m/s
SPAN = BLOCKS * BLOCK  # rows that are exchanged together: fifteen seconds
ROWS = 20  # of a regime that a span needs
LEAST = 2  # spans, of faulty and of clean recordings
EXCHANGES = 1999
Regime = Callable[[Seen, int, int], NDArray[np.bool_]]  # of a recording: cylinder and joint to the rows (T,) in it


class Spot(NamedTuple):
    """A joint's row in a regime: rms [N m] of the faulty and of the clean recordings there (the latter unseen by their
    fit), its `share` of all excess energy of that joint, `p` that chance alone would make as much more than MARGIN
    times the clean ones' energy, whether it is `found` at the rate FALSE."""

    channel: str
    regime: str
    faulty: float
    clean: float
    share: float
    p: float
    found: bool


REGIMES: dict[str, Regime] = {
    "extending": lambda seen, c, _: seen.rows.speed[:, c] > 0.0,
    "retracting": lambda seen, c, _: seen.rows.speed[:, c] < 0.0,
    "slow": lambda seen, c, _: np.abs(seen.rows.speed[:, c]) < SLOW,
    "fast": lambda seen, c, _: np.abs(seen.rows.speed[:, c]) > FAST,
    "empty": lambda seen, *_: np.full(len(seen.rows.t), seen.recorded.load == 0.0),
    "loaded": lambda seen, *_: np.full(len(seen.rows.t), seen.recorded.load > 0.0),
    "first half": lambda seen, *_: seen.rows.t < np.median(seen.rows.t),
    "second half": lambda seen, *_: seen.rows.t >= np.median(seen.rows.t),
    "angle low": lambda seen, _, j: seen.rows.posture[:, j] < np.median(seen.rows.posture[:, j]),
    "angle high": lambda seen, _, j: seen.rows.posture[:, j] >= np.median(seen.rows.posture[:, j]),
}


def where(problem: Problem, size: Gap, rng: np.random.Generator) -> list[Spot]:
    """All joints and regimes, most certain first, then what stands out most."""
    left, unseen, usual = size.nominal, size.clean, size.floor
    spots = []
    for r, j in enumerate(problem.model.machine.rows):
        rows = sum(int(np.sum(np.isfinite(e[:, r]))) for e in left)
        excess = float(rms(left)[r] ** 2 - usual[r] ** 2) * rows
        for name, regime in REGIMES.items():
            clean, faulty = (
                _spans(group, [e[:, r] for e in each], regime, problem.model.acting[r][0], j)
                for group, each in ((problem.clean, unseen), (problem.faulty, left))
            )
            found = _spot((problem.model.machine.links[j].name, name), clean, faulty, excess, rng)
            spots += [found] if found else []
    return sorted(_discoveries(spots), key=lambda s: (s.p, -s.faulty / s.clean))


class _Spans(NamedTuple):
    """Spans of recordings (B,): sum of `squares`, number of `rows`, whether `loaded`."""

    squares: Array
    rows: Array
    loaded: NDArray[np.bool_]


def _spans(group: Sequence[Seen], left: Sequence[Array], regime: Regime, c: int, j: int) -> _Spans:
    """Those that have enough rows in a regime."""
    found = []
    for seen, e in zip(group, left, strict=True):
        here = np.where(regime(seen, c, j), e, np.nan)
        parts = (here[k : k + SPAN] for k in range(0, len(here), SPAN))
        good = (part[np.isfinite(part)] for part in parts)
        found += [(float(np.sum(x**2)), x.size, seen.recorded.load > 0.0) for x in good if x.size >= ROWS]
    squares, rows, loaded = np.array(found, dtype=np.float64).reshape(-1, 3).T
    return _Spans(squares, rows, loaded > 0.0)


def _spot(
    place: tuple[str, str], clean: _Spans, faulty: _Spans, excess: float, rng: np.random.Generator
) -> Spot | None:
    if min(len(clean.rows), len(faulty.rows)) < LEAST:
        return None
    usual, here = (float(x.squares.sum() / x.rows.sum()) for x in (clean, faulty))
    squares, rows, loaded = (np.concatenate(pair) for pair in zip(faulty, clean, strict=True))
    p = chance(np.log(squares / rows + 1e-12), np.arange(len(rows)) < len(faulty.rows), loaded, rng, MARGIN)
    share = (here - usual) * float(faulty.rows.sum()) / excess if excess > 0.0 else 0.0
    return Spot(*place, here**0.5, usual**0.5, float(np.clip(share, 0.0, 1.0)), p, found=False)


def chance(
    values: Array, faulty: NDArray[np.bool_], loaded: NDArray[np.bool_], rng: np.random.Generator, margin: float = 1.0
) -> float:
    """Share of exchanges of faulty and clean spans (B,), loaded ones among themselves, empty ones among themselves, in
    which the faulty ones' mean is as far above the clean ones'; `values` (B,): logarithms of their energies, the faulty
    ones' divided by `margin` before."""
    values = values - np.log(margin) * faulty
    drawn = np.tile(faulty, (EXCHANGES, 1))
    for stratum in (loaded, ~loaded):
        drawn[:, stratum] = rng.permuted(drawn[:, stratum], axis=1)
    real, usual = (d @ values / np.sum(faulty) - ~d @ values / np.sum(~faulty) for d in (faulty, drawn))
    return float((1 + np.sum(usual >= real - 1e-12)) / (1 + EXCHANGES))


def _discoveries(spots: list[Spot]) -> list[Spot]:
    order = sorted(spots, key=lambda s: s.p)
    last = max((k for k, s in enumerate(order, 1) if s.p <= FALSE * k / len(order)), default=0)
    return [s._replace(found=k < last) for k, s in enumerate(order)]
