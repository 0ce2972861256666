"""Least squares of any length in constant memory: a recording as triangular factors of its blocks.

A block's rows [columns | observed] are kept as the triangle of their QR decomposition, which is all that least
squares ever asks of them: parameters, residual sums, scores. Blocks weigh alone, can be left out (held-out
prediction), counted down (outliers), grouped (standard errors under correlation). When there are too many, neighbours
merge."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.estimate import Array

CHUNK = 4096  # rows that are decomposed at once: small enough for the cache


class Factors(NamedTuple):
    """B blocks of R measured rows each: `triangle` (B, R, K+1, K+1) upper triangular, of K columns and the observed
    value; `noise`, the same of what the sensors' noise alone adds to those rows; `aside`, the same of rows that are not
    fitted, but count in what is left unexplained; `samples` (B, R): how many are fitted, `others` (B, R): how many are
    not; `mark` (B, M): what else is known of a block (e.g. posture, speed), its mean."""

    triangle: Array
    noise: Array
    aside: Array
    samples: Array
    others: Array
    mark: Array


class BlockRows(NamedTuple):
    """Of a stretch: `columns` (T, R, K) and `observed` (T, R), NaN where not usable; `noise` (T, R, K+1): what the
    sensors' noise adds to both; `fitted` (T, R): whether a row is fitted or only counts in what is left unexplained;
    `mark` (T, M)."""

    columns: Array
    observed: Array
    noise: Array
    fitted: NDArray[np.bool_]
    mark: Array


def triangle_of(rows: Array) -> Array:
    """The triangle (K, K) of rows (T, K): T may be any length, zero-padded when it is short."""
    size = rows.shape[1]
    held = np.zeros((size, size))
    for first in range(0, len(rows), CHUNK):
        held = upper(np.concatenate([held, rows[first : first + CHUNK]]))
    return held


def upper(rows: Array) -> Array:
    """The triangle (..., K, K) of rows (..., T >= K, K)."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def factors(columns: Array, observed: Array, mark: Array, block: int) -> Factors:
    """Factors of a stretch without noise: columns (T, R, K), observed (T, R) with NaN where not usable, mark (T, M),
    `block` samples a block."""
    exact = np.zeros((*observed.shape, columns.shape[-1] + 1))
    return row_factors(BlockRows(columns, observed, exact, np.ones(observed.shape, dtype=bool), mark), block)


def row_factors(rows: BlockRows, block: int) -> Factors:
    """Factors of a stretch, `block` samples a block."""
    both = np.concatenate([rows.columns, rows.observed[..., None]], axis=-1)
    good = np.all(np.isfinite(both), axis=-1)
    fitted, others = good & rows.fitted, good & np.logical_not(rows.fitted)
    parts = [slice(k, k + block) for k in range(0, len(both), block)]
    return Factors(
        _triangles(both, fitted, block),
        _triangles(rows.noise, fitted, block),
        _triangles(both, others, block),
        np.array([fitted[p].sum(axis=0) for p in parts], dtype=np.float64),
        np.array([others[p].sum(axis=0) for p in parts], dtype=np.float64),
        np.array([rows.mark[p].mean(axis=0) for p in parts]),
    )


def _triangles(rows: Array, good: NDArray[np.bool_], block: int) -> Array:
    """The triangles (B, R, K, K) of the good ones of rows (T, R, K); a row of zeros tells nothing."""
    steps, measured, size = rows.shape
    held = np.zeros((-(-steps // block), measured, max(block, size), size))
    if not np.any(good) or not np.any(rows[good]):
        return held[:, :, :size]
    for k, first in enumerate(range(0, steps, block)):
        part = slice(first, first + block)
        held[k, :, : len(rows[part])] = np.where(good[part, :, None], rows[part], 0.0).swapaxes(0, 1)
    return upper(held)


def joined(parts: Iterable[Factors], most: int) -> Factors:
    """All blocks, in order; beyond `most` neighbours are merged in pairs, again and again."""
    held: Factors | None = None
    for part in parts:
        held = part if held is None else Factors(*(np.concatenate(pair) for pair in zip(held, part, strict=True)))
        while len(held.samples) > most:
            held = _halved(held)
    if held is None:
        raise ValueError("no blocks to join")
    return held


def _each(held: Factors, change: Callable[[Array], Array]) -> Factors:
    """The same change of all triangles."""
    return held._replace(triangle=change(held.triangle), noise=change(held.noise), aside=change(held.aside))


def _halved(held: Factors) -> Factors:
    size = len(held.samples) // 2 * 2
    even = Factors(*(part[:size] for part in held))
    samples, others = (part.reshape(size // 2, 2, -1) for part in (even.samples, even.others))
    weight = samples.sum(axis=2, keepdims=True) + 1e-9
    mark = np.sum(even.mark.reshape(size // 2, 2, -1) * weight, axis=1) / np.sum(weight, axis=1)
    merged = _each(even, _paired)._replace(samples=samples.sum(axis=1), others=others.sum(axis=1), mark=mark)
    return Factors(*(np.concatenate([m, last[size:]]) for m, last in zip(merged, held, strict=True)))


def _paired(triangle: Array) -> Array:
    return upper(np.concatenate([triangle[0::2], triangle[1::2]], axis=-2))


def chosen(held: Factors, columns: list[int]) -> Factors:
    """The same with some of the columns only."""
    keep = [*columns, held.triangle.shape[-1] - 1]
    return _each(held, lambda triangle: upper(triangle[..., keep]))


def beside(held: Factors, combinations: Array) -> Factors:
    """The same with M more columns, each row's `combinations` (R, K, M) of those that are there."""

    def wider(triangle: Array) -> Array:
        return np.concatenate([triangle[..., :-1], triangle[..., :-1] @ combinations, triangle[..., -1:]], axis=-1)

    return _each(held, wider)


def settled(held: Factors, columns: list[int], values: Array) -> Factors:
    """Without `columns`, whose parameters are known to be `values`: what they explain is taken off the observed
    value."""
    rest = [k for k in range(held.triangle.shape[-1] - 1) if k not in set(columns)]

    def without(triangle: Array) -> Array:
        left = triangle[..., -1:] - triangle[..., columns] @ values[:, None]
        return np.concatenate([triangle[..., :-1], left], axis=-1)

    return chosen(_each(held, without), rest)


def of_row(held: Factors, row: int) -> Factors:
    """One of the measured rows alone."""
    return Factors(*(part[:, [row]] for part in held))._replace(mark=held.mark)


def of_noise(held: Factors) -> Factors:
    """What the sensors' noise alone adds, as if it had been measured."""
    return held._replace(triangle=held.noise)


def of_others(held: Factors) -> Factors:
    """The rows that are not fitted, as if they were."""
    return held._replace(triangle=held.aside, samples=held.others)


def of_all(held: Factors) -> Factors:
    """All rows, as if they were fitted; noise as of those that are."""
    triangle = upper(np.concatenate([held.triangle, held.aside], axis=-2))
    return held._replace(triangle=triangle, samples=held.samples + held.others)


def stacked_triangle(held: Factors, weight: Array) -> Array:
    """The triangle (K+1, K+1) of all rows, those of block b and row r multiplied by `weight` (B, R)."""
    rows = held.triangle * weight[..., None, None]
    return triangle_of(rows.reshape(-1, rows.shape[-1]))


def residual_squares(held: Factors, values: Array) -> Array:
    """Sum of squared residuals (B, R) of every block at `values` (K,)."""
    left = held.triangle @ np.append(values, -1.0)
    return np.asarray(np.sum(left**2, axis=-1))


def scores(held: Factors, values: Array) -> Array:
    """A' e (B, R, K) of every block: the pull of its residuals e = observed - A values on the parameters."""
    left = -held.triangle @ np.append(values, -1.0)
    return np.asarray((np.swapaxes(held.triangle, -1, -2) @ left[..., None])[..., :-1, 0])
