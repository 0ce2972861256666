"""A shift of work as it really is: plain cycles, and those with spill, tip-off, a dump in two parts, a double dip, or a
swing that brings nothing."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .cycle import ARM, EMPTY_TEETH_RISE, HEADWAY, STEEPEST, SWING, TEETH, material, smoothed, twitching
from .plan import RATE, Plan, empty, smooth
from .site import Site
from .soil import soil

Array = NDArray[np.float64]
Step = tuple[float, float, float]  # s from, s to; share of the load that the bucket holds afterwards
Pose = tuple[float, float, float, float]  # s, and three numbers as in cycle.TEETH or cycle.ARM


class Course(NamedTuple):
    """One kind of cycle at the usual pace, from its start [s]: poses of the teeth, then of the arm; how the bucket
    fills and loses; when it is `free` of the ground, when the last of the load begins to fall and has fallen, `end`."""

    teeth: tuple[Pose, ...]
    arm: tuple[Pose, ...]
    steps: tuple[Step, ...]
    free: float
    falls: float
    fallen: float
    end: float
    dumps: float = 0.0  # when the first part falls onto the truck, where that is not the last one


def _later(poses: tuple[Pose, ...], by: float) -> tuple[Pose, ...]:
    return tuple((t + by, *rest) for t, *rest in poses)  # type: ignore[misc]


PLAIN = Course(TEETH, ARM, ((1.8, 6.2, 1.0),), 7.4, 12.8, 15.0, 19.0)
SPILL = PLAIN._replace(steps=((1.8, 6.2, 1.0), (8.6, 9.3, 0.85)))
# the bucket opens over the heap, a part falls back, it curls again: the operator wants a smaller load
TIP_OFF = Course(
    (*TEETH, (8.6, -2.4, 1.0, -190.0), (10.2, -2.3, 1.0, -150.0), (11.6, -2.4, 1.0, -192.0)),
    _later(ARM, 4.6),
    ((1.8, 6.2, 1.0), (9.6, 10.6, 0.65)),
    12.0,
    17.4,
    19.6,
    23.6,
)
# over the truck the bucket opens half, waits, and empties
TWO_PARTS = Course(
    TEETH,
    (
        *ARM[:3],
        (14.0, 45.0, -76.0, -62.0),
        (15.8, 45.0, -76.0, -60.0),
        (18.6, 43.0, -68.0, -5.0),
        (19.2, 40.0, -69.0, -4.0),
    ),
    ((1.8, 6.2, 1.0), (12.8, 14.2, 0.5)),
    7.4,
    16.2,
    18.0,
    22.0,
    12.8,
)
# too little the first time: the bucket goes into the ground once more before it is lifted
DOUBLE_DIP = Course(
    (
        *TEETH,
        (9.2, -0.6, 0.35, -150.0),
        (10.2, -0.9, -0.15, -140.0),
        (11.6, -1.8, -0.18, -155.0),
        (12.8, -2.3, -0.10, -175.0),
        (14.1, -2.4, 0.55, -192.0),
    ),
    _later(ARM, 7.2),
    ((1.8, 6.2, 0.5), (10.4, 13.4, 1.0)),
    14.6,
    20.0,
    22.2,
    26.2,
)
SWING_ONLY = PLAIN._replace(steps=())
COURSES = {
    "plain": PLAIN,
    "spill": SPILL,
    "tip_off": TIP_OFF,
    "two_parts": TWO_PARTS,
    "double_dip": DOUBLE_DIP,
    "swing": SWING_ONLY,
}


class Job(NamedTuple):
    """One cycle to do: kind, load that is dug [kg], what stays in the bucket afterwards [kg], pace (more is slower)."""

    kind: str
    kilograms: float
    stays: float = 0.0
    pace: float = 1.0


def shift(
    site: Site, duration_s: float | None = None, *, jobs: tuple[Job, ...], slew_rate: float = 0.6, jerk: float = 0.0
) -> list[Plan]:
    """Empty motion, then the jobs one after the other. `slew_rate` [rad/s], `jerk` [m] as in `cycle.Manner`. The notes
    of a cycle tell its kind, the bucket's content when the dump begins and after it, and the times [s]."""
    del duration_s  # the jobs last as long as they last
    rng, knots, begins = site.rng, [(0.0, site.posture())], []
    begin = HEADWAY
    for job in jobs:
        begins.append(begin)
        knots += [(begin + job.pace * t, p) for t, p in _postures(site, COURSES[job.kind], job.kind)]
        begin += job.pace * COURSES[job.kind].end
    knots.append((begin, knots[1][1]))
    plan = empty(twitching(smoothed(knots), jerk, rng), 0.0)
    t = np.arange(plan.rows) / RATE
    payload, cycle, slew, notes, before = plan.payload.copy(), plan.cycle.copy(), np.zeros(plan.rows), [], 0.0
    for k, (job, start) in enumerate(zip(jobs, begins, strict=True)):
        course, u = COURSES[job.kind], (t - start) / job.pace
        within = (u >= 0.0) & (u < course.end)
        mass, held = _mass(course, job, before, u)
        x, z = site.heap()
        fills, falls = smooth((u - 1.8) / 4.4), smooth((u - course.falls) / (course.fallen - course.falls))
        payload[within], cycle[within] = material(mass, x, z, fills, falls)[within], 1 + k
        back = course.end - course.fallen - 0.4
        turn = float(rng.choice((-1.0, 1.0))) * slew_rate * job.pace * back / STEEPEST
        slew += turn * (smooth((u - course.free) / SWING) - smooth((u - course.fallen - 0.2) / back))
        notes.append(_note(1 + k, job, course, start, held))
        before = job.stays if course.steps else before
    ground = soil(site.ground, float(rng.uniform(0.7, 1.4)))
    return [replace(plan, slew=slew, payload=payload, cycle=cycle, ground=ground, notes={"cycles": notes})]


def _mass(course: Course, job: Job, before: float, u: Array) -> tuple[Array, float]:
    """What the bucket holds [kg] at the times `u`, and when the dump begins. The first filling adds to what was in
    it `before`; without filling that stays."""
    mass, held = before + 0.0 * u, before
    lifted = before
    for a, b, share in course.steps:
        mass += (share * job.kilograms - held) * smooth((u - a) / (b - a))
        held = share * job.kilograms
        lifted = held if not course.dumps or a < course.dumps else lifted
    if course.steps:
        mass += (job.stays - held) * smooth((u - course.falls) / (course.fallen - course.falls))
    return mass, lifted


def _note(number: int, job: Job, course: Course, start: float, held: float) -> dict[str, object]:
    dumps = course.dumps or course.falls
    free, falls, fallen, end = (start + job.pace * x for x in (course.free, dumps, course.fallen, course.end))
    after = job.stays if course.steps else held
    weights = {"payload_kg": held, "carry_back_kg": after}
    return {"cycle": number, "kind": job.kind, **weights, "free_s": [free, falls], "empty_s": [fallen, end]}


def _postures(site: Site, course: Course, kind: str) -> list[tuple[float, Array]]:
    """Times and lengths of one cycle at the usual pace, drawn anew."""
    rng, geometry = site.rng, site.geometry
    begin, rise = float(rng.uniform(7.0, 7.6)), EMPTY_TEETH_RISE if kind == "swing" else 0.0
    low, high = geometry.working.T
    found = []
    for t, x, height, attitude in course.teeth:
        z = site.ground + height * float(rng.uniform(0.85, 1.15)) + rise
        pose = geometry.posture(begin + x, z, np.radians(attitude + float(rng.uniform(-4.0, 4.0))))
        found.append((t, np.clip(geometry.lengths(pose), low, high)))
    for t, *degrees in course.arm:
        pose = np.radians(np.array(degrees) + rng.uniform(-3.0, 3.0, 3))
        found.append((t, np.clip(geometry.lengths(pose), low, high)))
    return found
