"""Evidence for effects: Bayesian linear regression on Gram matrices of whitened blocks.

What the machine always was - base parameters, loads, and the library's own effects in small doses - is fitted to clean
and faulty recordings together and so projected out (nuisance rejection: Basseville and Nikiforov 1993); an effect is
proposed for the faulty ones alone. Its evidence is tempered by how much the blocks' scores scatter beyond what white
noise would do."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.core.gap.rows import BLOCK
from cylforce.core.gap.whitening import Floor, whitened
from cylforce.words.estimate import Array


class Blocks(NamedTuple):
    """Gram matrices (B, K+1, K+1) of [columns K | left], whitened, of the clean and of the faulty recordings, how many
    rows each block has, `clean_rows`, `faulty_rows` (B,), and the standard errors that each column's size has
    beforehand, `spread` (K,). `shared`: the columns that stand for what the machine always was."""

    clean: Array
    faulty: Array
    clean_rows: Array
    faulty_rows: Array
    spread: Array
    shared: tuple[int, ...]


class Term(NamedTuple):
    """Columns (M,) that the faulty recordings have in excess, each multiplied by its `course` (M, B) block by block."""

    columns: tuple[int, ...]
    course: Array


class Told(NamedTuple):
    """What the data tell of a term: sizes `value` (M,) with `covariance` (M, M), `evidence` [nats] against its absence,
    and `inflation`: the scatter of the blocks' scores, the term taken off, over that of white noise."""

    value: Array
    covariance: Array
    evidence: float
    inflation: float


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


class Evidence:
    """All answers about one set of blocks, each block counted by its `weight` (B,), clean ones first, with the terms
    in `held` taken as present."""

    def __init__(self, blocks: Blocks, held: Sequence[Term] = (), weight: Array | None = None) -> None:
        self.blocks, self.held = blocks, tuple(held)
        self.weight = np.ones(len(blocks.clean) + len(blocks.faulty)) if weight is None else weight
        clean, faulty = np.split(self.weight, [len(blocks.clean)])
        self._both = np.tensordot(clean, blocks.clean, 1) + np.tensordot(faulty, blocks.faulty, 1)
        self._weight, self._alone = faulty, np.tensordot(faulty, blocks.faulty, 1)
        self._base = list(blocks.shared)
        self._spread = np.concatenate([blocks.spread[self._base], *(blocks.spread[list(h.columns)] for h in self.held)])
        known = self._joint(self.held)
        self._root = np.linalg.cholesky(known[:-1, :-1] + np.diag(self._spread**-2.0))
        self.fitted = self._solved(known[:-1, -1])

    def _joint(self, terms: Sequence[Term]) -> Array:
        """The Gram matrix of [base | terms | left]."""
        base, last = self._base, self._both.shape[0] - 1
        columns = [c for term in terms for c in term.columns]
        n, m = len(base), len(columns)
        outer = [*range(n), n + m]
        found = np.empty((n + m + 1, n + m + 1))
        found[np.ix_(outer, outer)] = self._both[np.ix_([*base, last], [*base, last])]
        if m:
            course = np.concatenate([term.course for term in terms])
            across = np.stack([self._across(k, c) for k, c in zip(columns, course, strict=True)])
            within = self._within(columns, course)
            found[n : n + m, outer] = across[:, [*base, last]]
            found[np.ix_(outer, range(n, n + m))] = across[:, [*base, last]].T
            found[n : n + m, n : n + m] = within
        return found

    def _across(self, column: int, course: Array) -> Array:
        """Gram row (K+1,) of a column with its course."""
        if np.all(course == 1.0):
            return np.asarray(self._alone[column])
        on = course != 0.0
        return np.asarray((course[on] * self._weight[on]) @ self.blocks.faulty[on, column, :])

    def _within(self, columns: list[int], course: Array) -> Array:
        """Gram matrix (M, M) of columns with their courses."""
        if np.all(course == 1.0):
            return np.asarray(self._alone[np.ix_(columns, columns)])
        each = self.blocks.faulty[:, columns][:, :, columns]
        return np.asarray(np.einsum("ab,cb,b,bac->ac", course, course, self._weight, each, optimize=True))

    def _solved(self, right: Array) -> Array:
        return np.asarray(np.linalg.solve(self._root.T, np.linalg.solve(self._root, right)))

    def of(self, term: Term, temper: float | None = None) -> Told:
        """The evidence for one more term, tempered by `temper`, by default by its own inflation."""
        joint, m = self._joint([*self.held, term]), len(term.columns)
        old, new = slice(0, len(joint) - 1 - m), slice(len(joint) - 1 - m, len(joint) - 1)
        gain = self._solved(joint[old, new])
        unit = self.blocks.spread[list(term.columns)]
        information = (joint[new, new] - joint[old, new].T @ gain) * np.outer(unit, unit)
        score = (joint[new, -1] - joint[old, new].T @ self.fitted) * unit
        one = np.eye(m)
        inflation = self._inflation(term, gain, np.linalg.solve(information + one, score) * unit, information)
        divide = inflation if temper is None else temper
        precision = information / divide + one
        value = np.linalg.solve(precision, score / divide)
        evidence = 0.5 * float(score @ value) / divide - 0.5 * float(np.linalg.slogdet(precision)[1])
        covariance = np.linalg.inv(information / max(inflation, divide) + one) * np.outer(unit, unit)
        return Told(value * unit, covariance, evidence, inflation)

    def blind(self, column: int, temper: float) -> float:
        """Standard error of a column's size in the faulty recordings, from them alone: infinite where it shows not."""
        joint = self._joint([*self.held, Term((column,), np.ones((1, len(self.blocks.faulty))))])
        gain = self._solved(joint[:-2, -2])
        information = float(joint[-2, -2] - joint[:-2, -2] @ gain) / temper
        return float(information**-0.5) if information > 1e-12 * float(joint[-2, -2]) > 0.0 else float("inf")

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
        clean = np.einsum("bi,bij,bj->b", a, self.blocks.clean, a, optimize=True)
        return clean, np.einsum("bi,bij,bj->b", b, self.blocks.faulty, b, optimize=True)

    def joint_values(self, term: Term, told: Told) -> Array:
        """Values of base, held terms and the term itself, fitted together."""
        joint, m = self._joint([*self.held, term]), len(term.columns)
        old, new = slice(0, len(joint) - 1 - m), slice(len(joint) - 1 - m, len(joint) - 1)
        return np.concatenate([self.fitted - self._solved(joint[old, new]) @ told.value, told.value])

    def _inflation(self, term: Term, gain: Array, value: Array, information: Array) -> float:
        """Scatter of the blocks' scores over that of white noise, with the term itself taken off."""
        terms = [*self.held, term]
        left = self.left(terms, np.concatenate([self.fitted - gain @ value, value]))
        pulled = [
            np.einsum("bij,bj->bi", g, e, optimize=True)
            for g, e in zip((self.blocks.clean, self.blocks.faulty), left, strict=True)
        ]
        unit = self.blocks.spread[list(term.columns)]
        pulls = []
        for m in range(len(term.columns)):
            chosen = np.zeros(len(value))
            chosen[m] = -1.0
            ahead = self.left(terms, np.concatenate([gain[:, m], chosen]))
            each = [np.sum(a[:, :-1] * g[:, :-1], axis=1) for a, g in zip(ahead, pulled, strict=True)]
            pulls.append(np.concatenate(each) * self.weight * unit[m])
        pull = np.array(pulls)
        return max(1.0, float(np.trace(np.linalg.solve(information + np.eye(len(pull)), pull @ pull.T))) / len(pull))
