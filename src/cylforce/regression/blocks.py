"""Least squares of any length in constant memory: a recording as triangular factors of its blocks.

A block's rows [columns | observed] are kept as the triangle of their QR decomposition, which is all that least
squares ever asks of them: parameters, residual sums, scores. Blocks weigh alone, can be left out (held-out
prediction), counted down (outliers), grouped (standard errors under correlation). When there are too many, neighbours
merge."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from cylforce.words.estimate import Array

CHUNK = 4096  # rows that are decomposed at once: small enough for the cache


class Factors(NamedTuple):
    """B blocks of R measured rows each: `triangle` (B, R, K+1, K+1) upper triangular, of K columns and the observed
    value; `samples` (B, R): how many; `mark` (B, M): what else is known of a block (e.g. posture, speed), its
    mean."""

    triangle: Array
    samples: Array
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
    """Factors of a stretch: columns (T, R, K), observed (T, R) with NaN where not usable, mark (T, M), `block`
    samples a block."""
    rows = np.concatenate([columns, observed[..., None]], axis=-1)
    good = np.isfinite(observed) & np.all(np.isfinite(columns), axis=-1)
    parts = [slice(k, k + block) for k in range(0, len(observed), block)]
    triangles = [[triangle_of(rows[p, r][good[p, r]]) for r in range(observed.shape[1])] for p in parts]
    counts = np.array([good[p].sum(axis=0) for p in parts], dtype=np.float64)
    return Factors(np.array(triangles), counts, np.array([mark[p].mean(axis=0) for p in parts]))


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


def _halved(held: Factors) -> Factors:
    size = len(held.samples) // 2 * 2
    pairs = held.triangle[:size].reshape(size // 2, 2, *held.triangle.shape[1:])
    stacked = np.concatenate([pairs[:, 0], pairs[:, 1]], axis=-2)
    triangle = upper(stacked)
    samples, weight = (
        held.samples[:size].reshape(size // 2, 2, -1),
        held.samples[:size].sum(axis=1).reshape(-1, 2, 1) + 1e-9,
    )
    mark = np.sum(held.mark[:size].reshape(size // 2, 2, -1) * weight, axis=1) / np.sum(weight, axis=1)
    merged = Factors(triangle, samples.sum(axis=1), mark)
    if size == len(held.samples):
        return merged
    return Factors(*(np.concatenate([m, last[size:]]) for m, last in zip(merged, held, strict=True)))


def chosen(held: Factors, columns: list[int]) -> Factors:
    """The same with some of the columns only."""
    keep = [*columns, held.triangle.shape[-1] - 1]
    return held._replace(triangle=upper(held.triangle[..., keep]))


def beside(held: Factors, combinations: Array) -> Factors:
    """The same with M more columns, each row's `combinations` (R, K, M) of those that are there."""
    more = held.triangle[..., :-1] @ combinations
    return held._replace(triangle=np.concatenate([held.triangle[..., :-1], more, held.triangle[..., -1:]], axis=-1))


def settled(held: Factors, columns: list[int], values: Array) -> Factors:
    """Without `columns`, whose parameters are known to be `values`: what they explain is taken off the observed
    value."""
    rest = [k for k in range(held.triangle.shape[-1] - 1) if k not in set(columns)]
    triangle = held.triangle.copy()
    triangle[..., -1] -= triangle[..., columns] @ values
    return chosen(held._replace(triangle=triangle), rest)


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
