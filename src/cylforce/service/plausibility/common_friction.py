"""Evidence for an error of one signal when all blocks have one friction.

Each block alone may have any everyday friction, and pays for it with its prior. In cold oil friction is far from what
it was at commissioning, but it is the same in all blocks: if each second paid for it anew, a slipped angle, which
explains a part of it, would become evident within half a minute. Here the hypotheses, with the error and without, each
choose one friction for all blocks, and pay for it once. What differs from stroke to stroke each block still chooses
itself."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cylforce.service.plausibility.blocks import CONTACT, LEAST, MOST, Block, cost
from cylforce.signals.estimate import Array

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class OneFriction:
    """Blocks of one window (B), and what their costs are with a friction f (F,) that all of them share.

    blocks: with their `rows`, `masses` and `belief`
    rated:  payload [kg]"""

    blocks: Block
    rated: float

    def better(self, signal: int, size: float, begin: int, harmless: Array, scatter: Array, most: float) -> float:
        """Return twice the log likelihood ratio of an error and of none.

        signal:   number of the signal that is off
        size:     of its error [bar, rad]
        begin:    the block from which on it is off
        harmless: (B,) size up to which an error changes no weight
        scatter:  (B,) variance that each block's torques have beyond that of commissioning
        most:     largest vote of one block"""
        number = len(self.blocks.left)
        wrong = np.where(np.arange(number) >= begin, size, 0.0)
        plain, explained = (cost(self.blocks, x, self.rated)[:, signal] < self._contact for x in (0.0, size))
        after = np.where(wrong != 0.0, explained, plain)
        none = self._best(signal, np.zeros(number), (plain, plain | after))
        error = self._best(signal, wrong, (after, plain | after))
        as_is = np.minimum(none[0], self._cost(none[2], signal, np.clip(wrong, -harmless, harmless)))
        votes = np.clip((as_is - error[0]) / scatter, -most, most)
        return float(votes.sum() + none[1] - error[1])

    @property
    def _contact(self) -> Array:
        """Costs (B,) of blocks that no load explains."""
        return CONTACT * self.blocks.weight[:, 0]

    def _best(self, signal: int, wrong: Array, choices: tuple[Mask, ...]) -> tuple[Array, float, Array]:
        """Return costs (B,), the price of the friction, and the friction (F,) that costs least with errors `wrong` (B,)
        of a signal. Blocks in contact say nothing of friction; which those are is one of the `choices` (B,)."""
        mean, spread = self.blocks.belief[-1]
        found = []
        for used in choices:
            friction = self._fitted(signal, wrong, used)
            price = float((((friction - mean) / spread) ** 2).sum())
            found.append((self._cost(friction, signal, wrong), price, friction))
        return min(found, key=lambda each: float(each[0].sum()) + each[1])

    def _fitted(self, signal: int, wrong: Array, used: Mask) -> Array:
        """Return the friction (F,) that explains the `used` blocks (B,) best, beside errors `wrong` (B,)."""
        (mean, spread), rows = self.blocks.belief[-1], self.blocks.rows[used]
        size = len(mean)
        left = rows[:, :size, -1] - wrong[used, None] * rows[:, :size, size + signal]
        information = rows[:, :size, :size].sum(axis=0) + np.diag(spread**-2)
        return np.linalg.solve(information, left.sum(axis=0) + mean / spread**2)

    def _cost(self, friction: Array, signal: int, wrong: Array) -> Array:
        """Return what blocks leave (B,), at most that of a block in contact; that much for an impossible mass."""
        parts = np.zeros(self.blocks.masses.shape)
        parts[:, : len(friction)], parts[:, -1] = -friction, 1.0
        parts[:, len(friction) + signal] = -wrong
        left = np.einsum("bi,bij,bj->b", parts, self.blocks.rows, parts)
        mass, spread = (parts * self.blocks.masses).sum(axis=1), self.blocks.spread[:, 0]
        hangs = (mass > LEAST * self.rated - 3.0 * spread) & (mass < MOST * self.rated)
        return np.where(hangs, np.minimum(left, self._contact), self._contact)
