"""Test for another machine than the identified one.

An identified file of another machine of the same type passes every check of the file. It is detected in motion clear of
the ground, in which no load explains the residual torque of its parameters.

The residual torque is explained, in blocks of two seconds of motion, by a load of each block's own, and by changes of
friction and pressure zeros that all blocks share. Blocks that resemble contact start the test anew, so that only motion
clear of the ground counts. Limits: `tools/studies/recognition.py`."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import correlated_samples, load_spread
from cylforce.service.residual import InstantResidual
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array

BLOCK_SECONDS = 2.0
IN_MOTION = 0.6  # share of a block's rows that must be usable and in motion
FRICTION = 0.5  # share of its identified value by which friction may have changed: between cold and warm oil
SHIFT = 5e3  # Pa: standard error of a pressure zero that has changed; 0.3 bar stay below LIMIT with it
CONTACT = 5.0  # mean squared normalised residual of a block alone, above which another force acts on the tool
BLOCKS = 5  # blocks clear of the ground before the first conclusion
FADE = 0.9  # factor on older blocks at each new one
LIMIT = 3.0  # mean squared normalised residual; machines with their own file stay below 2.4, with warm oil, else 0.9
SURE = 2  # results in a row above LIMIT
LOAD = 4  # parameters of a load


class RecognizerConstants(Constants):
    """Constants of the test whether this is the identified machine.

    spread: (D,) standard errors by which frictions [N, N s/m] and zeros [N] may have changed on the same machine
    memory: number of consecutive samples that count as one independent sample
    prior:  (4, 4) prior information on a load m, m x, m z, J
    size:   K, number of columns of a block: load, D changes, residual
    block:  number of steps of a block
    """

    def __init__(self, model: Model, tares: Tares, kernel: Kernel | None = None) -> None:
        """Compute by how much the identified machine may have changed, and the prior spread of a load.

        A friction may have changed by FRICTION of its value, a pressure zero by SHIFT [Pa]. More means another machine.

        model:  of the machine
        tares:  identified parameters of the empty machine, friction among them
        kernel: form of the kernel; None: the compiled one if there is one
        """
        self.kernel = kernel or choice.chosen()
        self.solver = solver(model, tares, self.kernel)
        zeros = [SHIFT * c.area_head for c in model.machine.cylinders]
        self.spread = np.concatenate([FRICTION * np.abs(tares.values[model.changing_friction]), zeros])
        self.memory = correlated_samples(model.filters)
        self.prior = np.diag(load_spread(model.machine) ** -2.0)
        self.size = LOAD + len(self.spread) + 1
        self.block = BLOCK_SECONDS * model.filters.rate_hz

    @property
    def nothing(self) -> Array:
        """Sum (K-4, K-4) of no blocks."""
        return np.zeros((self.size - LOAD, self.size - LOAD))


@dataclass(slots=True)
class Recognizer(Estimator):
    """Test whether the machine in use is the identified one, from blocks of motion clear of the ground.

    constants: of the machine
    gram:      (K, K) products of the running block's rows [load | friction | zeros | residual], in standard errors
               of the residual, flat
    rows:      number of rows of the running block
    steps:     number of steps of the running block
    sum:       (K-4, K-4) sum of the products of earlier blocks, their loads eliminated, faded
    weight:    number of independent samples of these blocks, faded likewise
    blocks:    number of these blocks, not faded
    misfits:   number of results in a row above LIMIT
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
        """Return the state before any sample: no block of motion compared, no sign of another machine.

        The rows of a block have K columns: load (4), changes of friction and zeros (D), residual (1)."""
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
        """Begin another block, because the measurement stopped or the block has ended."""
        self.gram, self.rows, self.steps = ZERO * self.constants.size**2, 0, 0

    def update(self, residual: InstantResidual, usable: Numbers) -> None:
        """Add one instant to the running block of motion; compare the block with the machine after BLOCK_SECONDS.

        A block in which less than the share IN_MOTION of the rows was usable and in motion is discarded.

        residual: measured joint torques [N m] less those of the identified parameters of the empty machine (tares) and
                  of the drift of friction and pressure zeros, with the columns of the tares and the drift
        usable:   (R,) 1 where the row of a measured joint torque can be used, else 0
        """
        c, instant = self.constants, (residual.rows, residual.numbers, usable)
        error_torques, signals = ZERO, 0  # no errors of signals are examined
        self.rows += c.kernel.gather(c.solver, *instant, c.spread, error_torques, signals, c.memory, self.gram)
        self.steps += 1
        if self.steps < c.block:
            return
        if self.rows >= IN_MOTION * self.steps * len(usable):
            self._conclude_block()
        self.interrupt()

    @property
    def mean_square(self) -> float:
        """Mean squared normalised residual of the blocks so far: about 0.5 for the machine that was identified."""
        return _residual_squares(self.sum) / self.weight

    def _conclude_block(self) -> None:
        """Conclude from the block that has ended whether this is another machine than the identified one.

        The block's own load is eliminated. If friction and zeros of its own do not explain its residual, another force
        acts on the tool, and the comparison starts anew; the conclusion so far (`another`) stays. Otherwise the block
        is added to the faded earlier ones. From BLOCKS blocks on, their `mean_square` is a result: it is another
        machine after SURE results in a row above LIMIT, and no longer after one within it."""
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
        fits = self.mean_square <= LIMIT
        self.misfits = 0 if fits else self.misfits + 1
        self.another = not fits and (self.another or self.misfits >= SURE)


def _residual_squares(block: Array) -> float:
    """Return the squared residual of a block that no change of friction and zeros explains.

    block: (K-4, K-4) products of its rows [friction | zeros | residual]; the unit of a change is its prior standard
           error, that of the residual its standard error
    """
    size = len(block) - 1
    return float(block[-1, -1] - block[-1, :-1] @ np.linalg.solve(block[:-1, :-1] + np.eye(size), block[:-1, -1]))
