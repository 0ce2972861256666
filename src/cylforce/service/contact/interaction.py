"""Resultant, soil force and contact events from the rows of an instant.

The resultant is the force of all that acts on the tool. The soil force is the resultant less the load in the bucket."""

from dataclasses import dataclass
from typing import Self

from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import EMPTY_BELOW
from cylforce.service.contact.carried import CarriedConstants, CarriedFilter
from cylforce.service.contact.events import ContactConstants, ContactDetector
from cylforce.service.contact.lateness import Lateness, RecentForces, no_forces
from cylforce.service.contact.noise import NoiseConstants, SolvedForce, TorqueNoise
from cylforce.service.force import ForceSensor
from cylforce.service.loading.lift import Lift
from cylforce.service.pipeline import Instant
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array, Force, Reason, invalid_force
from cylforce.signals.units import STANDARD_GRAVITY
from cylforce.signals.value_class import value_class

STILL = 0.005  # m/s of a cylinder below which no noise is learned from its rows; chosen


@value_class
class Forces:
    """Forces of an instant.

    resultant: of all that acts on the tool
    soil:      of the soil alone
    """

    resultant: Force
    soil: Force


class ForceConstants(Constants):
    """Constants of the forces of one machine.

    sensor:    determines the status of a force
    published: latency of the force on the bus: that of its filter, and all waits
    filtered:  latency against the torques of inertia and weight of the same instant: that of its filter alone, because
               all of them wait equally long
    lightest:  mass below which a load does not count [kg]
    acting:    numbers of the cylinders that act on the joint of each row
    dt:        step [s]
    noise:     constants of the errors of the rows
    carried:   constants of the load in the bucket
    contact:   limits of the contact
    """

    def __init__(
        self, model: Model, tares: Tares, rated_force: float, delay_s: float, kernel: Kernel | None = None
    ) -> None:
        """Compute the constants of force, contact and load at the tool.

        model:       of the machine
        tares:       identified parameters of the empty machine
        rated_force: largest force that can be published [N]
        delay_s:     delay of a published force behind the true one [s]
        kernel:      form of the kernel; None: the compiled one if there is one
        """
        self.sensor = ForceSensor(tares, rated_force)
        self.published = Lateness(delay_s, model.fast.dt)
        self.filtered = Lateness(model.fast.delay, model.fast.dt)
        self.lightest = EMPTY_BELOW * model.machine.rated_payload
        self.acting = tuple(tuple(acting) for acting in model.acting)
        self.dt = 1.0 / model.filters.rate_hz
        self.noise = NoiseConstants(model, tares, rated_force, kernel)
        self.carried = CarriedConstants(model.machine, kernel)
        self.contact = ContactConstants(rated_force, self.dt)


@dataclass(slots=True)
class ForceEstimator(Estimator):
    """Estimator of the forces at the tool and of its contact.

    constants: of the machine
    noise:     errors of the rows
    carried:   the load in the bucket
    contact:   of the tool with the ground
    recent:    the last resultants, for the error of the present one by its latency
    """

    constants: ForceConstants
    noise: TorqueNoise
    carried: CarriedFilter
    contact: ContactDetector
    recent: RecentForces

    @classmethod
    def start(cls, constants: ForceConstants) -> Self:
        """Return the estimator of the forces before any sample: no load known, no contact, no error learned."""
        return cls(
            constants,
            noise=TorqueNoise.start(constants.noise),
            carried=CarriedFilter.start(constants.carried),
            contact=ContactDetector.start(constants.contact),
            recent=no_forces(),
        )

    def interrupt(self) -> None:
        """Begin anew after an interruption of the measurement; learned errors of the torques and events are kept."""
        self.noise.interrupt()
        self.carried.forget()
        self.contact.interrupt()
        self.recent.clear()

    def update(
        self, instant: Instant, usable: Numbers, drift: Array, lift: Lift | None, t_us: int, undetected: Array
    ) -> Forces:
        """Return the forces at the tool at one instant, resultant and soil force, and update contact and its events.

        While a load is weighed in the air, the errors of the torques are learned, too. Without a usable row both forces
        are INVALID (DEAD_POINT), and a present contact is forgotten.

        instant:    filtered rows of the step
        usable:     (R,) 1 where the row of a measured joint torque can be used, else 0
        drift:      (D,) change of friction [N, N s/m] and pressure zeros [N] since the identification
        lift:       of the load in the bucket; None: there is no valid weight
        t_us:       time [us]
        undetected: (R, H) torques by the probable error of each of H signals [N m]
        """
        if not any(usable):
            self.contact.interrupt()
            self.recent.clear()
            nothing = invalid_force(Reason.DEAD_POINT)
            return Forces(nothing, nothing)
        c, carried, contact = self.constants, self.carried, self.contact
        carried.update(lift, c.dt, in_contact=contact.in_contact)
        solved = self.noise.solve(instant, usable, carried.values, drift, undetected)
        late = c.filtered.error(self.recent, solved.x, solved.z)
        contact.update(t_us, solved, late, instant.place, instant.velocity)
        if carried.known and not contact.in_contact:
            self.noise.learn(solved, carried.values, self._moving(usable, instant.speed))
        forces = self._forces(solved, c.published.error(self.recent, solved.x, solved.z))
        self.recent.keep(solved.x, solved.z, c.published.steps)
        return forces

    def _forces(self, solved: SolvedForce, late: tuple[float, float]) -> Forces:
        """Return both forces as they are published, each with its status: resultant and soil force.

        The resultant has the reason NO_CONTACT while the tool has neither contact nor a load. The soil force is the
        resultant less the load. In the air, before a load is weighed, it is the resultant less the mass that explains
        most of it.

        solved: force that explains the residual torque of the instant, with its covariance
        late:   error (x, z) of the forces by their latency [N]
        """
        c, carried, in_contact = self.constants, self.carried, self.contact.in_contact
        # mass in the bucket [kg]
        hanging = carried.values[0] if carried.known else solved.weight / STANDARD_GRAVITY
        acts = bool(in_contact or abs(hanging) > c.lightest)
        loaded = carried.known or in_contact
        resultant, soil = self.noise.show(solved, carried.values, carried.covariance, late, loaded=loaded)
        return Forces(c.sensor.force(resultant, acts, late), c.sensor.force(soil, in_contact, late))

    def _moving(self, usable: Numbers, speed: Numbers) -> Numbers:
        """Return for each row (R,), one measured joint torque, 1 where it is usable and a cylinder of its joint moves.

        It is 0 elsewhere. A cylinder moves above STILL [m/s].

        usable: (R,) 1 where the row can be used, else 0
        speed:  (C,) of the cylinders [m/s]
        """
        found = usable[:]
        for row, acting in enumerate(self.constants.acting):
            if not any(abs(speed[c]) > STILL for c in acting):
                found[row] = 0.0
        return found
