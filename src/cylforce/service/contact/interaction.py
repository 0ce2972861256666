"""From the rows of an instant to the two forces and the events: resultant of all that acts on the tool, and that of the
soil, which is the resultant less the load in the bucket."""

from dataclasses import dataclass
from typing import NamedTuple

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import SMALLEST
from cylforce.service.contact.carried import Carrier, KnownLoad
from cylforce.service.contact.events import Touch, Watcher
from cylforce.service.contact.lateness import NOT_BEGUN, Lateness
from cylforce.service.contact.noise import Noise, Solved, Unrest
from cylforce.service.force import ForceSensor
from cylforce.service.pipeline import Instant
from cylforce.service.weighing import Weighing
from cylforce.signals.estimate import Array, Force, Load, Reason, Status, invalid_force
from cylforce.signals.quick import new, once
from cylforce.signals.units import STANDARD_GRAVITY

STILL = 0.005  # m/s of a cylinder below which its rows teach nothing about noise; chosen


class Interaction(NamedTuple):
    """State: errors, load in the bucket, contact; `recent`: the last resultants, from which it follows how late the
    present one is (`lateness.Lateness`)."""

    unrest: Unrest
    carried: KnownLoad
    contact: Touch
    recent: Numbers


class Forces(NamedTuple):
    """The resultant of all that acts on the tool, and the force of the soil."""

    resultant: Force
    soil: Force


@dataclass(frozen=True)
class Interactor:
    """The interaction of one machine with its surroundings; `delay_s`: of the published force [s]."""

    model: Model
    tares: Tares
    rated_force: float
    delay_s: float

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
    def _published(self) -> Lateness:
        """Of the force on the bus: its filter, and all waits."""
        return Lateness(self.delay_s, self.model.fast.dt)

    @once
    def _filtered(self) -> Lateness:
        """Of the force against the torques of inertia and weight of the same instant: its filter alone, because all of
        them wait alike."""
        return Lateness(self.model.fast.delay, self.model.fast.dt)

    @once
    def _watcher(self) -> Watcher:
        return Watcher(self.rated_force, self.model.machine.rated_payload, 1.0 / self.model.filters.rate_hz)

    def begin(self) -> Interaction:
        """The state before any sample."""
        return Interaction(self._noise.begin(), self._carrier.begin(), self._watcher.begin(), NOT_BEGUN)

    def interrupt(self, state: Interaction) -> Interaction:
        """The state after an interruption of the measurement: errors and events remain."""
        unrest, contact = self._noise.interrupted(state.unrest), self._watcher.interrupt(state.contact)
        return Interaction(unrest, self._carrier.begin(), contact, NOT_BEGUN)

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
            contact = self._watcher.interrupt(state.contact)
            return state._replace(contact=contact, recent=NOT_BEGUN), Forces(nothing, nothing)
        carried = self._carried(state, *weighed)
        unrest, solved = self._noise.solve(state.unrest, instant, usable, carried.values, drift, unnoticed)
        force = (state.recent, solved.x, solved.z)
        late = self._filtered.error(*force)
        contact = self._watcher.step(state.contact, t_us, solved, late, instant.place, instant.velocity)
        if carried.known and not contact.touching:
            unrest = self._noise.learn(unrest, solved, carried.values, self._moving(usable, instant))
        forces = self._forces(solved, carried, contact.touching, self._published.error(*force))
        return new(Interaction, (unrest, carried, contact, self._published.keep(*force))), forces

    def _forces(self, solved: Solved, carried: KnownLoad, touching: bool, late: tuple[float, float]) -> Forces:
        """Both forces, wider by errors of signals and because they are `late` (x, z) [N]. The resultant is that of no
        contact while nothing touches the tool or hangs in it. That of the soil is the resultant less the load; in the
        air with a load that is not known yet: less the mass that explains most of it."""
        hanging = carried.values[0] if carried.known else solved.weight / STANDARD_GRAVITY
        acts = bool(touching or abs(hanging) > SMALLEST * self.model.machine.rated_payload)
        load = (carried.values, self._carrier.covariance(carried))
        resultant, soil = self._noise.show(solved, *load, carried.known or touching, late)
        return new(Forces, (self._sensor.force(resultant, acts, late), self._sensor.force(soil, touching, late)))

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
