"""The shape of what no effect explains: at which joint it is, and what it goes with: the joint's position, its
cylinder's speed, a cylinder's force, time, or nothing but few moments."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander

from cylforce.diagnosis.columns.problem import Problem
from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.inference.residuals import SPAN, rms
from cylforce.diagnosis.numbers import HALF, SLIGHT
from cylforce.signals.estimate import Array

BENDS = 8  # Legendre polynomials of a curve: as fine as the motion's own periods allow
MOVING = 0.01  # m/s, where a cylinder is half certain of its direction
TENTH = 10  # in one of so many blocks is what is there in few moments


class Abscissa(NamedTuple):
    """Something (T,) of all faulty rows that a torque may go with, `of` which kind, in words `detail`."""

    of: str
    detail: str
    values: Array


def quantities(problem: Problem, row: int) -> tuple[list[Abscissa], Array]:
    """Those of a measured joint, and its cylinder's direction (T,) -1..1."""
    machine, own, rows = problem.model.machine, problem.model.acting[row][0], [s.rows for s in problem.faulty]
    speed, force = (np.concatenate([getattr(r, name) for r in rows]) for name in ("speed", "force"))
    position = np.concatenate([r.posture[:, machine.rows[row]] for r in rows])
    loads = sorted(range(len(machine.cylinders)), key=lambda c: c != own)
    found = [Abscissa("position", "", position), Abscissa("speed", "", np.arcsinh(speed[:, own] / MOVING))]
    found += [Abscissa("load", f"force of the {machine.cylinders[c].name} cylinder", force[:, c]) for c in loads]
    return [*found, Abscissa("time", "", np.concatenate([r.t for r in rows]))], np.tanh(speed[:, own] / MOVING)


def unexplained(problem: Problem, left: Sequence[Array], floor: Array) -> dict[str, Any]:
    """The shape of residuals (T, R) [N m] of the faulty recordings beyond the `floor` (R,), of the joint that has most:
    the share of its excess energy that a curve over one quantity foresees on stretches that it was not fitted to."""
    row = int(np.argmax(rms(left) / floor))
    span = np.concatenate([1000 * k + np.arange(len(e)) // (SPAN * BLOCK) for k, e in enumerate(left)])
    torque = np.concatenate([e[:, row] for e in left])
    good = np.isfinite(torque)
    excess = max(float(np.mean(torque[good] ** 2) - floor[row] ** 2), 1e-9)
    each, way = quantities(problem, row)
    shares = [_foreseen(torque[good], _curve(q.values, way)[good], span[good] % 2) / excess for q in each]
    found = [(q.of, q.detail, s) for q, s in zip(each, shares, strict=True)]
    found.sort(key=lambda f: -f[2])
    few = _few(torque, floor[row]) / excess
    if found[0][2] < SLIGHT:
        found.insert(0, ("moments", "", few) if few > HALF else ("none", "", 0.0))
    first, *others = [{"of": o, "detail": d, "share": float(np.clip(s, 0.0, 1.0))} for o, d, s in found]
    at = problem.model.machine.links[problem.model.machine.rows[row]].name
    return {"at": at, **first, "alternatives": [o for o in others if o["share"]][:3]}


def _curve(x: Array, way: Array) -> Array:
    """A smooth curve over x (T,), and another one that turns with the direction: columns (T, 2 BENDS)."""
    low, high = np.percentile(x, [1.0, 99.0])
    bends = legvander(np.clip(2.0 * (x - low) / max(high - low, 1e-9) - 1.0, -1.0, 1.0), BENDS - 1)
    return np.hstack([bends, bends * way[:, None]])


def _foreseen(torque: Array, columns: Array, fold: Array) -> float:
    """Mean square that columns take away from each half when they are fitted to the other."""
    rest = 0.0
    for k in (0, 1):
        sizes = np.linalg.lstsq(columns[fold != k], torque[fold != k], rcond=1e-6)[0]
        rest += float(np.sum((torque[fold == k] - columns[fold == k] @ sizes) ** 2))
    return float(np.mean(torque**2)) - rest / len(torque)


def _few(torque: Array, floor: float) -> float:
    """Mean square beyond the floor's that the worst tenth of all blocks makes."""
    blocks = np.array_split(torque, -(-len(torque) // BLOCK))
    above = np.sort([float(np.nansum(b**2 - floor**2)) for b in blocks])[::-1]
    return float(np.sum(above[: -(-len(above) // TENTH)])) / max(int(np.sum(np.isfinite(torque))), 1)
