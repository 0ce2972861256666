"""How good stated probabilities are. Pure functions of (probability of what is likeliest, whether it was right)."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from .judged import NO_GAP, UNKNOWN, Judged

BINS = 5
LEAST = 1e-3  # a hypothesis that is given less, or none, counts as this much: the logarithm of nothing has no mean


class Stated(NamedTuple):
    """The probability of the likeliest hypothesis, and whether it was right."""

    probability: float
    right: bool


def stated(cases: Iterable[Judged]) -> list[Stated]:
    """Of every case that gives probabilities and is weighed."""
    return [Stated(c.probabilities[c.first], c.first in c.answers) for c in cases if c.first and weighed(c)]


def weighed(case: Judged) -> bool:
    """Machines in order, visible effects, and whatever is named. Not: silence about what is too small to be seen, too
    little motion, and a library from which the answer was taken."""
    if case.kind in ("poor", "without"):
        return False
    return case.kind == "none" or case.visible or case.first not in (NO_GAP, UNKNOWN, None)


def calibration_error(found: Sequence[Stated]) -> float | None:
    """Expected calibration error, in five bins of equal count; cases of one probability share what was right of them,
    so that their order does not count."""
    if len(found) < BINS:
        return None
    ordered = np.array(sorted(found, key=lambda s: s.probability), dtype=np.float64)
    _, same, counts = np.unique(ordered[:, 0], return_inverse=True, return_counts=True)
    right = (np.bincount(same, ordered[:, 1]) / counts)[same]
    return float(sum(abs(np.sum(part)) for part in np.array_split(ordered[:, 0] - right, BINS)) / len(found))


def brier(found: Sequence[Stated]) -> float | None:
    """Mean squared difference between probability and what was."""
    return float(np.mean([(s.probability - s.right) ** 2 for s in found])) if found else None


def brier_skill(found: Sequence[Stated]) -> float | None:
    """1 - Brier score over that of the base rate, which is always the same: 1 is perfect, 0 no better than a constant;
    None where all are right or all wrong."""
    score, rate = brier(found), np.mean([s.right for s in found]) if found else 0.0
    base = float(rate * (1.0 - rate))
    return None if score is None or base == 0.0 else 1.0 - score / base


def log_score(cases: Iterable[Judged]) -> float | None:
    """Mean logarithm of the probability of the right hypotheses together: 0 is perfect."""
    shares = [sum(c.probabilities.get(a, 0.0) for a in c.answers) for c in cases if c.first and weighed(c)]
    return float(np.mean(np.log(np.clip(shares, LEAST, 1.0)))) if shares else None
