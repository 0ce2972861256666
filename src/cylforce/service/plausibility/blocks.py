"""Blocks of one second of motion as evidence for a load alone, or for a load and a constant error of a signal.

As in `service/recognition.py`, a load of the block's own and the usual changes of friction and pressure zeros explain
the residual torque of the identified machine. For each signal one column is added: the torque per unit
of a constant error of it. The squared residual is then a parabola in the size of that error. A block is stored as the
three coefficients of that parabola, and the load's mass."""

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
from cylforce.estimation.residual import correlated_samples, load_spread
from cylforce.service.adaptation import DriftFilter
from cylforce.service.pipeline import Instant
from cylforce.service.snapshot import Constants, Estimator
from cylforce.service.weighing import COLD
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

EVERY = 20  # steps between the samples that are used: neighbouring ones contain the same information
SAMPLES = 5  # of a block: one second at 100 Hz
IN_MOTION = 0.6  # share of a block's rows that must be usable and in motion, as in `recognition`
# share of the identified friction by which friction may have changed while it is not adapted, as in `recognition`
FRICTION = 0.5
UNKNOWN = FRICTION / EXPECTED.friction - 1.0  # ratio of that to the spread between strokes, less 1
BAR = 1e5  # Pa
# speed [m/s] of the fastest cylinder below which the machine is at rest, as `pipeline.MOVING`. At rest the force of the
# ground may resemble a constant error, with any friction
SLOWEST = 0.005
TILTED = 1e-3  # rad by which an angle is shifted to find its column: the torque per radian of its error
LOAD = 4  # parameters of a load
CONTACT = 5.0  # mean squared residual of a block from which on no load explains it, as in `recognition`
LEAST, MOST = -0.05, 2.0  # times the rated payload: mass that can hang in a bucket; below EMPTY_BELOW it is empty


def _nothing() -> Array:
    return np.zeros(0)


@dataclass(frozen=True, slots=True)
class Block:
    """Evidence of a block about H signals; of several blocks each array has one axis more, (B, ...).

    With an error x of signal h the squared residual is r - 2 linear_h x + square_h x^2, in squares of standard
    errors, and the load's mass is mass - slope_h x. An error is positive where the signal reads too large; its unit is
    bar of a cylinder's force over its head area, or rad of an angle.

    residual: (1,) squared residual r without an error
    mass:     (1,) mass of the load [kg]
    spread:   (1,) standard error of the mass [kg]
    weight:   (1,) number of independent samples
    linear:   (H,) linear coefficients of the parabolas
    square:   (H,) quadratic coefficients of the parabolas
    slope:    (H,) change of the mass [kg per unit of the error]

    Of F frictions that all blocks share (`common_friction`), as changes since the identification, in standard errors
    between strokes:
    rows:           (F + H + 1, F + H + 1) products of [friction | errors | residual], with the load, the zeros and the
                    deviations from stroke to stroke eliminated
    masses:         (F + H + 1,) mass of the load [kg] per unit of each of these columns
    friction_prior: (2, F) prior mean and standard error of the friction, from the adaptation

    ways:   (C,) motion of each cylinder in the block [m], extending positive
    """

    residual: Array
    mass: Array
    spread: Array
    weight: Array
    linear: Array
    square: Array
    slope: Array
    rows: Array = field(default_factory=_nothing)
    masses: Array = field(default_factory=_nothing)
    friction_prior: Array = field(default_factory=_nothing)
    ways: Array = field(default_factory=_nothing)

    def followed_by(self, new: "Block", most: int) -> "Block":
        """Return a sequence of blocks of motion with a `new` one at its end, of which the last `most` are kept."""
        if not len(self.residual):
            return Block(**{f.name: getattr(new, f.name)[None] for f in fields(Block)})
        parts = ((f.name, getattr(self, f.name), getattr(new, f.name)) for f in fields(Block))
        return Block(**{name: np.concatenate([old[1 - most :], one[None]]) for name, old, one in parts})

    def explained(self, rated: float) -> bool:
        """Return whether a load alone, of a possible mass, explains the torques of this single block.

        If not, a signal is wrong or another force acts on the tool.

        rated: rated payload [kg]
        """
        margin, mass = 3.0 * self.spread.item(), self.mass.item()
        hangs = LEAST * rated - margin < mass < MOST * rated
        return bool(hangs and self.residual.item() < CONTACT * self.weight.item())


def no_blocks(signals: int) -> Block:
    """Return an empty sequence of blocks about so many `signals`."""
    one, each = np.zeros((0, 1)), np.zeros((0, signals))
    return Block(residual=one, mass=one, spread=one, weight=one, linear=each, square=each, slope=each)


def cost(block: Block, x: Array | float, rated: float) -> Array:
    """Return the squared residual of each block if a signal had a constant error, for each of H signals (..., H).

    The unit is the square of a standard error. It is at most CONTACT per independent sample, which an impossible mass
    of the load also has.

    block: one block (H,), or several (B, H)
    x:     (..., H) supposed error of each signal [bar of a cylinder's force over its head area, rad of an angle]
    rated: rated payload [kg]
    """
    most, mass = CONTACT * block.weight, block.mass - block.slope * x
    residual = block.residual - 2.0 * x * block.linear + x**2 * block.square
    hangs = (mass > LEAST * rated - 3.0 * block.spread) & (mass < MOST * rated)
    return np.asarray(np.where(hangs, np.minimum(residual, most), most))


class BlockConstants(Constants):
    """Constants of the blocks of one machine.

    The H signals are the forces of the cylinders in `pressed` [bar on the head side], then the angles of the joints in
    `turned` [rad].

    model:         of the machine
    tares:         of the machine
    pressed:       numbers of the cylinders whose force is measured
    turned:        numbers of the joints with an angle sensor
    size:          H, number of signals
    rows:          R, number of measured torques
    rated:         rated payload [kg]
    stroke_errors: (D,) standard errors of the drift between strokes: frictions [N, N s/m], then zeros [N]
    frictions:     F, number of the drifts that are frictions; the others are zeros
    prior:         (4 + D,) diagonal of the prior information on the load and on the changes of frictions and zeros; 1
                   for a change, whose unit is its own standard error
    memory:        number of consecutive samples (one every EVERY steps) that count as one independent sample
    daily:         (D,) standard errors of the drift from day to day: frictions [N, N s/m], then zeros [N]
    """

    def __init__(self, model: Model, tares: Tares, kernel: Kernel | None = None) -> None:
        """Compute which signals may have an error, and the prior spreads of load, friction and pressure zeros.

        The signals are the forces of cylinders with a measured force, and the angles of joints with an encoder.

        model:  of the machine
        tares:  identified parameters of the empty machine
        kernel: form of the kernel; None: the compiled one if there is one
        """
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
        self.stroke_errors = drift_spread(model, tares.values, EXPECTED)
        self.frictions = len(model.changing_friction)
        self.prior = np.concatenate([load_spread(machine) ** -2.0, np.ones_like(self.stroke_errors)])
        self.memory = max(1.0, correlated_samples(model.filters, tares.correlation) / EVERY)
        self.daily = daily_spread(model, tares.values)
        self._kinds = kinds(model)  # (D,) 0 for a friction, 1 for a zero
        # force [N] of a bar on the head side of each cylinder of `pressed`
        self._per_bar = numbers(BAR * machine.cylinders[c].area_head for c in self.pressed)
        self._columns = counts(model.zero.start + c for c in self.pressed)  # of these cylinders' forces
        self._joints = counts(self.turned)
        self.solver = solver(model, tares, self.kernel)
        self.plan = making.plan(model, self.kernel.KernelPlan)

    def daily_change(self, drift: DriftFilter) -> Array:
        """Return the standard errors (D,) of the difference of friction [N, N s/m] and zeros [N] from the adapted ones.

        They are those of a healthy machine. For a zero it is that between strokes. For a friction it is that between
        strokes when the adaptation has determined the present friction, and up to FRICTION times the identified one
        before.

        drift: adapted friction and zeros, with their covariance
        """
        found = ZERO * len(self.stroke_errors)
        self.kernel.daily_change(self.solver, drift.covariance, self.stroke_errors, self.frictions, UNKNOWN, found)
        return np.frombuffer(found)

    def prior_of(self, drift: DriftFilter) -> Array:
        """Return the prior information (4 + D,), inverse variances, on the load and on changes of friction and zeros.

        The unit of a change is its `daily_change`. The information is smaller than usual where the returns of this
        machine's empty bucket show a larger spread of friction and zeros (cold oil).

        drift: adapted friction and zeros, with the spread that this machine shows
        """
        own = self.daily * np.sqrt(drift.scale)[self._kinds]
        wider = np.maximum(own / self.daily_change(drift), 1.0)
        return np.asarray(self.prior / np.concatenate([np.ones(LOAD), wider**2]))

    def torque_per_error(self, instant: Instant, channels: Numbers, load: Array) -> Array:
        """Return the residual torque (R, H) [N m] that one unit of error of each of H signals causes.

        The signals are cylinder forces [bar over the head area], then joint angles [rad]. An angle that reads one
        radian too large changes the levers, and the modelled gravity of tares and load, g Re((X + i Z) exp(i q)) of
        each link.

        instant:  filtered rows of the step
        channels: (D,) joint angles [rad], cylinder forces [N], attitude
        load:     (4,) in the bucket: m, m x, m z, J about the last pin [kg, kg m, kg m, kg m^2]
        """
        found = ZERO * (self.rows * self.size)
        room = (ZERO * len(self.tares.values), ZERO * (self.rows * len(self.turned)))
        of = (self._columns, len(self.pressed), self._per_bar, self._joints, len(self.turned), TILTED)
        self.kernel.torque_per_error(self.plan, self.solver, instant.numbers, channels, load, *of, *room, found)
        return np.frombuffer(found).reshape(self.rows, -1)

    def turned_force(self, channels: Numbers, force: complex) -> Array:
        """Return by how much errors of angles change the torque (R, H) [N m] of a known force at the tool.

        The unit of such an error is one radian. An angle that reads too large rotates all links beyond its joint, so
        that the force seems to act at another place. The columns of the cylinder forces, before those of the angles,
        are 0.

        channels: (D,) joint angles [rad], cylinder forces [N], attitude
        force:    at the tool, x + i z, forwards and upwards [N]
        """
        found = ZERO * (self.rows * self.size)
        angles = (self._joints, len(self.turned), len(self.pressed))
        self.kernel.turn_force(self.plan, channels, force.real, force.imag, *angles, found)
        return np.frombuffer(found).reshape(self.rows, self.size)

    def without_zeros(self, rows: Array, drift: DriftFilter) -> Array:
        """Return the products (K, K) of a block's rows after the drift of the pressure zeros is subtracted, too.

        The residual in a block excludes the drift of the frictions only, because a zero that drifts may be a fault. The
        measured weight excludes both drifts. Here the residual becomes the same: residual - scale column drift, with
        the factor `Tares.scale` on all residual torques. A zero's column is the torque per standard error between
        strokes, so that its drift is over that standard error.

        rows:  (K, K) products of the columns [load (4) | friction and zeros (D) | errors of signals (H) | residual (1)]
        drift: adapted friction [N, N s/m] and zeros [N]
        """
        zeros = slice(self.frictions, None)  # among the drifts; their columns follow those of the load
        columns = slice(LOAD + self.frictions, LOAD + len(self.stroke_errors))
        change = np.eye(len(rows))
        change[columns, -1] = -self.tares.scale * drift.values[zeros] / self.stroke_errors[zeros]
        return np.asarray(change.T @ rows @ change)


@dataclass(slots=True)
class BlockGatherer(Estimator):
    """Samples of motion, gathered into blocks.

    constants: of the machine
    load:      (4,) load (m, m x, m z, J) estimated in the previous block [kg, kg m, kg m, kg m^2]; zero in contact
    gram:      (K, K) products of the running block's rows [load | changes of friction and zeros | errors | residual],
               flat
    last:      (K, K) products of the previous block's rows; 0 after a block in which the machine hardly moved
    errors:    (R, H) torque per unit of each error at the last sample [N m]
    rows:      number of rows of the running block
    samples:   number of samples of the running block
    ways:      (C,) motion of the cylinders in the running block, extending positive [m]
    block:     the block that ended with the last sample; None: no block ended, or the machine hardly moved
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
        """Return the state before any sample: an empty running block, no load known.

        The rows of a block have K columns: load (4), changes of friction and zeros (D), errors of signals (H), residual
        (1)."""
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
        """Return whether a block has ended with the last sample."""
        return self.samples == 0

    @property
    def products(self) -> Array:
        """Products (K, K) of the running block's rows."""
        return np.frombuffer(self.gram).reshape(self.last.shape)

    @property
    def explained(self) -> bool | None:
        """Return whether a load explains the block that has just ended; None: none has, or the machine hardly moved."""
        return None if self.block is None else self.block.explained(self.constants.rated)

    def interrupt(self) -> None:
        """Begin the running block anew, because the measurement stopped."""
        self.last = np.zeros_like(self.last)
        self._begin()

    def _begin(self) -> None:
        self.gram, self.rows, self.samples = ZERO * len(self.gram), 0, 0
        self.ways = np.zeros_like(self.ways)

    def update(self, instant: Instant, channels: Numbers, drift: DriftFilter) -> None:
        """Add one sample to the running block of one second; its last sample concludes it.

        A block in which the machine hardly moved is discarded. Of the drift only friction is subtracted: a pressure
        zero that drifts may be a fault.

        instant:  filtered rows of the step
        channels: (D,) joint angles [rad], cylinder forces [N] and attitude, filtered like the rows of the weighing
        drift:    adapted friction and zeros
        """
        c, self.block = self.constants, None
        self.errors = c.torque_per_error(instant, channels, self.load)
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
        """Add the rows in motion of one sample to the running block, and return their number.

        A row is the residual torque of one measured joint with its columns, in units of its standard error. The unit of
        a change of friction or of a zero is its `daily_change`.

        instant: filtered rows of the step, of which those that are usable and in motion are added
        drift:   adapted friction and zeros, with their covariance
        """
        c, drifts = self.constants, len(self.constants.stroke_errors)
        seen = (instant.numbers, instant.usable, drift.values, drift.covariance, c.stroke_errors, c.frictions, UNKNOWN)
        room = (ZERO * ((3 + drifts) * c.rows), ZERO * drifts, ZERO * drifts)
        return c.kernel.gather_block(c.solver, *seen, self.errors, c.size, 1.0, *room, self.gram)

    def conclude(self, drift: DriftFilter) -> Block:
        """Return the evidence of the block that has ended: how well a load alone explains it, or one with an error.

        Load, friction and zeros are eliminated from the products of its rows. What remains is the squared residual as a
        parabola in the error of each signal. The estimated load (4,) is kept for the next block; it is 0 where no load
        explains this one (contact).

        drift: adapted friction and zeros, with the spread that this machine shows
        """
        c, prior = self.constants, self.constants.prior_of(drift)
        gram, known = self.products / c.memory, len(prior)
        inverse = np.linalg.inv(gram[:known, :known] + np.diag(prior))
        both = gram[:known, known:]  # load and usual changes against errors and residual
        reduced = gram[known:, known:] - both.T @ inverse @ both
        # mass (H + 1,) per unit of each error, and of the load itself; load (4,)
        masses, load = inverse[0] @ both, inverse[:LOAD] @ both[:, -1]
        rows, shared_masses, friction_prior = self._shared(drift, prior)
        block = Block(
            residual=np.array([reduced[-1, -1]]),
            mass=np.array([masses[-1]]),
            spread=np.array([np.sqrt(inverse[0, 0])]),
            weight=np.array([self.rows / c.memory]),
            linear=reduced[:-1, -1],
            square=np.maximum(np.diagonal(reduced)[:-1], 1e-12),
            slope=masses[:-1],
            rows=rows,
            masses=shared_masses,
            friction_prior=friction_prior,
            ways=self.ways,
        )
        self.load = np.where(block.explained(c.rated), load, 0.0)
        return block

    def _shared(self, drift: DriftFilter, prior: Array) -> tuple[Array, Array, Array]:
        """Return the evidence of a block about a friction that all blocks share: three fields of `Block`.

        They are `rows`, `masses` and `friction_prior`: the products (F + H + 1, F + H + 1) of the columns [friction |
        errors of signals | residual], the mass of the load [kg] per unit of each column, and prior mean and standard
        error (2, F) of the friction. The unit of friction is its standard error between strokes.

        drift: adapted friction and zeros
        prior: (4 + D,) information on load, friction and zeros of this machine (`prior_of`)

        With the friction f of all blocks and its deviation e in this block, torque = C (f + e). e has a standard error
        of one, and is eliminated as the load is. The gram's residual is relative to the friction of the `drift`. Here
        it is made relative to the identified friction, so that f has one meaning in all blocks."""
        c, known, own = self.constants, len(prior), slice(self.constants.frictions)
        daily_change = c.daily_change(drift) / c.stroke_errors
        scale = np.ones(len(self.last))
        scale[LOAD:known] = 1.0 / daily_change
        gram = self.products * scale * scale[:, None] / c.memory
        inverse = np.linalg.inv(gram[:known, :known] + np.diag(c.prior))
        shared = np.r_[LOAD : LOAD + c.frictions, known : len(gram)]
        both = gram[:known, shared]
        mean = drift.values[own] / c.stroke_errors[own]
        spread = daily_change[own] / np.sqrt(prior[LOAD : LOAD + c.frictions])
        if not drift.returned:  # the oil may be cold, as in the weighing's gate
            spread = np.maximum(spread, COLD * (c.daily / c.stroke_errors)[own])
        beside = np.eye(len(shared))
        beside[own, -1] = mean
        rows = beside.T @ (gram[np.ix_(shared, shared)] - both.T @ inverse @ both) @ beside
        return rows, inverse[0] @ both @ beside, np.stack([mean, spread])
