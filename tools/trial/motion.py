"""What a machine of the trial does: strokes, stairs of still postures, several sines at once, normal work."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from reference_machine.machine import RUN, Machine, Stage, stream
from reference_machine.plan import DIG, RATE, Path, Plan, smooth
from reference_machine.site import Site

Array = NDArray[np.float64]
KINDS = ("strokes", "stairs", "sines", "work")
NEAR_S = 0.5  # of a load or of soil, what the filters carry to the rows around it
CYCLE_S = 27.0  # the shortest normal work: some empty motion and one cycle
TRIES = 40
SMALLER = 0.85


def stage(
    machine: Machine,
    kind: str,
    seconds: float,
    run: int,
    *,
    slope: tuple[float, float] | None = None,
    degc: float = 40.0,
    load_kg: float = 0.0,
    slew: bool = True,
) -> Stage:
    """A recording that is planned: run number `run` of the machine, on a slope [deg], with a load all the time."""
    pitch, roll = slope or (None, None)
    common = {"seed": run, "pitch_deg": pitch, "roll_deg": roll, "oil_degc": degc, "slew": slew}
    if kind == "work":
        return machine.stage("cycles", duration_s=max(seconds, CYCLE_S), **common)  # type: ignore[arg-type]
    made = machine.stage("commissioning", duration_s=seconds, payload_kg=load_kg, **common)  # type: ignore[arg-type]
    if kind == "strokes":
        return made
    (plan,), rng = made.plans, stream(machine.seed, RUN, run, 1)
    site = Site(machine.geometry, rng, haste=1.0 / (1.0 + load_kg / machine.geometry.specimen.sheet.rated_payload))
    lengths = {"stairs": stairs, "sines": sines}[kind](site, plan.rows)
    turn = turning(rng, plan.rows) if slew and kind == "sines" else np.zeros(plan.rows)
    return replace(made, plans=[replace(plan, lengths=lengths, slew=turn)])


Motion = Callable[[Site, int], Array]


def stairs(site: Site, rows: int) -> Array:
    """Lengths (T, 3): a step with one joint, a rest of 0.7-3 s; a new posture now and then."""
    path = Path(site.posture())
    path.rest(1.0)
    while path.rows < rows:
        joint, way = int(site.rng.integers(3)), float(site.rng.choice((-1.0, 1.0)))
        for _ in range(int(site.rng.integers(2, 6))):
            target = path.now.copy()
            target[joint] += way * float(site.rng.uniform(0.05, 0.25))
            low, high = site.geometry.working.T
            if np.any(target < low) or np.any(target > high) or not site.clear(path.sketch(target, 0.1)):
                break
            path.go(target, float(site.rng.uniform(0.05, 0.15)))
            path.rest(float(site.rng.uniform(0.7, 3.0)))
        site.go(path)
        path.rest(float(site.rng.uniform(0.7, 3.0)))
    return path.done()[:rows]


def sines(site: Site, rows: int) -> Array:
    """Lengths (T, 3): four to seven sines of 0.02-0.5 Hz in each joint, as wide as there is room and speed."""
    t, (low, high) = np.arange(rows) / RATE, site.geometry.working.T
    while True:
        waves = np.stack([_waves(site.rng, t) for _ in range(3)], axis=-1)
        middle, wide = site.posture(), 0.5 * (high - low)
        fastest = np.abs(np.diff(waves, axis=0)).max(axis=0) * RATE
        wide = np.minimum(wide, site.quickest / fastest)
        for _ in range(TRIES):
            path = np.clip(middle + wide * waves, low, high)
            inside = np.all(np.abs(path - middle - wide * waves) < 1e-9)
            if inside and site.clear(path):
                return np.asarray(path)
            wide = wide * SMALLER
            middle = SMALLER * middle + (1.0 - SMALLER) * 0.5 * (low + high)


def _waves(rng: np.random.Generator, t: Array) -> Array:
    """A sum of sines (T,), at most 1, that begins at rest."""
    count = int(rng.integers(4, 8))
    hertz, phase = np.exp(rng.uniform(np.log(0.02), np.log(0.5), count)), rng.uniform(0.0, 2.0 * np.pi, count)
    sum_of = np.sum(np.sin(2.0 * np.pi * hertz * t[:, None] + phase) / np.sqrt(hertz), axis=1) * smooth(t / 3.0)
    return np.asarray(sum_of / np.abs(sum_of).max())


def turning(rng: np.random.Generator, rows: int) -> Array:
    """Slewing to and fro (T,) [rad], with rests of 1-10 s."""
    turn, clock, angle = np.zeros(rows), float(rng.uniform(3.0, 20.0)), 0.0
    t = np.arange(rows) / RATE
    while clock < rows / RATE - 8.0:
        time, target = float(rng.uniform(4.5, 7.5)), float(rng.uniform(-1.3, 1.3))
        turn += (target - angle) * smooth((t - clock) / time)
        angle, clock = target, clock + time + float(rng.uniform(1.0, 10.0))
    return turn


def quiet(plan: Plan, known: bool) -> NDArray[np.bool_]:
    """Whether nothing unknown acts (T,): no soil, and no load unless it is known, nor just before or after."""
    acts = plan.phase == DIG
    if not known:
        acts = acts | (plan.payload[:, 0] > 1.0)
    near = np.convolve(acts, np.ones(round(2 * NEAR_S * RATE) + 1), "same") > 0.5
    return np.asarray(~near)


def standing(plan: Plan) -> Plan:
    """The plan while the boom stays where it is at the begin."""
    lengths = plan.lengths.copy()
    lengths[:, 0] = lengths[0, 0]
    return replace(plan, lengths=lengths)
