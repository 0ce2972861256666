"""Least squares of any length in constant memory: a recording as triangular factors of its blocks.

A block is a few seconds of a recording. Its rows [columns | observed] are stored as the triangle U of their QR
decomposition. U is sufficient for least squares: parameters, sums of squared residuals, scores. Each block has its own
weight: zero to predict it from the other blocks, a small one for an outlier. Its residuals can be summed up (standard
errors with correlation). When there are too many blocks, neighbours are merged."""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.signals.estimate import Array

CHUNK = 4096  # rows decomposed at once; chosen: small enough for the processor's cache


class Factors(NamedTuple):
    """Triangular factors of B blocks of R measured torques each.

    triangle: (B, R, K+1, K+1) upper triangular factor of the fitted rows [columns | observed], with K columns
    noise:    (B, R, K+1, K+1) factor of the noise that the sensors add to these rows
    aside:    (B, R, K+1, K+1) factor of rows that are not fitted, but whose residuals count in the row errors
    samples:  (B, R) number of fitted rows
    others:   (B, R) number of rows set aside
    mark:     (B, M) means over the block of further quantities, such as posture and speed
    """

    triangle: Array
    noise: Array
    aside: Array
    samples: Array
    others: Array
    mark: Array


class BlockRows(NamedTuple):
    """Rows of a stretch of a recording.

    columns:  (T, R, K)
    observed: (T, R); NaN where not usable
    noise:    (T, R, K+1) noise that the sensors add to both; None: none
    fitted:   (T, R) whether a row is fitted, or set aside so that only its residual counts
    mark:     (T, M) further quantities, such as posture and speed
    """

    columns: Array
    observed: Array
    noise: Array | None
    fitted: NDArray[np.bool_]
    mark: Array


def triangle_of(rows: Array) -> Array:
    """Return upper triangular U (K, K) with U'U = rows' rows, of rows (T, K); T may also be less than K."""
    size = rows.shape[1]
    triangle = np.zeros((size, size))
    for first in range(0, len(rows), CHUNK):
        triangle = upper(np.concatenate([triangle, rows[first : first + CHUNK]]))
    return triangle


def upper(rows: Array) -> Array:
    """Return upper triangular U (..., K, K) of the QR decomposition of rows (..., T >= K, K)."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def factors(columns: Array, observed: Array, mark: Array, block: int) -> Factors:
    """Return the triangular factors of a stretch of a recording whose columns have no noise, cut into blocks.

    columns:  (T, R, K) of R measured torques
    observed: (T, R) what the columns explain; NaN where not usable
    mark:     (T, M) further quantities
    block:    samples per block
    """
    return row_factors(BlockRows(columns, observed, None, np.ones(observed.shape, dtype=bool), mark), block)


def row_factors(rows: BlockRows, block: int) -> Factors:
    """Return the triangular factors of the rows of a stretch of a recording, cut into blocks.

    A row that is not finite is omitted. Rows that are set aside have a factor of their own.

    rows:  of the stretch: columns (T, R, K), observed values (T, R), their noise, and which rows are fitted
    block: samples per block
    """
    size = rows.columns.shape[-1] + 1
    sums = rows.columns.reshape(-1, size - 1) @ np.ones(size - 1)  # of finite numbers of any size that occurs
    good = np.isfinite(sums.reshape(rows.observed.shape) + rows.observed)
    fitted, others = good & rows.fitted, good & np.logical_not(rows.fitted)
    both, noise = (rows.columns, rows.observed[..., None]), rows.noise
    begins = np.arange(0, len(good), block)
    counts = np.diff(np.append(begins, len(good)))[:, None]
    return Factors(
        _triangles(both, fitted, block, size),
        _triangles((noise,) if noise is not None and noise.any() else (), fitted, block, size),
        _triangles(both, others, block, size),
        np.add.reduceat(fitted, begins, dtype=np.float64),
        np.add.reduceat(others, begins, dtype=np.float64),
        np.add.reduceat(rows.mark, begins, dtype=np.float64) / counts,
    )


def _triangles(rows: tuple[Array, ...], good: NDArray[np.bool_], block: int, size: int) -> Array:
    """Return the upper triangular factors (B, R, K, K) of the QR decompositions of B blocks of R rows.

    Rows that are not good are replaced by zeros, which do not change a triangle. The last block may be shorter. One
    block after the other is decomposed in the same array, which stays in the processor's cache.

    rows:  parts (T, R, ...) side by side, together K numbers; no part: the triangles are zero
    good:  (T, R) whether a row is used
    block: samples per block
    size:  K
    """
    steps, measured = good.shape
    shape = (-(-steps // block), measured, size, size)
    if not rows or not good.any():
        return _zeros(shape)
    found, place = np.empty(shape), np.empty((measured, size, max(block, size)))
    for triangles, first in zip(found, range(0, steps, block), strict=True):
        _fill(place, [part[first : first + block] for part in rows], good[first : first + block])
        for triangle, columns in zip(triangles, place, strict=True):
            _decompose(columns, triangle)
    return found


def _decompose(columns: Array, into: Array) -> None:
    """Compute the upper triangular factor of the QR decomposition of a matrix (T, K), given by its columns.

    LAPACK needs this order, and NumPy's `qr` would copy the columns twice more.

    columns: (K, T), T >= K; overwritten
    into:    (K, K) written: the triangle
    """
    from scipy.linalg.lapack import dgeqrf  # here, because programs that only read results do without scipy

    size = len(columns)
    np.multiply(dgeqrf(columns.T, overwrite_a=True)[0][:size], _above(size), out=into)


@cache
def _above(size: int) -> Array:
    """Return (K, K), 1 on and above the diagonal, else 0."""
    return np.triu(np.ones((size, size)))


def _fill(place: Array, parts: list[Array], good: NDArray[np.bool_]) -> None:
    """Write the columns of one block, with zeros where a row is not good, and after its last sample.

    place: (R, K, T) written: column by column, for R measured torques; T is at least the number of samples
    parts: of the rows (samples, R, ...), side by side, together K numbers
    good:  (samples, R) whether a row is used
    """
    steps, column = len(good), 0
    place[..., steps:] = 0.0
    for part in parts:
        place[:, column : column + part.shape[-1], :steps] = part.transpose(1, 2, 0)
        column += part.shape[-1]
    if not good.all():
        np.copyto(place[..., :steps], 0.0, where=np.logical_not(good).T[:, None])


def _zeros(shape: tuple[int, ...]) -> Array:
    """Return an array of zeros that takes no memory (all strides are 0): noise, or rows set aside, of which there are
    none."""
    return np.broadcast_to(np.zeros(()), shape)


def _is_nothing(part: Array) -> bool:
    """Return whether an array was made by `_zeros`."""
    return not any(part.strides)


def _one_after_another(parts: Sequence[Array]) -> Array:
    """Return arrays (B1, ...), (B2, ...), ... as one (B1 + B2 + ..., ...): blocks of one part after those of another.

    If all are made by `_zeros`, and take no memory, the result does not either."""
    if all(map(_is_nothing, parts)):
        return _zeros((sum(map(len, parts)), *parts[0].shape[1:]))
    return np.concatenate(parts)


def joined(parts: Iterable[Factors], most: int) -> Factors:
    """Return all blocks of the parts in order. While there are more than `most`, neighbouring blocks are merged in
    pairs.

    Raises ValueError when there are no parts."""
    data: list[Factors] = []
    for part in parts:
        data.append(part)
        while sum(len(each.samples) for each in data) > most:
            data = [_halved(_together(data))]
    if not data:
        raise ValueError("no blocks to join")
    return _together(data)


def _together(parts: list[Factors]) -> Factors:
    """Return the blocks of all parts, one part after the other."""
    return Factors(*map(_one_after_another, zip(*parts, strict=True)))


def _each(data: Factors, change: Callable[[Array], Array]) -> Factors:
    """Return the factors with a function applied to all three kinds of triangles."""
    return data._replace(triangle=change(data.triangle), noise=change(data.noise), aside=change(data.aside))


def _halved(data: Factors) -> Factors:
    """Return the factors with neighbouring blocks merged in pairs; an odd last block remains.

    Numbers of samples are added. Marks are averaged, with the numbers of fitted samples of all torques as weights."""
    size = len(data.samples) // 2 * 2
    even = Factors(*(part[:size] for part in data))
    samples, others = (part.reshape(size // 2, 2, -1) for part in (even.samples, even.others))
    weight = samples.sum(axis=2, keepdims=True) + 1e-9
    mark = np.sum(even.mark.reshape(size // 2, 2, -1) * weight, axis=1) / np.sum(weight, axis=1)
    merged = _each(even, _paired)._replace(samples=samples.sum(axis=1), others=others.sum(axis=1), mark=mark)
    return Factors(*(_one_after_another((m, last[size:])) for m, last in zip(merged, data, strict=True)))


def _paired(triangle: Array) -> Array:
    """Return the triangles (B/2, R, K, K) of neighbouring blocks together, from those of the blocks (B, R, K, K).

    The triangle of two blocks is that of both triangles, one below the other."""
    if _is_nothing(triangle):
        return triangle[0::2]
    found, size = np.empty((len(triangle) // 2, *triangle.shape[1:])), triangle.shape[-1]
    place, each = np.empty((size, 2 * size)), triangle.reshape(len(found), 2, -1, size, size)
    for into, (first, second) in zip(found, each, strict=True):
        for row, a, b in zip(into, first, second, strict=True):
            place[:, :size], place[:, size:] = a.T, b.T
            _decompose(place, row)
    return found


def chosen(data: Factors, columns: list[int]) -> Factors:
    """Return the factors of a selection of the columns, for a fit of their parameters alone.

    columns: numbers of the columns to keep, in their new order
    """
    keep = [*columns, data.triangle.shape[-1] - 1]

    def kept(triangle: Array) -> Array:
        """Return the triangle (..., K+1, K+1) of the kept columns and the observed one."""
        if _is_nothing(triangle):
            return _zeros((*triangle.shape[:-2], len(keep), len(keep)))
        return upper(triangle[..., keep])

    return _each(data, kept)


def beside(data: Factors, combinations: Array) -> Factors:
    """Return the factors with M more columns, which are linear combinations of the existing ones.

    The new columns follow the K existing ones, the observed values remain last. The factors (K+1, K+M+1) are no
    triangles then, but still have the squares and products of the rows, which is all that a fit needs.

    data:         factors of K columns of R measured torques
    combinations: (R, K, M) coefficients of the new columns, for each measured torque
    """

    def wider(triangle: Array) -> Array:
        return np.concatenate([triangle[..., :-1], triangle[..., :-1] @ combinations, triangle[..., -1:]], axis=-1)

    return _each(data, wider)


def settled(data: Factors, columns: list[int], values: Array) -> Factors:
    """Return the factors without some columns, whose parameters are fixed and whose part is subtracted.

    data:    factors of K columns
    columns: (n,) numbers of the columns to remove
    values:  (n,) value of the parameter of each of them
    """
    rest = [k for k in range(data.triangle.shape[-1] - 1) if k not in set(columns)]

    def without(triangle: Array) -> Array:
        observed = triangle[..., -1:] - triangle[..., columns] @ values[:, None]
        return np.concatenate([triangle[..., :-1], observed], axis=-1)

    return chosen(_each(data, without), rest)


def of_row(data: Factors, row: int) -> Factors:
    """Return the factors of one measured torque alone, as number `row` of the R; R = 1 in the result."""
    return Factors(*(part[:, [row]] for part in data))._replace(mark=data.mark)


def of_noise(data: Factors) -> Factors:
    """Return the factors of the sensors' noise (`noise`) in place of those of the fitted rows (`triangle`)."""
    return data._replace(triangle=data.noise)


def of_others(data: Factors) -> Factors:
    """Return the factors of the rows set aside in place of those of the fitted rows."""
    return data._replace(triangle=data.aside, samples=data.others)


def of_all(data: Factors) -> Factors:
    """Return the factors of fitted rows and rows set aside together; the noise remains that of the fitted rows."""
    triangle = upper(np.concatenate([data.triangle, data.aside], axis=-2))
    return data._replace(triangle=triangle, samples=data.samples + data.others)


def stacked_triangle(data: Factors, weight: Array) -> Array:
    """Return one triangle (K+1, K+1) of the rows of all blocks and measured torques together, for a weighted fit.

    data:   factors of B blocks of R measured torques, of K columns
    weight: (B, R) factor on the rows of each block
    """
    if _is_nothing(data.triangle):
        return np.zeros(data.triangle.shape[-2:])
    rows = data.triangle * weight[..., None, None]
    return triangle_of(rows.reshape(-1, rows.shape[-1]))


def residual_squares(data: Factors, values: Array) -> Array:
    """Return the sum of squared residuals (B, R) of every block, in the squared unit of the observed values.

    data:   factors of B blocks of R measured torques
    values: (K,) parameters
    """
    residual = data.triangle @ np.append(values, -1.0)
    return np.asarray(np.sum(residual**2, axis=-1))


def scores(data: Factors, values: Array) -> Array:
    """Return the scores A' e (B, R, K) of every block, with columns A and residuals e = observed - A values.

    A score is the direction in which the block would change the parameters.

    data:   factors of B blocks of R measured torques
    values: (K,) parameters
    """
    if _is_nothing(data.triangle):
        return _zeros((*data.triangle.shape[:-2], len(values)))
    residual = -data.triangle @ np.append(values, -1.0)
    return np.asarray((np.swapaxes(data.triangle, -1, -2) @ residual[..., None])[..., :-1, 0])
