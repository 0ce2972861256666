"""What recordings say of every effect, as sufficient statistics: Gram matrices of whitened rows.

Of every joint r and block b of three seconds the first Legendre polynomials are kept by themselves, so that a smooth
discrepancy of any level can be put in later."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.columns.whitening import Floor, whitened
from cylforce.signals.estimate import Array

SMOOTH = 6  # Legendre polynomials of a block
FEWEST = 2 * SMOOTH  # rows of a block and joint, below which nothing smooth is taken out of it


class White(NamedTuple):
    """Whitened rows (T, R, N) of a recording, zero where not usable, and which are usable (T, R)."""

    rows: NDArray[np.float32]
    good: NDArray[np.bool_]


def white(columns: Array, floor: Floor, only: Sequence[int] | slice = slice(None)) -> White:
    """Columns (T, R, N) whitened by the floor, in units of its white noise; `only` some of them, the others zero."""
    each = [whitened(columns[:, r, only], floor.memory[r]) / floor.white[r] for r in range(columns.shape[1])]
    chosen = np.stack(each, axis=1)
    good = np.all(np.isfinite(chosen), axis=2)
    rows = np.zeros(columns.shape, dtype=np.float32)
    rows[..., only] = np.where(good[..., None], chosen, 0.0)
    return White(rows, good)


class Shared(NamedTuple):
    """Products (B, R, 1+SMOOTH, K+1) of the sensors' noise in every column and in what is left, block by block: of all
    rows, and along each polynomial; last the square of what is in the latter. Rows (B, R) that were counted."""

    products: Array
    rows: Array

    @classmethod
    def nothing(cls, joints: int, columns: int) -> "Shared":
        """No noise that `columns`, the last one what is left, share."""
        return cls(np.zeros((0, joints, 1 + SMOOTH, columns)), np.zeros((0, joints)))

    def of(self, counted: Array) -> Array:
        """The same in a recording with rows (B', R) counted: samples (B, R, 1+SMOOTH, K+1) that add up to it."""
        rows = np.sum(counted, axis=0) / np.maximum(np.sum(self.rows, axis=0), 1.0)
        blocks = np.sum(counted > 0.0, axis=0) / np.maximum(np.sum(self.rows > 0.0, axis=0), 1.0)
        found = self.products * blocks[:, None, None]
        found[:, :, 0] = self.products[:, :, 0] * rows[:, None]
        return np.asarray(found)


class Statistics(NamedTuple):
    """Of recordings with R joints, B blocks, K columns: `whole` (R, K+1, K+1) Gram matrices of [columns | left],
    `smooth` (B, R, SMOOTH, K+1) their share along the polynomials, `rows` (B, R) counted; `crossed`
    (S, R, 1+SMOOTH, K+1): samples that add up to what of the columns' product with what is left, whole and along each
    polynomial, is the sensors' noise in both (errors in variables)."""

    whole: Array
    smooth: Array
    rows: Array
    crossed: Array


def statistics(each: White, own: Sequence[int], shared: Shared) -> Statistics:
    """The statistics of a recording's columns `own` and what is left, the last column; `shared`: noise of the columns
    that is also in what is left (see `crossed`)."""
    whole, smooth, rows = _one(each.rows[..., [*own, -1]].astype(np.float64), each.good)
    return Statistics(whole, smooth, rows, shared.of(rows))


def _one(rows: Array, good: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    usable = blocked(good.astype(np.float64))
    whole = np.stack([rows[:, r].T @ rows[:, r] for r in range(rows.shape[1])])
    return whole, _along(rows, polynomials(usable)), np.asarray(usable.sum(axis=1))


def crossing(each: White, own: Sequence[int], places: Sequence[int]) -> tuple[Array, Array]:
    """Products of the columns `places` of [columns `own` | left] with all of these (R, M, K+1), and their share along
    the polynomials (R, SMOOTH, M, K+1)."""
    rows = each.rows[..., [*own, -1]].astype(np.float64)
    whole = np.stack([rows[:, r, places].T @ rows[:, r] for r in range(rows.shape[1])])
    along = _along(rows, polynomials(blocked(each.good.astype(np.float64))))
    smooth = np.einsum("brkm,brkj->rkmj", along[..., places], along, optimize=True)
    return whole, np.asarray(smooth)


def _along(rows: Array, basis: Array) -> Array:
    """Rows (T, R, N) along the polynomials (B, R, SMOOTH, N) of each block."""
    return np.asarray(np.moveaxis(basis, 2, 1).swapaxes(2, 3) @ np.moveaxis(blocked(rows), 2, 1))


def blocked(rows: Array) -> Array:
    """Rows (T, ...) as blocks (B, BLOCK, ...), filled with zeros."""
    count = -(-len(rows) // BLOCK)
    padded = np.zeros((count * BLOCK, *rows.shape[1:]), dtype=rows.dtype)
    padded[: len(rows)] = rows
    return padded.reshape(count, BLOCK, *rows.shape[1:])


def polynomials(good: Array) -> Array:
    """Orthonormal polynomials (B, BLOCK, R, SMOOTH) on the usable rows (B, BLOCK, R) of each block; zero where these
    are too few."""
    shapes = legvander(2.0 * (np.arange(BLOCK) + 0.5) / BLOCK - 1.0, SMOOTH - 1)
    masked = np.moveaxis(good[..., None] * shapes[:, None, :], 1, 2)  # (B, R, BLOCK, SMOOTH)
    enough = good.sum(axis=1) >= FEWEST
    found = np.zeros_like(masked)
    found[enough] = np.linalg.qr(masked[enough])[0]
    return np.moveaxis(found, 2, 1)


def laid(each: White, rows: NDArray[np.int_]) -> White:
    """Some rows (N,) in another order, in whole blocks; -1: none."""
    there = rows >= 0
    found = np.where(there[:, None, None], each.rows[rows], np.float32(0.0))
    return White(found, each.good[rows] & there[:, None])


def shared(added: Array, floor: Floor, own: Sequence[int], rows: NDArray[np.int_] | None = None) -> Shared:
    """The noise that columns and what is left share, of what the sensors' noise once more adds to them (T, R, N): the
    product of what it adds to the columns `own` and to what is left, in units of the floor's white noise; of all rows,
    or of `rows` in their order (see `laid`)."""
    each = white(added[..., [*own, -1]], floor)
    each = each if rows is None else laid(each, rows)
    noise, good = blocked(each.rows.astype(np.float64)), blocked(each.good.astype(np.float64))
    along = np.einsum("btrs,btrk->brsk", polynomials(good), noise, optimize=True)
    whole = np.einsum("btrk,btr->brk", noise, noise[..., -1], optimize=True)
    return Shared(np.concatenate([whole[:, :, None], along * along[..., -1:]], axis=2), good.sum(axis=1))


def energy(each: Sequence[Shared]) -> Array:
    """Energy of the noise in what is left (R, 1+SMOOTH) of recordings: per row, and per block along each polynomial."""
    products = np.sum([np.sum(s.products[..., -1], axis=0) for s in each], axis=0)
    rows = np.sum([np.sum(s.rows, axis=0) for s in each], axis=0)
    blocks = np.sum([np.sum(s.rows > 0.0, axis=0) for s in each], axis=0)
    return np.asarray(products / np.maximum(np.column_stack([rows, *[blocks] * SMOOTH]), 1.0))
