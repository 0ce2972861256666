"""A base that rocks or brakes, and no inertial sensor on it: noticed in the tilt's own motion, and in what the torques
have in common. It does not correct the weight; it widens the error of every row (mechanics/README.md, section 3)."""

from array import array
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from cylforce.estimation.kernel import choice, making
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, solver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import MIN_SECONDS
from cylforce.service.loading.lift import Lift
from cylforce.service.pipeline import Unexplained
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import new, once

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

    @once
    def _lag(self) -> int:
        return max(round(LAG_SECONDS * self.model.filters.rate_hz), 1)

    @once
    def _solver(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return solver(self.model, self.tares, self.kernel)

    @once
    def _plan(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        return making.plan(self.model, self.kernel.KernelPlan)

    @once
    def _share(self) -> float:
        return self._lag / (MEMORY_SECONDS * self.model.filters.rate_hz)

    @once
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
        return state, new(Unexplained, (left.rows, left.kept, state.wider)) if state.wider else left

    def _looked(self, state: Rocking, left: Unexplained, channels: Numbers, lift: Lift, usable: Numbers) -> Rocking:
        state = self._tilted(state)
        swings = PIN_HEIGHT**2 * max(state.turning - self._noise, 0.0)
        settled = not lift.refused and lift.taken > MIN_SECONDS * self.model.filters.rate_hz
        found, wider, rows = array("d", (state.forward, state.upward)), ZERO * len(usable), len(usable)
        seen = (left.rows, left.kept, lift.kept, channels, settled and all(usable), swings)
        work = (ZERO * rows, ZERO * len(self.model.parameters), ZERO * (2 * rows))
        self.kernel.rock(self._plan, self._solver, *seen, self._share, FITS, 1.0 / WIDEST**2, *work, found, wider)
        return new(Rocking, (*found, *state[2:-1], wider))

    def _tilted(self, state: Rocking) -> Rocking:
        """With one mean pitch more."""
        pitches = (*state.pitches, state.total / state.number)[-3:]
        turning = state.turning
        if len(pitches) == 3:
            before, middle, after = pitches
            turn = (after - 2.0 * middle + before) / (self._lag / self.model.filters.rate_hz) ** 2
            turning += self._share * (turn**2 - turning)
        return new(Rocking, (state.forward, state.upward, turning, pitches, 0.0, 0, state.wider))
