"""What is left of the recordings [N m] by the machine as its references show it: of the field, of the references
themselves, unseen by their own fit, and with the model's parameters refitted to the field. It is the fit of the noise
floor: the model's parameters and one form of every law of friction."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.floor import normal, ridge
from cylforce.diagnosis.columns.problem import Problem, Seen
from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.columns.whitening import ORDER, Floor
from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.numbers import SAME
from cylforce.effects.fault import INCIDENTAL
from cylforce.signals.estimate import Array

FOLDS = 4  # of the clean recordings, each predicted from the others: convention
SPAN = 5  # blocks that are held out, drawn or exchanged together: fifteen seconds
STEADY = ("tip.x.0", "tip.z.0")  # a force at the teeth
Blocks = NDArray[np.bool_]


def residuals(problem: Problem, values: Array) -> list[Array]:
    """What values (K,) of the columns that last leave of the faulty recordings (T, R) [N m], NaN where the whitening
    has no past to predict from: there nothing was fitted."""
    columns = (problem.columns(seen) for seen in problem.faulty)
    return [_judged(c[..., -1] - c[..., : problem.lasting] @ values) for c in columns]


def _judged(left: Array) -> Array:
    lost = ~np.isfinite(left)
    for k in range(1, ORDER + 1):
        lost[k:] |= ~np.isfinite(left[:-k])
    return np.where(lost, np.nan, left)


@dataclass(frozen=True)
class Clean:
    """What the clean recordings tell of the machine: `values` (K,) of the columns that last, residuals (T, R) [N m] of
    them as all are fitted, `seen`, and each stretch predicted from the others, `unseen`, which is what a clean field
    would leave. Nothing, without clean recordings."""

    values: Array
    seen: list[Array]
    unseen: list[Array]


def clean(question: Asking) -> Clean:
    """Least squares of the clean recordings."""
    problem, own = question.problem, list(question.problem.of_the_floor)
    values = np.zeros(problem.lasting)
    if not problem.clean:
        return Clean(values, [], [])
    columns = [problem.columns(seen)[..., [*own, -1]] for seen in problem.clean]
    folds = _folds([len(c) for c in columns])
    parts = [_normal(question, [c[f == k] for c, f in zip(columns, folds, strict=True)]) for k in range(FOLDS)]
    each = [ridge(problem, np.sum(parts, axis=0) - part) for part in (*parts, np.zeros_like(parts[0]))]
    left = [c @ np.append(-each[-1], 1.0) for c in columns]
    unseen = [np.full_like(e, np.nan) for e in left]
    for k in range(FOLDS):
        for e, c, f in zip(unseen, columns, folds, strict=True):
            e[f == k] = c[f == k] @ np.append(-each[k], 1.0)
    values[own] = each[-1]
    return Clean(values, left, unseen)


def _folds(lengths: Sequence[int]) -> list[NDArray[np.int_]]:
    """In which part each row (T,) of recordings of these lengths is: four times each, one after the other."""
    blocks = [-(-length // BLOCK) for length in lengths]
    fold = np.split(np.arange(sum(blocks)) * 4 * FOLDS // sum(blocks) % FOLDS, np.cumsum(blocks)[:-1])
    return [rows_of(f, length) for f, length in zip(fold, lengths, strict=True)]


def _normal(question: Asking, columns: Sequence[Array]) -> Array:
    return np.asarray(np.sum([normal(c, question.floor, range(c.shape[-1] - 1)) for c in columns], axis=0))


def rows_of(blocks: NDArray[np.int_] | Blocks, length: int) -> NDArray[np.int_]:
    """What blocks (B,) have, row by row (T,)."""
    return np.asarray(np.repeat(blocks, BLOCK)[:length])


def chosen(one: list[Array], other: list[Array], problem: Problem, second: Blocks) -> list[Array]:
    """Residuals (T, R) of one kind, or of the other in the blocks (B,) that are `second`."""
    pairs = zip(one, other, problem.spans, strict=True)
    return [np.where(rows_of(second[slice(*span)], len(a))[:, None], b, a) for a, b, span in pairs]


def rms(each: Sequence[Array]) -> Array:
    """Of all residuals together, per row (R,); 0 where nothing is known."""
    whole = np.concatenate(each)
    good = np.isfinite(whole)
    return np.asarray(np.sqrt(np.sum(np.where(good, whole, 0.0) ** 2, axis=0) / np.maximum(np.sum(good, axis=0), 1)))


def without_gap(residual: Array, floor: Array | float) -> Blocks:
    """Return which joints (R,) have no gap: a residual no larger than references leave of each other.

    residual, floor: rms (R,) in the same unit, of the field and of the references
    """
    return np.asarray(residual**2 <= (1.0 + SAME) * floor**2)


def refitted(question: Asking, nominal: Sequence[Array]) -> tuple[list[Array], Array]:
    """Residuals (T, R) [N m] of the faulty recordings with the model's own columns fitted to them, from what is left
    without that, `nominal`, and how far the parameters move (P,) [standard errors of the prior].

    Least squares of the mean square over all joints, the prior around what it was: never more than before."""
    problem = question.problem
    size, known = problem.first, problem.spread[: problem.first]
    rows = np.maximum(np.sum([np.sum(np.isfinite(e), axis=0) for e in nominal], axis=0), 1)
    normal, score = np.diag(known**-2.0) * float(np.mean(question.floor.rms**2)) / float(np.sum(rows)), np.zeros(size)
    columns = [problem.columns(seen)[..., :size] for seen in problem.faulty]
    for x, e in zip(columns, nominal, strict=True):
        for r in range(e.shape[1]):
            good, part = np.isfinite(e[:, r]), 1.0 / (rows[r] * len(rows))
            normal += part * x[good, r].T @ x[good, r]
            score += part * x[good, r].T @ e[good, r]
    values = np.linalg.solve(normal, score)
    count = len(problem.model.parameters)
    return [e - x @ values for x, e in zip(columns, nominal, strict=True)], values[:count] / known[:count]


def counting(question: Asking, left: Sequence[Array]) -> list[Array]:
    """What is left (T, R) of the faulty recordings, NaN in the blocks that do not count."""
    if question.aside is None:
        return list(left)
    each = zip(left, question.problem.spans, strict=True)
    return [np.where(rows_of(question.aside[slice(*span)], len(e))[:, None], np.nan, e) for e, span in each]


def hung(problem: Problem, floor: Floor, left: Sequence[Array]) -> Array:
    """Values (K,) of where the field's loads hang, and how a base that always moved goes, by least squares of what is
    left (T, R) of its recordings, rows weighed by the floor."""
    own, found = problem.of_the_field, np.zeros(problem.lasting)
    normal, score = np.diag(problem.spread[own] ** -2.0), np.zeros(len(own))
    for seen, e in zip(problem.faulty, left, strict=True):
        good = np.isfinite(e)
        part = (problem.columns(seen)[..., own] / floor.rms[:, None])[good]
        normal += part.T @ part
        score += part.T @ (e / floor.rms)[good]
    found[own] = np.linalg.solve(normal, score)
    return found


def added(problem: Problem, columns: Sequence[int], sizes: Array, course: Array) -> list[Array]:
    """Torques (T, R) [N m] of an effect along the faulty recordings: sizes (W, M) of its `columns`, each row of them
    with its `course` (W, B) over the blocks."""
    each = course.T @ sizes  # (B, M)
    pairs = zip(problem.faulty, problem.spans, strict=True)
    return [
        np.einsum(
            "trm,tm->tr", problem.columns(s)[..., list(columns)], np.repeat(each[slice(*b)], BLOCK, 0)[: len(s.rows.t)]
        )
        for s, b in pairs
    ]


def weighed(question: Asking, left: Sequence[Array]) -> float:
    """Error of the weight [kg], rms over the faulty recordings, that residuals (T, R) [N m] make: as much of a load as
    fits each of them."""
    names = ("load.mass", "load.X", "load.Z", "load.J")
    pairs = [pair for pair in zip(question.problem.faulty, left, strict=True) if np.any(np.isfinite(pair[1]))]
    each = [_solved(question, *pair, names)[0] for pair in pairs] or [0.0]
    return float(np.sqrt(np.mean(np.square(each))))


def pushed(question: Asking, left: Sequence[Array]) -> float:
    """Force at the teeth [N] that is not there, rms over blocks: as much of a steady one as fits each of them. (One
    that changes within a block fits noise: thousands of N where joints rest.)"""
    each = [
        _solved(question, seen, e, STEADY, slice(k, k + BLOCK))
        for seen, e in zip(question.problem.faulty, left, strict=True)
        for k in range(0, len(e), BLOCK)
        if np.any(np.isfinite(e[k : k + BLOCK]))
    ] or [np.zeros(len(STEADY))]
    return float(np.sqrt(np.mean(np.sum(np.square(each), axis=1))))


def unforced(question: Asking, left: Sequence[Array], rows: Sequence[NDArray[np.int_]]) -> float:
    """Share (rms) of what is left (T, R) [N m] of the faulty recordings, outside of some `rows` of each, that no force
    at the teeth explains, which may be another one in every row in which all joints are usable. All of it where two
    joints or fewer tell a force, which then explains anything, or none is."""
    columns, floor, energy = [INCIDENTAL.index(name) for name in STEADY], question.floor.rms, np.zeros(2)
    for seen, e, inside in zip(question.problem.faulty, counting(question, left), rows, strict=True):
        good = np.all(np.isfinite(e), axis=1)
        good[inside] = False
        y, x = e[good] / floor, seen.rows.incidental[good][..., columns] / floor[:, None]
        along = np.linalg.svd(x, full_matrices=False)[0]
        beyond = y - np.einsum("trk,tk->tr", along, np.einsum("trk,tr->tk", along, y))
        energy += np.sum(beyond**2), np.sum(y**2)
    told = energy[1] > 0.0 and len(floor) > len(columns)
    return float(np.sqrt(energy[0] / energy[1])) if told else 1.0


def _solved(question: Asking, seen: Seen, left: Array, names: Sequence[str], part: slice = slice(None)) -> Array:
    """Sizes (I,) of incidents' columns by least squares of a residual, rows weighed by the floor."""
    columns, good = [INCIDENTAL.index(name) for name in names], np.isfinite(left[part])
    unit, floor = question.problem.unusual[columns], question.floor.rms
    x = (seen.rows.incidental[part][..., columns] * unit / floor[:, None])[good]
    y = (left[part] / floor)[good]
    return np.asarray(np.linalg.solve(x.T @ x + np.eye(len(unit)), x.T @ y) * unit)
