"""From the rows of an instant to the two forces and the events: resultant of all that acts on the tool, and that of the
soil, which is the resultant less the load in the bucket."""

from dataclasses import dataclass
from typing import NamedTuple

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import SMALLEST
from cylforce.service.contact.carried import Carrier, KnownLoad
from cylforce.service.contact.events import Touch, Watcher
from cylforce.service.contact.noise import Noise, Solved, Unrest
from cylforce.service.force import ForceSensor
from cylforce.service.pipeline import Instant
from cylforce.service.weighing import Weighing
from cylforce.signals.estimate import Array, Force, Load, Reason, Status, invalid_force
from cylforce.signals.quick import new, once
from cylforce.signals.units import STANDARD_GRAVITY

STILL = 0.005  # m/s of a cylinder below which its rows teach nothing about noise; chosen


class Interaction(NamedTuple):
    """State: errors, load in the bucket, contact."""

    unrest: Unrest
    carried: KnownLoad
    contact: Touch


class Forces(NamedTuple):
    """The resultant of all that acts on the tool, and the force of the soil."""

    resultant: Force
    soil: Force


@dataclass(frozen=True)
class Interactor:
    """The interaction of one machine with its surroundings."""

    model: Model
    tares: Tares
    rated_force: float

    @once
    def _sensor(self) -> ForceSensor:
        return ForceSensor(self.tares, self.rated_force)

    @once
    def _noise(self) -> Noise:
        return Noise(self.model, self.tares, self.rated_force)

    @once
    def _carrier(self) -> Carrier:
        return Carrier(self.model.machine)

    @once
    def _watcher(self) -> Watcher:
        return Watcher(self.rated_force, self.model.machine.rated_payload, 1.0 / self.model.filters.rate_hz)

    def begin(self) -> Interaction:
        """The state before any sample."""
        return Interaction(self._noise.begin(), self._carrier.begin(), self._watcher.begin())

    def interrupt(self, state: Interaction) -> Interaction:
        """The state after an interruption of the measurement: errors and events remain."""
        return Interaction(
            self._noise.interrupted(state.unrest), self._carrier.begin(), self._watcher.interrupt(state.contact)
        )

    def step(
        self,
        state: Interaction,
        instant: Instant,
        drift: Array,
        usable: Numbers,
        weighed: tuple[Weighing, Load],
        t_us: int,
        unnoticed: Array,
    ) -> tuple[Interaction, Forces]:
        """The state and the forces after one instant: its rows, the adapted friction and zeros `drift` (D,),
        `usable` (R,) rows, weighing and load of the same step, time [us], torques (R, H) [N m] by probable errors of
        signals."""
        if not any(usable):
            nothing = invalid_force(Reason.DEAD_POINT)
            return state._replace(contact=self._watcher.interrupt(state.contact)), Forces(nothing, nothing)
        carried = self._carried(state, *weighed)
        unrest, solved = self._noise.solve(state.unrest, instant, usable, carried.values, drift, unnoticed)
        contact = self._watcher.step(state.contact, t_us, solved, instant.place, instant.velocity)
        if carried.known and not contact.touching:
            unrest = self._noise.learn(unrest, solved, carried.values, self._moving(usable, instant))
        return new(Interaction, (unrest, carried, contact)), self._forces(solved, carried, contact.touching)

    def _forces(self, solved: Solved, carried: KnownLoad, touching: bool) -> Forces:
        """Both forces, wider by errors of signals. The resultant is that of no contact while nothing touches the tool
        or hangs in it. That of the soil is the resultant less the load; in the air with a load that is not known yet:
        less the mass that explains most of it."""
        hanging = carried.values[0] if carried.known else solved.weight / STANDARD_GRAVITY
        acts = bool(touching or abs(hanging) > SMALLEST * self.model.machine.rated_payload)
        load = (carried.values, self._carrier.covariance(carried))
        resultant, soil = self._noise.show(solved, *load, carried.known or touching)
        return new(Forces, (self._sensor.force(resultant, acts), self._sensor.force(soil, touching)))

    def _carried(self, state: Interaction, weighing: Weighing, load: Load) -> KnownLoad:
        known = load.mass.status is not Status.INVALID
        lift = weighing.lift if known else None
        return self._carrier.step(state.carried, lift, state.contact.touching, self._watcher.dt)

    @once
    def _acting(self) -> tuple[tuple[int, ...], ...]:
        return tuple(tuple(acting) for acting in self.model.acting)

    def _moving(self, usable: Numbers, instant: Instant) -> Numbers:
        """The usable rows (R,) whose cylinders move: 1, else 0."""
        speed, found = instant.speed, usable[:]
        for row, acting in enumerate(self._acting):
            for c in acting:
                if abs(speed[c]) > STILL:
                    break
            else:
                found[row] = 0.0
        return found
