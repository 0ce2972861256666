"""The smooth discrepancy of every joint, and its noise: Gram matrices of a recording under both, the level and the
scale that are likeliest, and what may happen at single moments."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.statistics import SMOOTH, Statistics, White, blocked, polynomials
from cylforce.diagnosis.numbers import HAPPENS, LEVEL_CHANGE, SCALE_CHANGE, TAIL, USUAL_SIZES
from cylforce.signals.estimate import Array

DECAY = 1.0 / (1.0 + np.arange(SMOOTH)) ** 2  # variance of the discrepancy's polynomials: that of a smooth function
LEVELS = np.exp(np.arange(np.log(0.05), np.log(300.0), 0.15))  # rho, of a joint's white noise
SCALES = np.exp(np.arange(np.log(0.3), np.log(6.0), 0.03))  # v, of a joint's white noise
APART = np.log(LEVEL_CHANGE), np.log(SCALE_CHANGE)
RHO, V = (each.ravel() for each in np.meshgrid(LEVELS, SCALES, indexing="ij"))  # all pairs (G,) that are tried
VARIANCE = V**2 + RHO**2 * DECAY[:, None]  # (SMOOTH, G) along each polynomial


class Scatter(NamedTuple):
    """Of every joint (R,): level of the discrepancy and scale of the noise; `unsure`: times as uncertain as between
    two recordings of one machine is what is usual, of every joint alike or (R,) (of the usual noise only); `everyday`:
    how large the machine's everyday differences are, of what is usual."""

    rho: Array
    v: Array
    unsure: float | Array = 1.0
    everyday: float = 1.0

    @property
    def share(self) -> Array:
        """The discrepancy's share (R, SMOOTH) of the variance along each polynomial."""
        smooth = self.rho[:, None] ** 2 * DECAY
        return np.asarray(smooth / (self.v[:, None] ** 2 + smooth))

    def weight(self, theirs: Array) -> Array:
        """The weight (R, 1+SMOOTH) of products of noise, whole and along each polynomial. Where the sensors would make
        more noise, `theirs` (R,) per row, than there is, all of it is theirs."""
        own = np.concatenate([np.ones((len(self.rho), 1)), -self.share], axis=1)
        return np.asarray(own / np.maximum(self.v**2, theirs)[:, None])


@dataclass(frozen=True)
class Sums:
    """Gram matrices of a recording, in units of the columns' prior spread, last column what is left: `whole`
    (R, K+1, K+1), `smooth` (R, SMOOTH, K+1, K+1), rows (R,) and blocks (R,) counted; `crossed` (S, R, 1+SMOOTH, K+1):
    samples that add up to what of the product with what is left, whole and along each polynomial, is sensor noise in
    both."""

    whole: Array
    smooth: Array
    rows: Array
    blocks: Array
    crossed: Array

    def information(self, noise: Scatter) -> Array:
        """X' P X (K+1, K+1), P the inverse covariance of noise and discrepancy."""
        scale, size = noise.v**-2.0, self.whole.shape[-1]
        smooth = (noise.share * scale[:, None]).ravel() @ self.smooth.reshape(-1, size * size)
        return np.asarray(scale @ self.whole.reshape(len(scale), -1) - smooth).reshape(size, size)

    @property
    def theirs(self) -> Array:
        """Energy of the sensors' noise in what is left (R,), per row."""
        return np.asarray(np.sum(self.crossed[:, :, 0, -1], axis=0) / np.maximum(self.rows, 1.0))

    def common(self, noise: Scatter) -> tuple[Array, Array]:
        """What noise in both adds to X' P y (K,): errors in variables; and how its samples differ (S, K), the products
        of which add up to its covariance. No more of it than there is noise at all."""
        each = np.einsum("rq,srqk->sk", noise.weight(self.theirs), self.crossed[..., :-1], optimize=True)
        return each.sum(axis=0), each - np.sum(each, axis=0) / max(len(each), 1)

    def with_noise(self, lost: Array) -> "Sums":
        """The same with the energy of the sensors' noise (R, 1+SMOOTH), per row and per block along each polynomial,
        that a correction of the readings took away: recordings with less noise are not by that more probable. No more
        of it than there is noise at all."""
        given = np.minimum(1.0, 1.0 / np.maximum(self.theirs, 1e-300))[:, None] * lost
        whole, smooth = self.whole.copy(), self.smooth.copy()
        whole[:, -1, -1] += self.rows * given[:, 0]
        smooth[:, :, -1, -1] += self.blocks[:, None] * given[:, 1:]
        return replace(self, whole=whole, smooth=smooth)

    def with_products(self, unit: Array, places: Sequence[int], whole: Array, smooth: Array) -> "Sums":
        """The same with other products of the columns `places`, (R, M, K+1) and (R, SMOOTH, M, K+1); `unit` (K+1,):
        of the columns."""
        both = np.outer(unit[places], unit)
        found = self.whole.copy(), self.smooth.copy()
        for old, new in zip(found, (whole * both, smooth * both), strict=True):
            old[..., places, :], old[..., :, places] = new, np.swapaxes(new, -1, -2)
        return replace(self, whole=found[0], smooth=found[1])

    def norm(self, noise: Scatter) -> float:
        """What of the logarithm of the likelihood depends on noise alone."""
        each = np.log1p(noise.rho[:, None] ** 2 * DECAY / noise.v[:, None] ** 2)
        smooth = 0.5 * self.blocks * np.sum(each, axis=1)
        return float(-np.sum(self.rows * np.log(noise.v) + smooth))

    def energies(self, coefficients: Array, covariance: Array) -> tuple[Array, Array]:
        """Expected energies, white (R,) and along each polynomial (R, SMOOTH), of what coefficients (K+1,) leave whose
        first K have a covariance."""
        second = np.outer(coefficients, coefficients)
        second[:-1, :-1] += covariance
        whole, smooth = (each.reshape(*each.shape[:-2], -1) @ second.ravel() for each in (self.whole, self.smooth))
        return whole - np.sum(smooth, axis=1), smooth

    def plain(self, left: Array) -> tuple[Array, Array]:
        """Energies, white (H, R) and along each polynomial (H, R, SMOOTH), of what coefficients (H, K+1) leave that are
        certain."""
        whole = np.einsum("hi,rhi->hr", left, left @ self.whole)
        smooth = np.einsum("hi,rkhi->hrk", left, left @ self.smooth)
        return whole - np.sum(smooth, axis=2), smooth


def sums(spread: Array, parts: Sequence[Statistics]) -> Sums:
    """The sums of recordings together; `spread` (K,): units of the columns."""
    unit = np.append(spread, 1.0)
    whole = np.sum([p.whole for p in parts], axis=0) * np.outer(unit, unit)
    each = [np.einsum("brki,brkj->rkij", p.smooth, p.smooth, optimize=True) for p in parts]
    rows = np.sum([np.sum(p.rows, axis=0) for p in parts], axis=0)
    blocks = np.sum([np.sum(p.rows > 0.0, axis=0) for p in parts], axis=0)
    crossed = np.concatenate([p.crossed for p in parts]) * unit
    return Sums(whole, np.sum(each, axis=0) * np.outer(unit, unit), rows, blocks.astype(np.float64), crossed)


def together(each: Sequence[Sums]) -> Sums:
    """Recordings as one."""
    whole, smooth, rows, blocks = (
        np.sum([getattr(s, name) for s in each], axis=0) for name in ("whole", "smooth", "rows", "blocks")
    )
    return Sums(whole, smooth, rows, blocks, np.concatenate([s.crossed for s in each]))


def likeliest(found: Sums, white: Array, smooth: Array, usual: Scatter | None) -> tuple[Scatter, Array]:
    """Level and scale of every joint (H, R) that make energies (H, R), (H, R, SMOOTH) most probable, and of every
    hypothesis the log likelihood with their prior (H,)."""
    levels, scales, log = np.zeros(white.shape), np.zeros(white.shape), np.zeros(len(white))
    for r in range(white.shape[1]):
        fixed = -found.rows[r] * np.log(V) - 0.5 * found.blocks[r] * np.sum(np.log(VARIANCE / V**2), axis=0)
        before = log_prior(RHO, V, usual, r) if usual else np.zeros_like(V)
        told = fixed + before - 0.5 * white[:, r, None] / V**2 - 0.5 * smooth[:, r] @ (1.0 / VARIANCE)
        best = np.argmax(told, axis=1)
        levels[:, r], scales[:, r] = RHO[best], V[best]
        log += told[np.arange(len(told)), best]
    return Scatter(levels, scales), log


def settled_noise(found: Sums, energies: tuple[Array, Array], usual: Scatter | None) -> Scatter:
    """The likeliest level and scale of every joint (R,) for energies (R,), (R, SMOOTH)."""
    noise = likeliest(found, energies[0][None], energies[1][None], usual)[0]
    return Scatter(noise.rho[0], noise.v[0])


def allowed(found: Sums, white: Array, smooth: Array) -> Array:
    """The largest level of the discrepancy of every joint (R,) that energies (R,), (R, SMOOTH) allow: half a nat, one
    standard error, below the likeliest. Whatever is small beside the noise is as likely as nothing at all."""
    levels = np.zeros(len(white))
    for r in range(len(white)):
        fixed = -found.rows[r] * np.log(V) - 0.5 * found.blocks[r] * np.sum(np.log(VARIANCE / V**2), axis=0)
        told = fixed - 0.5 * white[r] / V**2 - 0.5 * smooth[r] @ (1.0 / VARIANCE)
        best = np.max(told.reshape(len(LEVELS), -1), axis=1)
        levels[r] = LEVELS[np.flatnonzero(best >= np.max(best) - 0.5)[-1]]
    return levels


def log_prior(rho: Array, v: Array, usual: Scatter, joint: int) -> Array:
    """Log density of level and scale: what references show, and the flat tail."""
    unsure = float(np.broadcast_to(usual.unsure, usual.rho.shape)[joint])
    level, scale = unsure * APART[0], unsure * APART[1]
    apart = (np.log(rho / usual.rho[joint]) / level) ** 2 + (np.log(v / usual.v[joint]) / scale) ** 2
    core = np.log(1.0 - TAIL) - 0.5 * apart - np.log(2.0 * np.pi * level * scale)
    flat = np.log(TAIL) - np.log(np.log(LEVELS[-1] / LEVELS[0]) * np.log(SCALES[-1] / SCALES[0]))
    return np.asarray(np.logaddexp(core, flat))


NEVER = float(np.log((1.0 - HAPPENS) / HAPPENS))  # nats, by which nothing is more probable than something in a block


@dataclass(frozen=True)
class Moments:
    """What may happen in a block of a recording, each by itself: a force at the teeth of any smooth course, a load.
    Statistics of the blocks with columns in units of their spread, forces in units of their usual size; zero in blocks
    in which nothing happens."""

    across: Array
    within: Array
    waves: Array
    smooth: Array

    def weighed(self, noise: Scatter) -> tuple[Array, Array, float]:
        """Of every block the product with all columns (B, I, K+1), the precision (B, I, I), and what the freedom
        costs."""
        share = noise.share
        scale = noise.v**-2.0
        across = np.einsum("brij,r->bij", self.across, scale, optimize=True)
        pulled = self.waves * (share * scale[:, None])[..., None]
        across -= np.einsum("brki,brkj->bij", pulled, self.smooth, optimize=True)
        within = np.einsum("brij,r->bij", self.within, scale) - np.einsum("brki,brkj->bij", pulled, self.waves)
        precision = within + np.eye(within.shape[-1])
        return across, precision, 0.5 * float(np.sum(np.linalg.slogdet(precision)[1]))

    def told(self, noise: Scatter) -> tuple[Array, float]:
        """What of the information (K+1, K+1) is lost to them, and the cost."""
        across, precision, cost = self.weighed(noise)
        root = np.linalg.cholesky(precision)
        half = np.linalg.solve(root, across).reshape(-1, across.shape[-1])
        return np.asarray(half.T @ half, dtype=np.float64), cost

    def expected(self, left: Array, noise: Scatter) -> tuple[Array, Array]:
        """Sizes (B, I) of what happens, by what coefficients (K+1,) leave without it; their covariance (B, I, I)."""
        across, precision, _ = self.weighed(noise)
        covariance = np.asarray(np.linalg.inv(precision))
        return np.asarray(np.einsum("bij,bjk,k->bi", covariance, across, left, optimize=True)), covariance

    def energies(self, left: Array, noise: Scatter) -> tuple[Array, Array]:
        """By how much the energies, white (R,) and smooth (R, SMOOTH), of what coefficients (K+1,) leave change."""
        sizes, covariance = self.expected(left, noise)
        second = np.einsum("bi,bj->bij", sizes, sizes) + covariance
        whole = np.einsum("brij,bij->r", self.within, second, optimize=True)
        whole -= 2.0 * np.einsum("bi,brij,j->r", sizes, self.across, left, optimize=True)
        plain = np.einsum("brkj,j->brk", self.smooth, left, optimize=True)
        moved = np.einsum("brki,bi->brk", self.waves, sizes, optimize=True)
        spread = np.einsum("brki,bij,brkj->rk", self.waves, covariance, self.waves, optimize=True)
        smooth = np.sum((plain - moved) ** 2 - plain**2, axis=0) + spread
        return whole - np.sum(smooth, axis=1), smooth

    def likeliest(self, left: Array, noise: Scatter, sizes: Sequence[float]) -> Array:
        """Of every block the usual size (B,), of `sizes`, that coefficients (K+1,) of what is left make most probable,
        0 where nothing is more probable than any."""
        across, precision, _ = self.weighed(noise)
        score, unit = across @ left, np.eye(precision.shape[-1])
        each = [evidence(size * score, size**2 * (precision - unit) + unit) for size in sizes]
        best = np.argmax(each, axis=0)
        happens = np.max(each, axis=0) - np.log(len(sizes)) > NEVER
        return np.where(happens, np.array(sizes)[best], 0.0)

    def only(self, usual: Array) -> "Moments":
        """The same with another usual size, of these, in every block (B,); 0: nothing happens there."""
        on = usual[:, None, None, None].astype(np.float64)
        return Moments(self.across * on, self.within * on**2, self.waves * on, self.smooth)

    @staticmethod
    def prior(where: NDArray[np.bool_], sizes: Sequence[float] = USUAL_SIZES) -> float:
        """Log of the prior probability that it happens in just these blocks, with usual sizes out of as many."""
        share = np.where(where, HAPPENS / len(sizes), 1.0 - HAPPENS)
        return float(np.sum(np.log(share)))


def evidence(score: Array, precision: Array) -> Array:
    """Evidence (...) [nats] of scores (..., I), sizes integrated out, by their precision (..., I, I)."""
    sizes = np.linalg.solve(precision, score[..., None])[..., 0]
    return np.asarray(0.5 * np.einsum("...i,...i->...", score, sizes) - 0.5 * np.linalg.slogdet(precision)[1])


def moments(each: Sequence[White], own: Sequence[int], spread: Array, within: Sequence[int], usual: Array) -> Moments:
    """The moments of recordings: columns `own` in units of `spread` (K,), what may happen, columns `within` in units of
    `usual` (I,)."""
    unit = np.append(spread, 1.0)
    found = [_moments(w, [*own, -1], within) for w in each]
    across, inner, waves, smooth = (np.concatenate(part) for part in zip(*found, strict=True))
    return Moments(across * usual[:, None] * unit, inner * np.outer(usual, usual), waves * usual, smooth * unit)


def _moments(each: White, own: Sequence[int], within: Sequence[int]) -> tuple[Array, Array, Array, Array]:
    columns, happening = (blocked(each.rows[..., list(k)].astype(np.float64)) for k in (own, within))
    basis = polynomials(blocked(each.good.astype(np.float64)))
    across = np.einsum("btri,btrk->brik", happening, columns, optimize=True)
    inner = np.einsum("btri,btrj->brij", happening, happening, optimize=True)
    waves, smooth = (np.einsum("btrk,btri->brki", basis, x, optimize=True) for x in (happening, columns))
    return across, inner, waves, smooth
