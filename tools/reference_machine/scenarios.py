"""What the machine does: empty moves, known payloads, known forces, poses at rest, parking, warming up.

A scenario is a function (site, duration_s, options) -> plans, one after the other; see SCENARIOS.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .cycle import STEADY, Manner, cycles_plan
from .oil import warming
from .plan import HOLD, RAMPS, RATE, Path, Plan, empty, smooth
from .shift import shift
from .site import ZERO, Site
from .soil import firm

Array = NDArray[np.float64]


Scenario = Callable[..., list[Plan]]


def _there_and_back(site: Site, path: Path, j: int, speed: float, farthest: float) -> None:
    """Joint j alone, both ways over the same stretch, as far as there is room."""
    low, high = site.geometry.working[j]
    room = (high - path.now[j], low - path.now[j])
    for way in sorted(room, key=abs, reverse=True):
        for share in (1.0, 0.7, 0.5, 0.3):
            target = path.now.copy()
            target[j] += np.sign(way) * min(abs(way), farthest) * share
            if abs(target[j] - path.now[j]) > 0.1 and site.clear(path.sketch(target, speed)):
                home = path.now.copy()
                path.go(target, speed)
                path.rest(0.6)
                path.go(home, speed)
                path.rest(0.6)
                return


def _one_by_one(site: Site, path: Path, until_s: float, duration_s: float) -> None:
    """Each joint alone, slowly, briskly, fast, each time in a new posture."""
    slow = max(0.04, 12.0 / duration_s)
    for speed in (slow, 0.12, 0.22, slow, 0.2, 0.08) * 100:
        for j in site.rng.permutation(3).tolist():
            if path.seconds > until_s:
                return
            _there_and_back(site, path, j, min(speed, site.quickest[j]), max(0.45, 2.0 * speed))
        site.go(path)
        path.rest(0.5)


def _all_at_once(site: Site, path: Path, until_s: float) -> None:
    """Combined moves between postures, each joint at its own speed and a little late."""
    while path.seconds < until_s:
        for _ in range(60):
            target = site.posture()
            speeds = site.quickest * site.rng.uniform(0.2, 1.0, 3)
            late = site.rng.uniform(0.0, 0.6, 3)
            if site.clear(path.sketch(target, speeds, late)):
                path.go(target, speeds, late)
                break
        path.rest(float(site.rng.uniform(0.0, 0.8)))


def _touch_down(site: Site, path: Path) -> None:
    """Teeth onto the ground, pressed, dragged a little, and up again."""
    x, attitude = float(site.rng.uniform(5.2, 7.2)), float(np.radians(site.rng.uniform(-115.0, -85.0)))
    places = [(x, 0.5), (x, -0.02), (x - 0.3, -0.02), (x - 0.3, 0.5)]
    poses = [site.geometry.posture(px, site.ground + pz, attitude) for px, pz in places]
    for pose, speed in zip(poses, (0.12, 0.08, 0.05, 0.12), strict=True):
        target = site.geometry.lengths(pose)
        time = float(np.max(np.abs(target - path.now))) / speed
        path.go(target, np.maximum(np.abs(target - path.now) / time, 1e-3))
        path.rest(float(site.rng.uniform(1.0, 3.0)))


def commissioning(
    site: Site,
    duration_s: float = 300.0,
    *,
    payload_kg: float = 0.0,
    touching: bool = False,
    slew: bool = False,
    ramp_s: float | None = None,
) -> list[Plan]:
    """Empty moves of an operator: joints alone, both ways, at several speeds, then all at once. `payload_kg` and
    `touching` are what a commissioning must refuse. `ramp_s`: time in which every cylinder is brought to speed and
    stopped, shorter than RAMPS for sharp starts."""
    site.haste = 1.0 / (1.0 + payload_kg / site.geometry.specimen.sheet.rated_payload)
    path = Path(site.posture(), RAMPS if ramp_s is None else (ramp_s,) * 3)
    path.rest(1.0)
    if touching:
        while path.seconds < duration_s:
            _touch_down(site, path)
            site.go(path)
            _all_at_once(site, path, path.seconds + 8.0)
    else:
        _one_by_one(site, path, 0.5 * duration_s, duration_s)
        _all_at_once(site, path, duration_s)
    plan = empty(path.done()[: round(duration_s * RATE)], 0.0)
    if slew:
        plan = replace(plan, slew=_turning(site, plan.rows))
    if touching:
        plan = replace(plan, ground=firm(site.ground))
    return [site.loaded(plan, payload_kg) if payload_kg else plan]


def _turning(site: Site, rows: int) -> Array:
    """Slewing to and fro in the last third."""
    turn, clock, angle = np.zeros(rows), 0.67 * rows / RATE, 0.0
    t = np.arange(rows) / RATE
    while clock < rows / RATE - 8.0:
        time = float(site.rng.uniform(4.5, 7.5))
        target = float(site.rng.uniform(-1.3, 1.3))
        turn += (target - angle) * smooth((t - clock) / time)
        angle, clock = target, clock + time + 0.8
    return turn


def cycles(
    site: Site,
    duration_s: float | None = None,
    *,
    payloads_kg: "tuple[float, ...] | None" = None,
    slew: bool = True,
    strength: float = 1.0,
    manner: Manner = STEADY,
) -> list[Plan]:
    """Dig, lift, swing, dump, return, with known payloads; some empty motion first."""
    count = len(payloads_kg) if payloads_kg else max(1, int((duration_s or 180.0) / 19.0))
    rated = site.geometry.specimen.sheet.rated_payload
    loads = payloads_kg or tuple((rated * site.rng.uniform(0.2, 1.0, count)).tolist())
    return [cycles_plan(site, loads, slew=slew, strength=strength, manner=manner)]


def tip_load(site: Site, duration_s: float = 180.0, *, force_n: tuple[float, float] = (5e3, 30e3)) -> list[Plan]:
    """Known forces on the line of the teeth, in poses at rest and in slow moves, in all directions."""
    path, spans = Path(site.posture()), []
    path.rest(2.0)
    while path.seconds < duration_s - 25.0:
        site.go(path)
        path.rest(2.0)
        begin = path.seconds
        path.rest(4.0)
        _there_and_back(site, path, int(site.rng.integers(3)), 0.05, 0.2)
        spans.append((begin, path.seconds))
        path.rest(2.0)
    plan = empty(path.done(), 0.0)
    t, tip = np.arange(plan.rows) / RATE, np.zeros((plan.rows, 2))
    for begin, end in spans:
        size, way = float(site.rng.uniform(*force_n)), float(site.rng.uniform(0.0, 2.0 * np.pi))
        on = smooth((t - begin) / 1.5) * (1.0 - smooth((t - end + 1.5) / 1.5))
        tip += size * on[:, None] * np.array([np.cos(way), np.sin(way)])
    return [replace(plan, tip=tip)]


def known_lift(site: Site, duration_s: float = 75.0, *, weight_kg: float = 1000.0) -> list[Plan]:
    """A known weight taken up from near the ground, carried through some postures, and set down again."""
    path = Path(site.posture())
    path.rest(1.0)
    _all_at_once(site, path, 12.0)
    low = site.geometry.lengths(site.geometry.posture(6.4, site.ground + 0.9, np.radians(-165.0)))
    path.go(low, 0.15)
    path.rest(1.0)
    taken = path.seconds
    path.rest(3.0)
    high = low + np.array([0.35, 0.0, 0.0])
    path.go(high, 0.12)
    path.rest(3.0)
    while path.seconds < duration_s - 18.0:
        site.go(path, 0.12)
        path.rest(2.0)
    path.go(high, 0.15)
    path.go(low, 0.10)
    path.rest(1.0)
    given = path.seconds
    path.rest(2.5)
    _all_at_once(site, path, path.seconds + 4.0)
    plan = empty(path.done(), 0.0)
    t, payload = np.arange(plan.rows) / RATE, plan.payload.copy()
    payload[:, 0] = weight_kg * smooth((t - taken) / 2.0) * (1.0 - smooth((t - given) / 2.0))
    payload[:, 1:3] = site.heap()
    notes = {"weight_kg": weight_kg, "lifted_s": [taken + 3.0, given - 1.0]}
    return [replace(plan, payload=payload, notes=notes)]


def holds(site: Site, duration_s: float = 200.0, *, payload_kg: float = 0.0) -> list[Plan]:
    """Poses reached from either direction, each kept for 4 s."""
    path, held = Path(site.posture()), []
    path.rest(2.0)
    while path.seconds < duration_s:
        pose = site.posture()
        ways = [pose + sign * np.array([0.10, 0.12, 0.10]) for sign in (1.0, -1.0)]
        low, high = site.geometry.working.T
        if not all(np.all((w > low) & (w < high)) and site.clear(w[None]) for w in ways):
            continue
        for way in ways:
            path.go(way, 0.12)
            path.rest(0.5)
            path.go(pose, 0.05)
            held.append([path.seconds + 1.0, path.seconds + 4.0])
            path.rest(4.0)
    plan = empty(path.done(), 0.0)
    plan = replace(plan, phase=np.full(plan.rows, HOLD), notes={"held_s": held})
    return [site.loaded(plan, payload_kg) if payload_kg else plan]


def parked(site: Site, duration_s: float = 2400.0) -> list[Plan]:
    """Half a minute of empty moves, then nothing but the sensors' noise."""
    path = Path(site.posture())
    path.rest(1.0)
    _all_at_once(site, path, 30.0)
    path.rest(3.0)
    plan = empty(path.done(), 0.0)
    return [replace(plan, still_s=max(duration_s - plan.rows / RATE, 0.0))]


def warm_up(
    site: Site,
    duration_s: float = 3600.0,
    *,
    pieces: int = 24,
    degc: tuple[float, float] = (10.0, 60.0),
    slew: bool = True,
    payloads_kg: tuple[float, ...] | None = None,
) -> list[Plan]:
    """Representative pieces of an hour's work while the oil warms: a cycle with a known payload, one with an empty
    bucket that does not touch the ground. What lies between the pieces is not recorded."""
    plans, rated = [], site.geometry.specimen.sheet.rated_payload
    for k in range(pieces):
        begin = duration_s * k / pieces
        load = payloads_kg[k % len(payloads_kg)] if payloads_kg else float(rated * site.rng.uniform(0.2, 1.0))
        plan = cycles_plan(site, (load, 0.0), slew=slew, first=1 + 2 * k)
        t = begin + np.arange(plan.rows) / RATE
        kelvin = np.array([warming(*degc, duration_s, float(x)) for x in t]) + ZERO
        plans.append(replace(plan, kelvin=kelvin, begin=round(begin * RATE) / RATE))
    return plans


SCENARIOS: dict[str, Scenario] = {
    "commissioning": commissioning,
    "cycles": cycles,
    "tip_load": tip_load,
    "known_lift": known_lift,
    "holds": holds,
    "parked": parked,
    "warm_up": warm_up,
    "shift": shift,
}
