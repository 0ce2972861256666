"""Likelihood of a hypothesis: the probability of a recording with its effects, everything else integrated out.

Of each joint and each block of three seconds the whitened residual y of the model is

    y = X (m + g) + X_h s + N n + Q d + e
    g ~ N(0, C + V)   s: magnitudes, log-uniform   n ~ N(0, I)   d_k ~ N(0, rho^2 / (1 + k)^2)   e ~ N(0, v^2)

X, m, C: columns, their mean and covariance on the healthy machine (model.py)
V:       run-to-run variation, and the change at another temperature where the conditions have one
X_h:     columns of the hypothesis' effects
N:       columns of nuisances of single blocks or stretches: payload, contact, slewing, free torque; of one kind or none
Q:       polynomials
rho, v:  level of the model discrepancy and scale of the white noise of each joint, maximised with their prior, anew for
         each hypothesis
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from math import gamma, pi

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotri
from scipy.special import ndtri

from cylforce.diagnosis.constants import (
    CARRY_BACK,
    CORRELATED_ROWS,
    DISCREPANCY_CHANGE,
    INCIDENT,
    INCIDENT_SIZES,
    NOISE_CHANGE,
    PAYLOAD,
    POLYNOMIALS,
    SAME_MACHINE,
    SECOND_EFFECT,
    TAIL,
)
from cylforce.diagnosis.statistics import Blocks, Gram, Mask, in_blocks, polynomials
from cylforce.effects.fault import BEYOND, LAW_ERROR
from cylforce.readings.constants import BLOCK_ROWS, CLEAR_GAP, HALF
from cylforce.signals.estimate import Array

DECAY = (
    1.0 / (1.0 + np.arange(POLYNOMIALS)) ** 2
)  # variance of the discrepancy along each polynomial: a smooth function
LEVELS = np.exp(np.arange(np.log(0.05), np.log(300.0), 0.15))  # grid of rho, in units of a joint's white noise
SCALES = np.exp(np.arange(np.log(0.3), np.log(6.0), 0.03))  # grid of v, in the same units
RHO, V = (each.ravel() for each in np.meshgrid(LEVELS, SCALES, indexing="ij"))  # all pairs (G,)
VARIANCE = V**2 + RHO**2 * DECAY[:, None]  # (POLYNOMIALS, G) along each polynomial
PRECISION, WHITE_PRECISION = 1.0 / VARIANCE, V**-2.0  # (POLYNOMIALS, G) and (G,) their inverses
LOG_V, LOG_SMOOTH = np.log(V), np.sum(np.log(VARIANCE / V**2), axis=0)  # (G,) terms of the normalisation
ROUNDS = 12  # of noise and residual in turns, at most
KEPT_STATES = 16  # marginals of a noise that are kept: each takes some megabytes
ROUNDING = 1e-9  # of a Gram matrix, by which single precision may make it negative
SINGLE = float(np.finfo(np.float32).eps)
AXES, DRAWS_COUNT, FEWEST_DRAWS = 6, 1024, 8  # of the quadrature over uncertain magnitudes
# Precision of a Gaussian factor beside the log-uniform prior, on each component s of a magnitude in typical sizes:
#     exp(-FREE_PRECISION (s^2 - s_0^2) / 2)        s_0: size for which the readings are corrected, else 0
# It bounds the standard error where the recording does not determine a magnitude: two typical sizes, which are the
# largest plausible magnitude of most effects. It shrinks magnitudes. It is 1 at s_0, no normalised density: it
# costs half a nat at two typical sizes, and nothing at a converged correction. Value chosen.
FREE_PRECISION = 0.25


# Conditions


@dataclass(frozen=True)
class Conditions:
    """Conditions of a recording compared with those of the references.

    variation:   factor on the standard deviations of the machine's run-to-run variation
    temperature: factor on the change of friction at another temperature of oil and sensors; None: the same one
    """

    variation: float = 1.0
    temperature: float | None = None

    @property
    def other_oil(self) -> bool:
        """True where the oil, and not only the sensors, has another temperature: the friction differs."""
        return bool(self.temperature)

    @property
    def log_prior(self) -> float:
        """Log prior probability: another temperature is one circumstance more."""
        if self.temperature is None:
            return 0.0
        return float(np.log(SECOND_EFFECT / len(TEMPERATURES)))


# Most machines are steadier than stated, and a weak effect shows on a steady machine only: both are as probable. The
# likelier of the two counts for a hypothesis; they are not averaged.
USUAL_CONDITIONS = (Conditions(1.0), Conditions(0.5))
# Another temperature of the sensors alone; of the oil, too: a third of the largest change of friction, and all of it.
TEMPERATURES = (Conditions(temperature=0.0), Conditions(temperature=0.3), Conditions(temperature=1.0))


# Noise of the residual


@dataclass(frozen=True)
class ResidualNoise:
    """Residual model of each joint: white noise plus a smooth model discrepancy, in units of the floor's white noise.

    discrepancy: (R,) rho, standard deviation of the smooth component at order 0; the variance at order k is
                 rho^2 / (1 + k)^2
    white:       (R,) v, standard deviation of the white component
    width:       (R,) factor on the spread of both between recordings (prior only)
    conditions:  of the recording (of a hypothesis only)
    """

    discrepancy: Array
    white: Array
    width: Array = field(default_factory=lambda: np.ones(1))
    conditions: Conditions = USUAL_CONDITIONS[0]

    @cached_property
    def log_density_on_grid(self) -> Array:
        """Log density (R, G) of the pairs of the grid, if this is the noise of a healthy machine."""
        return np.stack([_log_density(RHO, V, self, r) for r in range(len(self.white))])

    @property
    def smooth_share(self) -> Array:
        """Share (R, POLYNOMIALS) of the discrepancy in the variance along each polynomial."""
        smooth = self.discrepancy[:, None] ** 2 * DECAY
        return np.asarray(smooth / (self.white[:, None] ** 2 + smooth))

    def information(self, gram: Gram) -> Array:
        """Return [X y]' P [X y] (K+1, K+1), P the inverse covariance of noise and discrepancy."""
        scale, size = self.white**-2.0, gram.whole.shape[-1]
        smooth = (self.smooth_share * scale[:, None]).ravel() @ gram.smooth.reshape(-1, size * size)
        return np.asarray(scale @ gram.whole.reshape(len(scale), -1) - smooth).reshape(size, size)

    def log_norm(self, gram: Gram) -> float:
        """Return the term of the log likelihood that depends on the noise alone."""
        each = np.log1p(self.discrepancy[:, None] ** 2 * DECAY / self.white[:, None] ** 2)
        return float(-np.sum(gram.rows * np.log(self.white) + 0.5 * gram.blocks * np.sum(each, axis=1)))

    def shared(self, gram: Gram) -> tuple[Array, Array]:
        """Return the bias of X' P y (K,) from sensor noise in both factors, and samples (S, K) of its uncertainty.

        Its energy is limited to that of the whole noise.
        """
        weight = self.noise_weight(gram.noise_energy)
        each = (weight.ravel() @ gram.shared.reshape(-1, weight.size, gram.shared.shape[-1]))[:, :-1]
        return each.sum(axis=0), each - np.sum(each, axis=0) / max(len(each), 1)

    def noise_weight(self, noise_energy: Array) -> Array:
        """Return the weight (R, 1 + POLYNOMIALS) of products of sensor noise, whole and along each polynomial."""
        own = np.concatenate([np.ones((len(self.white), 1)), -self.smooth_share], axis=1)
        return np.asarray(own / np.maximum(self.white**2, noise_energy)[:, None])

    def log_prior(self, usual: "ResidualNoise") -> float:
        """Return the log prior of the noise of all joints and of the conditions.

        usual: noise of a healthy machine
        """
        joints = range(len(self.white))
        return self.conditions.log_prior + sum(
            float(_log_density(self.discrepancy[r], self.white[r], usual, r)) for r in joints
        )

    def probability_usual(self, usual: "ResidualNoise") -> float:
        """Return the probability that the noise of all joints is a healthy machine's, and none from the tail.

        usual: noise of a healthy machine
        """
        found = 1.0
        for r in range(len(self.white)):
            whole = _log_density(self.discrepancy[r], self.white[r], usual, r)
            found *= 1.0 - float(np.exp(_LOG_FLAT - whole))
        return found

    def same_as(self, other: "ResidualNoise") -> bool:
        """Return whether both are the same point of the grid."""
        return np.array_equal(self.discrepancy, other.discrepancy) and np.array_equal(self.white, other.white)


_LOG_FLAT = float(np.log(TAIL) - np.log(np.log(LEVELS[-1] / LEVELS[0]) * np.log(SCALES[-1] / SCALES[0])))


def _log_density(discrepancy: Array, white: Array, usual: ResidualNoise, joint: int) -> Array:
    """Return the log density of level and scale: log-normal about the healthy machine's, and a flat tail."""
    width = float(np.broadcast_to(usual.width, usual.white.shape)[joint])
    level, scale = width * float(np.log(DISCREPANCY_CHANGE)), width * float(np.log(NOISE_CHANGE))
    distance = (np.log(discrepancy / usual.discrepancy[joint]) / level) ** 2
    distance = distance + (np.log(white / usual.white[joint]) / scale) ** 2
    core = np.log(1.0 - TAIL) - 0.5 * distance - np.log(2.0 * np.pi * level * scale)
    return np.asarray(np.logaddexp(core, _LOG_FLAT))


def likeliest_noise(
    gram: Gram, white: Array, smooth: Array, usual: ResidualNoise | None
) -> tuple[ResidualNoise, Array]:
    """Return the most probable level and scale (H, R) for given energies, and their log probability (H,).

    white:  (H, R) energies
    smooth: (H, R, POLYNOMIALS) energies along the polynomials
    usual:  noise of a healthy machine, the prior; None: flat
    """
    levels, scales, log = np.zeros(white.shape), np.zeros(white.shape), np.zeros(len(white))
    for r in range(white.shape[1]):
        fixed = -gram.rows[r] * LOG_V - 0.5 * gram.blocks[r] * LOG_SMOOTH
        before = usual.log_density_on_grid[r] if usual else 0.0
        each = fixed + before - 0.5 * (white[:, r, None] * WHITE_PRECISION + smooth[:, r] @ PRECISION)
        best = np.argmax(each, axis=1)
        levels[:, r], scales[:, r] = RHO[best], V[best]
        log += each[np.arange(len(each)), best]
    return ResidualNoise(levels, scales), log


def settled_noise(gram: Gram, energies: tuple[Array, Array], usual: ResidualNoise | None) -> ResidualNoise:
    """Return the likeliest noise for energies (R,), (R, POLYNOMIALS)."""
    noise = likeliest_noise(gram, energies[0][None], energies[1][None], usual)[0]
    return ResidualNoise(noise.discrepancy[0], noise.white[0])


def largest_discrepancy(gram: Gram, white: Array, smooth: Array) -> Array:
    """Return the largest level (R,) that energies (R,), (R, POLYNOMIALS) allow: half a nat below the likeliest.

    A level far below the noise is as likely as none at all.
    """
    levels = np.zeros(len(white))
    for r in range(len(white)):
        fixed = -gram.rows[r] * LOG_V - 0.5 * gram.blocks[r] * LOG_SMOOTH
        each = fixed - 0.5 * (white[r] * WHITE_PRECISION + smooth[r] @ PRECISION)
        best = np.max(each.reshape(len(LEVELS), -1), axis=1)
        levels[r] = LEVELS[np.flatnonzero(best >= np.max(best) - 0.5)[-1]]
    return levels


# Forms of effects, and the prior of a magnitude


@dataclass(frozen=True)
class Form:
    """Effect at a location, in one of its forms: with one choice of its shape parameters.

    name:      of the effect
    at:        its location
    columns:   numbers of its columns
    low:       least plausible magnitude [unit of the effect]
    high:      largest plausible magnitude [unit of the effect]
    sign:      1 or -1 where only that sign is possible, else 0
    axes:      number of its sizes that are components of the magnitude
    sensor:    whether it is an error of readings or of geometry
    law_error: relative error of a magnitude because the law is only approximate
    torque_error: relative error of its torque that the law leaves at the right size
    """

    name: str
    at: str
    columns: tuple[int, ...]
    low: float
    high: float
    sign: int = 0
    axes: int = 1
    sensor: bool = False
    law_error: float = 0.0
    torque_error: float = LAW_ERROR

    @property
    def key(self) -> tuple[str, str]:
        """Name and location."""
        return self.name, self.at

    @property
    def components(self) -> int:
        """Number of its sizes that are components of the magnitude."""
        return min(self.axes, len(self.columns))

    @property
    def side_precision(self) -> Array:
        """Prior precision (M,) of its sizes in units of their typical size: 1 of those that are not components."""
        return np.where(np.arange(len(self.columns)) < self.components, 0.0, 1.0)

    def log_prior(self, sizes: Array, covariance: Array) -> float:
        """Return the log prior density of sizes (M,), averaged over their uncertainty.

        Log-uniform in magnitude from the least to the largest plausible one, in any direction that the sign allows.
        """
        density, apart = self.density(sizes, covariance)
        axes = len(apart)
        return density - improbability(apart, covariance[:axes, :axes])

    def density(self, sizes: Array, covariance: Array) -> tuple[float, Array]:
        """Return the log prior density of sizes (M,), and the change (A,) to the nearest plausible ones.

        The density is averaged over the sizes' uncertainty, and the change is 0, if they are plausible. If hardly any
        draw is plausible, the density is that of the nearest plausible sizes.
        """
        axes = self.components
        root = np.linalg.cholesky(covariance[:axes, :axes] + 1e-300 * np.eye(axes))
        drawn = sizes[:axes] + _DRAWS[:, :axes] @ root.T
        density = np.exp(self._log_density(drawn))
        if np.count_nonzero(density) >= FEWEST_DRAWS:
            return float(np.log(np.mean(density))), np.zeros(axes)
        magnitude = float(np.linalg.norm(sizes[:axes]))
        nearest = float(np.clip(magnitude, self.low, BEYOND * self.high))
        sign = self.sign if axes == 1 else 0
        wanted = np.array([sign * nearest]) if sign else sizes[:axes] * (nearest / max(magnitude, 1e-300))
        log_range = float(np.log(np.log(BEYOND * self.high / self.low) * _sphere(axes)))
        return -axes * float(np.log(nearest)) - log_range, wanted - sizes[:axes]

    def _log_density(self, sizes: Array) -> Array:
        axes = self.components
        magnitude = np.linalg.norm(sizes, axis=1)
        plausible = (magnitude >= self.low) & (magnitude <= BEYOND * self.high)
        plausible &= (self.sign == 0) | (axes > 1) | (self.sign * sizes[:, 0] > 0.0)
        directions = 1.0 if self.sign and axes == 1 else _sphere(axes)
        whole = np.log(BEYOND * self.high / self.low) * directions
        return np.where(plausible, -axes * np.log(np.maximum(magnitude, 1e-300)) - np.log(whole), -np.inf)

    def bounded(self, sizes: Array) -> Array:
        """Return sizes (M,) scaled down to the largest plausible magnitude."""
        largest = BEYOND * self.high * (1.0 - 1e-9)
        return np.asarray(sizes * min(largest / max(float(np.linalg.norm(sizes[: self.components])), 1e-300), 1.0))


def improbability(apart: Array, covariance: Array) -> float:
    """Return the evidence [nats] against a change (A,) of sizes with a covariance (A, A)."""
    return 0.5 * float(apart @ np.linalg.solve(covariance, apart)) if np.any(apart) else 0.0


def _sphere(axes: int) -> float:
    """Return the surface of the unit sphere; of one axis its two directions."""
    return float(2.0 * pi ** (axes / 2.0) / gamma(axes / 2.0))


def _evenly_spread() -> Array:
    """Return points (DRAWS_COUNT, AXES) of a standard normal distribution (Kronecker sequence; Roberts 2018)."""
    golden = 2.0
    for _ in range(50):
        golden = (1.0 + golden) ** (1.0 / (AXES + 1.0))
    steps = golden ** -(1.0 + np.arange(AXES))
    return np.asarray(ndtri((0.5 + np.outer(1.0 + np.arange(DRAWS_COUNT), steps)) % 1.0))


_DRAWS = _evenly_spread()


def symmetric_positive(matrix: Array) -> Array:
    """Return the nearest symmetric, positive semidefinite matrix (..., M, M).

    A difference of large matrices may be neither by rounding.
    """
    values, vectors = np.linalg.eigh((matrix + np.swapaxes(matrix, -1, -2)) / 2.0)
    return np.asarray((vectors * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(vectors, -1, -2))


# Nuisances of blocks


@dataclass(frozen=True)
class Nuisance:
    """Columns that are present in some blocks only, with sizes of their own: contact, slewing, free torque, payload.

    across: (B, R, I, K+1) product of the nuisance's columns with all others, in units of their typical sizes
    within: (B, R, I, I) product of the nuisance's columns with each other
    waves:  (B, R, POLYNOMIALS, I) the nuisance's columns along the polynomials
    smooth: (B, R, POLYNOMIALS, K+1) the others along the polynomials
    """

    across: Array
    within: Array
    waves: Array
    smooth: Array

    @classmethod
    def of(
        cls, blocks: Sequence[Blocks], columns: Sequence[int], unit: Array, own: Sequence[int], typical: Array
    ) -> "Nuisance":
        """Return the nuisance of recordings.

        columns: numbers of the other columns, in units `unit` (K,)
        own:     numbers of the nuisance's columns, in units `typical` (I,)
        """
        scale = np.append(unit, 1.0)
        parts = []
        for each in blocks:
            others, mine = each.rows[..., [*columns, -1]], each.rows[..., list(own)]
            across = np.einsum("btri,btrk->brik", mine, others, optimize=True)
            # In double precision: a large load's energy but for its smooth part is a difference of large sums.
            exact = mine.astype(np.float64)
            within = np.einsum("btri,btrj->brij", exact, exact, optimize=True)
            waves = np.einsum("btrs,btri->brsi", each.basis, exact, optimize=True)
            parts.append((across, within, waves, each.smooth[..., [*columns, -1]]))
        across, within, waves, smooth = (np.concatenate(part).astype(np.float64) for part in zip(*parts, strict=True))
        return cls(
            across * typical[:, None] * scale, within * np.outer(typical, typical), waves * typical, smooth * scale
        )

    def sized(self, sizes: Array) -> "Nuisance":
        """Return the nuisance with typical sizes scaled by block (B,); 0: absent in the block."""
        on = sizes[:, None, None, None]
        return Nuisance(self.across * on, self.within * on**2, self.waves * on, self.smooth)

    def present(self, sizes: Array) -> "Nuisance":
        """Return the nuisance of the blocks in which it is present, with typical sizes scaled by block (B,)."""
        return self.only(sizes > 0.0).sized(sizes[sizes > 0.0])

    def only(self, kept: Mask) -> "Nuisance":
        """Return the nuisance of some blocks (B,)."""
        return Nuisance(self.across[kept], self.within[kept], self.waves[kept], self.smooth[kept])

    def weighted(self, noise: ResidualNoise) -> tuple[Array, Array]:
        """Return, for each group of blocks, the product with all columns (G, I, K+1) and the precision (G, I, I)."""
        share, scale = noise.smooth_share, noise.white**-2.0
        blocks, joints, orders, count = self.waves.shape
        pulled = self.waves * (share * scale[:, None])[..., None]
        pulled, waves, smooth = (
            x.reshape(blocks, joints * orders, x.shape[-1]) for x in (pulled, self.waves, self.smooth)
        )
        pulled = pulled.swapaxes(1, 2)
        across = np.einsum("brij,r->bij", self.across, scale) - pulled @ smooth
        within = np.einsum("brij,r->bij", self.within, scale) - pulled @ waves
        return across, within + np.eye(count)

    def spread(self, groups: Array) -> Array:
        """Return values of groups (G, ...), one per block (B, ...)."""
        return groups

    def marginal(self, noise: ResidualNoise) -> tuple[Array, float]:
        """Return the information (K+1, K+1) lost to the nuisance, and the cost of its freedom [nats]."""
        across, precision = self.weighted(noise)
        root = np.linalg.cholesky(precision)
        half = np.linalg.solve(root, across).reshape(-1, across.shape[-1])
        cost = 0.5 * float(np.sum(np.linalg.slogdet(precision)[1]))
        return np.asarray(half.T @ half), cost

    def expected(self, coefficients: Array, noise: ResidualNoise) -> tuple[Array, Array]:
        """Return the sizes (B, I) in each block for a residual (K+1,), and their covariance (B, I, I)."""
        across, precision = self.weighted(noise)
        covariance = np.asarray(np.linalg.inv(precision))
        sizes = (covariance @ (across @ coefficients)[..., None])[..., 0]
        return self.spread(sizes), self.spread(covariance)

    def energies(self, coefficients: Array, noise: ResidualNoise) -> tuple[Array, Array]:
        """Return the change of the energies, white (R,) and smooth (R, POLYNOMIALS), of a residual (K+1,)."""
        sizes, covariance = self.expected(coefficients, noise)
        second = sizes[:, :, None] * sizes[:, None] + covariance
        whole = np.einsum("brij,bij->r", self.within, second)
        whole -= 2.0 * np.einsum("bi,bri->r", sizes, self.across @ coefficients)
        plain = self.smooth @ coefficients
        moved = (self.waves @ sizes[:, None, :, None])[..., 0]
        spread = np.sum((self.waves @ covariance[:, None]) * self.waves, axis=(0, 3))
        smooth = np.sum((plain - moved) ** 2 - plain**2, axis=0) + spread
        return whole - np.sum(smooth, axis=1), smooth

    def likeliest_sizes(self, coefficients: Array, noise: ResidualNoise, sizes: Sequence[float]) -> Array:
        """Return the most probable of `sizes` in each block (B,), for a residual (K+1,).

        0 where the nuisance is less probable than its absence, with prior probability INCIDENT.
        """
        across, precision = self.weighted(noise)
        score, unit = across @ coefficients, np.eye(precision.shape[-1])
        each = [log_evidence(size * score, size**2 * (precision - unit) + unit) for size in sizes]
        present = np.max(each, axis=0) - np.log(len(sizes)) > np.log((1.0 - INCIDENT) / INCIDENT)
        return np.where(present, np.array(sizes)[np.argmax(each, axis=0)], 0.0)


def log_evidence(score: Array, precision: Array) -> Array:
    """Return the evidence (...) [nats] of scores (..., I) with precision (..., I, I), the sizes integrated out."""
    sizes = np.linalg.solve(precision, score[..., None])[..., 0]
    return np.asarray(0.5 * np.einsum("...i,...i->...", score, sizes) - 0.5 * np.linalg.slogdet(precision)[1])


def log_prior_of_blocks(present: Mask, sizes: Sequence[float] = INCIDENT_SIZES) -> float:
    """Return the log prior probability of an incident in exactly these blocks (B,), with one of these sizes in each."""
    return float(np.sum(np.log(np.where(present, INCIDENT / len(sizes), 1.0 - INCIDENT))))


@dataclass(frozen=True)
class Payload(Nuisance):
    """Unknown payloads: one for all blocks of a stretch without contact, or carried on from the stretch before.

    stretch:      (B,) number of each block's stretch
    carried_on:   (S,) whether the load of a stretch is that of the one before
    shared:       (B, R, 1 + POLYNOMIALS, I) product of the sensors' noise in a load's columns and in the residual
    noise_energy: (R,) energy of that noise in the residual, per row
    """

    stretch: NDArray[np.int_]
    carried_on: Mask
    shared: Array
    noise_energy: Array

    @cached_property
    def load(self) -> NDArray[np.int_]:
        """Number of every block's load (B,)."""
        return np.asarray((np.cumsum(~self.carried_on) - 1)[self.stretch])

    def with_loads(self, carried_on: Mask) -> "Payload":
        """Return the payloads with another division of the stretches into loads.

        carried_on: (S,) whether the load of a stretch is that of the one before
        """
        return replace(self, carried_on=carried_on)

    def weighted(self, noise: ResidualNoise) -> tuple[Array, Array]:
        """Return, for each load, the product with all columns (G, I, K+1) and the precision (G, I, I)."""
        across, precision = super().weighted(noise)
        weight = noise.noise_weight(self.noise_energy)
        across[..., -1] -= np.einsum("rq,brqi->bi", weight, self.shared, optimize=True)
        count, unit = int(self.load[-1]) + 1, np.eye(precision.shape[-1])
        each, within = np.zeros((count, *across.shape[1:])), np.zeros((count, *precision.shape[1:]))
        np.add.at(each, self.load, across)
        np.add.at(within, self.load, precision - unit)
        return each, within + unit

    def spread(self, groups: Array) -> Array:
        """Return values of loads (G, ...), one per block (B, ...)."""
        return np.asarray(groups[self.load])

    def losses(self, residual: Array, noise: ResidualNoise) -> "Losses":
        """Return the changes of loads that are carried on, and the spills among them.

        residual: coefficients (K+1,) of the residual without loads
        """
        across, precision = self.with_loads(np.zeros_like(self.carried_on)).weighted(noise)
        score, unit = across @ residual, np.eye(precision.shape[-1])
        loads, covariance = np.linalg.solve(precision, score[..., None])[..., 0], np.linalg.inv(precision)
        less, errors = np.zeros_like(loads), np.zeros_like(loads)
        less[1:] = loads[:-1] - loads[1:]
        errors[1:] = np.sqrt(np.einsum("sii->si", covariance[:-1] + covariance[1:]))
        apart, one = (
            log_evidence(score, precision),
            log_evidence(score[:-1] + score[1:], precision[:-1] + precision[1:] - unit),
        )
        gain = np.append(-np.inf, apart[:-1] + apart[1:] - one)
        differs = self.carried_on & (gain > np.log((1.0 - INCIDENT) / INCIDENT))
        surely = gain / CORRELATED_ROWS > np.log((1.0 - INCIDENT) / INCIDENT)  # the rest may be model error
        fell, same = differs & surely & (less[:, 0] * PAYLOAD > CARRY_BACK), np.cumsum(~self.carried_on)
        for n in np.flatnonzero(fell):  # a mass that returns was supported, not spilled
            later = loads[n:][same[n:] == same[n], 0]
            fell[n] = loads[n - 1, 0] - np.max(later) > HALF * less[n, 0]
        return Losses(differs, fell, less, errors)


@dataclass(frozen=True)
class Losses:
    """Changes of carried loads at the beginning of each of S stretches.

    differs: (S,) whether a load that is carried on differs from that of the stretch before
    fell:    (S,) whether it spilled
    less:    (S, I) decrease of the load, in units of the payload's columns
    errors:  (S, I) standard errors
    """

    differs: Mask
    fell: Mask
    less: Array
    errors: Array


# Hidden Markov chain along the time of a working recording


CELL_ROWS = 4  # rows of 0.05 s, to which begin and end of a stretch are found
LONGEST_CELLS = 100  # of a stretch, twenty seconds; a longer one becomes two
FEWEST_CELLS = 3  # of a stretch that counts, beyond those in which the filters settle
CHANGE = float(np.log(BLOCK_ROWS / INCIDENT))  # nats: that contact or a load begins in just this row
DUMPED = 0.5  # of the way from where the bucket is tilted as a load is lifted to where it is emptied; convention


@dataclass(frozen=True)
class FreeStretch:
    """Rows of a recording without contact.

    first:      number of the first row
    last:       number of the row after the last one
    loaded:     whether an unknown load is in the bucket
    carried_on: whether it is the load of the stretch before
    """

    first: int
    last: int
    loaded: bool
    carried_on: bool = False

    @property
    def blocks(self) -> NDArray[np.int_]:
        """Its rows in blocks of equal length (B, BLOCK_ROWS), each filled up with -1."""
        rows = np.arange(self.first, self.last)
        parts = np.array_split(rows, -(-len(rows) // BLOCK_ROWS))
        return np.stack([np.pad(part, (0, BLOCK_ROWS - len(part)), constant_values=-1) for part in parts])


@dataclass(frozen=True)
class _Cells:
    """Sums over cells of CELL_ROWS rows.

    energy: (N, R) of the residual
    across: (N, R, I) its products with a load
    within: (N, R, I, I) products of a load's columns
    rows:   (N, R) usable rows
    """

    energy: Array
    across: Array
    within: Array
    rows: Array

    @classmethod
    def of(cls, residual: Array, loads: Array, usable: Mask) -> "_Cells":
        """Return the cells of whitened rows: residual (T, R), a load's columns (T, R, I), the usable ones (T, R)."""
        count = -(-len(residual) // CELL_ROWS)

        def split(x: Array) -> Array:
            padded = np.zeros((count * CELL_ROWS, *x.shape[1:]))
            padded[: len(x)] = x
            return padded.reshape(count, CELL_ROWS, *x.shape[1:])

        y, x = split(np.where(usable, residual, 0.0)), split(np.where(usable[..., None], loads, 0.0))
        across, within = np.einsum("nsri,nsr->nri", x, y), np.einsum("nsri,nsrj->nrij", x, x)
        return cls(np.sum(y**2, axis=1), across, within, split(usable.astype(np.float64)).sum(axis=1))

    def path(self, free: Array, busy: Array, precision: Mapping[bool, Array]) -> list[FreeStretch]:
        """Return the most probable stretches without contact (in cells), by dynamic programming.

        The residual has the scale `free` (R,) and one load in a stretch, the scale `busy` (R,) elsewhere.
        """
        weight, count = free**-2.0, len(self.rows)
        sums = [
            np.concatenate([np.zeros((1, *each.shape[1:])), np.cumsum(each, axis=0)])
            for each in (
                self.energy @ weight,
                np.einsum("nri,r->ni", self.across, weight),
                np.einsum("nrij,r->nij", self.within, weight),
                self.rows @ np.log(free),
            )
        ]
        contact = -self.rows @ np.log(busy) - 0.5 * self.energy @ busy**-2.0
        outside, inside = np.full(count + 1, -np.inf), np.full(count + 1, -np.inf)
        outside[0], came_inside = 0.0, np.zeros(count + 1, dtype=np.bool_)
        begun: list[FreeStretch | None] = [None] * (count + 1)
        for end in range(1, count + 1):
            came_inside[end] = inside[end - 1] - CHANGE > outside[end - 1]
            outside[end] = max(outside[end - 1], inside[end - 1] - CHANGE) + contact[end - 1]
            begins = np.arange(max(0, end - LONGEST_CELLS), end)
            before = np.maximum(outside[begins], inside[begins]) - CHANGE
            energy, across, within, norm = (each[end] - each[begins] for each in sums)
            for loaded, prior in precision.items():
                gain = log_evidence(across, within + np.diag(prior)) + 0.5 * np.sum(np.log(prior))
                log = before - 0.5 * energy - norm + gain - np.log(2.0)
                best = int(np.argmax(log))
                if log[best] > inside[end]:
                    inside[end], begun[end] = log[best], FreeStretch(int(begins[best]), end, loaded)
        found, end, now_inside = list[FreeStretch](), count, bool(inside[-1] > outside[-1])
        while end > 0:
            stretch = begun[end] if now_inside else None
            if stretch is None:
                end, now_inside = end - 1, bool(came_inside[end])
            else:
                found.append(stretch)
                end = stretch.first
                now_inside = bool(inside[end] > outside[end])
        return found[::-1]

    def scales(
        self, path: Sequence[FreeStretch], free: Array, busy: Array, precision: Mapping[bool, Array]
    ) -> tuple[Array, Array]:
        """Return the scales (R,) of the noise inside and outside the stretches of a path."""
        energy, rows, weight = np.zeros_like(free), np.zeros_like(free), free**-2.0
        outside = np.ones(len(self.rows), dtype=np.bool_)
        for each in path:
            own = slice(each.first, each.last)
            across, within = self.across[own].sum(axis=0), self.within[own].sum(axis=0)
            normal = np.einsum("rij,r->ij", within, weight) + np.diag(precision[each.loaded])
            load = np.linalg.solve(normal, weight @ across)
            energy += self.energy[own].sum(axis=0) - 2.0 * across @ load + np.einsum("rij,i,j->r", within, load, load)
            rows += self.rows[own].sum(axis=0)
            outside[own] = False
        free = np.where(rows > 0.0, np.sqrt(np.maximum(energy, 0.0) / np.maximum(rows, 1.0)), free)
        free = np.maximum(free, SCALES[0])
        others = np.maximum(self.rows[outside].sum(axis=0), 1.0)
        busy = np.sqrt(self.energy[outside].sum(axis=0) / others) if np.any(outside) else busy
        return free, np.maximum(busy, CLEAR_GAP * free)


def free_stretches(
    residual: Array, loads: Array, usable: Mask, tilt: Array, typical: Array, settle: int, *, payloads: bool = True
) -> list[FreeStretch]:
    """Return the stretches of a recording without contact, each with one load or with carry-back.

    Rows in which the filters settle are excluded at both ends.
    residual: (T, R) whitened residual of the healthy machine
    loads:    (T, R, I) whitened columns of a load
    usable:   (T, R)
    tilt:     (T,) angle of the tool against the house [rad]
    typical:  (I,) typical sizes of a load's columns
    payloads: whether unknown payloads are possible, or only carry-back
    """
    cells = _Cells.of(residual, loads, usable)
    precision = {False: (CARRY_BACK * typical) ** -2.0}
    if payloads:
        precision[True] = (PAYLOAD * typical) ** -2.0
    rows = np.maximum(cells.rows.sum(axis=0), 1.0)
    free, busy = np.ones(len(rows)), np.maximum(np.sqrt(cells.energy.sum(axis=0) / rows), CLEAR_GAP)
    path = cells.path(free, busy, precision)
    for _ in range(3):
        free, busy = cells.scales(path, free, busy, precision)
        path = cells.path(free, busy, precision)
    found = []
    for each in path:
        first, last = CELL_ROWS * each.first + settle, min(CELL_ROWS * each.last, len(residual)) - settle
        if last - first >= FEWEST_CELLS * CELL_ROWS:
            found.append(FreeStretch(first, last, each.loaded))
    return _carried_on(found, np.any(usable, axis=1), tilt, settle)


def _carried_on(found: list[FreeStretch], usable: Mask, tilt: Array, settle: int) -> list[FreeStretch]:
    """Return the stretches with `carried_on` set where the load is that of the stretch before.

    The gap between both is shorter than the filters' memory. In the gap the bucket's tilt stays nearer to that at which
    the load was lifted than to that at which it is emptied.
    """
    carried, first = [False] * len(found), 0
    gaps = []
    for one, other in pairwise(found):
        before = np.flatnonzero(usable[: one.last])
        after = other.first + np.flatnonzero(usable[other.first :])
        gaps.append(slice(int(before[-1]) if before.size else 0, int(after[0]) + 1 if after.size else len(usable)))
    for k, rows in enumerate(gaps, 1):
        if found[k - 1].loaded and found[k].loaded and rows.stop - rows.start <= 4 * settle:
            continue
        lifted = tilt[found[first].first]
        way = tilt[rows] - lifted
        emptied = way[np.argmax(np.abs(way))]
        for n in range(first + 1, k):
            stays = (tilt[gaps[n - 1]] - lifted) * np.sign(emptied) < DUMPED * np.abs(emptied)
            carried[n] = bool(np.all(stays))
        first = k
    return [replace(stretch, carried_on=each) for stretch, each in zip(found, carried, strict=True)]


def log_of_other_rows(residual: Array, usable: Mask, found: Sequence[FreeStretch]) -> float:
    """Return the log probability of the rows (T, R) outside the stretches.

    Their residual is a smooth curve plus noise. Each block and joint has levels of its own, log-uniform from the noise
    floor on.
    """
    out = usable.copy()
    for each in found:
        out[each.first : each.last] = False
    rows, mask = in_blocks(np.where(out, residual, 0.0)), in_blocks(out)
    basis = polynomials(np.asarray(mask, dtype=np.bool_))
    along = np.einsum("btrs,btr->brs", basis, rows, optimize=True)
    orders = np.any(basis != 0.0, axis=1)
    count = mask.sum(axis=1) - np.sum(orders, axis=2)
    white = np.sqrt(np.maximum(np.sum(rows**2, axis=1) - np.sum(along**2, axis=2), 0.0) / np.maximum(count, 1.0))
    levels = np.concatenate([np.abs(along), white[..., None]], axis=2)
    weight = np.concatenate([orders, count[..., None]], axis=2)
    each = -weight * (np.log(np.maximum(levels, 1.0)) + 0.5 * np.minimum(levels, 1.0) ** 2)
    chosen = float(np.log(np.log(LEVELS[-1] / LEVELS[0]))) * np.count_nonzero(weight)
    return float(np.sum(each)) - chosen + 2.0 * float(np.log(INCIDENT)) * len(found)


# Hypotheses


@dataclass(frozen=True)
class MachineKnowledge:
    """Statistics of the healthy machine, in units of the columns' typical sizes.

    mean:        (K,) of the columns
    covariance:  (K, K) of the columns
    variation:   (K,) standard deviations of the run-to-run variation
    noise:       of the residual
    temperature: change at another temperature; None if that is no explanation
    """

    mean: Array
    covariance: Array
    variation: Array
    noise: ResidualNoise
    temperature: "TemperatureChange | None" = None

    @property
    def conditions(self) -> tuple[Conditions, ...]:
        """Conditions that are tried."""
        return (*USUAL_CONDITIONS, *self.temperatures)

    @property
    def temperatures(self) -> tuple[Conditions, ...]:
        """Other temperatures that are tried: without a change of friction, those of the sensors alone."""
        if self.temperature is None:
            return ()
        return tuple(c for c in TEMPERATURES if self.temperature.friction is not None or not c.other_oil)

    def under(self, conditions: Conditions) -> Array:
        """Return the covariance (K, K) of the columns under some conditions."""
        found = self.covariance + np.diag((conditions.variation * self.variation) ** 2)
        if self.temperature is not None and conditions.temperature is not None:
            found = found + self.temperature.zeros
            if self.temperature.friction is not None:
                found = found + conditions.temperature**2 * self.temperature.friction
        return found

    @cached_property
    def _precisions(self) -> dict[Conditions, tuple[Array, float]]:
        return {}

    def prior_precision(self, conditions: Conditions) -> tuple[Array, float]:
        """Return the precision (K, K) of the columns, and the log determinant of its inverse."""
        if conditions not in self._precisions:
            whole = self.under(conditions) + 1e-12 * np.eye(len(self.mean))
            self._precisions[conditions] = np.asarray(np.linalg.inv(whole)), float(np.linalg.slogdet(whole)[1])
        return self._precisions[conditions]


@dataclass(frozen=True)
class TemperatureChange:
    """Covariance of the change of a healthy machine at another temperature, in units of the columns' typical sizes.

    zeros:    (K, K) of the zeros of pressure sensors
    friction: (K, K) of the friction with oil of a much higher or lower viscosity; None if the oil is as warm as before
    """

    zeros: Array
    friction: Array | None

    def padded(self, more: int) -> "TemperatureChange":
        """Return the change of a machine with further columns that the temperature does not change."""
        friction = None if self.friction is None else np.pad(self.friction, (0, more))
        return TemperatureChange(np.pad(self.zeros, (0, more)), friction)


@dataclass(frozen=True)
class Hypothesis:
    """Set of effects with its evidence.

    forms:   numbers of the forms
    log:     log probability of the recordings under it, without the prior of the effects
    noise:   of the residual under it
    sizes:   (M,) of all its columns, in units of their typical sizes
    errors:  (M,) standard errors of the sizes
    rest:    refitted residual at the worst joint, in noise floors. Machine and nuisances are fitted within their priors
             too: a healthy machine may refit a gap away at the price of its prior
    doubt:   loss of evidence [nats] because the sensor noise in columns and residual is uncertain
    """

    forms: tuple[int, ...]
    log: float
    noise: ResidualNoise
    sizes: Array
    errors: Array
    rest: float
    doubt: float = 0.0


@dataclass(frozen=True)
class MarginalLikelihood:
    """Likelihood of recordings with one residual noise, the machine's parameters integrated out.

    known:      (K, K) information
    covariance: (K, K) of the nuisance parameters g
    fitted:     (K,) their means
    score:      (K,) marginal score of magnitudes
    unsure:     (S, K) samples whose products add up to the uncertainty of the score beyond the noise
    log:        log likelihood without any effect
    """

    known: Array
    covariance: Array
    fitted: Array
    score: Array
    unsure: Array
    log: float

    def follows(self, own: Sequence[int]) -> Array:
        """Return the derivative (K, M) of the parameters with respect to the sizes of some columns."""
        return self.covariance @ self.known[:, list(own)]

    def information(self, own: Sequence[int]) -> Array:
        """Return the marginal information (M, M) of the sizes of some columns."""
        chosen = list(own)
        return self.known[np.ix_(chosen, chosen)] - self.known[chosen] @ self.follows(chosen)


@dataclass(frozen=True)
class Fitted:
    """Magnitudes of a hypothesis.

    more:       (M,) sizes beyond those that the recording was corrected for
    sizes:      (M,) whole sizes
    covariance: (M, M) of the sizes
    gain:       z' I^-1 z / 2 + log |2 pi I^-1| / 2 [nats]: evidence of `more`, integrated over its uncertainty; I
                and z contain the precision of the priors. It is small for a converged correction, whose evidence is in
                the likelihood of the corrected recording
    doubt:      loss of evidence [nats] because the sensor noise in columns and residual is uncertain
    """

    more: Array
    sizes: Array
    covariance: Array
    gain: float
    doubt: float


def effective_share(rest: float) -> float:
    """Return the factor that tempers a log likelihood when the residual exceeds the noise floor.

    White noise counts in full. Excess residual is model error, correlated over CORRELATED_ROWS rows, so that those rows
    carry the information of one (Miller & Dunson 2019, coarsened posterior).
    rest: refitted residual of the hypothesis at the worst joint, in noise floors
    """
    excess = max(1.0 - (1.0 + SAME_MACHINE) / max(rest, 1.0) ** 2, 0.0)
    return float(1.0 / (1.0 + (CORRELATED_ROWS - 1.0) * excess))


def _no_support(_form: int, _sizes: Array) -> float:
    return 0.0


@dataclass(frozen=True)
class Likelihood:
    """Likelihood of hypotheses for recordings, given the statistics of the healthy machine.

    gram:      Gram matrices of the recordings
    unit:      (K,) typical sizes of the columns
    forms:     all lasting effects that may be a cause
    machine:   statistics of the healthy machine
    nuisance:  nuisances of single blocks; None if there are none
    corrected: sizes (M,) of forms that the recordings were corrected for, in units of the typical sizes
    support:   evidence [nats] for a form of sizes (M,) [SI] from other data: return pressures, counts of jumps
    apart:     log probability of the rows that are excluded; beside an incident log prior probability of its blocks
    """

    gram: Gram
    unit: Array
    forms: tuple[Form, ...]
    machine: MachineKnowledge
    nuisance: Nuisance | None = None
    corrected: Mapping[int, Array] = field(default_factory=dict)
    support: Callable[[int, Array], float] = _no_support
    apart: float = 0.0

    @cached_property
    def _states(self) -> dict[tuple[bytes, bytes, Conditions], MarginalLikelihood]:
        return {}

    def state(self, noise: ResidualNoise) -> MarginalLikelihood:
        """Return the marginal likelihood with a residual noise.

        The last KEPT_STATES are kept: many hypotheses share a point of the grid.
        """
        key = noise.discrepancy.tobytes(), noise.white.tobytes(), noise.conditions
        found = self._states.pop(key, None) or self._marginal(noise)
        self._states[key] = found
        if len(self._states) > KEPT_STATES:
            del self._states[next(iter(self._states))]
        return found

    def _marginal(self, noise: ResidualNoise) -> MarginalLikelihood:
        information, cost, mean = noise.information(self.gram), 0.0, self.machine.mean
        rounding = np.diag(ROUNDING * np.diag(information)[:-1])
        if self.nuisance is not None:
            taken, cost = self.nuisance.marginal(noise)
            information = information - taken
        known = (information[:-1, :-1] + information[:-1, :-1].T) / 2.0
        shared, unsure = noise.shared(self.gram)
        score = information[:-1, -1] - shared - known @ mean
        energy = information[-1, -1] - 2.0 * mean @ information[:-1, -1] + mean @ known @ mean
        precision, log_determinant = self.machine.prior_precision(noise.conditions)
        root = _root_of(known + precision, rounding)
        lower = np.tril(dpotri(root, lower=True)[0])
        covariance = lower + np.tril(lower, -1).T
        fitted = covariance @ score
        log = -0.5 * (energy - score @ fitted) - 0.5 * log_determinant - float(np.sum(np.log(np.diag(root))))
        unsure = unsure - (unsure @ covariance) @ known
        log += noise.log_norm(self.gram) - cost
        return MarginalLikelihood(known, covariance, fitted, score - known @ fitted, unsure, log)

    def least_squares(self, own: Sequence[int], others: Array, conditions: Conditions) -> Array:
        """Return the values (A,) of some columns by least squares with their prior, all other coefficients given.

        The reported residual is that of least squares, joints weighted by their floor, without a model discrepancy.
        others: (K+1,) coefficients of the residual without these columns
        """
        chosen, joints = list(own), len(self.gram.rows)
        noise = ResidualNoise(np.zeros(joints), np.ones(joints))
        information = noise.information(self.gram)
        if self.nuisance is not None:
            information = information - self.nuisance.marginal(noise)[0]
        products = information[chosen]
        covariance = self.machine.under(conditions)[np.ix_(chosen, chosen)]
        precision = np.linalg.inv(symmetric_positive(covariance) + 1e-12 * np.eye(len(chosen)))
        target = products @ others + precision @ self.machine.mean[chosen]
        return np.asarray(np.linalg.solve(products[:, chosen] + precision, target))

    def columns(self, forms: Sequence[int]) -> list[int]:
        """Return the columns of some forms."""
        return [c for p in forms for c in self.forms[p].columns]

    def already(self, forms: Sequence[int]) -> Array:
        """Return the sizes (M,) for which the recordings were corrected."""
        zero = (np.zeros(len(self.forms[p].columns)) for p in forms)
        return np.concatenate([np.zeros(0), *(self.corrected.get(p, z) for p, z in zip(forms, zero, strict=True))])

    def fitted(self, forms: Sequence[int], state: MarginalLikelihood) -> tuple[list[int], Fitted]:
        """Return columns and magnitudes of some forms.

        The score s of the magnitudes has the information I of the noise and a covariance V of the shared sensor noise:
        evidence s' I^-1 s / 2 without, s' (I + V)^-1 s / 2 with it; `doubt` is the difference.
        """
        own, taken = self.columns(forms), self.already(forms)
        side = np.concatenate([np.zeros(0), *(self.forms[p].side_precision for p in forms)])
        precision = np.where(side > 0.0, side, FREE_PRECISION)
        information = symmetric_positive(state.information(own)) + np.diag(precision)
        unsure = state.unsure[:, own].T @ state.unsure[:, own]
        alone = symmetric_positive(np.linalg.inv(information)) if own else np.zeros((0, 0))
        covariance = alone + alone @ unsure @ alone
        score = state.score[own] - precision * taken
        more = alone @ score
        log_known, log_both = (float(np.linalg.slogdet(each)[1]) for each in (information, information + unsure))
        gain = 0.5 * float(score @ more - side @ taken**2 + len(own) * np.log(2.0 * np.pi) - log_known)
        lost = score @ (more - np.linalg.solve(information + unsure, score)) if own else 0.0
        return own, Fitted(more, taken + more, covariance, gain, 0.5 * float(lost + log_known - log_both))

    def under(self, forms: Sequence[int], state: MarginalLikelihood) -> tuple[float, Fitted, Array]:
        """Return the log marginal likelihood of some forms without the noise's prior, their magnitudes, the residual
        (K+1,).
        """
        own, fitted = self.fitted(forms, state)
        log = state.log + fitted.gain + self._log_prior(forms, fitted)
        log += sum(self.support(p, sizes) for p, _, sizes, _ in self._magnitudes(forms, fitted))
        return log, fitted, self.residual(own, fitted, state)

    def screening(self, forms: Sequence[int], state: MarginalLikelihood) -> float:
        """Return the evidence [nats] of some forms at one noise, without that of other data, which takes long."""
        fitted = self.fitted(forms, state)[1]
        return fitted.gain - fitted.doubt + self._log_prior(forms, fitted)

    def _log_prior(self, forms: Sequence[int], fitted: Fitted) -> float:
        """Return the log prior of magnitudes in units of their typical sizes, averaged over their uncertainty.

        Magnitudes that are not plausible are changed to plausible ones together: they may depend on each other.
        """
        log, moved, apart = 0.0, list[int](), list[float]()
        for p, place, sizes, covariance in self._magnitudes(forms, fitted):
            form = self.forms[p]
            unit = self.unit[list(form.columns[: form.components])]
            density, change = form.density(sizes, covariance)
            log += density + float(np.sum(np.log(unit))) - 0.5 * float(np.log(2.0 * np.pi)) * (len(sizes) - len(unit))
            if np.any(change):
                moved += range(place.start, place.start + len(unit))
                apart += (change / unit).tolist()
        return log - improbability(np.array(apart), fitted.covariance[np.ix_(moved, moved)])

    def _magnitudes(self, forms: Sequence[int], fitted: Fitted) -> Iterator[tuple[int, slice, Array, Array]]:
        """Yield each form, the place of its sizes among all, the sizes (M,) [SI] and their covariance (M, M)."""
        first = 0
        for p in forms:
            unit = self.unit[list(self.forms[p].columns)]
            own = slice(first, first + len(unit))
            yield p, own, fitted.sizes[own] * unit, fitted.covariance[own, own] * np.outer(unit, unit)
            first += len(unit)

    def residual(self, own: Sequence[int], fitted: Fitted, state: MarginalLikelihood) -> Array:
        """Return the coefficients (K+1,) of the residual with the magnitudes of some columns."""
        found = np.append(-self.machine.mean - state.fitted + state.follows(own) @ fitted.more, 1.0)
        found[own] -= fitted.more
        return found

    @cached_property
    def healthy(self) -> Hypothesis:
        """Hypothesis without effects, with its most probable noise."""
        return self.hypothesis((), self.machine.noise)

    def doubt(self, forms: Sequence[int], base: Hypothesis) -> float:
        """Return the doubt [nats] about the forms that `base` lacks, with the noise of `base`.

        The smaller noise of a hypothesis with these forms would make the doubt exceed any evidence.
        """
        state = self.state(base.noise)
        whole, before = (self.fitted(each, state)[1].doubt for each in (forms, base.forms))
        return base.doubt + max(whole - before, 0.0)

    def _settled(self, forms: Sequence[int], noise: ResidualNoise) -> tuple[ResidualNoise, MarginalLikelihood]:
        """Return the noise of a hypothesis and its marginal likelihood, by expectation maximisation."""
        state = self.state(noise)
        for _ in range(ROUNDS):
            residual, before = self.residual(*self.fitted(forms, state), state), noise
            energies = self._energies(residual, state.covariance, noise)
            noise = replace(settled_noise(self.gram, energies, self.machine.noise), conditions=before.conditions)
            if noise.same_as(before):
                break
            state = self.state(noise)
        return noise, state

    def _energies(self, residual: Array, covariance: Array, noise: ResidualNoise) -> tuple[Array, Array]:
        found = self.gram.energies(residual, covariance)
        if self.nuisance is None:
            return found
        more = self.nuisance.energies(residual, noise)
        white, smooth = (np.maximum(a + b, SINGLE * a) for a, b in zip(found, more, strict=True))
        return white, smooth

    def hypothesis(self, forms: Sequence[int], noise: ResidualNoise, doubt: float | None = None) -> Hypothesis:
        """Return a hypothesis with its most probable noise.

        doubt: loss of evidence [nats]; None: that of all its effects compared with none
        """
        forms = tuple(forms)
        if doubt is None:
            doubt = self.doubt(forms, self.healthy) if forms else 0.0
        noise, state = self._settled(forms, noise)
        log, fitted, residual = self.under(forms, state)
        log += noise.log_prior(self.machine.noise) + self.apart - doubt
        errors = np.sqrt(np.diag(fitted.covariance))
        return Hypothesis(forms, log, noise, fitted.sizes, errors, float(np.max(self.rests(residual, noise))), doubt)

    def with_one_more(self, base: Hypothesis, form: int) -> Hypothesis:
        """Return a hypothesis with one form more."""
        forms = tuple(sorted((*base.forms, form)))
        return self.hypothesis(forms, base.noise, self.doubt(forms, base))

    def nearby(self, base: Hypothesis, form: int) -> Hypothesis:
        """Return a hypothesis with one form more and the noise of `base`: an approximation for a weak effect."""
        state, forms = self.state(base.noise), tuple(sorted((*base.forms, form)))
        (log, fitted, residual), (before, _, _) = self.under(forms, state), self.under(base.forms, state)
        errors, rest = np.sqrt(np.diag(fitted.covariance)), float(np.max(self.rests(residual, base.noise)))
        doubt = self.doubt(forms, base)
        log = base.log + log - before - (doubt - base.doubt)
        return Hypothesis(forms, log, base.noise, fitted.sizes, errors, rest, doubt)

    def likeliest(
        self,
        forms: Sequence[int],
        noise: ResidualNoise,
        doubt: float | None = None,
        conditions: Sequence[Conditions] | None = None,
    ) -> Hypothesis:
        """Return a hypothesis with its most probable conditions.

        conditions: that are tried; None: all of the machine
        """
        tried = self.machine.conditions if conditions is None else conditions
        return max((self.hypothesis(forms, replace(noise, conditions=c), doubt) for c in tried), key=lambda h: h.log)

    def rests(self, residual: Array, noise: ResidualNoise | None = None) -> Array:
        """Return the rms (R,) of a residual, in noise floors.

        residual: coefficients (K+1,); those of `under` give the refitted residual, those of the reported one the gap
        noise:    of the residual; with it, the nuisances are subtracted
        """
        energy = np.einsum("i,rij,j->r", residual, self.gram.whole, residual)
        if self.nuisance is not None and noise is not None:
            white, smooth = self.nuisance.energies(residual, noise)
            energy = energy + white + np.sum(smooth, axis=1)
        return np.asarray(np.sqrt(np.maximum(energy, 0.0) / np.maximum(self.gram.rows, 1.0)))


def _root_of(matrix: Array, rounding: Array) -> Array:
    """Return the Cholesky factor of a matrix.

    A difference of single-precision sums may be short of positive definite by up to its rounding, which is added.
    """
    for _ in range(6):
        try:
            return np.asarray(np.linalg.cholesky(matrix + rounding))
        except np.linalg.LinAlgError:
            rounding = 10.0 * rounding
    return np.asarray(np.linalg.cholesky(matrix + rounding))
