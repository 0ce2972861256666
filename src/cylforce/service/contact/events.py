"""Events at the teeth: contact begins or ends, the teeth leave the soil, a stiff object, the slope changes."""

from dataclasses import dataclass
from math import erf, hypot, sqrt
from typing import Self

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.service.contact.noise import SolvedForce
from cylforce.service.contact.slope import NO_COURSE, Course, kink
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.contact import KEPT, ContactEvent, EventKind

# Fitted on machines of another generator (`tools/accuracy events --foreign`), see tools/studies/README.md.
BEGINS = 64.0  # f' (C + e e')^-1 f at which contact begins: 8 standard errors, e: error of the force by its latency
ENDS = 12.0  # f' C^-1 f below which there is no contact: 99.8 % of the noise
ENDING_S = 0.1  # s for which it must stay there
NO_CONTACT_BELOW = 0.005  # times the rated force: a smaller one is no contact
RISE_S = 0.1  # s over which the rise of the force is measured
STIFF = 2e5  # N/m: rise of the force over the path of the teeth that is no soil; measured in soils: up to 5e4
JUMP = 0.05  # times the rated force: smallest rise that is a stiff object
INSIDE_M = 0.05  # m of path in contact, before which a rise is only the contact's beginning
CRAWL_M = 0.01  # m of path within RISE_S: with less the arm presses, and the rise over the path is undefined
DUG_M = 0.3  # m of path in contact, from which on its end is a transition from soil to air
AGAIN_S = 1.0  # s from one stiff object to the next


class ContactConstants(Constants):
    """Limits of one machine.

    smallest: least force of a contact [N]
    jump:     least rise of the force that is a stiff object [N]
    dt:       step [s]
    window:   steps over which the rise of the force is measured
    """

    def __init__(self, rated_force: float, dt: float) -> None:
        """Compute the limits; `rated_force`: largest force that can be published [N], `dt`: step [s]."""
        self.smallest, self.jump, self.dt = NO_CONTACT_BELOW * rated_force, JUMP * rated_force, dt
        self.window = max(2, round(RISE_S / dt))


@dataclass(slots=True)
class ContactDetector(Estimator):
    """Contact of the tool, and its events.

    Weight in the bucket is no contact. The force that a hanging mass explains is not counted, so that an unknown load,
    or dumping it, is not mistaken for contact.

    constants:   limits
    in_contact:  whether the tool is in contact
    away:        time for which the clearness has been below ENDS in contact [s]
    seconds:     time since contact began [s]
    path:        length of the path of the teeth since contact began [m]
    since_stiff: time since the last stiff object, at most AGAIN_S [s]
    forces:      magnitudes of the force at the instants of the last RISE_S, oldest first [N]
    paths:       length of the path of the teeth at these instants, from an arbitrary origin [m]
    course:      points x, z of the path of the teeth along the ground [m], from which its slope is computed
    number:      number of events so far
    events:      the last KEPT events, newest last
    """

    constants: ContactConstants
    in_contact: bool
    away: float
    seconds: float
    path: float
    since_stiff: float
    forces: Numbers
    paths: Numbers
    course: Course
    number: int
    events: tuple[ContactEvent, ...]

    @classmethod
    def start(cls, constants: ContactConstants) -> Self:
        """Return the state before any force: not in contact, no events.

        Times [s], forces [N] and paths [m] are zero. Only the time since the last stiff object is AGAIN_S, so that the
        first one may be reported at once."""
        return cls(
            constants,
            in_contact=False,
            away=0.0,
            seconds=0.0,
            path=0.0,
            since_stiff=AGAIN_S,
            forces=ZERO * (constants.window + 1),
            paths=ZERO * (constants.window + 1),
            course=NO_COURSE,
            number=0,
            events=(),
        )

    def interrupt(self) -> None:
        """Begin without contact after an interruption of the measurement; only the events so far are kept."""
        self.in_contact, self.away, self.seconds, self.path = False, 0.0, 0.0, 0.0
        self.since_stiff, self.course = AGAIN_S, NO_COURSE
        self.forces, self.paths = ZERO * (self.constants.window + 1), ZERO * (self.constants.window + 1)

    def update(
        self, t_us: int, force: SolvedForce, late: tuple[float, float], place: complex, velocity: complex
    ) -> None:
        """Update whether the tool is in contact with the ground, and the events at the teeth, with one instant.

        The clearness of a force is f' C^-1 f of the force f (without the weight of a mass in the bucket) with
        covariance C: its squared ratio to its standard error. A contact begins with a clearness above BEGINS and a
        force that is large enough. It ends when the clearness has stayed below ENDS for ENDING_S. Only a beginning is
        judged with the error by latency, because a sharp start of the arm resembles a force until the delayed torque of
        inertia follows. The clearness without that error is the larger one; it is compared first, because it is known
        already.

        t_us:     time [us]
        force:    at the tool: components forwards and upwards [N], clearness, weight [N] of the mass in the bucket that
                  explains most of the force (positive; it acts downwards, so that it is added to z to remove it)
        late:     error (x, z) of the force by its latency [N]
        place:    of the teeth, x + i z [m]
        velocity: of the teeth [m/s], complex like the place
        """
        dt, way = self.constants.dt, abs(velocity) * self.constants.dt
        del self.forces[0], self.paths[0]
        self.forces.append(hypot(force.x, force.z))
        self.paths.append(self.paths[-1] + way)
        self.since_stiff = min(self.since_stiff + dt, AGAIN_S)
        if self.in_contact:
            self.away = self.away + dt if force.clearness < ENDS else 0.0
            self.seconds += dt
            self.path += way
            if self.away >= ENDING_S:
                self._end(t_us, force, place)
            else:
                self._check_stiffness(t_us, force, place)
                self._check_slope(t_us, place)
            return
        self.seconds = self.path = 0.0
        large = hypot(force.x, force.z + force.weight) > self.constants.smallest  # without the weight in the bucket
        if force.clearness > BEGINS and large:
            self._begin(t_us, clearness(force, late), place)

    def _begin(self, t_us: int, clear: float, place: complex) -> None:
        """Begin a contact if the clearness exceeds BEGINS also where the error by latency is counted.

        t_us:  time [us]
        clear: clearness with this error, a squared ratio (`clearness`)
        place: of the teeth, x + i z [m]
        """
        if clear > BEGINS:
            self.in_contact, self.away, self.course = True, 0.0, NO_COURSE
            self._note(EventKind.CONTACT_BEGINS, t_us, place, probably(sqrt(clear), sqrt(BEGINS), 1.0))

    def _end(self, t_us: int, force: SolvedForce, place: complex) -> None:
        """End the contact, after a path of more than DUG_M as a transition from soil to air.

        t_us:  time [us]
        force: at the tool, with its clearness
        place: of the teeth, x + i z [m]
        """
        kind = EventKind.SOIL_LEFT if self.path > DUG_M else EventKind.CONTACT_ENDS
        self.in_contact, self.away = False, 0.0
        self._note(kind, t_us, place, probably(sqrt(BEGINS) - sqrt(force.clearness), sqrt(BEGINS), 1.0))

    def _check_stiffness(self, t_us: int, force: SolvedForce, place: complex) -> None:
        """Report a stiff object where the force rises over the path of the teeth more than in any soil.

        Force [N] and path [m] are compared over the last window of samples. The rise must exceed the jump that counts,
        and STIFF [N/m] times the path; the teeth must move, and have gone INSIDE_M since the contact began. After a
        report there is none for AGAIN_S.

        t_us:  time [us]
        force: at the tool, whose covariance gives the error of the rise
        place: of the teeth, x + i z [m]
        """
        rise, path = self.forces[-1] - self.forces[0], self.paths[-1] - self.paths[0]
        enough = rise > self.constants.jump and path > CRAWL_M and self.path > INSIDE_M
        if not (enough and rise > STIFF * path and self.since_stiff >= AGAIN_S):
            return
        error = sqrt(2.0 * (force.xx + force.zz))  # of a difference of two forces
        self.since_stiff = 0.0
        self._note(EventKind.STIFF_OBJECT, t_us, place, probably(rise, self.constants.jump, error))

    def _check_slope(self, t_us: int, place: complex) -> None:
        """Report a change of the slope of the ground along which the teeth are dragged.

        t_us:  time [us]
        place: of the teeth, x + i z [m]
        """
        self.course, confidence = kink(self.course, place)
        if confidence is not None:
            self._note(EventKind.SLOPE_CHANGES, t_us, place, confidence)

    def _note(self, kind: EventKind, t_us: int, place: complex, confidence: float) -> None:
        """Append an event at the place x + i z [m] of the teeth; `confidence`: its probability."""
        self.number += 1
        event = ContactEvent(self.number, t_us, kind, place.real, place.imag, confidence)
        self.events = (*self.events, event)[-KEPT:]


def clearness(force: SolvedForce, late: tuple[float, float]) -> float:
    """Return how clearly a force at the tool differs from none: its squared ratio to its standard error.

    It is f' (C + e e')^-1 f of the force f less the weight in the bucket, with covariance C. A sharp start of the arm
    resembles a force until the delayed torque of inertia follows. A force that changes quickly is therefore uncertain
    by e.

    force: at the tool [N], with its covariance [N^2] and the weight [N] of the mass in the bucket
    late:  e, error (x, z) of the force by its latency [N]
    """
    x, z, (late_x, late_z) = force.x, force.z + force.weight, late
    xx, xz, zz = force.xx + late_x * late_x, force.xz + late_x * late_z, force.zz + late_z * late_z
    return (zz * x * x - 2.0 * xz * x * z + xx * z * z) / (xx * zz - xz * xz)


def probably(value: float, limit: float, error: float) -> float:
    """Return the probability that the true value exceeds half the limit, for a normally distributed error.

    value: measured
    limit: that the value had to exceed, in the same unit
    error: standard error of the value, in the same unit
    """
    return 0.5 * (1.0 + erf((value - limit / 2.0) / (sqrt(2.0) * max(error, 1e-9))))
