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


def white(columns: Array, floor: Floor) -> White:
    """Columns (T, R, N) whitened by the floor, in units of its white noise."""
    each = [whitened(columns[:, r], floor.memory[r]) / floor.white[r] for r in range(columns.shape[1])]
    rows = np.stack(each, axis=1)
    good = np.all(np.isfinite(rows), axis=2)
    return White(np.where(good[..., None], rows, 0.0).astype(np.float32), good)


class Statistics(NamedTuple):
    """Of recordings with R joints, B blocks, K columns: `whole` (R, K+1, K+1) Gram matrices of [columns | left],
    `smooth` (B, R, SMOOTH, K+1) their share along the polynomials, `rows` (B, R) counted; `crossed` (R, K+1): what of
    the columns' product with what is left is the sensors' noise in both (errors in variables)."""

    whole: Array
    smooth: Array
    rows: Array
    crossed: Array


def statistics(each: Sequence[White], own: Sequence[int], shared: Array) -> Statistics:
    """The statistics of recordings' columns `own` and what is left, the last column; `shared` (R, K+1): noise of the
    columns per row that is also in what is left (see `crossed`)."""
    chosen = [*own, -1]
    parts = [_one(w.rows[..., chosen].astype(np.float64), w.good) for w in each]
    whole, smooth, rows = zip(*parts, strict=True)
    counted = np.concatenate(rows)
    return Statistics(np.sum(whole, axis=0), np.concatenate(smooth), counted, counted.sum(axis=0)[:, None] * shared)


def _one(rows: Array, good: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    padded = blocked(rows)
    usable = blocked(good.astype(np.float64))
    counted = usable.sum(axis=1)
    basis = polynomials(usable)
    whole = np.stack([rows[:, r].T @ rows[:, r] for r in range(rows.shape[1])])
    smooth = np.moveaxis(basis, 2, 1).swapaxes(2, 3) @ np.moveaxis(padded, 2, 1)
    return whole, np.asarray(smooth), np.asarray(counted)


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


def crossed(columns: Array, noisy: Array, floor: Floor, own: Sequence[int]) -> Array:
    """Noise of the columns per row that is also in what is left (R, K+1), of columns (T, R, N) and the same with the
    sensors' noise once more: the product of what it adds to the column and to what is left, in units of the floor's
    white noise; last the square of what it adds to the latter."""
    found = np.zeros((columns.shape[1], len(own) + 1))
    for r in range(columns.shape[1]):
        added = whitened(noisy[:, r] - columns[:, r], floor.memory[r])[:, [*own, -1]]
        added = added[np.all(np.isfinite(added), axis=1)]
        found[r] = added.T @ added[:, -1] / max(len(added) * float(floor.white[r]) ** 2, 1e-300)
    return found
