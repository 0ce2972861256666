"""Gaussian knowledge as information (N, K, K) and pull (N, K): what it finds is the solution of information x = pull.
Knowledge of the same thing adds up; many are computed at once."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.estimate import Array

Beside = Callable[[Callable[[Any], Any], Sequence[Any]], list[Any]]  # does some work for each; may use threads
AT_ONCE = 32  # pieces of knowledge: their matrices fit the processor's cache (of 8 to 256 the fastest, by measurement)


class Belonging(NamedTuple):
    """N pieces of knowledge, each of a thing of its own, which belongs to `group` (N,) 0..G-1."""

    information: Array
    pull: Array
    group: NDArray[np.intp]

    @property
    def groups(self) -> int:
        """G."""
        return int(self.group.max(initial=-1)) + 1

    def chosen(self, which: NDArray[np.intp]) -> "Belonging":
        """Some of them; groups keep their numbers."""
        return Belonging(self.information[which], self.pull[which], self.group[which])

    def summed(self) -> tuple[Array, Array]:
        """All that each group knows, as if its things were one: (G, K, K) and (G, K)."""
        sorted_by_group = bool(np.all(np.diff(self.group) >= 0))
        order = slice(None) if sorted_by_group else np.argsort(self.group, kind="stable")
        present, begins = np.unique(self.group[order], return_index=True)
        size, each = self.pull.shape[-1], (self.information[order], self.pull[order])
        information, pull = np.zeros((self.groups, size, size)), np.zeros((self.groups, size))
        for group, begin, end in zip(present, begins, [*begins[1:], len(self.pull)], strict=True):
            # one sum a group: four times as fast as np.add.reduceat
            each[0][begin:end].sum(axis=0, out=information[group])
            each[1][begin:end].sum(axis=0, out=pull[group])
        return information, pull


def pieces(count: int) -> list[slice]:
    """So many pieces of knowledge, AT_ONCE together."""
    return [slice(begin, begin + AT_ONCE) for begin in range(0, count, AT_ONCE)]


def in_turn(work: Callable[[Any], Any], each: Sequence[Any]) -> list[Any]:
    """`work` of each, one after the other."""
    return [work(one) for one in each]


def loosened(information: Array, pull: Array, variance: Array, beside: Beside = in_turn) -> tuple[Array, Array]:
    """The same knowledge of a thing that differs from the known one by N(0, diag(variance)):
    (S^-1 + V)^-1 = r^-1 (1 - (1 + r S r)^-1) r^-1 with r = sqrt(V), information S that need not be regular. No variance
    may be 0."""
    r = np.sqrt(variance)
    scale, one = np.outer(r, r), np.eye(len(r))
    told, force = np.empty_like(information), np.empty_like(pull)

    def loosen(some: slice) -> None:
        less = np.linalg.inv(information[some] * scale + one)
        told[some] = (one - less) / scale
        force[some] = (less @ (r * pull[some])[..., None])[..., 0] / r

    beside(loosen, pieces(len(pull)))
    return told, force


def solved(information: Array, pull: Array) -> tuple[Array, Array]:
    """Mean (N, K) and covariance (N, K, K)."""
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return np.asarray((covariance @ pull[..., None])[..., 0]), covariance
