"""Is this the machine that was identified? An identified file of another machine of the same type passes every check of
the file. It shows when the machine moves clear of the ground: no load explains then what the parameters leave.

Torque that is left is compared, in blocks of two seconds of motion, with what a load of each block's own, and friction
and pressure zeros that have changed since (the same in all blocks), can explain. Blocks that look like contact start
the comparison anew, so that only motion clear of the ground is judged. Limits: `tools/studies/recognition.py`."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import correlated, load_spread
from cylforce.service.pipeline import Unexplained
from cylforce.signals.estimate import Array
from cylforce.signals.quick import new, once

BLOCK_SECONDS = 2.0
IN_MOTION = 0.6  # share of a block's rows that must be usable and in motion
FRICTION = 0.5  # of its identified value, by which friction may have changed: between cold and warm oil
SHIFT = 5e3  # Pa: standard error of a pressure zero that has changed; 0.3 bar stay below LIMIT with it
CONTACT = 5.0  # mean squared normalised residual of a block alone from which on something else acts on the tool
BLOCKS = 5  # clear of the ground, before anything is concluded
FADE = 0.9  # by which older blocks count less
LIMIT = 3.0  # mean squared normalised residual; machines with their own file stay below 2.4, with warm oil, else 0.9
SURE = 2  # judgements in a row above LIMIT


class Recognition(NamedTuple):
    """State: `gram` (K, K) of the running block's rows [load | friction | zeros | torque left], its `rows` and `steps`;
    of the blocks before, the load taken out: their `sum` (K-4, K-4), its weight, how many `blocks`; judgements in a row
    that do not fit, and whether this is `another` machine."""

    gram: Numbers
    rows: int
    steps: int
    sum: Array
    weight: float
    blocks: int
    misfits: int
    another: bool


@dataclass(frozen=True)
class Recognizer:
    """The recognition of one machine."""

    model: Model
    tares: Tares
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def _solver(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return solver(self.model, self.tares, self.kernel)

    @once
    def _spread(self) -> Array:
        """What friction and zeros may have changed by."""
        zeros = [SHIFT * c.area_head for c in self.model.machine.cylinders]
        return np.concatenate([FRICTION * np.abs(self.tares.values[self.model.changing_friction]), zeros])

    @once
    def _memory(self) -> float:
        return correlated(self.model.filters)

    @once
    def _prior(self) -> Array:
        """Information (4, 4) on a load before anything is seen."""
        return np.diag(load_spread(self.model.machine) ** -2.0)

    @once
    def _size(self) -> int:
        return 5 + len(self._spread)

    @once
    def _nothing(self) -> Array:
        """A block without a load, empty."""
        return np.zeros((self._size - 4, self._size - 4))

    def begin(self) -> Recognition:
        """Nothing is known yet."""
        return Recognition(ZERO * self._size**2, 0, 0, self._nothing, 0.0, 0, 0, another=False)

    def interrupt(self, state: Recognition) -> Recognition:
        """The measurement stopped: the running block starts anew."""
        return state._replace(gram=ZERO * self._size**2, rows=0, steps=0)

    def step(self, state: Recognition, left: Unexplained, usable: Numbers) -> Recognition:
        """Take one instant in; `usable` (R,) rows."""
        gram = state.gram[:]
        parts = (left.rows, left.kept, usable)
        telling = self.kernel.gather(self._solver, *parts, self._spread, ZERO, 0, self._memory, gram)
        more, steps = gram if telling else state.gram, state.steps + 1
        state = new(Recognition, (more, state.rows + telling, steps) + state[3:])  # noqa: RUF005 - quicker
        if steps < self._block:
            return state
        moved = state.rows >= IN_MOTION * state.steps * len(usable)
        return self.interrupt(self._judged(state) if moved else state)

    @once
    def _block(self) -> float:
        """Steps of a block."""
        return BLOCK_SECONDS * self.model.filters.rate_hz

    def misfit(self, state: Recognition) -> float:
        """Mean squared normalised residual of the blocks so far: about 0.5 for the machine that was identified."""
        return _left(state.sum) / state.weight

    def _judged(self, state: Recognition) -> Recognition:
        """With the block that has ended."""
        gram, weight = np.frombuffer(state.gram).reshape(self._size, -1), state.rows / self._memory
        block = gram[4:, 4:] - gram[4:, :4] @ np.linalg.solve(gram[:4, :4] + self._prior, gram[:4, 4:])
        if _left(block) > CONTACT * weight:
            return state._replace(sum=self._nothing, weight=0.0, blocks=0, misfits=0)
        state = state._replace(
            sum=FADE * state.sum + block, weight=FADE * state.weight + weight, blocks=state.blocks + 1
        )
        if state.blocks < BLOCKS:
            return state
        fits = self.misfit(state) <= LIMIT
        misfits = 0 if fits else state.misfits + 1
        return state._replace(misfits=misfits, another=not fits and (state.another or misfits >= SURE))


def _left(block: Array) -> float:
    """Least squares of what is left, with friction and zeros that may have changed by one of their spreads."""
    size = len(block) - 1
    return float(block[-1, -1] - block[-1, :-1] @ np.linalg.solve(block[:-1, :-1] + np.eye(size), block[:-1, -1]))
