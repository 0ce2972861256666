"""One second of motion as evidence: how well an empty or a hanging load explains it, and how much better it would if a
signal were off by a constant.

Torque that the identified machine does not explain is compared, as in `service/recognition.py`, with what a load of the
block's own, and everyday changes of friction and pressure zeros, can explain. For each signal one column is added: the
torque per unit of a constant error of it. What is left is then a parabola in the size of that error; its three numbers,
and the load's mass, are all that is kept of a block."""

from array import array
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.drift import daily_spread, drift_spread, kinds
from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import EXPECTED, Model, Tares
from cylforce.estimation.residual import correlated, load_spread
from cylforce.service.adaptation import Drift
from cylforce.service.pipeline import Instant
from cylforce.service.weighing import COLD
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import once

EVERY = 20  # steps between the samples that are used: neighbouring ones contain the same information
SAMPLES = 5  # of a block: one second at 100 Hz
IN_MOTION = 0.6  # share of a block's rows that must be usable and in motion, as in `recognition`
FRICTION = 0.5  # of its identified value, by which friction may have changed while it is not known, as in `recognition`
UNKNOWN = FRICTION / EXPECTED.friction - 1.0  # by how many times it is more than what differs between strokes
BAR = 1e5  # Pa
# m/s of the fastest cylinder, as MOVING of `step`. At rest the ground may push as a constant error does, whatever
# friction is
SLOWEST = 0.005
TILTED = 1e-3  # rad by which an angle is shifted to find its column
LOAD = 4  # parameters of a load
NONE = np.zeros(0)


class Block(NamedTuple):
    """What a block leaves with an error of size x of signal h is left - 2 linear_h x + square_h x^2 (squares in units
    of their variance), and the load's mass then mass - slope_h x [kg] with the standard error `spread` [kg]; `weight`:
    independent samples. `left`, `mass`, `spread` and `weight` are (1,), the others (H,); of several blocks (B, ...).

    Of F frictions that all blocks share (`common_friction`), in standard errors by which strokes differ:
    rows:   (F + H + 1, F + H + 1) products of [friction | errors | torque left], the load, the zeros and what differs
            from stroke to stroke taken out
    masses: (F + H + 1,) the load's mass [kg] by each of them
    belief: (2, F) mean and standard error of the friction, as the adaptation knows it
    ways:   (C,) by how much each cylinder moved [m], extending positive"""

    left: Array
    mass: Array
    spread: Array
    weight: Array
    linear: Array
    square: Array
    slope: Array
    rows: Array = NONE
    masses: Array = NONE
    belief: Array = NONE
    ways: Array = NONE


class Gathering(NamedTuple):
    """State: the `load` (4,) of the block before, zero in contact; `gram` (K, K) of the running block's rows [load |
    everyday changes | errors | torque left], number of `rows` and of `samples`; `last` (K, K): those of
    the block before; `errors` (R, H) [N m]: torque by a unit of each error at the last sample; `ways` (C,) [m] that the
    cylinders moved in the running block."""

    load: Array
    gram: Array
    last: Array
    errors: Array
    rows: int = 0
    samples: int = 0
    ways: Array = NONE


@dataclass(frozen=True)
class Gatherer:
    """Blocks of one machine. The H signals are the forces of the cylinders in `pressed` [bar on the head side], then
    the angles of the joints in `turned` [rad]."""

    model: Model
    tares: Tares
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def pressed(self) -> list[int]:
        """Cylinders whose force is measured."""
        return [c for c, measured in enumerate(self.model.machine.forces_measured) if measured]

    @once
    def turned(self) -> list[int]:
        """Joints with an angle sensor."""
        seen = {s.index for s in self.model.machine.signals if s.kind is Kind.JOINT_ANGLE}
        return [j for j in range(self.model.machine.size) if j in seen]

    @once
    def _before(self) -> Array:
        """Standard errors (D,) of the drift before anything is seen of it."""
        return drift_spread(self.model, self.tares.values, EXPECTED)

    @once
    def _frictions(self) -> int:
        """How many of the drifts are frictions; the others are zeros."""
        return len(self.model.changing_friction)

    @once
    def _per_bar(self) -> Numbers:
        """Force [N] of a bar on the head side of each cylinder of `pressed`."""
        return numbers(BAR * self.model.machine.cylinders[c].area_head for c in self.pressed)

    @once
    def _places(self) -> tuple[Counts, Counts]:
        """Numbers of the columns of these cylinders' forces; the joints of `turned`."""
        return counts(self.model.zero.start + c for c in self.pressed), counts(self.turned)

    @once
    def prior(self) -> Array:
        """Information (4 + D,) on load and everyday changes."""
        return np.concatenate([load_spread(self.model.machine) ** -2.0, np.ones_like(self._before)])

    def _everyday(self, drift: Drift) -> Array:
        """Standard errors (D,) of everyday changes of friction and zeros: those of friction become smaller when the
        adaptation has seen how it is now."""
        found = ZERO * len(self._before)
        self.kernel.everyday(self._solver, drift.covariance, self._before, self._frictions, UNKNOWN, found)
        return np.frombuffer(found)

    def _as_seen(self, drift: Drift) -> Array:
        """The same where friction and zeros of this machine, as its returns tell (cold oil), spread more than every
        day's."""
        own = daily_spread(self.model, self.tares.values) * np.sqrt(drift.scale)[kinds(self.model)]
        wider = np.maximum(own / self._everyday(drift), 1.0)
        return np.asarray(self.prior / np.concatenate([np.ones(LOAD), wider**2]))

    @once
    def memory(self) -> float:
        """Samples that count as an independent one."""
        return max(1.0, correlated(self.model.filters, self.tares.correlation) / EVERY)

    @property
    def size(self) -> int:
        """Number H of signals that are examined."""
        return len(self.pressed) + len(self.turned)

    def begin(self) -> Gathering:
        """An empty block."""
        size = len(self.prior) + self.size + 1
        nothing = np.zeros((size, size))
        errors, ways = np.zeros((len(self.model.machine.rows), self.size)), np.zeros(len(self.model.machine.cylinders))
        return Gathering(np.zeros(LOAD), nothing, nothing, errors, ways=ways)

    def interrupt(self, state: Gathering) -> Gathering:
        """The state after an interruption of the measurement: the running block starts anew."""
        return self.begin()._replace(load=state.load, errors=state.errors)

    def step(
        self, state: Gathering, instant: Instant, channels: Numbers, drift: Drift
    ) -> tuple[Gathering, Block | None]:
        """One sample: an instant, the `channels` (D,) about which its slow rows are, drift so far. With the block's
        last sample the block, unless the machine hardly moved. Of the drift only friction is believed: a zero that
        drifts may be a fault."""
        errors = self._errors(instant, channels, state.load)
        moves = max(map(abs, instant.speed)) > SLOWEST
        gram, telling = self._with_rows(state.gram, instant, drift, errors) if moves else (state.gram, 0)
        many = state.rows + telling
        ways = state.ways + np.frombuffer(instant.speed) * (EVERY / self.model.filters.rate_hz)
        state = Gathering(state.load, gram, state.last, errors, many, state.samples + 1, ways)
        if state.samples < SAMPLES:
            return state, None
        if state.rows < IN_MOTION * SAMPLES * len(errors):
            return self.interrupt(state), None
        prior = self._as_seen(drift)
        after, block = self._ended(state, prior)
        return after, block._replace(**self._shared(state.gram, drift, prior), ways=state.ways)

    def _errors(self, instant: Instant, channels: Numbers, load: Array) -> Array:
        """Torque (R, H) [N m] by a unit of each error. That of a reading of each of `turned` too large by one radian is
        what it adds to what gravity of tares and `load` (4,) leaves, at `channels` (D,): g Re((X + i Z) exp(i q)) of
        each link, and the levers, change."""
        (pressed, turned), rows = self._places, instant.sizes.r
        found, work = ZERO * (rows * self.size), (ZERO * len(self.tares.values), ZERO * (rows * len(turned)))
        of = (pressed, len(pressed), self._per_bar, turned, len(turned), TILTED)
        self.kernel.mislead(self._plan, self._solver, instant.kept, channels, load, *of, *work, found)
        return np.frombuffer(found).reshape(rows, -1)

    def _with_rows(self, gram: Array, instant: Instant, drift: Drift, errors: Array) -> tuple[Array, int]:
        """The gram with the rows of one sample, in units of their standard errors; how many these are: none that is not
        in motion. Friction changes less from day to day when the adaptation has seen how it is now."""
        rows, drifts, new = len(errors), len(self._before), array("d", gram.tobytes())
        seen = (instant.kept, instant.usable, drift.values, drift.covariance, self._before)
        work = (ZERO * ((3 + drifts) * rows), ZERO * drifts, ZERO * drifts)
        told = (*seen, self._frictions, UNKNOWN, errors, self.size, 1.0, *work)
        telling = self.kernel.gather_block(self._solver, *told, new)
        return np.frombuffer(new).reshape(gram.shape), telling

    @once
    def _solver(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return solver(self.model, self.tares, self.kernel)

    @once
    def _plan(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return making.plan(self.model, self.kernel.KernelPlan)

    def less(self, rows: Array, drift: Drift) -> Array:
        """Rows (K, K) of a block with the `drift` of the zeros, too, taken from the torque that is left: as it is taken
        from the weight."""
        first, own = LOAD + self._frictions, slice(self._frictions, None)
        change = np.eye(len(rows))
        change[first : LOAD + len(self._before), -1] = -self.tares.scale * drift.values[own] / self._before[own]
        return np.asarray(change.T @ rows @ change)

    def swung(self, channels: Numbers, force: complex) -> Array:
        """Torque (R, H) [N m] that a unit of each error seems to take from a `force` x + i z [N] at the tool, at
        `channels` (D,): an angle that is read too large turns all that is beyond its joint."""
        rows, (pressed, turned) = len(self.model.machine.rows), self._places
        found = ZERO * (rows * self.size)
        self.kernel.turn_force(self._plan, channels, force.real, force.imag, turned, len(turned), len(pressed), found)
        return np.frombuffer(found).reshape(rows, self.size)

    def _shared(self, gram: Array, drift: Drift, prior: Array) -> dict[str, Array]:
        """Return a block's `rows`, `masses` and `belief`, from its `gram` (K, K).

        With the friction f of all blocks and e, what differs in this one: torque = C (f + e). e has a standard error of
        one, and is taken out as the load is. The gram's torque is that beside the friction of the `drift`; here it is
        that beside the identified one, so that f means the same in all blocks."""
        frictions, known = self._frictions, len(prior)
        everyday, own = self._everyday(drift) / self._before, slice(frictions)
        scale = np.ones(len(gram))
        scale[LOAD:known] = 1.0 / everyday
        gram = gram * scale * scale[:, None] / self.memory
        inverse = np.linalg.inv(gram[:known, :known] + np.diag(self.prior))
        shared = np.r_[LOAD : LOAD + frictions, known : len(gram)]
        both = gram[:known, shared]
        mean = drift.values[own] / self._before[own]
        spread = everyday[own] / np.sqrt(prior[LOAD : LOAD + frictions])
        if not drift.returned:  # the oil may be cold, as in the weighing's gate
            spread = np.maximum(spread, COLD * (daily_spread(self.model, self.tares.values) / self._before)[own])
        beside = np.eye(len(shared))
        beside[own, -1] = mean
        rows = beside.T @ (gram[np.ix_(shared, shared)] - both.T @ inverse @ both) @ beside
        return {"rows": rows, "masses": inverse[0] @ both @ beside, "belief": np.stack([mean, spread])}

    def _ended(self, state: Gathering, prior: Array) -> tuple[Gathering, Block]:
        gram, known = state.gram / self.memory, len(prior)
        inverse = np.linalg.inv(gram[:known, :known] + np.diag(prior))
        both = gram[:known, known:]  # load and everyday changes against errors and torque
        reduced = gram[known:, known:] - both.T @ inverse @ both
        square = np.maximum(np.diagonal(reduced)[:-1], 1e-12)
        masses, load = inverse[0] @ both, inverse[:LOAD] @ both[:, -1]
        each = (reduced[-1, -1], masses[-1], np.sqrt(inverse[0, 0]), state.rows / self.memory)
        left, mass, spread, weight = (np.array([x]) for x in each)
        block = Block(left, mass, spread, weight, reduced[:-1, -1], square, masses[:-1])
        hangs = explained(block, self.model.machine.rated_payload)
        load = np.where(hangs, load, 0.0)
        return self.begin()._replace(load=load, last=state.gram, errors=state.errors), block


CONTACT = 5.0  # mean squared residual of a block from which on no load explains it, as in `recognition`
LEAST, MOST = -0.05, 2.0  # times the rated payload: mass that can hang in a bucket; below SMALLEST it is empty


def cost(block: Block, x: Array | float, rated: float) -> Array:
    """What blocks leave (..., H) if signals are off by `x` (..., H), at most CONTACT for each independent sample; that
    much if the load would have an impossible mass."""
    most, mass = CONTACT * block.weight, block.mass - block.slope * x
    left = block.left - 2.0 * x * block.linear + x**2 * block.square
    hangs = (mass > LEAST * rated - 3.0 * block.spread) & (mass < MOST * rated)
    return np.asarray(np.where(hangs, np.minimum(left, most), most))


def explained(block: Block, rated: float) -> bool:
    """Whether a load explains a block as it is."""
    left, mass, spread, weight = (each.item() for each in block[:4])
    hangs = LEAST * rated - 3.0 * spread < mass < MOST * rated
    return bool(hangs and left < CONTACT * weight)
