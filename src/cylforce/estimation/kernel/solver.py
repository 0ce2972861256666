"""Constants of identified parameters, for the residual torque, the load and the force at the tool (`solving.py` makes
them); and triangles of symmetric matrices, by which the kernel solves."""

from collections.abc import Sequence
from math import sqrt
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, inner, record


@record
class KernelSolver:
    """Constants of R rows of K columns, of which the first P are those of the tares; C cylinders; D drifting
    parameters; T unknowns at the tool. The limits are those of `service`, by the same names. One solver serves one
    thread, because it has room for intermediate results.

    at_rest, tip, coulomb: first columns of friction at rest, of the tool and of Coulomb friction
    loads, dry_size:    lengths of `load` and of `dry`
    scale:              factor on the residual torque
    scale_error:        its standard error
    relative:           model error as a share of the residual torque
    changing:           (D,) columns of the drift
    load_at:            (M, 2) parameter and component of a load
    load:               (M,) numbers of the (P, 4) table from a load to parameters that are not zero
    values, covariance: (P,) and (P, P) of the tares
    row_error:          (R,) of the tares [N m]
    dry:                (C,) Coulomb friction; empty: none
    by_load:            (C,) share of a cylinder's force by which its dry friction increases
    prior:              (T, T) information on the force
    places, at, many, spread, own, square, other, some: room for intermediate results
    """

    r: Count
    k: Count
    p: Count
    c: Count
    d: Count
    t: Count
    at_rest: Count
    tip: Count
    loads: Count
    dry_size: Count
    coulomb: Count
    scale: Number
    scale_error: Number
    relative: Number
    gate: Number
    break_away: Number
    cold: Number
    drifted: Number
    memory: Number
    patience: Number
    keep: Number
    late: Number
    largest: Number
    learning: Number
    heaviest: Number
    changing: Counts
    load_at: Counts
    places: Counts
    at: Counts
    many: Counts
    load: Numbers
    values: Numbers
    covariance: Numbers
    row_error: Numbers
    dry: Numbers
    by_load: Numbers
    prior: Numbers
    spread: Numbers
    own: Numbers
    square: Numbers
    other: Numbers
    some: Numbers
    arrays: object

    def __init__(self, sizes: Sequence[int], limits: Sequence[float], counts: list[Any], numbers: list[Any]) -> None:
        """Everything in the order of the fields."""
        self.arrays = (counts, numbers)
        self.r, self.k, self.p, self.c, self.d, self.t, self.at_rest, self.tip = (sizes[i] for i in range(8))
        self.scale, self.scale_error, self.relative, self.gate, self.break_away = (limits[i] for i in range(5))
        self.cold, self.drifted, self.memory, self.patience = (limits[i] for i in range(5, 9))
        self.keep, self.late, self.largest, self.learning = (limits[i] for i in range(9, 13))
        self.heaviest = limits[13]
        self.changing, self.load_at = as_counts(counts[0]), as_counts(counts[1])
        self.places, self.at = as_counts(counts[2]), as_counts(counts[3])
        self.many = as_counts(counts[4])
        self.load, self.values = as_numbers(numbers[0]), as_numbers(numbers[1])
        self.covariance, self.row_error = as_numbers(numbers[2]), as_numbers(numbers[3])
        self.dry, self.prior = as_numbers(numbers[4]), as_numbers(numbers[5])
        self.spread, self.own = as_numbers(numbers[6]), as_numbers(numbers[7])
        self.square, self.other = as_numbers(numbers[8]), as_numbers(numbers[9])
        self.some = as_numbers(numbers[10])
        self.by_load = as_numbers(numbers[11])
        self.loads, self.dry_size, self.coulomb = len(numbers[0]), len(numbers[4]), sizes[8]


@inner
def factor(matrix: Numbers, size: Count, usable: Numbers) -> None:
    """Replace the lower triangle of a matrix by its Cholesky factor, of the usable rows alone."""
    for i in range(size):
        for j in range(i + 1):
            if usable[i] != 0.0 and usable[j] != 0.0:
                total = matrix[i * size + j]
                for k in range(j):
                    if usable[k] != 0.0:
                        total -= matrix[i * size + k] * matrix[j * size + k]
                matrix[i * size + j] = sqrt(max(total, 1e-300)) if i == j else total / matrix[j * size + j]


@inner
def forward(matrix: Numbers, size: Count, usable: Numbers, x: Numbers, o: Count) -> None:
    """Compute x <- L^-1 x of the usable rows, 0 in the others; x begins at `o`."""
    for i in range(size):
        total = x[o + i]
        for k in range(i):
            total -= matrix[i * size + k] * x[o + k] if usable[k] != 0.0 else 0.0
        x[o + i] = total / matrix[i * size + i] if usable[i] != 0.0 else 0.0


@inner
def backward(matrix: Numbers, size: Count, usable: Numbers, x: Numbers, o: Count) -> None:
    """Compute x <- L'^-1 x of the usable rows, 0 in the others; x begins at `o`."""
    for i in range(size - 1, -1, -1):
        total = x[o + i]
        for k in range(i + 1, size):
            total -= matrix[k * size + i] * x[o + k] if usable[k] != 0.0 else 0.0
        x[o + i] = total / matrix[i * size + i] if usable[i] != 0.0 else 0.0


@inner
def invert(matrix: Numbers, size: Count, into: Numbers, o: Count) -> None:
    """Write the inverse of a positive definite matrix, of which the lower triangle is given, to the place `o` of
    `into`."""
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i * size + j]
            for k in range(j):
                total -= matrix[i * size + k] * matrix[j * size + k]
            matrix[i * size + j] = sqrt(max(total, 1e-300)) if i == j else total / matrix[j * size + j]
    for column in range(size):
        for i in range(size):
            total = 1.0 if i == column else 0.0
            for k in range(i):
                total -= matrix[i * size + k] * into[o + k * size + column]
            into[o + i * size + column] = total / matrix[i * size + i]
        for i in range(size - 1, -1, -1):
            total = into[o + i * size + column]
            for k in range(i + 1, size):
                total -= matrix[k * size + i] * into[o + k * size + column]
            into[o + i * size + column] = total / matrix[i * size + i]
