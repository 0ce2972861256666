"""What a loader does: empty moves, a known lift, and cycles of digging, lifting, carrying, dumping and returning."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from reference_machine.cycle import STEADY, Manner, material, smoothed, twitching
from reference_machine.plan import AIR, DIG, DUMP, LIFT, RATE, REACH, RETURN, Path, Plan, empty, smooth

from .site import QUICKEST, Site

Array = NDArray[np.float64]
HEADWAY = 8.0  # s of empty motion before the first cycle
# s from a cycle's start: teeth in the heap from, to; free of it; material falls from, to; end
ENTERS, LEAVES, FREE, FALLS, FALLEN, END = 1.6, 6.0, 6.8, 17.2, 19.2, 26.0
POSES = (  # time, arm and the bucket's attitude in degrees
    (0.0, -36.0, 0.0),
    (1.4, -41.0, 0.0),
    (3.2, -38.0, 8.0),
    (6.2, -32.0, 44.0),
    (9.0, -22.0, 45.0),
    (12.0, -8.0, 45.0),
    (16.4, 38.0, 43.0),
    (17.0, 40.0, 41.0),
    (19.4, 40.0, -42.0),
    (20.4, 37.0, -40.0),
    (23.6, -10.0, -5.0),
    (25.4, -34.0, 0.0),
)
# s: out of the heap and braked, towards the truck and braked, back and braked, to the heap and braked
TRAVEL = (7.0, 9.5, -1.0), (12.0, 14.5, 1.0), (19.8, 21.6, -1.0), (23.0, 24.4, 1.0)
RAMP, STEEPEST = 1.4, 15.0 / 8.0  # s to speed; largest slope of `smooth`
PUSH, PRESS = (25e3, 60e3), (5e3, 20e3)  # N against the teeth and upwards, at a rated load
ROCKING_HZ = ((0.25, 0.5), (0.8, 1.2), (1.3, 1.8))  # of a machine on tyres: slow, pitching, bouncing
Motion = tuple[float, float]


@dataclass(frozen=True)
class LoaderPlan(Plan):
    """`base` (T, 5): speed and acceleration along x; angle, rate and acceleration of rocking. SI."""

    base: Array = field(default_factory=lambda: np.zeros((0, 5)))


def planned(plan: Plan, base: Array | None = None) -> LoaderPlan:
    """A plan with the base's motion; without it the base stands."""
    still = np.zeros((plan.rows, 5)) if base is None else base
    return LoaderPlan(**{name: getattr(plan, name) for name in Plan.__dataclass_fields__}, base=still)


def rocking(rng: np.random.Generator, rows: int, degrees: float) -> Array:
    """Angle, rate and acceleration (T, 3) of a base that rocks by `degrees` rms."""
    t, found = np.arange(rows) / RATE, np.zeros((rows, 3))
    shares = np.radians(degrees) * np.sqrt(2.0 / len(ROCKING_HZ))
    for low, high in ROCKING_HZ:
        w, at = 2.0 * np.pi * float(rng.uniform(low, high)), float(rng.uniform(0.0, 2.0 * np.pi))
        grows = np.stack([np.sin(w * t + at), w * np.cos(w * t + at), -w * w * np.sin(w * t + at)], axis=-1)
        found += shares * grows * smooth(t / 3.0)[:, None]
    return found


def travelling(u: Array, most: float) -> Array:
    """Speed and acceleration (T, 2) at times `u` from a cycle's start, with at most `most` [m/s^2]."""
    speed = np.zeros(len(u))
    for begin, end, way in TRAVEL:
        speed += way * most * RAMP / STEEPEST * (smooth((u - begin) / RAMP) - smooth((u - end) / RAMP))
    return np.stack([speed, np.gradient(speed) * RATE], axis=-1)


def commissioning(site: Site, duration_s: float = 300.0) -> LoaderPlan:
    """Empty moves of an operator: cylinders alone, both ways, at several speeds, then both at once."""
    path = Path(site.posture())
    path.rest(1.0)
    for speed in (0.05, 0.12, 0.2, 0.05, 0.16, 0.08) * 20:
        for j in site.rng.permutation(2).tolist():
            _there_and_back(site, path, j, min(speed, float(QUICKEST[j])))
        if path.seconds > 0.5 * duration_s:
            break
        site.go(path)
        path.rest(0.5)
    while path.seconds < duration_s:
        site.go(path)
        path.rest(float(site.rng.uniform(0.0, 0.8)))
    return planned(empty(path.done()[: round(duration_s * RATE)], 0.0))


def _there_and_back(site: Site, path: Path, j: int, speed: float) -> None:
    """Cylinder j alone, both ways over the same stretch, as far as there is room."""
    low, high = site.geometry.working[j]
    for way in sorted((high - path.now[j], low - path.now[j]), key=abs, reverse=True):
        for share in (1.0, 0.7, 0.5, 0.3):
            target = path.now.copy()
            target[j] += np.sign(way) * min(abs(way), max(0.35, 2.0 * speed)) * share
            if abs(target[j] - path.now[j]) > 0.08 and site.clear(path.sketch(target, speed)):
                home = path.now.copy()
                for end in (target, home):
                    path.go(end, speed)
                    path.rest(0.6)
                return


def known_lift(site: Site, duration_s: float = 75.0, *, weight_kg: float = 3000.0) -> LoaderPlan:
    """A known weight taken up near the ground, lifted and lowered, and set down again."""
    path = Path(site.posture())
    path.rest(1.0)
    site.go(path)
    low, high = (site.geometry.lengths(*np.radians(pose).tolist()) for pose in ((-30.0, 40.0), (-15.0, 42.0)))
    path.go(low, 0.12)
    path.rest(1.0)
    taken = path.seconds
    path.rest(3.0)
    path.go(high, 0.10)
    path.rest(2.0)
    while path.seconds < duration_s - 18.0:
        arm, attitude = np.radians(site.rng.uniform((-10.0, 20.0), (42.0, 45.0))).tolist()
        target = site.geometry.lengths(arm, attitude)
        speeds = QUICKEST * site.rng.uniform(0.3, 0.7, 2)
        if site.clear(path.sketch(target, speeds)):
            path.go(target, speeds)
            path.rest(2.0)
    path.go(high, 0.12)
    path.go(low, 0.08)
    path.rest(1.0)
    given = path.seconds
    path.rest(2.5)
    site.go(path)
    plan = empty(path.done(), 0.0)
    t, payload = np.arange(plan.rows) / RATE, plan.payload.copy()
    payload[:, 0] = weight_kg * smooth((t - taken) / 2.0) * (1.0 - smooth((t - given) / 2.0))
    payload[:, 1:3] = site.heap()
    notes = {"weight_kg": weight_kg, "lifted_s": [taken + 3.0, given - 1.0]}
    return planned(replace(plan, payload=payload, notes=notes))


def cycles(
    site: Site,
    *,
    payloads_kg: tuple[float, ...] = (3000.0,),
    manner: Manner = STEADY,
    drive: float = 0.0,
    rock_deg: float = 0.0,
) -> LoaderPlan:
    """Empty motion, then one cycle for each payload [kg]. `drive`: largest acceleration on the way [m/s^2];
    `rock_deg`: how the base rocks, rms. The notes are those of an excavator's cycles."""
    rng, knots = site.rng, [(0.0, site.posture())]
    for k in range(len(payloads_kg)):
        knots += [(HEADWAY + k * END + t, p) for t, p in _postures(site)]
    knots.append((HEADWAY + len(payloads_kg) * END, knots[1][1]))
    plan = empty(twitching(smoothed(knots), manner.jerk, rng), 0.0)
    t = np.arange(plan.rows) / RATE
    base = np.concatenate([np.zeros((plan.rows, 2)), rocking(rng, plan.rows, rock_deg)], axis=-1)
    payload, tip, phase, notes = plan.payload.copy(), plan.tip.copy(), np.full(plan.rows, float(AIR)), []
    cycle = plan.cycle.copy()
    for k, kilograms in enumerate(payloads_kg):
        begin = HEADWAY + k * END
        u, within = t - begin, (t >= begin) & (t < begin + END)
        held = kilograms * (1.0 - manner.lost(k))
        filling = _filling(u, kilograms, held, manner.stays(k - 1), manner.stays(k))
        payload[within] = material(filling, *site.heap(), *_shares(u))[within]
        tip[within] = _resistance(rng, u, kilograms / site.geometry.specimen.sheet.rated_payload)[within]
        base[:, :2] += travelling(u, drive)
        phase[within], cycle[within] = _phase(u[within]), k + 1.0
        note = {"cycle": k + 1, "payload_kg": held, "free_s": [begin + FREE, begin + FALLS]}
        notes.append(note | {"carry_back_kg": manner.stays(k), "empty_s": [begin + FALLEN, begin + END]})
    done = replace(plan, payload=payload, tip=tip, phase=phase, cycle=cycle, notes={"cycles": notes})
    return planned(done, base)


def _postures(site: Site) -> list[tuple[float, Array]]:
    """Times and lengths of one cycle, drawn anew."""
    found = []
    for t, *degrees in POSES:
        arm, attitude = np.radians(np.array(degrees) + site.rng.uniform(-1.5, 1.5, 2)).tolist()
        found.append((t, site.geometry.lengths(arm, attitude)))
    return found


def _shares(u: Array) -> tuple[Array, Array]:
    """How far the bucket has been filled and emptied."""
    return smooth((u - ENTERS - 0.6) / (LEAVES - ENTERS - 0.6)), smooth((u - FALLS) / (FALLEN - FALLS))


def _filling(u: Array, dug: float, held: float, before: float, after: float) -> Array:
    """What the bucket holds [kg]; a part may spill while it is lifted."""
    fills, falls = _shares(u)
    filled = before + (dug - before) * fills + (held - dug) * smooth((u - 8.0) / 0.7)
    return np.asarray(filled * (1.0 - falls) + after * falls)


def _resistance(rng: np.random.Generator, u: Array, share: float) -> Array:
    """Force (T, 2) of the heap on the teeth while the loader drives into it, rough over time [N]."""
    push, press = (share * float(rng.uniform(*limits)) for limits in (PUSH, PRESS))
    within = smooth((u - ENTERS) / 1.2) * (1.0 - smooth((u - LEAVES + 1.2) / 1.2))
    rough = 1.0 + 0.15 * np.sin(9.0 * u + rng.uniform(0.0, 6.0)) + 0.1 * np.sin(23.0 * u)
    return np.asarray(within[:, None] * rough[:, None] * np.array([-push, -press]))


def _phase(u: Array) -> Array:
    edges = (ENTERS, LEAVES + 0.7, FALLS, FALLEN)
    return np.array((REACH, DIG, LIFT, DUMP, RETURN), dtype=np.float64)[np.searchsorted(edges, u)]


SCENARIOS: dict[str, Callable[..., LoaderPlan]] = {
    "commissioning": commissioning,
    "known_lift": known_lift,
    "cycles": cycles,
}
