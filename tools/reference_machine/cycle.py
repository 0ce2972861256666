"""The working cycle: reach, dig, lift and swing, dump, return."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from .plan import AIR, DIG, DUMP, LIFT, RATE, REACH, RETURN, Plan, empty, smooth
from .site import Site
from .soil import soil

Array = NDArray[np.float64]
HEADWAY = 8.0  # s of empty motion before the first cycle
# s from the cycle's start: teeth in the ground from, to; free from the ground; material falls from, to; end
ENTERS, LEAVES, FREE, FALLS, FALLEN, END = 1.0, 6.2, 7.4, 12.8, 15.0, 19.0
TEETH = (  # time, x from where the digging begins, height above the ground, the bucket's attitude in degrees
    (0.0, 0.0, 0.45, -100.0),
    (1.6, -0.25, -0.20, -112.0),
    (3.0, -1.0, -0.25, -128.0),
    (4.4, -1.8, -0.23, -150.0),
    (5.6, -2.3, -0.10, -175.0),
    (6.9, -2.4, 0.55, -192.0),
)
ARM = (  # time, boom, stick (relative), bucket (relative) in degrees
    (9.8, 42.0, -102.0, -128.0),
    (11.2, 46.0, -90.0, -130.0),
    (12.4, 46.0, -80.0, -127.0),
    (15.6, 43.0, -68.0, -5.0),
    (16.2, 40.0, -69.0, -4.0),
)
EMPTY_TEETH_RISE = 0.75  # m that a cycle without a payload stays higher: it touches nothing
SMOOTHING = 0.4  # s
SPILLS = (8.6, 9.3)  # s from the cycle's start: a part of the load falls out from, to
SWING, BACK = 5.2, 3.7  # s that the house turns towards the truck, and back
STEEPEST = 15.0 / 8.0  # largest slope of `plan.smooth`
TWITCH = 0.25  # s


@dataclass(frozen=True)
class Manner:
    """How the work is done. `carry_back_kg` stays in the bucket after each dump; `spilled`: share of each load that
    falls out while it is lifted; `slew_rate`: fastest turning of the house [rad/s], on its way back, None: drawn;
    `jerk` [m]: size of an unsteady hand's twitches, one in a second and cylinder."""

    carry_back_kg: tuple[float, ...] = ()
    spilled: tuple[float, ...] = ()
    slew_rate: float | None = None
    jerk: float = 0.0

    def stays(self, k: int) -> float:
        """What is in the bucket after cycle k [kg]; before the first one nothing."""
        return self.carry_back_kg[k] if 0 <= k < len(self.carry_back_kg) else 0.0

    def lost(self, k: int) -> float:
        """Share of load k that falls out on the way."""
        return self.spilled[k] if k < len(self.spilled) else 0.0

    def turn(self, rng: np.random.Generator) -> float:
        """Angle between pit and truck [rad]."""
        drawn = float(rng.uniform(0.9, 1.5) * rng.choice((-1.0, 1.0)))
        return drawn if self.slew_rate is None else float(np.sign(drawn)) * self.slew_rate * BACK / STEEPEST


STEADY = Manner()


def cycles_plan(
    site: Site,
    payloads_kg: tuple[float, ...],
    *,
    slew: bool = True,
    strength: float = 1.0,
    first: int = 1,
    manner: Manner = STEADY,
) -> Plan:
    """Empty motion, then one cycle for each payload [kg]; one of 0 kg goes through the same motion above the ground.
    The notes of a cycle tell what the bucket holds when the dumping begins, and after it."""
    rng, knots = site.rng, [(0.0, site.posture())]
    for k, kilograms in enumerate(payloads_kg):
        knots += [(HEADWAY + k * END + t, p) for t, p in _postures(site, kilograms)]
    knots.append((HEADWAY + len(payloads_kg) * END, knots[1][1]))
    path = twitching(smoothed(knots), manner.jerk, rng)
    plan = empty(path, 0.0)
    t = np.arange(plan.rows) / RATE
    slews, payload, phase, cycle = (
        np.zeros(plan.rows),
        plan.payload.copy(),
        np.full(plan.rows, float(AIR)),
        plan.cycle.copy(),
    )
    notes = []
    for k, kilograms in enumerate(payloads_kg):
        u = t - HEADWAY - k * END
        within = (u >= 0.0) & (u < END)
        cycle[within] = first + k
        phase[within] = _phase(u[within])
        fills, falls = smooth((u - ENTERS - 0.8) / (LEAVES - ENTERS - 0.8)), smooth((u - FALLS) / (FALLEN - FALLS))
        x, z = site.heap()
        before, after, held = manner.stays(k - 1), manner.stays(k), kilograms * (1.0 - manner.lost(k))
        spills = smooth((u - SPILLS[0]) / (SPILLS[1] - SPILLS[0]))
        filled = before + (kilograms - before) * fills
        mass = (filled + (held - kilograms) * spills) * (1.0 - falls) + after * falls
        payload[within] = material(mass, x, z, fills, falls)[within]
        turn = manner.turn(rng) if slew else 0.0
        slews += turn * (smooth((u - 7.4) / SWING) - smooth((u - 15.2) / BACK))
        start = HEADWAY + k * END
        note = {"cycle": first + k, "payload_kg": held, "free_s": [start + FREE, start + FALLS]}
        notes.append(note | {"carry_back_kg": after, "empty_s": [start + FALLEN, start + END]})
    return replace(
        plan,
        slew=slews,
        payload=payload,
        phase=phase,
        cycle=cycle,
        ground=soil(site.ground, strength * float(rng.uniform(0.7, 1.4))),
        notes={"cycles": notes},
    )


def material(mass: Array, x: float, z: float, fills: Array, falls: Array) -> Array:
    """Mass, centre and radius of gyration: the first lies near the teeth, the last leaves over them."""
    forward = 1.0 + 0.15 * (1.0 - fills) + 0.1 * falls
    return np.stack([mass, x * forward, z + 0.0 * mass, 0.3 + 0.0 * mass], axis=-1)


def twitching(path: Array, size: float, rng: np.random.Generator) -> Array:
    """Lengths (T, 3) of a hand that pulls its levers unsteadily."""
    if size == 0.0:
        return path
    t, found = np.arange(len(path)) / RATE, path.copy()
    for j in range(path.shape[1]):
        for begin in rng.uniform(0.0, t[-1], int(t[-1])).tolist():
            pulse = smooth((t - begin) / TWITCH) * smooth((begin + 3 * TWITCH - t) / TWITCH)
            found[:, j] += rng.uniform(-size, size) * pulse
    return found


def _phase(u: Array) -> Array:
    edges = (ENTERS, LEAVES + 0.7, FALLS, FALLEN)
    return np.array((REACH, DIG, LIFT, DUMP, RETURN), dtype=np.float64)[np.searchsorted(edges, u)]


def _postures(site: Site, payload: float) -> list[tuple[float, Array]]:
    """Times and lengths of one cycle, drawn anew."""
    rng, geometry = site.rng, site.geometry
    begin, rise = float(rng.uniform(7.0, 7.6)), 0.0 if payload > 0.0 else EMPTY_TEETH_RISE
    low, high = geometry.working.T
    found = []
    for t, x, height, attitude in TEETH:
        deep = height * float(rng.uniform(0.85, 1.15))
        pose = geometry.posture(
            begin + x, site.ground + deep + rise, np.radians(attitude + float(rng.uniform(-4.0, 4.0)))
        )
        found.append((t, np.clip(geometry.lengths(pose), low, high)))
    for t, *degrees in ARM:
        pose = np.radians(np.array(degrees) + rng.uniform(-3.0, 3.0, 3))
        found.append((t, np.clip(geometry.lengths(pose), low, high)))
    return found


def smoothed(knots: list[tuple[float, Array]]) -> Array:
    """Lengths (T, 3) through the knots, without corners of speed."""
    times, lengths = np.array([t for t, _ in knots]), np.array([p for _, p in knots])
    t = np.arange(round(times[-1] * RATE)) / RATE
    path = PchipInterpolator(times, lengths)(t)
    half = round(SMOOTHING * RATE / 2)
    window = np.hanning(2 * half + 1)
    padded = np.pad(path, ((half, half), (0, 0)), mode="edge")
    return np.stack([np.convolve(c, window / window.sum(), mode="valid") for c in padded.T], axis=-1)
