"""Evidence for an error of one signal when all blocks have one friction.

Each block by itself may have any friction within the usual spread, at the cost of its prior. In cold oil friction is
far from its value at commissioning, but the same in all blocks. If each block paid the prior's cost, a slipped angle,
which explains a part of the residual, would become evident within half a minute. Here each hypothesis, with the error
and without, has one friction for all blocks, whose prior counts once. Deviations from stroke to stroke are still fitted
in each block."""

from dataclasses import dataclass

import numpy as np

from cylforce.service.plausibility.blocks import CONTACT, LEAST, MOST, Block, cost
from cylforce.service.plausibility.pressure_groups import Mask
from cylforce.signals.estimate import Array


@dataclass(frozen=True, slots=True)
class FrictionFit:
    """One friction of all blocks, fitted beside errors of a signal.

    costs:    (B,) squared residual of each block, in squares of standard errors
    price:    cost of the friction by its prior
    friction: (F,) change since the identification, in standard errors between strokes
    """

    costs: Array
    price: float
    friction: Array

    @property
    def total(self) -> float:
        """Sum of the costs of all blocks and the price."""
        return float(self.costs.sum()) + self.price


@dataclass(frozen=True)
class OneFriction:
    """Blocks of one window (B), and their costs with a friction f (F,) that all of them share.

    blocks: with their `rows`, `masses` and `friction_prior`
    rated:  rated payload [kg]
    """

    blocks: Block
    rated: float

    def evidence(self, signal: int, size: float, begin: int, harmless: Array, scatter: Array, most: float) -> float:
        """Return twice the log likelihood ratio of an error and of none; positive: the error is more likely.

        "None" includes an error up to `harmless`.

        signal:   number of the signal with the error, among the H signals of the blocks: forces of cylinders, then
                  angles of joints (`BlockConstants`)
        size:     of the error, positive if the signal reads too large [bar of a force over the head area, rad]
        begin:    first block with the error
        harmless: (B,) size up to which an error does not matter for a weight [as `size`]
        scatter:  (B,) factor of each block, 1 or more: variance of its residual over that of commissioning (`scatter`)
        most:     largest vote of one block
        """
        number = len(self.blocks.residual)
        errors = np.where(np.arange(number) >= begin, size, 0.0)
        plain, explained = (cost(self.blocks, x, self.rated)[:, signal] < self._contact for x in (0.0, size))
        after = np.where(errors != 0.0, explained, plain)
        none = self._best(signal, np.zeros(number), (plain, plain | after))
        error = self._best(signal, errors, (after, plain | after))
        as_is = np.minimum(none.costs, self._cost(none.friction, signal, np.clip(errors, -harmless, harmless)))
        votes = np.clip((as_is - error.costs) / scatter, -most, most)
        return float(votes.sum() + none.price - error.price)

    @property
    def _contact(self) -> Array:
        """Costs (B,) from which on no load explains a block."""
        return CONTACT * self.blocks.weight[:, 0]

    def _best(self, signal: int, errors: Array, choices: tuple[Mask, ...]) -> FrictionFit:
        """Return the fit of the friction with the least cost, beside errors of a signal.

        Blocks in contact are no evidence about friction, and are not used in its fit. The prior is that of the last
        block.

        signal:  number of the signal
        errors:  (B,) of the signal [bar, rad]
        choices: masks (B,) of the blocks to use, each of which is tried
        """
        mean, spread = self.blocks.friction_prior[-1]
        fits = []
        for used in choices:
            friction = self._fitted(signal, errors, used)
            price = float((((friction - mean) / spread) ** 2).sum())
            fits.append(FrictionFit(self._cost(friction, signal, errors), price, friction))
        return min(fits, key=lambda fit: fit.total)

    def _fitted(self, signal: int, errors: Array, used: Mask) -> Array:
        """Return the friction (F,), in standard errors between strokes, that explains blocks best beside known errors.

        signal: number of the signal with the errors
        errors: (B,) error of that signal in each block [bar, rad]
        used:   (B,) True for the blocks to use
        """
        (mean, spread), rows = self.blocks.friction_prior[-1], self.blocks.rows[used]
        size = len(mean)
        residual = rows[:, :size, -1] - errors[used, None] * rows[:, :size, size + signal]
        information = rows[:, :size, :size].sum(axis=0) + np.diag(spread**-2)
        return np.linalg.solve(information, residual.sum(axis=0) + mean / spread**2)

    def _cost(self, friction: Array, signal: int, errors: Array) -> Array:
        """Return the squared residual (B,) of each block with a given friction and given errors of one signal.

        The unit is the square of a standard error. It is at most that of a block in contact, which an impossible mass
        of the load also has.

        friction: (F,) of all blocks, in standard errors between strokes
        signal:   number of the signal with the errors
        errors:   (B,) error of that signal in each block [bar, rad]
        """
        parts = np.zeros(self.blocks.masses.shape)
        parts[:, : len(friction)], parts[:, -1] = -friction, 1.0
        parts[:, len(friction) + signal] = -errors
        residual = np.einsum("bi,bij,bj->b", parts, self.blocks.rows, parts)
        mass, spread = (parts * self.blocks.masses).sum(axis=1), self.blocks.spread[:, 0]
        hangs = (mass > LEAST * self.rated - 3.0 * spread) & (mass < MOST * self.rated)
        return np.where(hangs, np.minimum(residual, self._contact), self._contact)
