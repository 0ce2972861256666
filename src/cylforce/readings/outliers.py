"""Outlier references: recordings of the healthy machine that are unlike the others.

They are compared by prediction: the residual of each with the parameters of the others, with the data sheet as prior.
Where a known load hangs is fitted to each recording by itself."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cylforce.estimation.priors.prior import Prior
from cylforce.readings.constants import CLEAR_GAP, LOAD_CENTRE
from cylforce.signals.estimate import Array

FEWEST = 3  # references, of which one can be distinguished from the others
ENOUGH_ROWS = 200  # of a joint, ten seconds, to compare it
LOAD = len(LOAD_CENTRE)
LOAD_PRECISION = np.diag(np.array(LOAD_CENTRE) ** -2.0)


@dataclass(frozen=True)
class References:
    """References as products of their columns.

    prior: of the P parameters
    grams: by name of the recording (R, P + LOAD + 2, P + LOAD + 2): parameters, centre of its load, torque [N m], ones
    """

    prior: Prior
    grams: Mapping[str, Array]

    @classmethod
    def of(cls, prior: Prior, columns: Sequence[tuple[str, Array]]) -> "References":
        """Return the products of columns (T, R, P + LOAD + 1) of stretches, each with the name of its recording.

        The columns are those of the parameters, of where a known load hangs (zero without one), and the torque without
        the load's mass; rows with NaN do not count.
        """
        grams = dict[str, Array]()
        for name, each in columns:
            whole = np.concatenate([each, np.ones((*each.shape[:2], 1))], axis=-1)
            whole = np.where(np.all(np.isfinite(whole), axis=-1, keepdims=True), whole, 0.0)
            gram = np.einsum("tri,trj->rij", whole, whole)
            grams[name] = grams[name] + gram if name in grams else gram
        return cls(prior, grams)

    @property
    def _size(self) -> int:
        return len(self.prior.mean)

    def outliers(self) -> list[str]:
        """Return the names of references that are unlike the others, the worst first."""
        found, remaining = list[str](), self
        while len(remaining.grams) >= FEWEST and (worst := remaining.worst()):
            found.append(worst)
            remaining = remaining.without(worst)
        return found

    def contradiction(self) -> float:
        """Return how many times as large a residual two references leave, fitted together, as each of them by itself.

        It is the largest of all joints; 0 of more or fewer references, and where no joint moves in both.
        """
        grams = list(self.grams.values())
        if len(grams) != FEWEST - 1:
            return 0.0
        both, found = self._fitted(grams), 0.0
        moved = np.min([gram[:, -1, -1] for gram in grams], axis=0) >= ENOUGH_ROWS
        for gram in grams:
            ratio = self._energy(gram, both) / (self._energy(gram, self._fitted([gram])) + 1e-9)
            found = max(found, float(np.sqrt(np.max(ratio, where=moved, initial=0.0))))
        return found

    def without(self, name: str) -> "References":
        """Return the references without one of them."""
        return References(self.prior, {other: gram for other, gram in self.grams.items() if other != name})

    def worst(self) -> str:
        """Return the name of the outlier that the others predict worst; "" if there is none.

        They predict it CLEAR_GAP times as badly as they predict one another without it, and as it is fitted by itself.
        """
        predicted, unlike = self.predicted(), dict[str, float]()
        for name, gram in self.grams.items():
            among = np.array(list(self.without(name).predicted().values()))
            known = np.any(np.isfinite(among), axis=0) & np.isfinite(predicted[name])
            if np.any(known):
                own = self._energy(gram, self._fitted([gram])) / np.maximum(gram[:, -1, -1], 1.0)
                usual = np.fmax(np.nanmax(among[:, known], axis=0), own[known]) + 1e-9
                unlike[name] = float(np.max(predicted[name][known] / usual))
        name = max(unlike, key=lambda n: unlike[n], default="")
        return name if name and unlike[name] > CLEAR_GAP**2 else ""

    def predicted(self) -> dict[str, Array]:
        """Return mean squares (R,) of each recording's residual with the parameters of the others.

        NaN where a joint hardly moves.
        """
        found = {}
        for name, gram in self.grams.items():
            others = list(self.without(name).grams.values())
            rows = np.minimum(gram[:, -1, -1], np.sum(others, axis=0)[:, -1, -1])
            squares = self._energy(gram, self._fitted(others)) / np.maximum(gram[:, -1, -1], 1.0)
            found[name] = np.where(rows < ENOUGH_ROWS, np.nan, squares)
        return found

    def _fitted(self, grams: Sequence[Array]) -> Array:
        """Return the parameters (P,) of recordings, with the data sheet as prior."""
        size, unit = self._size, np.sum(grams, axis=0)
        whole = np.zeros((size + 1, size + 1))
        kept, load = [*range(size), -2], slice(size, size + LOAD)
        for gram in grams:
            each = _weighted(gram, unit)
            across = each[load, :][:, kept]
            centre = np.linalg.solve(each[load, load] + LOAD_PRECISION, across)
            whole += each[np.ix_(kept, kept)] - across.T @ centre
        precision = np.linalg.inv(self.prior.covariance)
        return np.asarray(np.linalg.solve(whole[:-1, :-1] + precision, whole[:-1, -1] + precision @ self.prior.mean))

    def _energy(self, gram: Array, parameters: Array) -> Array:
        """Return the squares (R,) of the residual with parameters (P,), where the load hangs fitted beside."""
        size, each = self._size, _weighted(gram, gram)
        load = slice(size, size + LOAD)
        score = each[load, -2] - each[load, :size] @ parameters
        centre = np.linalg.solve(each[load, load] + LOAD_PRECISION, score)
        coefficients = np.concatenate([-parameters, -centre, [1.0, 0.0]])
        return np.asarray(np.maximum(np.einsum("i,rij,j->r", coefficients, gram, coefficients), 0.0))


def _weighted(gram: Array, unit: Array) -> Array:
    """Return the sum over joints, each in units of a tenth of its torque in `unit`."""
    squares = 0.01 * unit[:, -2, -2] / np.maximum(unit[:, -1, -1], 1.0) + 1.0
    return np.asarray(np.sum(gram / squares[:, None, None], axis=0))
