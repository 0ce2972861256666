"""Recordings of a machine in order that was at work: while the teeth touch the ground, or a load of which nothing is
known hangs in the bucket, they tell nothing of the machine itself. These blocks of three seconds do not count.

Least trimmed squares (Rousseeuw and Van Driessen 2006): the machine is fitted to the share of the blocks in which least
is left, until these stay the same, from a fit to each of many single blocks on, for which the machine's prior is
enough; of these the one that leaves least. Then every block counts in which no plausible load and no plausible force
at the teeth is seen, as far as those that count already tell the machine."""

from collections.abc import Sequence
from typing import NamedTuple

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

QUIET = 0.25  # of the rows, with which the search begins: so much of its time a digging machine is empty (physics)
STARTS = 64  # single blocks from which the search begins, at most twice as many
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
    sums = _Sums.of(problem, blocks)
    usable = np.any(sums.rows > 0.0, axis=1)
    if not np.any(usable):
        return np.asarray(~usable)
    starts = np.flatnonzero(usable)[:: max(int(np.sum(usable)) // STARTS, 1)]
    each = [sums.quietest(np.arange(len(usable)) == start) for start in starts]
    kept, _ = min(each, key=lambda found: found[1])
    for _ in range(ROUNDS):
        now = usable & ~_works(problem, blocks, sums, kept)
        if np.array_equal(now, kept) or not np.any(now):
            break
        kept = now
    return np.asarray(kept | ~usable)


class _Sums(NamedTuple):
    """Products (B, R, K+1, K+1) of the machine's own columns and of what the model leaves, last, over every block; how
    many rows (B, R) are usable; prior precision (K, K)."""

    products: Array
    rows: Array
    prior: Array

    @classmethod
    def of(cls, problem: Problem, blocks: Array) -> "_Sums":
        """Of blocks (B, BLOCK, R, N)."""
        own = blocks[..., [*range(problem.lasting), -1]]
        products = np.einsum("btri,btrj->brij", own, own, optimize=True)
        return cls(products, np.sum(own[..., -1] != 0.0, axis=1), np.diag(problem.spread[: problem.lasting] ** -2.0))

    def fit(self, kept: Blocks) -> tuple[Array, Array]:
        """Values (K,) of the machine's own columns by least squares of some blocks, and what they leave, rms (R,):
        infinite at a joint with no more rows than there are columns, which fit any."""
        products, rows = self.products[kept].sum(axis=0), self._enough(self.rows[kept].sum(axis=0))
        scale, values = _rms(products[:, -1, -1], rows), np.zeros(len(self.prior))
        for _ in range(2):
            whole = np.einsum("rij,r->ij", products, scale**-2.0)
            values = np.linalg.solve(whole[:-1, :-1] + self.prior, whole[:-1, -1])
            scale = _rms(_energy(products, values), rows)
        return values, scale

    def _enough(self, rows: Array) -> Array:
        """Numbers of rows (R,), 0 where they are too few to show what a fit leaves."""
        return np.where(rows > len(self.prior), rows, 0.0)

    def quietest(self, kept: Blocks) -> tuple[Blocks, float]:
        """The blocks (B,) with QUIET of the rows in which least is left per row by a fit to these themselves, from a
        fit to `kept` on; the sum of the logarithms of what is left there, infinite where a joint has too few rows."""
        rows, scale = self.rows.sum(axis=1), np.ones(self.rows.shape[1])
        for _ in range(ROUNDS):
            values, scale = self.fit(kept)
            order = np.argsort(_energy(self.products, values) @ scale**-2.0 / np.where(rows > 0.0, rows, np.nan))
            now = np.zeros_like(kept)
            now[order] = np.cumsum(rows[order]) <= QUIET * np.sum(rows)
            if np.array_equal(now, kept) or not np.any(now):
                break
            kept = now
        return kept, float(np.sum(np.log(scale[self._enough(self.rows.sum(axis=0)) > 0.0])))


def _energy(products: Array, values: Array) -> Array:
    """Sums of squares (..., R) that values (K,) leave."""
    left = np.append(-values, 1.0)
    return np.asarray(np.maximum(np.einsum("...ij,i,j->...", products, left, left, optimize=True), 0.0))


def _rms(squares: Array, rows: Array) -> Array:
    return np.asarray(np.sqrt(np.divide(squares, rows, out=np.full(rows.shape, np.inf), where=rows > 0.0))) + 1e-9


def _works(problem: Problem, blocks: Array, sums: _Sums, kept: Blocks) -> Blocks:
    """The blocks (B,) in which a load or a force at the teeth is at least of the least plausible size, and stands
    out against what is left and how well the `kept` ones tell the machine: as if all samples of a block erred alike."""
    values, scale = sums.fit(kept)
    unit, size = scale * np.sqrt(BLOCK), len(values)
    own = blocks[..., :size] / unit[:, None]
    left = (blocks[..., -1] - blocks[..., :size] @ values) / unit
    each = np.einsum("brij,r->bij", sums.products[..., :-1, :-1], unit**-2.0)
    other = ~kept[:, None, None]  # these tell nothing of the machine yet
    whole = each[kept].sum(axis=0) + sums.prior + np.where(other, each, 0.0)
    own_left = np.where(other, np.einsum("btri,btr->bi", own, left, optimize=True)[..., None], 0.0)
    found = np.zeros(len(blocks), dtype=np.bool_)
    for places, least in LEAST.items():
        usual = problem.unusual[list(places)]
        columns = blocks[..., [problem.lasting + k for k in places]] * usual / unit[:, None]
        across = np.einsum("btri,btrj->bij", own, columns, optimize=True)
        gram = np.einsum("btri,btrj->bij", columns, columns, optimize=True) + np.eye(len(places))
        pull = np.einsum("btri,btr->bi", columns, left, optimize=True)[..., None]
        beside = np.linalg.solve(whole, np.concatenate([across, own_left], axis=-1))
        told = np.swapaxes(across, 1, 2) @ beside
        gram, pull = gram - told[..., :-1], pull - told[..., -1:]
        sizes = np.linalg.solve(gram, pull)
        gain, magnitude = (
            np.sum(pull * sizes, axis=(1, 2)),
            np.linalg.norm((sizes[..., 0] * usual)[:, TAKEN[places]], axis=1),
        )
        found |= (magnitude >= least) & (gain >= SIGMAS**2)
    return found
