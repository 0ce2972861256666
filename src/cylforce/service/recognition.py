"""Is this the machine that was identified? An identified file of another machine of the same type passes every check of
the file. It shows when the machine moves clear of the ground: no load explains then the residual of the parameters.

The residual torque is compared, in blocks of two seconds of motion, with what a load of each block's own, and friction
and pressure zeros that have changed since (the same in all blocks), can explain. Blocks that look like contact start
the comparison anew, so that only motion clear of the ground is judged. Limits: `tools/studies/recognition.py`."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import correlated, load_spread
from cylforce.service.residual import InstantResidual
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array

BLOCK_SECONDS = 2.0
IN_MOTION = 0.6  # share of a block's rows that must be usable and in motion
FRICTION = 0.5  # of its identified value, by which friction may have changed: between cold and warm oil
SHIFT = 5e3  # Pa: standard error of a pressure zero that has changed; 0.3 bar stay below LIMIT with it
CONTACT = 5.0  # mean squared normalised residual of a block alone from which on something else acts on the tool
BLOCKS = 5  # clear of the ground, before anything is concluded
FADE = 0.9  # by which older blocks count less
LIMIT = 3.0  # mean squared normalised residual; machines with their own file stay below 2.4, with warm oil, else 0.9
SURE = 2  # judgements in a row above LIMIT
LOAD = 4  # parameters of a load


class RecognizerConstants(Constants):
    """What the recognition of one machine needs.

    spread: (D,) by which friction and zeros may have changed
    memory: number of consecutive samples that count as one independent sample
    prior:  (4, 4) information on a load before anything is seen
    size:   K, number of columns of a block: load, D changes, residual
    block:  steps of a block
    """

    def __init__(self, model: Model, tares: Tares, kernel: Kernel | None = None) -> None:
        self.kernel = kernel or choice.chosen()
        self.solver = solver(model, tares, self.kernel)
        zeros = [SHIFT * c.area_head for c in model.machine.cylinders]
        self.spread = np.concatenate([FRICTION * np.abs(tares.values[model.changing_friction]), zeros])
        self.memory = correlated(model.filters)
        self.prior = np.diag(load_spread(model.machine) ** -2.0)
        self.size = LOAD + len(self.spread) + 1
        self.block = BLOCK_SECONDS * model.filters.rate_hz

    @property
    def nothing(self) -> Array:
        """The sum of no blocks (K-4, K-4)."""
        return np.zeros((self.size - LOAD, self.size - LOAD))


@dataclass(slots=True)
class Recognizer(Estimator):
    """Comparison of blocks of motion with the identified machine.

    constants: of the machine
    gram:      (K, K) of the running block's rows [load | friction | zeros | residual], flat
    rows:      number of rows of the running block
    steps:     steps of the running block
    sum:       (K-4, K-4) of the blocks before, their loads taken out, faded
    weight:    number of independent samples of these blocks, faded
    blocks:    how many there are
    misfits:   judgements in a row that do not fit
    another:   whether this is another machine
    """

    constants: RecognizerConstants
    gram: Numbers
    rows: int
    steps: int
    sum: Array
    weight: float
    blocks: int
    misfits: int
    another: bool

    @classmethod
    def start(cls, constants: RecognizerConstants) -> Self:
        """Return the state before any sample."""
        return cls(
            constants,
            gram=ZERO * constants.size**2,
            rows=0,
            steps=0,
            sum=constants.nothing,
            weight=0.0,
            blocks=0,
            misfits=0,
            another=False,
        )

    def interrupt(self) -> None:
        """Begin another block: the measurement stopped, or the block has ended."""
        self.gram, self.rows, self.steps = ZERO * self.constants.size**2, 0, 0

    def update(self, residual: InstantResidual, usable: Numbers) -> None:
        """Take one instant; `usable` (R,) 1 where a row can be used."""
        c, instant = self.constants, (residual.rows, residual.numbers, usable)
        self.rows += c.kernel.gather(c.solver, *instant, c.spread, ZERO, 0, c.memory, self.gram)
        self.steps += 1
        if self.steps < c.block:
            return
        if self.rows >= IN_MOTION * self.steps * len(usable):
            self._judge()
        self.interrupt()

    @property
    def misfit(self) -> float:
        """Mean squared normalised residual of the blocks so far: about 0.5 for the machine that was identified."""
        return _residual_squares(self.sum) / self.weight

    def _judge(self) -> None:
        """Judge with the block that has ended."""
        c = self.constants
        gram, weight = np.frombuffer(self.gram).reshape(c.size, -1), self.rows / c.memory
        load = np.linalg.solve(gram[:LOAD, :LOAD] + c.prior, gram[:LOAD, LOAD:])
        block = gram[LOAD:, LOAD:] - gram[LOAD:, :LOAD] @ load
        if _residual_squares(block) > CONTACT * weight:
            self.sum, self.weight, self.blocks, self.misfits = c.nothing, 0.0, 0, 0
            return
        self.sum = FADE * self.sum + block
        self.weight = FADE * self.weight + weight
        self.blocks += 1
        if self.blocks < BLOCKS:
            return
        fits = self.misfit <= LIMIT
        self.misfits = 0 if fits else self.misfits + 1
        self.another = not fits and (self.another or self.misfits >= SURE)


def _residual_squares(block: Array) -> float:
    """Return the least squares of the residual, with friction and zeros that may have changed by one of their
    spreads."""
    size = len(block) - 1
    return float(block[-1, -1] - block[-1, :-1] @ np.linalg.solve(block[:-1, :-1] + np.eye(size), block[:-1, -1]))
