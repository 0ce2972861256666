"""A base that rocks or brakes, and no inertial sensor on it: noticed in the tilt's own motion, and in what the torques
have in common. It does not correct the weight; it widens the error of every row (mechanics/README.md, section 3)."""

from array import array
from dataclasses import dataclass, field
from functools import cached_property
from math import cos, sin
from operator import add
from typing import Any, NamedTuple

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import MIN_SECONDS
from cylforce.service.loading.lift import Lift
from cylforce.service.pipeline import Unexplained
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import new

MEMORY_SECONDS = 4.0  # s over which the acceleration is averaged; chosen: two periods of a slowly rocking machine
# s after which is looked again, over which the tilt is averaged; three such means give an acceleration; chosen: a tenth
# of a period of rocking on tyres
LAG_SECONDS = 0.1
# m from the ground, about which a base turns, to the first pin: 1.7 to 2.1 on machines of 15 to 20 t
PIN_HEIGHT = 2.0
FITS = 9.0  # mean squared remainder in standard errors (3 squared), above which it is no load; as for the weighing
WIDEST = 2.0  # m/s^2, standard error of an acceleration before anything is seen: tyres slide at 5; chosen


NONE = array("d")


class Rocking(NamedTuple):
    """State: variances of the first pin's acceleration forwards and upwards [m^2/s^4] as the torques tell it, and
    variance of the base's angular acceleration [rad^2/s^4] as the tilt tells it; the last mean pitches [rad], newest
    last, and of the running mean the sum and the number; what is added to the variance of each row (R,) [N^2 m^2],
    none: nothing."""

    forward: float = 0.0
    upward: float = 0.0
    turning: float = 0.0
    pitches: tuple[float, ...] = ()
    total: float = 0.0
    number: int = 0
    wider: Numbers = NONE

    def interrupted(self) -> "Rocking":
        """After a gap in the samples."""
        return self._replace(pitches=(), total=0.0, number=0)


STILL = Rocking()


@dataclass(frozen=True)
class Rocker:
    """How the base of one machine moves."""

    model: Model
    tares: Tares
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @cached_property
    def _lag(self) -> int:
        return max(round(LAG_SECONDS * self.model.filters.rate_hz), 1)

    @cached_property
    def _solver(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return solver(self.model, self.tares, self.kernel)

    @cached_property
    def _share(self) -> float:
        return self._lag / (MEMORY_SECONDS * self.model.filters.rate_hz)

    @cached_property
    def _noise(self) -> float:
        """Variance of the angular acceleration that the tilt sensor's noise alone shows [rad^2/s^4]."""
        error = max((s.standard_error for s in self.model.machine.signals if s.kind is Kind.PITCH), default=0.0)
        return 6.0 * error**2 / self._lag / (self._lag / self.model.filters.rate_hz) ** 4

    def step(
        self, state: Rocking, left: Unexplained, channels: Numbers, lift: Lift, usable: Numbers
    ) -> tuple[Rocking, Unexplained]:
        """The state, and what is left with wider variances, after one instant: `channels` (D,), the present `lift`
        before it, `usable` (R,) rows. Looked at every LAG_SECONDS; what a load leaves of the torques is asked once the
        lift is settled."""
        if self.model.channels.inertial:
            return state, left
        forward, upward, turning, pitches, total, number, wider = state
        state = new(Rocking, (forward, upward, turning, pitches, total + channels[-3], number + 1, wider))
        if state.number >= self._lag:
            state = self._looked(state, left, channels, lift, usable)
        return state, new(Unexplained, (*left[:2], state.wider)) if state.wider else left

    def _looked(self, state: Rocking, left: Unexplained, channels: Numbers, lift: Lift, usable: Numbers) -> Rocking:
        state = self._tilted(state)
        over, values = ZERO * len(usable), ZERO * len(self.model.parameters)
        self.kernel.without_load(self._solver, left.rows, left.kept, lift.kept, over, values)
        levers = self._levers(channels, values)
        swings = PIN_HEIGHT**2 * max(state.turning - self._noise, 0.0)
        settled = not lift.refused and lift.taken > MIN_SECONDS * self.model.filters.rate_hz
        if settled and all(usable):
            variances = list(map(add, left.variance, left.rest))
            wider = [variance + swings * (a * a + b * b) for variance, (a, b) in zip(variances, levers, strict=True)]
            state = self._accelerated(state, over, wider, levers)
        forward, upward = max(state.forward, swings), max(state.upward, swings)
        return state._replace(wider=array("d", [a * a * forward + b * b * upward for a, b in levers]))

    def _tilted(self, state: Rocking) -> Rocking:
        """With one mean pitch more."""
        pitches = (*state.pitches, state.total / state.number)[-3:]
        state = state._replace(pitches=pitches, total=0.0, number=0)
        if len(pitches) < 3:
            return state
        before, middle, after = pitches
        turn = (after - 2.0 * middle + before) / (self._lag / self.model.filters.rate_hz) ** 2
        return state._replace(turning=state.turning + self._share * (turn**2 - state.turning))

    def _levers(self, channels: Numbers, values: Numbers) -> list[tuple[float, float]]:
        """Torque (R, 2) [N m] per unit of the first pin's acceleration forwards and upwards [m/s^2]: -Im and Re of the
        first moment about each joint, of the parameters `values` (P,), sum over the links beyond of (X + i Z)
        exp(i q)."""
        size, angle = self.model.machine.size, channels[-3]
        own = []
        for j in range(size):
            angle += channels[j]
            x, z, t, u = values[3 * j + 1], values[3 * j + 2], cos(angle), sin(angle)
            own.append((x * t - z * u, x * u + z * t))
        across, along, found = 0.0, 0.0, [(0.0, 0.0)] * size
        for j in range(size - 1, -1, -1):
            along, across = along + own[j][0], across + own[j][1]
            found[j] = (-across, along)
        return [found[j] for j in self.model.machine.rows]

    def _accelerated(
        self, state: Rocking, over: Numbers, variances: list[float], levers: list[tuple[float, float]]
    ) -> Rocking:
        """With the acceleration that explains best what the load leaves, `over` (R,) [N m], its own variance
        subtracted. What is no load at all, as contact or a dump, is not asked, by the variance without what is found
        here: else it would excuse more and more."""
        if sum(x * x / v for x, v in zip(over, variances, strict=True)) > FITS * len(over):
            return state
        aa = bb = 1.0 / WIDEST**2
        ab = a_over = b_over = 0.0
        for x, v, (a, b) in zip(over, variances, levers, strict=True):
            aa, ab, bb = aa + a * a / v, ab + a * b / v, bb + b * b / v
            a_over, b_over = a_over + a * x / v, b_over + b * x / v
        size = aa * bb - ab * ab
        forward, upward = (bb * a_over - ab * b_over) / size, (aa * b_over - ab * a_over) / size
        forward, upward = forward * forward - bb / size, upward * upward - aa / size
        return state._replace(
            forward=max(state.forward + self._share * (forward - state.forward), 0.0),
            upward=max(state.upward + self._share * (upward - state.upward), 0.0),
        )
