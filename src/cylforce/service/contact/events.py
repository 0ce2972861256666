"""What happens at the teeth: contact begins and ends, the soil is left, a stiff object, another slope of the ground."""

from dataclasses import dataclass
from functools import cached_property
from math import erf, hypot, sqrt
from typing import NamedTuple

import numpy as np

from cylforce.service.contact.hanging_mass import without_mass
from cylforce.service.contact.slope import NO_COURSE, kink
from cylforce.signals.contact import KEPT, ContactEvent, EventKind
from cylforce.signals.estimate import Array

# Fitted on machines of another generator (`tools/accuracy events --foreign`), see tools/studies/README.md.
BEGINS = 100.0  # f' C^-1 f at which contact begins: 10 standard errors; empty motion reached 85 in 75 minutes
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
    and path [m]; seconds since the last stiff object; the last RISE_S as rows of (force [N], path [m]); the course of
    the ground; number of events so far and the KEPT last ones, newest last."""

    touching: bool
    away: float
    seconds: float
    path: float
    since_stiff: float
    recent: Array
    course: Array
    number: int
    events: tuple[ContactEvent, ...]


class Moment(NamedTuple):
    """What is seen at an instant: time [us], force (2,) [N] with covariance (2, 2), place [m] and velocity [m/s] of the
    teeth as x + i z."""

    t_us: int
    force: Array
    spread: Array
    place: complex
    velocity: complex


@dataclass(frozen=True)
class Watcher:
    """The events of one machine. Weight in the bucket is no contact: a force that a hanging mass explains is not
    counted, so that neither a load that is not known yet nor dumping it looks like contact."""

    rated_force: float
    rated_payload: float
    dt: float

    @cached_property
    def _window(self) -> int:
        return max(2, round(RISE_S / self.dt))

    def begin(self) -> Touch:
        """The state before anything is seen."""
        return Touch(False, 0.0, 0.0, 0.0, AGAIN_S, np.zeros((self._window + 1, 2)), NO_COURSE, 0, ())

    def interrupt(self, state: Touch) -> Touch:
        """The state after an interruption of the measurement; the events remain."""
        return self.begin()._replace(number=state.number, events=state.events)

    def step(self, state: Touch, seen: Moment) -> Touch:
        """The state after one instant."""
        pushed = without_mass(seen.force, seen.spread, self.rated_payload)
        clearness, size = normalised(pushed, seen.spread), hypot(*seen.force.tolist())
        state = self._moved(state, seen, size)
        if not state.touching:
            begins = clearness > BEGINS and hypot(*pushed.tolist()) > SMALLEST * self.rated_force
            return self._begun(state, seen, clearness) if begins else state
        state = state._replace(away=state.away + self.dt if clearness < ENDS else 0.0)
        if state.away >= ENDING_S:
            return self._ended(state, seen, clearness)
        return self._slope(self._stiff(state, seen), seen)

    def _moved(self, state: Touch, seen: Moment, size: float) -> Touch:
        went = abs(seen.velocity) * self.dt
        path = state.path + went if state.touching else 0.0
        recent = np.empty_like(state.recent)
        recent[:-1], recent[-1] = state.recent[1:], (size, state.recent[-1, 1] + went)
        seconds = state.seconds + self.dt if state.touching else 0.0
        since = min(state.since_stiff + self.dt, AGAIN_S)
        return state._replace(seconds=seconds, path=path, recent=recent, since_stiff=since)

    def _begun(self, state: Touch, seen: Moment, clearness: float) -> Touch:
        state = state._replace(touching=True, away=0.0, course=NO_COURSE)
        return self._note(state, EventKind.CONTACT_BEGINS, seen, probably(sqrt(clearness), sqrt(BEGINS), 1.0))

    def _ended(self, state: Touch, seen: Moment, clearness: float) -> Touch:
        kind = EventKind.SOIL_LEFT if state.path > DUG_M else EventKind.CONTACT_ENDS
        sure = probably(sqrt(BEGINS) - sqrt(clearness), sqrt(BEGINS), 1.0)
        return self._note(state._replace(touching=False, away=0.0), kind, seen, sure)

    def _stiff(self, state: Touch, seen: Moment) -> Touch:
        """A rise of the force over the path of the teeth that no soil has."""
        rise, path = (state.recent[-1] - state.recent[0]).tolist()
        enough = rise > JUMP * self.rated_force and path > CRAWL_M and state.path > INSIDE_M
        if not (enough and rise > STIFF * path and state.since_stiff >= AGAIN_S):
            return state
        error = sqrt(2.0 * float(np.trace(seen.spread)))  # of a difference of two forces
        sure = probably(rise, JUMP * self.rated_force, error)
        return self._note(state._replace(since_stiff=0.0), EventKind.STIFF_OBJECT, seen, sure)

    def _slope(self, state: Touch, seen: Moment) -> Touch:
        course, sure = kink(state.course, seen.place)
        state = state._replace(course=course)
        return state if sure is None else self._note(state, EventKind.SLOPE_CHANGES, seen, sure)

    def _note(self, state: Touch, kind: EventKind, seen: Moment, sure: float) -> Touch:
        number = state.number + 1
        event = ContactEvent(number, seen.t_us, kind, seen.place.real, seen.place.imag, sure)
        return state._replace(number=number, events=(*state.events, event)[-KEPT:])


def normalised(force: Array, spread: Array) -> float:
    """f' C^-1 f of a force (2,) [N] with covariance C (2, 2) [N^2]."""
    (xx, xz), (_, zz) = spread.tolist()
    x, z = force.tolist()
    return float((zz * x * x - 2.0 * xz * x * z + xx * z * z) / (xx * zz - xz * xz))


def probably(value: float, limit: float, error: float) -> float:
    """Probability that the true value exceeds half the limit, for a normal standard error."""
    return 0.5 * (1.0 + erf((value - limit / 2.0) / (sqrt(2.0) * max(error, 1e-9))))
