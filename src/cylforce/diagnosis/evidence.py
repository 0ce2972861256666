"""Sizes of effects that were found, block by block: Bayesian linear regression on Gram matrices of whitened blocks.

What the machine always was - base parameters, loads, and the library's own effects in small doses - is fitted to clean
and faulty recordings together; effects are there in the faulty ones alone. Any blocks can be left out."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from cylforce.diagnosis.rows import BLOCK
from cylforce.diagnosis.whitening import Floor, whitened
from cylforce.signals.estimate import Array

USUAL = 3.0  # times white noise: what a block may leave


@dataclass(frozen=True)
class Blocks:
    """Gram matrices (B, K+1, K+1) of [columns K | left], whitened, of the clean and of the faulty recordings, how many
    rows each block has, `clean_rows`, `faulty_rows` (B,), and the standard errors that each column's size has
    beforehand, `spread` (K,). `shared`: the columns that stand for what the machine always was, with the standard
    errors `always` (K,) of that.

    These are small: columns of sensor errors hold the readings themselves, and a large gain of both chambers beside
    scaled parameters would explain any gap away."""

    clean: Array
    faulty: Array
    clean_rows: Array
    faulty_rows: Array
    spread: Array
    always: Array
    shared: tuple[int, ...]

    @cached_property
    def sums(self) -> tuple[Array, Array]:
        """Gram matrices (K+1, K+1) of all clean and of all faulty blocks together."""
        return np.sum(self.clean, axis=0), np.sum(self.faulty, axis=0)


class Term(NamedTuple):
    """Columns (M,) that the faulty recordings have in excess, each multiplied by its `course` (M, B) block by block."""

    columns: tuple[int, ...]
    course: Array


def grams(columns: Array, floor: Floor) -> tuple[Array, Array]:
    """Gram matrices (B, K, K) of the blocks of columns (T, R, K), and numbers of rows (B,); rows with a NaN do not
    count."""
    found = np.zeros((-(-len(columns) // BLOCK), columns.shape[2], columns.shape[2]))
    rows = np.zeros(len(found))
    for r in range(columns.shape[1]):
        white = whitened(columns[:, r], floor.memory[r]) / floor.white[r]
        good = np.all(np.isfinite(white), axis=1)
        white = np.where(good[:, None], white, 0.0)
        for k in range(len(found)):
            part = slice(k * BLOCK, (k + 1) * BLOCK)
            found[k] += white[part].T @ white[part]
            rows[k] += np.sum(good[part])
    return found, rows


def own_blocks(terms: Sequence[Term]) -> NDArray[np.intp]:
    """The faulty blocks that some term has to itself."""
    courses = [course for term in terms for course in term.course if np.count_nonzero(course) == 1]
    return np.unique(np.flatnonzero(np.any(courses, axis=0))) if courses else np.zeros(0, dtype=np.intp)


def _weighted(grams: Array, total: Array, weight: Array) -> Array:
    """Sum (K, K) of Gram matrices (B, K, K) times `weight` (B,), from their sum `total` where most weights are 1."""
    less = np.flatnonzero(weight != 1.0)
    if 2 * len(less) > len(weight):
        return np.asarray(np.tensordot(weight, grams, 1))
    found = total.copy()
    for k in less.tolist():  # one by one: they are large
        found -= (1.0 - weight[k]) * grams[k]
    return found


def _squares(grams: Array, coefficients: Array) -> Array:
    """Sums of squares (B,) that coefficients (B, K) leave of Gram matrices (B, K, K)."""
    return np.asarray(np.einsum("bi,bij,bj->b", coefficients, grams, coefficients, optimize=True))


def _sorted(columns: Sequence[int]) -> tuple[list[int], dict[int, slice]]:
    """An order in which those that name the same column stand side by side, and where each column then stands."""
    order = sorted(range(len(columns)), key=columns.__getitem__)
    ends = np.cumsum([0, *(len(list(same)) for _, same in groupby(columns[k] for k in order))]).tolist()
    return order, {columns[order[first]]: slice(first, last) for first, last in pairwise(ends)}


class Evidence:
    """All answers about one set of blocks, each block counted by its `weight` (B,), clean ones first, with the terms
    in `held` taken as present. A block that such a term has to itself counts the less the more it leaves there: what
    happens for a moment is never quite of the term's form, and must not bend the fit of all other blocks."""

    def __init__(self, blocks: Blocks, held: Sequence[Term] = (), weight: Array | None = None) -> None:
        self.blocks, self.held = blocks, tuple(held)
        self._base = list(blocks.shared)
        self._spread = np.concatenate([blocks.always[self._base], *(blocks.spread[list(h.columns)] for h in self.held)])
        self._fit(np.ones(len(blocks.clean) + len(blocks.faulty)) if weight is None else weight)
        moments = own_blocks(self.held)
        for _ in range(2 if moments.size else 0):
            each = self.left(self.held, self.fitted)[1]
            left = np.array([each[k] @ blocks.faulty[k] @ each[k] for k in moments.tolist()])
            share, own = self.weight.copy(), len(blocks.clean) + moments
            share[own] *= np.minimum(1.0, USUAL * blocks.faulty_rows[moments] / np.maximum(left, 1e-9))
            self._fit(share)

    def _fit(self, weight: Array) -> None:
        """Weighted sums of the blocks, and the values that fit them."""
        blocks, self.weight = self.blocks, weight
        clean, faulty = np.split(weight, [len(blocks.clean)])
        self._weight, self._alone = faulty, _weighted(blocks.faulty, blocks.sums[1], faulty)
        self._both = _weighted(blocks.clean, blocks.sums[0], clean) + self._alone
        self._columns = [c for h in self.held for c in h.columns]
        self._course = np.concatenate([np.zeros((0, len(blocks.faulty))), *(h.course for h in self.held)])
        self._rows = self._held_across()
        self._root = cho_factor(self._known() + np.diag(self._spread**-2.0))
        self._score = np.concatenate([self._both[self._base, -1], self._rows[:, -1]])
        self.fitted = self._solved(self._score)

    def _held_across(self) -> Array:
        """Gram rows (H, K+1) of the held terms' columns."""
        rows = [self._across(k, c) for k, c in zip(self._columns, self._course, strict=True)]
        return np.array(rows).reshape(-1, self._both.shape[0])

    def _known(self) -> Array:
        """The Gram matrix of [base | held terms]."""
        across = self._rows[:, self._base]
        within = self._within(self._columns, self._course, self._columns, self._course)
        return np.block([[self._both[np.ix_(self._base, self._base)], across.T], [across, within]])

    def _across(self, column: int, course: Array) -> Array:
        """Gram row (K+1,) of a column with its course."""
        if np.all(course == 1.0):
            return np.asarray(self._alone[column])
        on = course != 0.0
        return np.asarray((course[on] * self._weight[on]) @ self.blocks.faulty[on, column, :])

    def _within(self, rows: list[int], course: Array, columns: list[int], other: Array) -> Array:
        """Gram matrix (M, N) of columns with their courses."""
        if np.all(course == 1.0) and np.all(other == 1.0):
            return np.asarray(self._alone[np.ix_(rows, columns)])
        on = np.any(course != 0.0, axis=0) & np.any(other != 0.0, axis=0)
        (own, j), (across, k) = _sorted(rows), _sorted(columns)
        left, right = course[:, on][own], other[:, on][across]
        grams = self._weight[on, None, None] * self.blocks.faulty[np.ix_(on, list(j), list(k))]
        found, sums = np.empty((2, len(rows), len(columns)))
        for a, m in enumerate(j.values()):
            for b, n in enumerate(k.values()):
                sums[m, n] = (left[m] * grams[:, a, b]) @ right[n].T
        found[np.ix_(own, across)] = sums
        return found

    def _solved(self, right: Array) -> Array:
        return np.asarray(cho_solve(self._root, right))

    @cached_property
    def covariance(self) -> Array:
        """Of the fitted values (N+H, N+H)."""
        return self._solved(np.eye(len(self.fitted)))

    def left(self, terms: Sequence[Term], values: Array) -> tuple[Array, Array]:
        """See `coefficients`."""
        return self.coefficients(self.blocks, terms, values)

    @staticmethod
    def coefficients(blocks: Blocks, terms: Sequence[Term], values: Array) -> tuple[Array, Array]:
        """Coefficients of [columns | left] (B, K+1) of clean and of faulty blocks that give what `values` of the shared
        columns and of the terms leave."""
        base, size = list(blocks.shared), len(blocks.spread)
        found = [np.zeros((len(g), size + 1)) for g in (blocks.clean, blocks.faulty)]
        for part in found:
            part[:, base] -= values[: len(base)]
            part[:, -1] = 1.0
        k = len(base)
        for term in terms:
            for column, course in zip(term.columns, term.course, strict=True):
                found[1][:, column] -= values[k] * course
                k += 1
        return found[0], found[1]

    def squares(self, terms: Sequence[Term], values: Array) -> tuple[Array, Array]:
        """Whitened sums of squares of clean and of faulty blocks (B,) that base `values` and terms leave."""
        a, b = self.left(terms, values)
        return _squares(self.blocks.clean, a), _squares(self.blocks.faulty, b)
