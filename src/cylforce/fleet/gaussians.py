"""Gaussian distributions as information (N, K, K) and pull (N, K): the mean solves information x = pull.

Independent information about one value adds up. Many are computed at once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.estimate import Array
from cylforce.signals.parallel import ParallelMap, sequential_map

AT_ONCE = 32  # distributions whose matrices fit the processor's cache (of 8 to 256 the fastest, by measurement)


class GroupedGaussians(NamedTuple):
    """N Gaussian distributions, each of a value of its own, which belongs to a group.

    information: (N, K, K)
    pull: (N, K)
    group: (N,) number of the group, 0..G-1
    """

    information: Array
    pull: Array
    group: NDArray[np.intp]

    @property
    def groups(self) -> int:
        """Return the number of groups G."""
        return int(self.group.max(initial=-1)) + 1

    def chosen(self, which: NDArray[np.intp]) -> "GroupedGaussians":
        """Return some of the distributions; groups keep their numbers."""
        return GroupedGaussians(self.information[which], self.pull[which], self.group[which])

    def summed(self) -> tuple[Array, Array]:
        """Return information (G, K, K) and pull (G, K) of each group, as if all its members were about one value."""
        sorted_by_group = bool(np.all(np.diff(self.group) >= 0))
        order = slice(None) if sorted_by_group else np.argsort(self.group, kind="stable")
        present, begins = np.unique(self.group[order], return_index=True)
        size, sorted_information, sorted_pull = self.pull.shape[-1], self.information[order], self.pull[order]
        information, pull = np.zeros((self.groups, size, size)), np.zeros((self.groups, size))
        for group, begin, end in zip(present, begins, [*begins[1:], len(self.pull)], strict=True):
            # one sum a group: four times as fast as np.add.reduceat
            sorted_information[begin:end].sum(axis=0, out=information[group])
            sorted_pull[begin:end].sum(axis=0, out=pull[group])
        return information, pull


def pieces(count: int) -> list[slice]:
    """Return slices of at most AT_ONCE distributions."""
    return [slice(begin, begin + AT_ONCE) for begin in range(0, count, AT_ONCE)]


def with_added_variance(
    information: Array, pull: Array, variance: Array, parallel_map: ParallelMap = sequential_map
) -> tuple[Array, Array]:
    """Return information and pull about another value, which differs from the first one by N(0, diag(variance)).

    (S^-1 + V)^-1 = r^-1 (1 - (1 + r S r)^-1) r^-1 with r = sqrt(V), for information S that need not be regular. No
    variance may be 0.

    variance: V (K,)
    parallel_map: maps a function, perhaps in parallel
    """
    r = np.sqrt(variance)
    scale, identity = np.outer(r, r), np.eye(len(r))
    added, added_pull = np.empty_like(information), np.empty_like(pull)

    def add(some: slice) -> None:
        """Set the information and pull of some distributions."""
        inverse = np.linalg.inv(information[some] * scale + identity)
        added[some] = (identity - inverse) / scale
        added_pull[some] = (inverse @ (r * pull[some])[..., None])[..., 0] / r

    parallel_map(add, pieces(len(pull)))
    return added, added_pull


def solved(information: Array, pull: Array) -> tuple[Array, Array]:
    """Return mean (N, K) and covariance (N, K, K)."""
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return np.asarray((covariance @ pull[..., None])[..., 0]), covariance
