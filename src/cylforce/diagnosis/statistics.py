"""Sufficient statistics of recordings: whitened rows in blocks of three seconds, and their Gram matrices.

For each joint r and block b, with columns X and residual y, both whitened by the noise floor:

    whole[r]     = sum over rows of [X y]' [X y]
    smooth[r, k] = sum over blocks of [X y]' q_k q_k' [X y]      q_k: orthonormal polynomials of order k on the block

A smooth discrepancy of any level is marginalised later from these, without the rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import TypeVar

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from cylforce.diagnosis.constants import MEMORY, POLYNOMIALS
from cylforce.readings.constants import BLOCK_ROWS
from cylforce.signals.estimate import Array

Mask = NDArray[np.bool_]
Kind = TypeVar("Kind", bound=np.generic)
FEWEST_ROWS = 2 * POLYNOMIALS  # of a block and joint, for polynomials to be fitted
STATIONARY = 0.2  # least share of a constant that the whitening passes: a slow residual must not count as noise


@dataclass(frozen=True)
class NoiseFloor:
    """Noise of a healthy machine's residual, by measured joint.

    rms:    (R,) of the residual [N m]
    memory: (R, MEMORY) autoregression: coefficients of the last rows that predict the next one
    white:  (R,) rms of the prediction error [N m]
    """

    rms: Array
    memory: Array
    white: Array

    @classmethod
    def of(cls, residuals: Sequence[Array]) -> "NoiseFloor":
        """Return the noise floor of residuals (T, R); NaN separates stretches."""
        joints = range(residuals[0].shape[1])
        memory = np.array([_autoregression([e[:, r] for e in residuals]) for r in joints])
        rms = np.array([_rms(np.concatenate([e[:, r] for e in residuals])) for r in joints])
        white = [_rms(np.concatenate([predicted_off(e[:, r], memory[r]) for e in residuals])) for r in joints]
        return cls(rms, memory, np.array(white))

    def scaled(self, rms: Array) -> "NoiseFloor":
        """Return the noise floor with another rms (R,) and the same colour."""
        return NoiseFloor(rms, self.memory, self.white * rms / self.rms)


def predicted_off(x: Array, memory: Array) -> Array:
    """Return the prediction error of x (T, ...) given its last samples; NaN without a past, as at the start or after a
    NaN.
    """
    found = x.copy()
    for lag, share in enumerate(memory, 1):
        found[lag:] -= share * x[:-lag]
    found[: len(memory)] = np.nan
    return found


def _autoregression(residuals: Sequence[Array]) -> Array:
    """Fit each sample to the MEMORY samples before it, by least squares.

    The poles are moved inwards until STATIONARY of a constant passes.
    """
    lags = [
        np.stack([np.roll(e, k) for k in range(MEMORY + 1)], axis=-1)[MEMORY:] for e in residuals if len(e) > MEMORY
    ]
    rows = np.concatenate(lags)
    rows = rows[np.all(np.isfinite(rows), axis=1)]
    if len(rows) < 10 * MEMORY:
        return np.zeros(MEMORY)
    memory = np.linalg.lstsq(rows[:, 1:], rows[:, 0], rcond=None)[0]
    candidates = (memory * radius ** np.arange(1, MEMORY + 1) for radius in np.linspace(1.0, 0.0, 101))
    return np.asarray(next(found for found in candidates if 1.0 - np.sum(found) >= STATIONARY))


def _rms(x: Array) -> float:
    good = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(good**2))) if good.size else 1.0


def rms(residuals: Sequence[Array]) -> Array:
    """Return the rms (R,) over all rows of residuals (T, R); 0 where no row is usable."""
    whole = np.concatenate(residuals)
    good = np.isfinite(whole)
    energy = np.sum(np.where(good, whole, 0.0) ** 2, axis=0)
    return np.asarray(np.sqrt(energy / np.maximum(np.sum(good, axis=0), 1)))


def in_blocks(rows: NDArray[Kind]) -> NDArray[Kind]:
    """Return rows (T, ...) as blocks (B, BLOCK_ROWS, ...), padded with zeros."""
    count = -(-len(rows) // BLOCK_ROWS)
    padded = np.zeros((count * BLOCK_ROWS, *rows.shape[1:]), dtype=rows.dtype)
    padded[: len(rows)] = rows
    return padded.reshape(count, BLOCK_ROWS, *rows.shape[1:])


def polynomials(usable: Mask) -> Array:
    """Return polynomials (B, BLOCK_ROWS, R, POLYNOMIALS), orthonormal on each block's usable rows (B, BLOCK_ROWS, R).

    They are zero in blocks with fewer than FEWEST_ROWS.
    """
    places = 2.0 * (np.arange(BLOCK_ROWS) + 0.5) / BLOCK_ROWS - 1.0
    shapes = np.asarray(legvander(places, POLYNOMIALS - 1), dtype=np.float64)
    masked = np.moveaxis(usable[..., None] * shapes[:, None, :], 1, 2)  # (B, R, BLOCK_ROWS, POLYNOMIALS)
    enough = usable.sum(axis=1) >= FEWEST_ROWS
    found = np.zeros_like(masked)
    if np.any(enough):
        found[enough] = np.linalg.qr(masked[enough])[0]
    return np.moveaxis(found, 2, 1)


@dataclass(frozen=True)
class Blocks:
    """Whitened rows of a recording in blocks: B blocks, R joints, N columns, the residual last.

    rows:   (B, BLOCK_ROWS, R, N) zero where not usable
    usable: (B, BLOCK_ROWS, R)
    """

    rows: NDArray[np.float32]
    usable: Mask

    @classmethod
    def whitened(cls, columns: Array, floor: NoiseFloor) -> "Blocks":
        """Return columns (T, R, N), the residual last, whitened by the floor, in units of its white noise."""
        rows, good = np.zeros(columns.shape, dtype=np.float32), np.zeros(columns.shape[:2], dtype=np.bool_)
        for r in range(columns.shape[1]):
            white = predicted_off(columns[:, r], floor.memory[r]) / floor.white[r]
            good[:, r] = np.all(np.isfinite(white), axis=1)
            rows[good[:, r], r] = white[good[:, r]]
        return cls(in_blocks(rows), in_blocks(good))

    @cached_property
    def basis(self) -> Array:
        """Polynomials (B, BLOCK_ROWS, R, POLYNOMIALS) of each block."""
        return polynomials(self.usable)

    @cached_property
    def smooth(self) -> NDArray[np.float32]:
        """Rows along the polynomials (B, R, POLYNOMIALS, N)."""
        basis = np.moveaxis(self.basis, 2, 1).swapaxes(2, 3).astype(np.float32)
        return np.asarray(basis @ np.moveaxis(self.rows, 2, 1))

    @cached_property
    def counts(self) -> Array:
        """Number of usable rows (B, R)."""
        return np.asarray(self.usable.sum(axis=1, dtype=np.float64))

    def laid(self, rows: NDArray[np.int_]) -> "Blocks":
        """Return rows (M,), numbered over all blocks, in whole blocks; -1 stands for an empty row."""
        flat, usable = self.rows.reshape(-1, *self.rows.shape[2:]), self.usable.reshape(-1, self.usable.shape[2])
        there = rows >= 0
        shape = (len(rows) // BLOCK_ROWS, BLOCK_ROWS)
        return Blocks(
            np.where(there[:, None, None], flat[rows], np.float32(0.0)).reshape(*shape, *flat.shape[1:]),
            (usable[rows] & there[:, None]).reshape(*shape, usable.shape[1]),
        )

    def masked(self, kept: Mask) -> "Blocks":
        """Return the blocks (B,) that are kept."""
        return Blocks(self.rows[kept], self.usable[kept])

    def with_columns(self, columns: Sequence[int], other: "Blocks") -> "Blocks":
        """Return the blocks with some columns renewed; rows are usable where both are.

        other: the renewed columns, in this order
        """
        usable, rows = self.usable & other.usable, self.rows.copy()
        rows[..., list(columns)] = other.rows
        rows[~usable] = 0.0
        return Blocks(rows, usable)


@dataclass(frozen=True)
class SharedNoise:
    """Sensor noise that columns and residual have in common (errors in variables).

    products: (B, R, 1 + POLYNOMIALS, K+1) product of the noise of each column with that of the residual, block by
              block: over all rows, then along each polynomial; last the energy of the noise in the residual
    counts:   (B, R) rows of each block
    """

    products: Array
    counts: Array

    @classmethod
    def none(cls, joints: int, columns: int) -> "SharedNoise":
        """Return zero shared noise of `columns` columns, the residual included."""
        return cls(np.zeros((0, joints, 1 + POLYNOMIALS, columns)), np.zeros((0, joints)))

    @classmethod
    def of(cls, added: Blocks, columns: Sequence[int]) -> "SharedNoise":
        """Return the shared noise from the change of whitened rows by added sensor noise."""
        noise = np.moveaxis(added.rows[..., [*columns, -1]], 2, 1).astype(np.float64)  # (B, R, BLOCK_ROWS, K+1)
        factors = np.concatenate([noise[..., -1:], np.moveaxis(added.basis, 2, 1)], axis=-1)
        products = factors.swapaxes(2, 3) @ noise
        products[:, :, 1:] *= products[:, :, 1:, -1:].copy()
        return cls(products, added.counts)

    def expected(self, counts: Array) -> Array:
        """Return samples (B, R, 1 + POLYNOMIALS, K+1) whose sum is the shared noise of rows (B', R)."""
        rows = np.sum(counts, axis=0) / np.maximum(np.sum(self.counts, axis=0), 1.0)
        blocks = np.sum(counts > 0.0, axis=0) / np.maximum(np.sum(self.counts > 0.0, axis=0), 1.0)
        found = self.products * blocks[:, None, None]
        found[:, :, 0] = self.products[:, :, 0] * rows[:, None]
        return np.asarray(found)

    def energy(self) -> Array:
        """Return the energy of the noise in the residual (R, 1 + POLYNOMIALS), per row and per block."""
        blocks = np.sum(self.counts > 0.0, axis=0)
        per = np.column_stack([np.sum(self.counts, axis=0), *[blocks] * POLYNOMIALS])
        return np.asarray(np.sum(self.products[..., -1], axis=0) / np.maximum(per, 1.0))


@dataclass(frozen=True)
class Gram:
    """Gram matrices of recordings with R joints and K columns in units of their typical size, the residual last.

    whole:  (R, K+1, K+1)
    smooth: (R, POLYNOMIALS, K+1, K+1) along each polynomial
    rows:   (R,) usable rows
    blocks: (R,) blocks with usable rows
    shared: (S, R, 1 + POLYNOMIALS, K+1) samples whose sum is the sensor noise that columns and residual share
    """

    whole: Array
    smooth: Array
    rows: Array
    blocks: Array
    shared: Array

    @classmethod
    def of(cls, blocks: Blocks, columns: Sequence[int], unit: Array, noise: SharedNoise) -> "Gram":
        """Return the Gram matrices of a recording's columns, in units (K,) of their typical size."""
        chosen, scale = [*columns, -1], np.append(unit, 1.0)
        rows = blocks.rows[..., chosen].reshape(-1, blocks.rows.shape[2], len(chosen))
        along = blocks.smooth[..., chosen].astype(np.float64)
        each = (rows[:, r].astype(np.float64) for r in range(rows.shape[1]))
        whole = np.stack([x.T @ x for x in each])
        smooth = np.matmul(np.moveaxis(along, 0, 2).swapaxes(2, 3), np.moveaxis(along, 0, 2))
        both = np.outer(scale, scale)
        return cls(
            whole * both,
            smooth * both,
            blocks.counts.sum(axis=0),
            np.sum(blocks.counts > 0.0, axis=0).astype(np.float64),
            noise.expected(blocks.counts) * scale,
        )

    @classmethod
    def total(cls, each: Sequence["Gram"]) -> "Gram":
        """Return the sum of the Gram matrices of several recordings."""
        names = ("whole", "smooth", "rows", "blocks")
        whole, smooth, rows, blocks = (reduce(np.add, [getattr(g, name) for g in each]) for name in names)
        return cls(whole, smooth, rows, blocks, np.concatenate([g.shared for g in each]))

    def remainder(self, part: "Gram") -> "Gram":
        """Return the Gram of the rows that are not in a part of the same recordings."""
        return Gram(
            self.whole - part.whole,
            self.smooth - part.smooth,
            self.rows - part.rows,
            self.blocks - part.blocks,
            self.shared - part.shared,
        )

    @property
    def noise_energy(self) -> Array:
        """Energy of the sensors' noise in the residual (R,), per row."""
        return np.asarray(np.sum(self.shared[:, :, 0, -1], axis=0) / np.maximum(self.rows, 1.0))

    def with_noise(self, energy: Array) -> "Gram":
        """Return the Gram with sensor noise (R, 1 + POLYNOMIALS) added to the residual's energy.

        A correction of readings that removes noise must not become more probable by that. At most the energy of the
        whole noise is added.
        """
        given = np.minimum(1.0, 1.0 / np.maximum(self.noise_energy, 1e-300))[:, None] * energy
        whole, smooth = self.whole.copy(), self.smooth.copy()
        whole[:, -1, -1] += self.rows * given[:, 0]
        smooth[:, :, -1, -1] += self.blocks[:, None] * given[:, 1:]
        return replace(self, whole=whole, smooth=smooth)

    def with_columns(
        self, blocks: Sequence[Blocks], changed: Sequence[int], unit: Array, noises: Sequence[SharedNoise]
    ) -> "Gram":
        """Return the Gram of recordings with the same usable rows, in which only some columns changed.

        changed: numbers of the columns that changed; K stands for the residual
        unit:    (K,) typical sizes of the columns
        noises:  shared noise of each recording
        """
        chosen, own, scale = [*range(len(unit)), -1], list(changed), np.append(unit, 1.0)
        whole, smooth = np.zeros_like(self.whole[..., own, :]), np.zeros_like(self.smooth[..., own, :])
        for each in blocks:
            rows = each.rows[..., chosen].reshape(-1, each.rows.shape[2], len(chosen))
            joints = (rows[:, r].astype(np.float64) for r in range(rows.shape[1]))
            whole += np.stack([x[:, own].T @ x for x in joints])
            along = np.moveaxis(each.smooth[..., chosen].astype(np.float64), 0, 2)  # (R, S, B, K+1)
            smooth += np.matmul(along[..., own].swapaxes(2, 3), along)
        both, found = np.outer(scale[own], scale), (self.whole.copy(), self.smooth.copy())
        for old, new in zip(found, (whole * both, smooth * both), strict=True):
            old[..., own, :], old[..., :, own] = new, np.swapaxes(new, -1, -2)
        shared = [noise.expected(each.counts) * scale for each, noise in zip(blocks, noises, strict=True)]
        return replace(self, whole=found[0], smooth=found[1], shared=np.concatenate(shared))

    def extended(
        self,
        blocks: Sequence[Blocks],
        columns: Sequence[int],
        own: Sequence[tuple[Blocks, SharedNoise]],
        unit: Array,
        more: Array,
    ) -> "Gram":
        """Return the Gram with columns appended before the residual.

        blocks:  the recordings of this Gram, with `columns` in units (K,)
        own:     their whitened columns (B, BLOCK_ROWS, R, M) to be appended, in units `more` (M,), and the sensor noise
                 that these share with the residual
        """
        scale, size, count = np.append(unit, 1.0), len(unit), len(more)
        joints = self.whole.shape[0]
        whole = np.zeros((joints, size + count + 1, size + count + 1))
        smooth = np.zeros((joints, self.smooth.shape[1], size + count + 1, size + count + 1))
        old, new = [*range(size), size + count], slice(size, size + count)
        for found, before in ((whole, self.whole), (smooth, self.smooth)):
            found[..., np.array(old)[:, None], np.array(old)] = before
        for each, (added, _) in zip(blocks, own, strict=True):
            mine = added.rows * each.usable[..., None]
            flat, others = (x.reshape(-1, *x.shape[2:]) for x in (mine, each.rows))
            product = np.stack([flat[:, r].T @ others[:, r] for r in range(joints)])[..., [*columns, -1]]
            product = product * more[:, None] * scale
            within = np.stack([flat[:, r].T @ flat[:, r] for r in range(joints)]) * np.outer(more, more)
            along = np.einsum("btrs,btri->brsi", each.basis, mine, optimize=True) * more
            theirs = each.smooth[..., [*columns, -1]] * scale
            product_smooth = np.einsum("brsi,brsk->rsik", along, theirs, optimize=True)
            for found, part, square in (
                (whole, product, within),
                (smooth, product_smooth, np.einsum("brsi,brsj->rsij", along, along, optimize=True)),
            ):
                found[..., new, old] += part
                found[..., old, new] += np.swapaxes(part, -1, -2)
                found[..., new, new] += square
        shared = np.zeros((*self.shared.shape[:-1], size + count + 1))
        shared[..., old] = self.shared
        noises = [noise.expected(each.counts)[..., :-1] for each, (_, noise) in zip(blocks, own, strict=True)]
        shared[..., new] = np.concatenate(noises) * more
        return replace(self, whole=whole, smooth=smooth, shared=shared)

    def energies(self, coefficients: Array, covariance: Array) -> tuple[Array, Array]:
        """Return the expected energies, white (R,) and along each polynomial (R, POLYNOMIALS), of a residual.

        coefficients: (K+1,) of the residual, the last one 1
        covariance:   (K, K) of the others
        """
        second = np.outer(coefficients, coefficients)
        second[:-1, :-1] += covariance
        whole, smooth = (each.reshape(*each.shape[:-2], -1) @ second.ravel() for each in (self.whole, self.smooth))
        return whole - np.sum(smooth, axis=1), smooth

    def certain_energies(self, coefficients: Array) -> tuple[Array, Array]:
        """Return the energies, white (H, R) and smooth (H, R, POLYNOMIALS), of residuals with coefficients (H, K+1)."""
        whole = np.einsum("hi,rhi->hr", coefficients, coefficients @ self.whole)
        smooth = np.einsum("hi,rkhi->hrk", coefficients, coefficients @ self.smooth)
        return whole - np.sum(smooth, axis=2), smooth

    def rms(self, coefficients: Array) -> Array:
        """Return the rms (R,) of a residual with coefficients (K+1,), in noise floors."""
        energy = np.einsum("i,rij,j->r", coefficients, self.whole, coefficients)
        return np.asarray(np.sqrt(np.maximum(energy, 0.0) / np.maximum(self.rows, 1.0)))
