"""What the report of a gap draws, from the diagnosis' search and verdict: pure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.answer.shrinkage import Gap, Simulation, written
from cylforce.diagnosis.answer.verdict import Judged, Search
from cylforce.diagnosis.answer.where import REGIMES
from cylforce.diagnosis.columns.problem import Problem, Seen
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.residuals import rms
from cylforce.effects.fault import Place
from cylforce.effects.library import Proposal
from cylforce.mechanics.machine import Machine
from cylforce.programs.reports import evidence
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

STRETCH_S = 30.0


class Heat(NamedTuple):
    """Residual [N m, rms] of R joints in G regimes (R, G): `before`, `after`, and `normal` in recordings of the machine
    in order."""

    joints: tuple[str, ...]
    regimes: tuple[str, ...]
    before: Array
    after: Array
    normal: Array


class Overlay(NamedTuple):
    """The stretch in which an effect shows most at the joint it acts on: title, recording, times (T,) [s], residual
    (T,) [N m] without the effect, and the torque (T,) [N m] of it that the effect explains, simulated."""

    title: str
    recording: str
    t: Array
    residual: Array
    effect: Array


class Shown(NamedTuple):
    """All that is drawn: heat map; samples of all faulty recordings, thinned, `before` and `after` (as `push` takes
    them, residual as measured torque); overlays; `steps`: (label, residual (R,) [N m, rms])."""

    heat: Heat
    before: evidence.DrawnSamples
    after: evidence.DrawnSamples
    overlays: tuple[Overlay, ...]
    steps: tuple[tuple[str, Array], ...]


def shown(search: Search, judged: Judged, gap: Gap) -> Shown:
    """What is drawn of a diagnosis; of a machine at work nothing as simulated."""
    judged = judged._replace(named=()) if search.working else judged
    causes = written(judged)
    simulation = Simulation(search, causes)
    stages = [gap.nominal, *(simulation.left(causes[:k]) for k in range(1, len(causes))), *([gap.left] * bool(causes))]
    labels = ("parameters refitted", *(f"+ {readable(cause.key)}" for cause in causes), "noise floor")
    sizes = (gap.refit, *(rms(stage) for stage in stages[1:]), gap.floor)
    return Shown(
        _heat(search, gap),
        _points(search.original, gap.nominal),
        _points(search.original, gap.left),
        tuple(_overlay(search, n.cause.proposal, *stages[k : k + 2]) for k, n in enumerate(judged.named)),
        (("as it was, parameters fixed", gap.fixed), *zip(labels, sizes, strict=True)),
    )


def _heat(search: Search, gap: Gap) -> Heat:
    problem = search.original
    machine = problem.model.machine
    groups = (
        (problem.faulty, gap.nominal),
        (problem.faulty, gap.left),
        (problem.clean if gap.clean else (), gap.clean),
    )
    tables = [np.array([_row(problem, *g, r) for r in range(len(machine.rows))]) for g in groups]
    normal = np.where(np.isfinite(tables[2]), tables[2], gap.floor[:, None])
    return Heat(tuple(machine.links[j].name for j in machine.rows), tuple(REGIMES), tables[0], tables[1], normal)


def _row(problem: Problem, seen: tuple[Seen, ...], residuals: list[Array], r: int) -> list[float]:
    """Residual of a joint in every regime; NaN where there is none."""
    c, j = problem.model.acting[r][0], problem.model.machine.rows[r]
    pairs = list(zip(seen, residuals, strict=True))
    return [_rms([e[regime(s, c, j), r] for s, e in pairs]) for regime in REGIMES.values()]


def _rms(parts: list[Array]) -> float:
    values = np.concatenate([*parts, np.zeros(0)])
    good = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(good**2))) if good.size else float("nan")


def _points(problem: Problem, residuals: list[Array]) -> evidence.DrawnSamples:
    viewer = Viewer(problem.model, np.zeros(len(problem.model.parameters)))
    joints, cylinders = movers(problem)
    parts = []
    for seen, left in zip(problem.faulty, residuals, strict=True):
        moved = evidence.drives(viewer.slow, joints, cylinders, viewer.thinned(seen.recorded.values))
        parts.append(evidence.DrawnSamples(left, np.zeros_like(left), seen.rows.posture, *moved))
    step = -(-sum(len(p.speed) for p in parts) // evidence.MOST_POINTS)
    return evidence.DrawnSamples(*(np.concatenate(column)[::step] for column in zip(*parts, strict=True)))


def movers(problem: Problem) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The joints whose torque is measured, and the cylinder that moves each."""
    model = problem.model
    return tuple(model.machine.rows), tuple(acting[0] for acting in model.acting)


def acts_on(machine: Machine, proposal: Proposal) -> list[int]:
    """The measured joints, by row, on which an effect acts by itself: those that its cylinder, sensor or link moves."""
    place, where = proposal.about.place, proposal.where
    joints: tuple[int, ...] = machine.rows
    if place in (Place.PRESSURE, Place.ANGLE, Place.SENSOR):
        signal = machine.signals[where]
        angle = signal.kind in (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
        joints = (signal.index,) if angle else machine.spans[signal.index]
    elif place is Place.CYLINDER:
        joints = machine.spans[where]
    elif place is Place.LINK:
        joints = (where,)
    return [r for r, j in enumerate(machine.rows) if j in joints] or list(range(len(machine.rows)))


def _overlay(search: Search, proposal: Proposal, denied: list[Array], admitted: list[Array]) -> Overlay:
    machine, own = search.original.model.machine, [a - b for a, b in zip(denied, admitted, strict=True)]
    k, r, span = _most(search, own, acts_on(machine, proposal))
    seen = search.original.faulty[k]
    title = f"{readable((proposal.name, proposal.at))}: {machine.links[machine.rows[r]].name} torque"
    return Overlay(title, seen.recorded.name, seen.rows.t[span], denied[k][span, r], own[k][span, r])


def readable(key: tuple[str, str]) -> str:
    """Name and place of an effect in words."""
    return f"{key[0].replace('_', ' ')} at {key[1]}" if key[1] else key[0]


def _most(search: Search, own: list[Array], rows: list[int]) -> tuple[int, int, slice]:
    """The recording, one of some rows and the stretch in which a signature is largest against the floor."""
    length, best, most = round(STRETCH_S * search.viewer.rows_hz), (0, rows[0], slice(0, None)), -1.0
    for k, signature in enumerate(own):
        squares = np.nan_to_num((signature / search.question.floor.rms)[:, rows]) ** 2
        totals = np.cumsum(np.vstack([np.zeros_like(squares[:1]), squares]), axis=0)
        width = min(length, len(squares))
        inside = totals[width:] - totals[:-width]
        at, r = np.unravel_index(int(np.argmax(inside)), inside.shape)
        if inside[at, r] > most:
            most, best = float(inside[at, r]), (k, rows[int(r)], slice(int(at), int(at) + width))
    return best


def excess(heat: Heat, values: Array) -> NDArray[np.float64]:
    """Residual (R, G) in multiples of that of the machine in order."""
    return np.asarray(values / heat.normal)
