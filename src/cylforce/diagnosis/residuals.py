"""What is left of the recordings [N m] with the parameters as they were, and what that does to weights and forces."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.closure import SPAN
from cylforce.diagnosis.evidence import Blocks, Evidence, Term, own_blocks
from cylforce.diagnosis.problem import Problem
from cylforce.diagnosis.rows import BLOCK
from cylforce.diagnosis.verdict import Search
from cylforce.diagnosis.whitening import ORDER
from cylforce.effects.fault import INCIDENTAL, SHAPES
from cylforce.signals.estimate import Array

FOLDS = 4  # of the clean recordings, each predicted from the others


def held_out(problem: Problem, blocks: Blocks, terms: Sequence[Term]) -> list[Array]:
    """Residuals (T, R) [N m] of the faulty recordings that some terms alone leave, each stretch with sizes of them that
    were fitted without it. The parameters stay those of the clean recordings, if there are any: only the terms go. (How
    far the gap shrinks is simulated: `shrinkage`.)"""
    count, clean = len(blocks.faulty), len(blocks.clean)
    fold = (np.arange(count) // SPAN) % 2
    found: list[Array] = []
    for k in (0, 1):
        weight = np.concatenate([np.ones(clean), np.where(fold == k, 0.0, 1.0)])
        part = residuals(problem, blocks, terms, _at_rest(problem, blocks, Evidence(blocks, terms, weight).fitted))
        found = part if not found else chosen(found, part, problem, fold == k)
    moments = np.isin(np.arange(count), own_blocks(terms))
    if np.any(moments):  # what happens for a moment has sizes that no other stretch knows
        values = _at_rest(problem, blocks, Evidence(blocks, terms).fitted)
        found = chosen(found, residuals(problem, blocks, terms, values), problem, moments)
    return found


def _at_rest(problem: Problem, blocks: Blocks, values: Array) -> Array:
    """Values (N+H,) with the machine's own (N,) put back to what the clean recordings tell."""
    if not len(blocks.clean):
        return values
    return np.concatenate([problem.fixed(blocks, values), values[len(blocks.shared) :]])


def fitted_clean(search: Search) -> list[Array]:
    """Residuals (T, R) [N m] of the clean recordings, fitted to them alone."""
    blocks = search.original.blocks(search.floor)
    weight = np.repeat([1.0, 0.0], [len(blocks.clean), len(blocks.faulty)])
    each = Evidence.coefficients(blocks, (), Evidence(blocks, weight=weight).fitted)[0]
    return [search.original.columns(seen) @ each[0] for seen in search.original.clean]


def held_out_clean(search: Search) -> list[Array]:
    """Residuals (T, R) [N m] of the clean recordings, every fourth stretch predicted from the others: what a clean
    field would leave. Empty without clean recordings."""
    problem, blocks = search.original, search.original.blocks(search.floor)
    ends = np.cumsum([0] + [-(-len(seen.rows.t) // BLOCK) for seen in problem.clean]).tolist()
    fold = np.arange(ends[-1]) * 4 * FOLDS // max(ends[-1], 1) % FOLDS
    found: list[Array] = [np.full(seen.rows.left.shape, np.nan) for seen in problem.clean]
    for k in range(FOLDS):
        weight = np.concatenate([np.where(fold == k, 0.0, 1.0), np.zeros(len(blocks.faulty))])
        each = Evidence.coefficients(blocks, (), Evidence(blocks, weight=weight).fitted)[0]
        for n, seen in enumerate(problem.clean):
            here = _rows(fold[ends[n] : ends[n + 1]] == k, len(seen.rows.t))
            found[n][here] = problem.columns(seen)[here] @ each[0]
    return found


def chosen(one: list[Array], other: list[Array], problem: Problem, second: NDArray[np.bool_]) -> list[Array]:
    """Residuals (T, R) of one kind, or of the other in the blocks (B,) that are `second`."""
    return [
        np.where(_rows(second[first:last], len(a))[:, None], b, a)
        for a, b, (first, last) in zip(one, other, problem.spans, strict=True)
    ]


def _rows(per_block: Array | NDArray[np.bool_], length: int) -> Array:
    return np.asarray(np.repeat(per_block, BLOCK, axis=0)[:length])


def residuals(problem: Problem, blocks: Blocks, terms: Sequence[Term], values: Array) -> list[Array]:
    """What values leave of each faulty recording (T, R) [N m]."""
    coefficients = Evidence.coefficients(blocks, terms, values)[1]
    return [
        _judged(np.einsum("trk,tk->tr", problem.columns(seen), _rows(coefficients[first:last], len(seen.rows.t))))
        for seen, (first, last) in zip(problem.faulty, problem.spans, strict=True)
    ]


def _judged(left: Array) -> Array:
    """Residuals (T, R), NaN where the whitening has no past to predict from: there nothing was fitted, and what is free
    at any instant could be anything."""
    lost = ~np.isfinite(left)
    for k in range(1, ORDER + 1):
        lost[k:] |= ~np.isfinite(left[:-k])
    return np.where(lost, np.nan, left)


def fixed(search: Search) -> tuple[list[Array], list[Array]]:
    """Residuals (T, R) [N m] of the clean and of the faulty recordings, nothing fitted to the latter."""
    problem, blocks = search.original, search.original.blocks(search.floor)
    values = problem.fixed(blocks, search.evidence.fitted)
    each = Evidence.coefficients(blocks, (), values)[0]
    clean = [problem.columns(seen) @ each[0] for seen in problem.clean]
    return clean, residuals(problem, blocks, (), values)


def rms(each: Sequence[Array]) -> Array:
    """Of all residuals together, per row (R,); 0 where nothing is known."""
    whole = np.concatenate(each)
    good = np.isfinite(whole)
    return np.asarray(np.sqrt(np.sum(np.where(good, whole, 0.0) ** 2, axis=0) / np.maximum(np.sum(good, axis=0), 1)))


def contributions(search: Search) -> Array:
    """What each cause adds to the torques of the faulty recordings (N, R) [N m, rms], by its columns."""
    problem, terms = search.original, [cause.term for cause in search.causes]
    found: list[list[Array]] = [[] for _ in terms]
    for seen, (first, last) in zip(problem.faulty, problem.spans, strict=True):
        columns = problem.columns(seen)
        for each, cause, term in zip(found, search.causes, terms, strict=True):
            sizes = _rows((cause.sizes[:, None] * term.course[:, first:last]).T, len(columns))
            each.append(np.einsum("trm,tm->tr", columns[..., list(term.columns)], sizes))
    return np.array([rms(each) for each in found]).reshape(len(terms), len(search.floor.rms))


def contributed(search: Search) -> list[float]:
    """The share of each cause in what all of them add to the torques, in units of the floor (squares)."""
    squares = np.sum((contributions(search) / search.floor.rms) ** 2, axis=1)
    return list((squares / max(float(np.sum(squares)), 1e-300)).tolist())


class Ends(NamedTuple):
    """What the gap does to what the product tells: error of the weight [kg], rms over recordings, and force at the
    teeth [N], rms over blocks, that is not there; before and after."""

    payload: tuple[float, float]
    force: tuple[float, float]


def ends(search: Search) -> Ends:
    """Errors of payload and tip force with the parameters as they were, and with the causes taken out."""
    blocks = search.original.blocks(search.floor)
    before = Evidence.coefficients(blocks, (), search.original.fixed(blocks, search.evidence.fitted))[1]
    after = search.evidence.left(search.evidence.held, search.evidence.fitted)[1]
    pairs = ((search.original, blocks, before), (search.problem, search.blocks, after))
    payload = [_weighed(problem, b, left) for problem, b, left in pairs]
    force = [_pushed(problem, b, left) for problem, b, left in pairs]
    return Ends((payload[0], payload[1]), (force[0], force[1]))


def _incident(problem: Problem, *names: str) -> list[int]:
    return [problem.lasting + INCIDENTAL.index(name) for name in names]


def _weighed(problem: Problem, blocks: Blocks, left: Array) -> float:
    columns = _incident(problem, "load.mass", "load.X", "load.Z", "load.J")
    each = [_solved(problem, blocks, left, columns, slice(*span))[0] for span in problem.spans]
    return float(np.sqrt(np.mean(np.square(each))))


def _pushed(problem: Problem, blocks: Blocks, left: Array) -> float:
    columns = _incident(problem, *(f"tip.{axis}.{k}" for k in range(SHAPES) for axis in "xz"))
    each = [_solved(problem, blocks, left, columns, slice(k, k + 1)) for k in range(len(blocks.faulty))]
    return float(np.sqrt(np.mean(np.sum(np.square(each), axis=1))))


def _solved(problem: Problem, blocks: Blocks, left: Array, columns: list[int], part: slice) -> Array:
    gram, unit = blocks.faulty[part], problem.spread[columns]
    score = np.einsum("bij,bj->i", gram[:, columns], left[part]) * unit
    information = gram[:, columns][:, :, columns].sum(axis=0) * np.outer(unit, unit)
    return np.asarray(np.linalg.solve(information + np.eye(len(columns)), score) * unit)
