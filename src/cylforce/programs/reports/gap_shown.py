"""What the report of a gap draws, from the diagnosis' search and verdict: pure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.evidence import Blocks, Evidence, Term
from cylforce.diagnosis.problem import Problem, Seen
from cylforce.diagnosis.residuals import fixed
from cylforce.diagnosis.rows import BLOCK, RATE_HZ, Viewer
from cylforce.diagnosis.shrinkage import Gap, Simulation, written
from cylforce.diagnosis.verdict import Judged, Named, Search
from cylforce.diagnosis.where import REGIMES
from cylforce.programs.reports import evidence
from cylforce.signals.estimate import Array

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
    """The stretch in which an effect shows most: title, recording, times (T,) [s], residual (T,) [N m] without
    the effect, all else refitted, and the torque (T,) [N m] of it that the effect explains."""

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
    """What is drawn of a diagnosis."""
    return Shown(
        _heat(search, fixed(search)[0], gap.nominal, gap.left),
        _points(search.original, gap.nominal),
        _points(search.original, gap.left),
        _overlays(search, judged.named),
        _steps(search, judged, gap),
    )


def _heat(search: Search, clean: list[Array], before: list[Array], after: list[Array]) -> Heat:
    problem = search.original
    machine = problem.model.machine
    groups = ((problem.faulty, before), (problem.faulty, after), (problem.clean, clean))
    tables = [np.array([_row(problem, *g, r) for r in range(len(machine.rows))]) for g in groups]
    normal = np.where(np.isfinite(tables[2]), tables[2], search.floor.rms[:, None])
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


def _overlays(search: Search, named: tuple[Named, ...]) -> tuple[Overlay, ...]:
    """Fits without and with each named effect: the difference of their residuals is what it explains."""
    problem, terms = search.original, [c.term for c in search.causes]
    blocks = problem.blocks(search.floor)
    admitted = _left(problem, blocks, terms)
    return tuple(_overlay(search, n, _left(problem, blocks, _without(n, terms)), admitted) for n in named)


def _without(named: Named, terms: list[Term]) -> list[Term]:
    return [term for term in terms if term is not named.cause.term]


def _overlay(search: Search, named: Named, denied: list[Array], admitted: list[Array]) -> Overlay:
    machine, own = search.original.model.machine, [a - b for a, b in zip(denied, admitted, strict=True)]
    k, r, span = _most(search, own)
    seen = search.original.faulty[k]
    title = f"{readable(named.cause.key)}: {machine.links[machine.rows[r]].name} torque"
    return Overlay(title, seen.recorded.name, seen.rows.t[span], denied[k][span, r], own[k][span, r])


def _left(problem: Problem, blocks: Blocks, terms: list[Term]) -> list[Array]:
    """What is left of the faulty recordings (T, R) [N m], all fitted to all of them."""
    solved = Evidence(blocks, terms)
    each = solved.left(terms, solved.fitted)[1]
    return [
        np.einsum("trk,tk->tr", problem.columns(seen), np.repeat(each[a:b], BLOCK, axis=0)[: len(seen.rows.t)])
        for seen, (a, b) in zip(problem.faulty, problem.spans, strict=True)
    ]


def readable(key: tuple[str, str]) -> str:
    """Name and place of an effect in words."""
    return f"{key[0].replace('_', ' ')} at {key[1]}"


def _most(search: Search, own: list[Array]) -> tuple[int, int, slice]:
    """The recording, row and stretch in which a signature is largest against the floor."""
    length, best, most = round(STRETCH_S * RATE_HZ), (0, 0, slice(0, None)), -1.0
    for k, signature in enumerate(own):
        usable = np.isfinite(search.original.faulty[k].rows.left)
        squares = np.where(usable, signature / search.floor.rms, 0.0) ** 2
        totals = np.cumsum(np.vstack([np.zeros_like(squares[:1]), squares]), axis=0)
        width = min(length, len(squares))
        inside = totals[width:] - totals[:-width]
        at, r = np.unravel_index(int(np.argmax(inside)), inside.shape)
        if inside[at, r] > most:
            most, best = float(inside[at, r]), (k, int(r), slice(int(at), int(at) + width))
    return best


def _steps(search: Search, judged: Judged, gap: Gap) -> tuple[tuple[str, Array], ...]:
    """The gap as effect after effect is simulated, with the sizes that they have together."""
    named = written(search, judged)
    labels = [f"+ {readable(cause.key)}" for cause in named]
    parts = [named[: k + 1] for k in range(len(labels) - 1)]
    simulation = Simulation(search, named)
    steps = [*(_mean(simulation.left(part)) for part in parts), gap.after]
    return (
        ("as it was, parameters fixed", gap.fixed),
        ("parameters refitted", gap.refit),
        *zip(labels, steps, strict=False),
        ("noise floor", gap.floor),
    )


def _mean(residuals: list[Array]) -> Array:
    return np.asarray([_rms([e[:, r] for e in residuals]) for r in range(residuals[0].shape[1])])


def excess(heat: Heat, values: Array) -> NDArray[np.float64]:
    """Residual (R, G) in multiples of that of the machine in order."""
    return np.asarray(values / heat.normal)
