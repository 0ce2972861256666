"""A machine's recordings, as far as they tell of changes: all that it always has, and what differs from day to day, is
integrated out."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cylforce.signals.estimate import Array


@dataclass(frozen=True)
class History:
    """A machine's n recordings at times `t` (n,) [d]: `information` (n, K, K) and `pull` (n, K) about what it always
    has (the differences of days are in them), of which N(`mean`, `spread`^2) is known beforehand; what changed already:
    courses (n,), each with its directions (K, M) and the
    standard deviations (M,) of its sizes beforehand."""

    t: Array
    information: Array
    pull: Array
    mean: Array
    spread: Array
    courses: tuple[tuple[Array, Array, Array], ...] = ()

    @cached_property
    def size(self) -> int:
        """K."""
        return int(self.pull.shape[1])

    @cached_property
    def _designs(self) -> Array:
        """(n, K, Z): what a recording has of what is common to all, and of the changes that are known."""
        parts = [np.broadcast_to(np.eye(self.size), (len(self.t), self.size, self.size))]
        parts += [course[:, None, None] * directions for course, directions, _ in self.courses]
        return np.concatenate(parts, axis=-1)

    @cached_property
    def _common(self) -> tuple[Array, Array]:
        """Inverse information (Z, Z) and pull (Z,) about those."""
        designs = self._designs
        information = np.sum(np.swapaxes(designs, 1, 2) @ self.information @ designs, axis=0)
        pull = np.einsum("nkz,nk->z", designs, self.pull)
        own = np.concatenate([self.spread, *(spread for *_, spread in self.courses)]) ** -2.0
        pull[: self.size] += own[: self.size] * self.mean
        return np.linalg.inv(information + np.diag(own)), pull

    @property
    def always(self) -> Array:
        """What the machine always had (K,), changes apart."""
        inverse, pull = self._common
        return np.asarray((inverse @ pull)[: self.size])

    def told(self, course: Array) -> tuple[Array, Array]:
        """Information (H, K, K) and pull (H, K) about what follows each `course` (H, n)."""
        inverse, pull = self._common
        weighed = np.swapaxes(self._designs, 1, 2) @ self.information
        with_common = np.tensordot(course, weighed, 1)
        alone = np.tensordot(course**2, self.information, 1)
        own = course @ self.pull
        return (
            alone - np.swapaxes(with_common, 1, 2) @ (inverse @ with_common),
            own - np.einsum("hzl,z->hl", with_common, inverse @ pull),
        )

    def without(self, k: int) -> "History":
        """The same, recording k telling nothing."""
        information, pull = self.information.copy(), self.pull.copy()
        information[k], pull[k] = 0.0, 0.0
        return replace(self, information=information, pull=pull)
