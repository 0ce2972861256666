"""One second of motion as evidence: how well an empty or a hanging load explains it, and how much better it would if a
signal were off by a constant.

The residual torque of the identified machine is compared, as in `service/recognition.py`, with what a load of the
block's own, and everyday changes of friction and pressure zeros, can explain. For each signal one column is added: the
torque per unit of a constant error of it. The rest is then a parabola in the size of that error; its three numbers, and
the load's mass, are all that is kept of a block."""

from dataclasses import dataclass, field, fields
from typing import Self

import numpy as np

from cylforce.estimation.drift import daily_spread, drift_spread, kinds
from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import EXPECTED, Model, Tares
from cylforce.estimation.residual import correlated, load_spread
from cylforce.service.adaptation import DriftFilter
from cylforce.service.pipeline import Instant
from cylforce.service.snapshot import Constants, Estimator
from cylforce.service.weighing import COLD
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

EVERY = 20  # steps between the samples that are used: neighbouring ones contain the same information
SAMPLES = 5  # of a block: one second at 100 Hz
IN_MOTION = 0.6  # share of a block's rows that must be usable and in motion, as in `recognition`
FRICTION = 0.5  # of its identified value, by which friction may have changed while it is not known, as in `recognition`
UNKNOWN = FRICTION / EXPECTED.friction - 1.0  # by how many times it is more than what differs between strokes
BAR = 1e5  # Pa
# m/s of the fastest cylinder, as `pipeline.MOVING`. At rest the ground may push as a constant error does, whatever
# friction is
SLOWEST = 0.005
TILTED = 1e-3  # rad by which an angle is shifted to find its column
LOAD = 4  # parameters of a load
CONTACT = 5.0  # mean squared residual of a block from which on no load explains it, as in `recognition`
LEAST, MOST = -0.05, 2.0  # times the rated payload: mass that can hang in a bucket; below SMALLEST it is empty


def _nothing() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, slots=True)
class Block:
    """Evidence of a block about H signals; of several blocks each array has one axis more, (B, ...).

    With an error of size x of signal h it leaves left - 2 linear_h x + square_h x^2, in squares of standard errors, and
    the load's mass is then mass - slope_h x.

    left:   (1,) squares of the residual without an error
    mass:   (1,) of the load [kg]
    spread: (1,) standard error of the mass [kg]
    weight: (1,) number of independent samples
    linear: (H,) of the parabola
    square: (H,) of the parabola
    slope:  (H,) of the mass [kg per unit of the error]

    Of F frictions that all blocks share (`common_friction`), in standard errors by which strokes differ:
    rows:   (F + H + 1, F + H + 1) products of [friction | errors | residual], the load, the zeros and what differs from
            stroke to stroke taken out
    masses: (F + H + 1,) the load's mass [kg] by each of them
    belief: (2, F) mean and standard error of the friction, as the adaptation knows it
    ways:   (C,) by how much each cylinder moved [m], extending positive
    """

    left: Array
    mass: Array
    spread: Array
    weight: Array
    linear: Array
    square: Array
    slope: Array
    rows: Array = field(default_factory=_nothing)
    masses: Array = field(default_factory=_nothing)
    belief: Array = field(default_factory=_nothing)
    ways: Array = field(default_factory=_nothing)

    def followed_by(self, new: "Block", most: int) -> "Block":
        """Return these blocks and a new one, at most so many of them; this may be no blocks at all."""
        if not len(self.left):
            return Block(**{f.name: getattr(new, f.name)[None] for f in fields(Block)})
        parts = ((f.name, getattr(self, f.name), getattr(new, f.name)) for f in fields(Block))
        return Block(**{name: np.concatenate([old[1 - most :], one[None]]) for name, old, one in parts})

    def explained(self, rated: float) -> bool:
        """Return whether a load explains this block as it is; `rated`: payload [kg]."""
        margin, mass = 3.0 * self.spread.item(), self.mass.item()
        hangs = LEAST * rated - margin < mass < MOST * rated
        return bool(hangs and self.left.item() < CONTACT * self.weight.item())


def no_blocks(signals: int) -> Block:
    """Return no blocks, of so many signals."""
    one, each = np.zeros((0, 1)), np.zeros((0, signals))
    return Block(left=one, mass=one, spread=one, weight=one, linear=each, square=each, slope=each)


def cost(block: Block, x: Array | float, rated: float) -> Array:
    """Return what blocks leave (..., H) if signals are off by `x` (..., H).

    It is at most CONTACT for each independent sample, and that much if the load would have an impossible mass."""
    most, mass = CONTACT * block.weight, block.mass - block.slope * x
    left = block.left - 2.0 * x * block.linear + x**2 * block.square
    hangs = (mass > LEAST * rated - 3.0 * block.spread) & (mass < MOST * rated)
    return np.asarray(np.where(hangs, np.minimum(left, most), most))


class BlockConstants(Constants):
    """What the blocks of one machine need. The H signals are the forces of the cylinders in `pressed` [bar on the head
    side], then the angles of the joints in `turned` [rad].

    model, tares: of the machine
    pressed:      cylinders whose force is measured
    turned:       joints with an angle sensor
    size:         H
    before:       (D,) standard errors of the drift before anything is seen of it
    frictions:    F, how many of the drifts are frictions; the others are zeros
    prior:        (4 + D,) information on load and everyday changes
    memory:       samples that count as an independent one
    """

    def __init__(self, model: Model, tares: Tares, kernel: Kernel | None = None) -> None:
        self.model, self.tares, self.kernel = model, tares, kernel or choice.chosen()
        machine = model.machine
        self.pressed = [c for c, measured in enumerate(machine.forces_measured) if measured]
        encoders = {s.index for s in machine.signals if s.kind is Kind.JOINT_ANGLE}
        self.turned = [j for j in range(machine.size) if j in encoders]
        self.size, self.rows, self.rated = (
            len(self.pressed) + len(self.turned),
            len(machine.rows),
            machine.rated_payload,
        )
        self.before = drift_spread(model, tares.values, EXPECTED)
        self.frictions = len(model.changing_friction)
        self.prior = np.concatenate([load_spread(machine) ** -2.0, np.ones_like(self.before)])
        self.memory = max(1.0, correlated(model.filters, tares.correlation) / EVERY)
        self.daily = daily_spread(model, tares.values)
        self._kinds = kinds(model)
        # force [N] of a bar on the head side of each cylinder of `pressed`
        self._per_bar = numbers(BAR * machine.cylinders[c].area_head for c in self.pressed)
        self._columns = counts(model.zero.start + c for c in self.pressed)  # of these cylinders' forces
        self._joints = counts(self.turned)
        self.solver = solver(model, tares, self.kernel)
        self.plan = making.plan(model, self.kernel.KernelPlan)

    def everyday(self, drift: DriftFilter) -> Array:
        """Return the standard errors (D,) of everyday changes of friction and zeros: those of friction become smaller
        when the adaptation has measured how it is now."""
        found = ZERO * len(self.before)
        self.kernel.everyday(self.solver, drift.covariance, self.before, self.frictions, UNKNOWN, found)
        return np.frombuffer(found)

    def prior_of(self, drift: DriftFilter) -> Array:
        """Return the information (4 + D,) on load and changes where friction and zeros of this machine, as its returns
        show (cold oil), spread more than every day's."""
        own = self.daily * np.sqrt(drift.scale)[self._kinds]
        wider = np.maximum(own / self.everyday(drift), 1.0)
        return np.asarray(self.prior / np.concatenate([np.ones(LOAD), wider**2]))

    def errors(self, instant: Instant, channels: Numbers, load: Array) -> Array:
        """Return the torque (R, H) [N m] by a unit of each error, at `channels` (D,).

        That of a reading of an angle too large by one radian is what it adds to the rest of the gravity of tares and
        `load` (4,): g Re((X + i Z) exp(i q)) of each link, and the levers, change."""
        found = ZERO * (self.rows * self.size)
        room = (ZERO * len(self.tares.values), ZERO * (self.rows * len(self.turned)))
        of = (self._columns, len(self.pressed), self._per_bar, self._joints, len(self.turned), TILTED)
        self.kernel.mislead(self.plan, self.solver, instant.numbers, channels, load, *of, *room, found)
        return np.frombuffer(found).reshape(self.rows, -1)

    def turned_force(self, channels: Numbers, force: complex) -> Array:
        """Return the torque (R, H) [N m] that a unit of each error seems to take from a `force` x + i z [N] at the
        tool, at `channels` (D,): an angle that is read too large turns all that is beyond its joint."""
        found = ZERO * (self.rows * self.size)
        angles = (self._joints, len(self.turned), len(self.pressed))
        self.kernel.turn_force(self.plan, channels, force.real, force.imag, *angles, found)
        return np.frombuffer(found).reshape(self.rows, self.size)

    def without_zeros(self, rows: Array, drift: DriftFilter) -> Array:
        """Return rows (K, K) of a block with the drift of the zeros taken from the residual, as it is taken from the
        weight."""
        first, own = LOAD + self.frictions, slice(self.frictions, None)
        change = np.eye(len(rows))
        change[first : LOAD + len(self.before), -1] = -self.tares.scale * drift.values[own] / self.before[own]
        return np.asarray(change.T @ rows @ change)


@dataclass(slots=True)
class BlockGatherer(Estimator):
    """Samples of motion, gathered into blocks.

    constants: of the machine
    load:      (4,) of the block before; zero in contact
    gram:      (K, K) of the running block's rows [load | everyday changes | errors | residual], flat
    last:      (K, K) of the block before
    errors:    (R, H) torque by a unit of each error at the last sample [N m]
    rows:      number of rows of the running block
    samples:   number of samples of the running block
    ways:      (C,) that the cylinders moved in the running block [m]
    block:     the block that ended with the last sample; None: none did, or the machine hardly moved
    """

    constants: BlockConstants
    load: Array
    gram: Numbers
    last: Array
    errors: Array
    rows: int
    samples: int
    ways: Array
    block: Block | None

    @classmethod
    def start(cls, constants: BlockConstants) -> Self:
        """Return an empty block."""
        size = len(constants.prior) + constants.size + 1
        return cls(
            constants,
            load=np.zeros(LOAD),
            gram=ZERO * size**2,
            last=np.zeros((size, size)),
            errors=np.zeros((constants.rows, constants.size)),
            rows=0,
            samples=0,
            ways=np.zeros(len(constants.model.machine.cylinders)),
            block=None,
        )

    @property
    def ended(self) -> bool:
        """Whether a block has ended with the last sample."""
        return self.samples == 0

    @property
    def products(self) -> Array:
        """Products (K, K) of the running block's rows."""
        return np.frombuffer(self.gram).reshape(self.last.shape)

    @property
    def explained(self) -> bool | None:
        """Whether a load explains the block that has just ended; None: there is none."""
        return None if self.block is None else self.block.explained(self.constants.rated)

    def interrupt(self) -> None:
        """Begin the running block anew: the measurement stopped."""
        self.last = np.zeros_like(self.last)
        self._begin()

    def _begin(self) -> None:
        self.gram, self.rows, self.samples = ZERO * len(self.gram), 0, 0
        self.ways = np.zeros_like(self.ways)

    def update(self, instant: Instant, channels: Numbers, drift: DriftFilter) -> None:
        """Take one sample; with the last one of a block this is concluded, unless the machine hardly moved.

        Of the drift only friction is believed: a zero that drifts may be a fault.

        channels: (D,) about which the slow rows are
        """
        c, self.block = self.constants, None
        self.errors = c.errors(instant, channels, self.load)
        if max(map(abs, instant.speed)) > SLOWEST:
            self.rows += self._take_rows(instant, drift)
        self.ways = self.ways + np.frombuffer(instant.speed) * (EVERY / c.model.filters.rate_hz)
        self.samples += 1
        if self.samples < SAMPLES:
            return
        if self.rows < IN_MOTION * SAMPLES * c.rows:
            self.interrupt()
            return
        self.block = self.conclude(drift)
        self.last = self.products
        self._begin()

    def _take_rows(self, instant: Instant, drift: DriftFilter) -> int:
        """Take the rows of one sample that are in motion, in units of their standard errors; return their number.
        Friction changes less from day to day when the adaptation has measured how it is now."""
        c, drifts = self.constants, len(self.constants.before)
        seen = (instant.numbers, instant.usable, drift.values, drift.covariance, c.before, c.frictions, UNKNOWN)
        room = (ZERO * ((3 + drifts) * c.rows), ZERO * drifts, ZERO * drifts)
        return c.kernel.gather_block(c.solver, *seen, self.errors, c.size, 1.0, *room, self.gram)

    def conclude(self, drift: DriftFilter) -> Block:
        """Return the block that has ended."""
        c, prior = self.constants, self.constants.prior_of(drift)
        gram, known = self.products / c.memory, len(prior)
        inverse = np.linalg.inv(gram[:known, :known] + np.diag(prior))
        both = gram[:known, known:]  # load and everyday changes against errors and residual
        reduced = gram[known:, known:] - both.T @ inverse @ both
        masses, load = inverse[0] @ both, inverse[:LOAD] @ both[:, -1]
        rows, shared_masses, belief = self._shared(drift, prior)
        block = Block(
            left=np.array([reduced[-1, -1]]),
            mass=np.array([masses[-1]]),
            spread=np.array([np.sqrt(inverse[0, 0])]),
            weight=np.array([self.rows / c.memory]),
            linear=reduced[:-1, -1],
            square=np.maximum(np.diagonal(reduced)[:-1], 1e-12),
            slope=masses[:-1],
            rows=rows,
            masses=shared_masses,
            belief=belief,
            ways=self.ways,
        )
        self.load = np.where(block.explained(c.rated), load, 0.0)
        return block

    def _shared(self, drift: DriftFilter, prior: Array) -> tuple[Array, Array, Array]:
        """Return `rows`, `masses` and `belief` of a block.

        With the friction f of all blocks and e, what differs in this one: torque = C (f + e). e has a standard error of
        one, and is taken out as the load is. The gram's residual is that beside the friction of the `drift`; here it is
        that beside the identified one, so that f means the same in all blocks."""
        c, known, own = self.constants, len(prior), slice(self.constants.frictions)
        everyday = c.everyday(drift) / c.before
        scale = np.ones(len(self.last))
        scale[LOAD:known] = 1.0 / everyday
        gram = self.products * scale * scale[:, None] / c.memory
        inverse = np.linalg.inv(gram[:known, :known] + np.diag(c.prior))
        shared = np.r_[LOAD : LOAD + c.frictions, known : len(gram)]
        both = gram[:known, shared]
        mean = drift.values[own] / c.before[own]
        spread = everyday[own] / np.sqrt(prior[LOAD : LOAD + c.frictions])
        if not drift.returned:  # the oil may be cold, as in the weighing's gate
            spread = np.maximum(spread, COLD * (c.daily / c.before)[own])
        beside = np.eye(len(shared))
        beside[own, -1] = mean
        rows = beside.T @ (gram[np.ix_(shared, shared)] - both.T @ inverse @ both) @ beside
        return rows, inverse[0] @ both @ beside, np.stack([mean, spread])
