"""What simple methods would have named: a diagnosis has to be better than these."""

import numpy as np

from cylforce.diagnosis.closure import SPAN
from cylforce.diagnosis.evidence import Blocks
from cylforce.diagnosis.problem import Problem
from cylforce.diagnosis.verdict import Search
from cylforce.effects.library import Proposal
from cylforce.signals.estimate import Array

SPARSE = 0.1  # of the largest size (in usual sizes): what is smaller is set to zero (STLSQ: Brunton et al. 2016)
ROUNDS = 10


def baselines(search: Search) -> dict[str, Proposal]:
    """The proposal that each simple method puts first: the largest raw correlation with the residual, sparse
    regression, the best prediction held out. None of them where only incidents, or nothing, can be proposed."""
    problem = search.original
    blocks = problem.blocks(search.floor)
    choices = [
        (p, list(places)) for p, places in zip(problem.proposals, problem.places, strict=True) if p.course is None
    ]
    if not choices:
        return {}
    gram = blocks.faulty.sum(axis=0)
    scores = {
        "correlation": [_correlation(gram, places[0]) for _, places in choices],
        "sparse_regression": _sparse(gram, problem, choices),
        "cross_validation": _predicted(blocks, problem.first, choices),
    }
    return {name: choices[int(np.argmax(score))][0] for name, score in scores.items()}


def _correlation(gram: Array, column: int) -> float:
    size = gram[column, column] * gram[-1, -1]
    return float(gram[column, -1] ** 2 / size) if size > 0.0 else 0.0


def _sparse(gram: Array, problem: Problem, choices: list[tuple[Proposal, list[int]]]) -> list[float]:
    """Sizes, in usual ones, by least squares over all effects at once; small ones are struck out again and again."""
    columns = np.array([places[0] for _, places in choices])
    unit = problem.spread[columns]
    scaled = gram[np.ix_(columns, columns)] * np.outer(unit, unit)
    score, kept, sizes = gram[columns, -1] * unit, np.ones(len(columns), dtype=bool), np.zeros(len(columns))
    for _ in range(ROUNDS):
        sizes = np.zeros(len(columns))
        part = scaled[np.ix_(kept, kept)] + 1e-9 * np.eye(int(kept.sum()))
        sizes[kept] = np.linalg.lstsq(part, score[kept], rcond=None)[0]
        kept = np.abs(sizes) > SPARSE * np.max(np.abs(sizes))
    return [float(x) for x in np.abs(sizes)]


def _predicted(blocks: Blocks, first: int, choices: list[tuple[Proposal, list[int]]]) -> list[float]:
    """Squares (negative) that each effect leaves of every other span when it is fitted to the rest, with the base."""
    fold = (np.arange(len(blocks.faulty)) // SPAN) % 2
    grams, found = [blocks.faulty[fold == k].sum(axis=0) for k in (0, 1)], []
    for _, places in choices:
        columns = [*range(first), *places]
        known = np.concatenate([blocks.always[:first], blocks.spread[places]])
        found.append(-sum(_squares(grams[1 - k], grams[k], columns, known) for k in (0, 1)))
    return found


def _squares(fitted: Array, other: Array, columns: list[int], known: Array) -> float:
    """What columns, known to standard errors `known`, leave of one Gram matrix when they are fitted to another."""
    values = np.linalg.solve(fitted[np.ix_(columns, columns)] + np.diag(known**-2.0), fitted[columns, -1])
    left = np.append(-values, 1.0)
    return float(left @ other[np.ix_([*columns, -1], [*columns, -1])] @ left)
