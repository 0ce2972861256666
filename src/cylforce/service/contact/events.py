"""What happens at the teeth: contact begins and ends, the soil is left, a stiff object, another slope of the ground."""

from array import array
from dataclasses import dataclass
from math import erf, hypot, sqrt
from typing import NamedTuple

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.service.contact.noise import Solved
from cylforce.service.contact.slope import NO_COURSE, Course, kink
from cylforce.signals.contact import KEPT, ContactEvent, EventKind
from cylforce.signals.quick import new, once

# Fitted on machines of another generator (`tools/accuracy events --foreign`), see tools/studies/README.md.
BEGINS = 64.0  # f' (C + e e')^-1 f at which contact begins: 8 standard errors, e: error of a force that is late
ENDS = 12.0  # f' C^-1 f below which there is none: 99.8 % of the noise
ENDING_S = 0.1  # s for which it must stay there
SMALLEST = 0.005  # times the rated force: a smaller one is no contact
RISE_S = 0.1  # s over which the rise of the force is measured
STIFF = 2e5  # N/m: rise of the force over the path of the teeth that is no soil; soils seen: up to 5e4
JUMP = 0.05  # times the rated force: smallest rise that is a stiff object
INSIDE_M = 0.05  # m of path in contact, before which a rise is only the contact's beginning
CRAWL_M = 0.01  # m of path within RISE_S: with less the arm presses, and the path says nothing
DUG_M = 0.3  # m of path in contact, from which on its end is a transition from soil to air
AGAIN_S = 1.0  # s from one stiff object to the next


class Touch(NamedTuple):
    """State: whether the tool is `touching`; seconds since it looked so last (`away`); since contact began, `seconds`
    and path [m]; seconds since the last stiff object; the last RISE_S as force [N] and path [m] in turn; the course of
    the ground; number of events so far and the KEPT last ones, newest last."""

    touching: bool
    away: float
    seconds: float
    path: float
    since_stiff: float
    recent: Numbers
    course: Course
    number: int
    events: tuple[ContactEvent, ...]


@dataclass(frozen=True)
class Watcher:
    """The events of one machine. Weight in the bucket is no contact: a force that a hanging mass explains is not
    counted, so that neither a load that is not known yet nor dumping it looks like contact."""

    rated_force: float
    rated_payload: float
    dt: float

    @once
    def _window(self) -> int:
        return max(2, round(RISE_S / self.dt))

    def begin(self) -> Touch:
        """The state before anything is seen."""
        return Touch(False, 0.0, 0.0, 0.0, AGAIN_S, ZERO * (2 * (self._window + 1)), NO_COURSE, 0, ())

    def interrupt(self, state: Touch) -> Touch:
        """The state after an interruption of the measurement; the events remain."""
        return self.begin()._replace(number=state.number, events=state.events)

    def step(
        self, state: Touch, t_us: int, seen: Solved, late: tuple[float, float], place: complex, velocity: complex
    ) -> Touch:
        """The state after one instant: the force, its error (x, z) [N] because it is `late`, `place` [m] and `velocity`
        [m/s] of the teeth as x + i z."""
        went, dt, now = abs(velocity) * self.dt, self.dt, (t_us, place)
        recent = state.recent[2:] + array("d", (hypot(seen.x, seen.z), state.recent[-1] + went))
        since = min(state.since_stiff + dt, AGAIN_S)
        if not state.touching:
            state = new(Touch, (False, state.away, 0.0, 0.0, since, recent, state.course, state.number, state.events))
            if seen.clearness <= BEGINS or hypot(seen.x, seen.z + seen.weight) <= SMALLEST * self.rated_force:
                return state
            clear = clearness(seen, late)
            return self._begun(state, now, clear) if clear > BEGINS else state
        away = state.away + dt if seen.clearness < ENDS else 0.0
        seconds, path = state.seconds + dt, state.path + went
        state = new(Touch, (True, away, seconds, path, since, recent, state.course, state.number, state.events))
        if away >= ENDING_S:
            return self._ended(state, now, seen.clearness)
        return self._slope(self._stiff(state, now, seen), now)

    def _begun(self, state: Touch, now: "Now", clearness: float) -> Touch:
        state = state._replace(touching=True, away=0.0, course=NO_COURSE)
        return self._note(state, EventKind.CONTACT_BEGINS, now, probably(sqrt(clearness), sqrt(BEGINS), 1.0))

    def _ended(self, state: Touch, now: "Now", clearness: float) -> Touch:
        kind = EventKind.SOIL_LEFT if state.path > DUG_M else EventKind.CONTACT_ENDS
        sure = probably(sqrt(BEGINS) - sqrt(clearness), sqrt(BEGINS), 1.0)
        return self._note(state._replace(touching=False, away=0.0), kind, now, sure)

    def _stiff(self, state: Touch, now: "Now", seen: Solved) -> Touch:
        """A rise of the force over the path of the teeth that no soil has."""
        rise, path = state.recent[-2] - state.recent[0], state.recent[-1] - state.recent[1]
        enough = rise > JUMP * self.rated_force and path > CRAWL_M and state.path > INSIDE_M
        if not (enough and rise > STIFF * path and state.since_stiff >= AGAIN_S):
            return state
        error = sqrt(2.0 * (seen.xx + seen.zz))  # of a difference of two forces
        sure = probably(rise, JUMP * self.rated_force, error)
        return self._note(state._replace(since_stiff=0.0), EventKind.STIFF_OBJECT, now, sure)

    def _slope(self, state: Touch, now: "Now") -> Touch:
        course, sure = kink(state.course, now[1])
        if course is state.course:
            return state
        state = state._replace(course=course)
        return state if sure is None else self._note(state, EventKind.SLOPE_CHANGES, now, sure)

    def _note(self, state: Touch, kind: EventKind, now: "Now", sure: float) -> Touch:
        number, (t_us, place) = state.number + 1, now
        event = ContactEvent(number, t_us, kind, place.real, place.imag, sure)
        return state._replace(number=number, events=(*state.events, event)[-KEPT:])


def clearness(seen: Solved, late: tuple[float, float]) -> float:
    """Return f' (C + e e')^-1 f of the force f less the weight in the bucket, e: its error (x, z) because it is late.

    A sharp start of the arm looks like a force until the late torque of inertia follows. While the force still changes
    quickly, it is therefore not sure."""
    x, z, (late_x, late_z) = seen.x, seen.z + seen.weight, late
    xx, xz, zz = seen.xx + late_x * late_x, seen.xz + late_x * late_z, seen.zz + late_z * late_z
    return (zz * x * x - 2.0 * xz * x * z + xx * z * z) / (xx * zz - xz * xz)


Now = tuple[int, complex]  # time [us] and place of the teeth


def probably(value: float, limit: float, error: float) -> float:
    """Probability that the true value exceeds half the limit, for a normal standard error."""
    return 0.5 * (1.0 + erf((value - limit / 2.0) / (sqrt(2.0) * max(error, 1e-9))))
