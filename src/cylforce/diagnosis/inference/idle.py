"""Recordings of a machine in order that was at work: while the teeth touch the ground, or a load of which nothing is
known hangs in the bucket, they tell nothing of the machine itself. These blocks of three seconds do not count.

Least trimmed squares (Rousseeuw and Van Driessen 2006): the machine is fitted to the share of the blocks in which least
is left, until these stay the same; then every block counts in which no plausible load and no plausible force at the
teeth is seen."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.problem import Problem, looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import BLOCK, Viewer
from cylforce.diagnosis.columns.statistics import blocked
from cylforce.diagnosis.numbers import SIGMAS
from cylforce.effects.fault import INCIDENTAL, SHAPES
from cylforce.effects.incidents.payload_spill import PayloadSpill
from cylforce.effects.loads.tip_force import TipForce
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

ROUNDS = 20  # at most, of either search
LOADS = tuple(INCIDENTAL.index(name) for name in ("load.mass", "load.X", "load.Z"))
TIPS = tuple(INCIDENTAL.index(f"tip.{axis}.{k}") for k in range(SHAPES) for axis in "xz")
LEAST = {LOADS: PayloadSpill().about.low, TIPS: TipForce().about.low}  # plausible sizes [kg, N]
TAKEN = {LOADS: slice(0, 1), TIPS: slice(None)}  # the coefficients that are the magnitude

QUIET = 0.4  # of the blocks, with which the search begins: those in which least is left
Blocks = NDArray[np.bool_]


def idle(model: Model, clean: Sequence[Recorded]) -> list[Recorded]:
    """The same recordings, with the rows that count told. One whose every block is work keeps all of them."""
    if not clean:
        return []
    viewer = Viewer(model, model.prior.mean)
    spread = np.sqrt(np.diag(model.prior.covariance))
    problem = Problem(model, spread, (), looked_at(viewer, clean, ()), (), tares=viewer.tares)
    each = [_blocked(problem.columns(seen)) for seen in problem.clean]
    kept = _at_rest(problem, np.concatenate(each))
    if not np.any(kept):
        return list(clean)
    found, first = [], 0
    for seen, blocks in zip(problem.clean, each, strict=True):
        own = np.repeat(kept[first : first + len(blocks)], BLOCK)[: len(seen.rows.t)]
        found.append(seen.recorded._replace(counts=own))
        first += len(blocks)
    return found


def _blocked(columns: Array) -> Array:
    """Columns (T, R, K+1) as blocks (B, BLOCK, R, K+1), zero where not usable."""
    return blocked(np.where(np.all(np.isfinite(columns), axis=-1, keepdims=True), columns, 0.0))


def _at_rest(problem: Problem, blocks: Array) -> Blocks:
    """The blocks (B,) that count, or that tell nothing anyhow."""
    usable = np.any(blocks[..., -1] != 0.0, axis=(1, 2))
    kept, values, scale = usable, np.zeros(problem.lasting), np.ones(blocks.shape[2])
    for _ in range(ROUNDS):
        values, scale = _fit(problem, blocks[kept])
        energy = np.where(usable, np.sum(_left(blocks, values) ** 2 / scale**2, axis=(1, 2)), np.inf)
        now = energy <= np.quantile(energy[usable], QUIET)
        if np.array_equal(now, kept):
            break
        kept = now
    for _ in range(ROUNDS):
        now = usable & ~_works(problem, blocks, values, scale)
        if np.array_equal(now, kept) or not np.any(now):
            break
        kept = now
        values, scale = _fit(problem, blocks[kept])
    return np.asarray(kept | ~usable)


def _fit(problem: Problem, blocks: Array) -> tuple[Array, Array]:
    """Values (K,) of the machine's own columns by least squares, and what they leave, rms (R,)."""
    own, prior = blocks[..., : problem.lasting], np.diag(problem.spread[: problem.lasting] ** -2.0)
    scale, values = _rms(blocks[..., -1]), np.zeros(problem.lasting)
    for _ in range(2):
        x, y = own / scale[:, None], blocks[..., -1] / scale
        gram = np.einsum("btri,btrj->ij", x, x, optimize=True)
        values = np.linalg.solve(gram + prior, np.einsum("btri,btr->i", x, y, optimize=True))
        scale = _rms(_left(blocks, values))
    return values, scale


def _left(blocks: Array, values: Array) -> Array:
    return np.asarray(blocks[..., -1] - blocks[..., : len(values)] @ values)


def _rms(x: Array) -> Array:
    count = np.maximum(np.sum(x != 0.0, axis=(0, 1)), 1)
    return np.asarray(np.sqrt(np.sum(x**2, axis=(0, 1)) / count)) + 1e-9


def _works(problem: Problem, blocks: Array, values: Array, scale: Array) -> Blocks:
    """The blocks (B,) in which a load or a force at the teeth is at least of the least plausible size, and stands
    out: its error is the rms of what is left, as if all samples of a block erred alike."""
    left, found = _left(blocks, values) / scale, np.zeros(len(blocks), dtype=np.bool_)
    for own, least in LEAST.items():
        columns = blocks[..., [problem.lasting + k for k in own]] / scale[:, None]
        unit = problem.unusual[list(own)]
        columns = columns * unit / np.sqrt(BLOCK)
        gram = np.einsum("btri,btrj->bij", columns, columns, optimize=True) + np.eye(len(own))
        pull = np.einsum("btri,btr->bi", columns, left / np.sqrt(BLOCK), optimize=True)
        sizes = np.linalg.solve(gram, pull[..., None])[..., 0]
        gain = np.einsum("bi,bi->b", pull, sizes)
        magnitude = np.linalg.norm((sizes * unit)[:, TAKEN[own]], axis=1)
        found |= (magnitude >= least) & (gain >= SIGMAS**2)
    return found
