"""The force at the tool at an instant, and how wrong its torque is: what is learned in the air, and two causes that are
seen coming. The arithmetic is the kernel's (estimation/kernel/pushed.py)."""

from array import array
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, Limits, solver
from cylforce.estimation.model import Model, Tares
from cylforce.service.contact.hanging_mass import HEAVIEST
from cylforce.service.force import CLEAR, prior
from cylforce.service.pipeline import Instant
from cylforce.signals.estimate import Array
from cylforce.signals.quick import new, once
from cylforce.signals.units import STANDARD_GRAVITY

# The figures below are measured on machines of another generator: see tools/studies/README.md.
PRIOR = 5.0  # times the row error of the weighing: standard error of a row before the machine was seen in the air
LATE_S = 0.034  # s: the torque of inertia is wrong by this time's change of it
FADING_S = 0.045  # s in which such an error fades, the delay of the measured speed
LEARNING_S = 20.0  # s of motion in the air in which the learned variance follows; chosen
LARGEST = 9.0  # normalised square above which a sample teaches no more than this, so that a blow is not noise; chosen

SHOWN = 14  # numbers of a force, see `pushed.publish`


class Unrest(NamedTuple):
    """State, as the kernel keeps it: covariance (R, R) [N^2 m^2] of the late torque of inertia; `reversing` (C,): 1
    where a cylinder turns round, fading; learned variance (R,) [N^2 m^2]."""

    kept: Numbers


class Solved(NamedTuple):
    """Force `x`, `z` [N] with covariance `xx`, `xz`, `zz` [N^2]; the weight [N] of the mass in the bucket that explains
    most of it; how clear the rest is, f' C^-1 f; `kept`: what the kernel asks for again."""

    x: float
    z: float
    xx: float
    xz: float
    zz: float
    weight: float
    clearness: float
    kept: Numbers


@dataclass(frozen=True)
class Noise:
    """The force of an instant and the errors of its rows. While the inertia changes, it is late; while a cylinder turns
    round, the sign of its friction is; the rest is learned from the torque that is left in the air."""

    model: Model
    tares: Tares
    rated_force: float
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def _solver(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        rate = self.model.filters.rate_hz
        keep = float(np.exp(-1.0 / (FADING_S * rate)))
        heaviest = HEAVIEST * self.model.machine.rated_payload * STANDARD_GRAVITY
        limits = Limits(keep=keep, late=LATE_S, largest=LARGEST, learning=LEARNING_S * rate, heaviest=heaviest)
        return solver(self.model, self.tares, self.kernel, limits, prior(self.model.machine, self.rated_force))

    @once
    def _rows(self) -> int:
        return len(self.model.machine.rows)

    @once
    def _size(self) -> int:
        return self._rows**2 + len(self.model.machine.cylinders)

    def begin(self) -> Unrest:
        """The state before any sample."""
        learned = np.broadcast_to((PRIOR * self.tares.row_error) ** 2, (self._rows,))
        return Unrest(ZERO * self._size + array("d", learned.tolist()))

    def interrupted(self, state: Unrest) -> Unrest:
        """The state after an interruption of the measurement: what was learned remains."""
        return Unrest(ZERO * self._size + state.kept[self._size :])

    def solve(
        self, state: Unrest, instant: Instant, usable: Numbers, load: Numbers, drift: Array, unnoticed: Array
    ) -> tuple[Unrest, Solved]:
        """The state, and the force that explains the torque of the rows marked in `usable` (R,), after one instant with
        a `load` (4,) in the bucket and the values `drift` (D,) of the adapted friction and zeros; torques
        `unnoticed` (R, H) [N m] by probable errors of signals."""
        r = self._rows
        after, found = ZERO * len(state.kept), ZERO * (8 * r + 11)
        wrong, size = unnoticed, unnoticed.shape[1]
        self.kernel.push(self._solver, instant.kept, usable, load, drift, wrong, size, state.kept, after, found)
        x, z, xx, xz, _, zz = found[2 * r : 2 * r + 6]
        seen = (x, z, xx, xz, zz, found[-5], found[-4], found)
        return new(Unrest, (after,)), new(Solved, seen)

    def learn(self, state: Unrest, solved: Solved, load: Numbers, good: Numbers) -> Unrest:
        """The state after the rows marked in `good` (R,) were left in the air with a load (4,)."""
        after = state.kept[:]
        self.kernel.learn(self._solver, solved.kept, good, load, after)
        return new(Unrest, (after,))

    def show(
        self, solved: Solved, load: Numbers, covariance: Numbers, loaded: bool, late: tuple[float, float]
    ) -> tuple[Numbers, Numbers]:
        """What is published of the resultant, and of the force of the soil: less a load (4,) with covariance (4, 4) if
        one is in the bucket (`loaded`), else less the mass that explains most of it (`pushed.publish`). Both are wrong
        by the force `late` (x, z) [N] in addition."""
        late_x, late_z = late
        wider = solved.kept[:]
        wider[-3] += late_x * late_x
        wider[-2] += late_x * late_z
        wider[-1] += late_z * late_z
        resultant, soil = ZERO * SHOWN, ZERO * SHOWN
        self.kernel.show(self._solver, wider, load, covariance, loaded, CLEAR, resultant, soil)
        return resultant, soil
