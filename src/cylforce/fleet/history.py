"""A machine's recordings as the evidence of changes: its constant values and the day-to-day differences are integrated
out.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cylforce.signals.estimate import Array


@dataclass(frozen=True)
class History:
    """Recordings of a machine, n of them with K quantities.

    t: (n,) times [d]
    information: (n, K, K) information of each recording about the machine's constant values, day-to-day differences
        included
    pull: (n, K) information times the value that the recording alone would give
    mean: (K,) mean of the constant values before any recording
    spread: (K,) their standard deviation before any recording
    courses: changes found before, each as course (n,), directions (K, M) and prior standard deviations (M,)
    """

    t: Array
    information: Array
    pull: Array
    mean: Array
    spread: Array
    courses: tuple[tuple[Array, Array, Array], ...] = ()

    @cached_property
    def size(self) -> int:
        """Return the number of quantities K."""
        return int(self.pull.shape[1])

    @cached_property
    def _designs(self) -> Array:
        """Return the design (n, K, Z) of each recording: columns of the constant values, then of the earlier found
        changes.
        """
        parts = [np.broadcast_to(np.eye(self.size), (len(self.t), self.size, self.size))]
        parts += [course[:, None, None] * directions for course, directions, _ in self.courses]
        return np.concatenate(parts, axis=-1)

    @cached_property
    def _common(self) -> tuple[Array, Array]:
        """Return the inverse information (Z, Z) and the pull (Z,) about constant values and earlier found changes."""
        designs = self._designs
        information = np.sum(np.swapaxes(designs, 1, 2) @ self.information @ designs, axis=0)
        pull = np.einsum("nkz,nk->z", designs, self.pull)
        prior = np.concatenate([self.spread, *(spread for course, directions, spread in self.courses)]) ** -2.0
        pull[: self.size] += prior[: self.size] * self.mean
        return np.linalg.inv(information + np.diag(prior)), pull

    @property
    def always(self) -> Array:
        """Return the machine's constant values (K,), changes apart."""
        inverse, pull = self._common
        return np.asarray((inverse @ pull)[: self.size])

    def evidence_of(self, course: Array) -> tuple[Array, Array]:
        """Return information (H, K, K) and pull (H, K) about the change that follows each course (H, n)."""
        inverse, pull = self._common
        weighted = np.swapaxes(self._designs, 1, 2) @ self.information
        cross = np.tensordot(course, weighted, 1)
        course_information = np.tensordot(course**2, self.information, 1)
        course_pull = course @ self.pull
        # Schur complement: the constant values and known changes are integrated out
        return (
            course_information - np.swapaxes(cross, 1, 2) @ (inverse @ cross),
            course_pull - np.einsum("hzl,z->hl", cross, inverse @ pull),
        )

    def without(self, k: int) -> "History":
        """Return the history without the information of recording k."""
        information, pull = self.information.copy(), self.pull.copy()
        information[k], pull[k] = 0.0, 0.0
        return replace(self, information=information, pull=pull)
