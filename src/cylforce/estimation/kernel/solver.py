"""Constants of identified parameters, for the residual torque, the load and the force at the tool (`solving.py` makes
them); and triangles of symmetric matrices, by which the kernel solves."""

from collections.abc import Sequence
from math import sqrt
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, inner, record


@record
class KernelSolver:
    """Constants of identified parameters for R rows of K columns, of which the first P are those of the tares; C
    cylinders; D drifting frictions and pressure zeros; T unknowns at the tool (force x, z, moment). One solver serves
    one thread, because it has room for intermediate results.

    Numbers and columns:
    r, k, p, c, d, t: sizes R, K, P, C, D, T
    at_rest:      first of C columns of friction of unknown direction, at rest
    tip:          first of three columns of force x, z and moment at the tool
    coulomb:      first of C columns of Coulomb friction
    loads:        M, length of `load`
    dry_size:     length of `dry`
    changing:     (D,) columns of the drift

    Tares:
    scale:        factor on the residual torque
    scale_error:  relative standard error of weights and forces by the scale (`Tares.reported_scale_error`)
    relative:     model error as a share of the residual torque
    values:       (P,) tares
    covariance:   (P, P) of the tares
    row_error:    (R,) rms torque that the tares do not explain [N m]
    dry:          (C,) Coulomb friction [N]; empty: none
    by_load:      (C,) share of a cylinder's force by which its dry friction increases
    load_at:      (M, 2) tare, and component 0 to 3 of a load (m, m x, m z, J), of each number of `load`
    load:         (M,) numbers that are not zero of the (P, 4) table from a load to tares
    prior:        (T, T) prior information on force and moment at the tool [1/N^2, 1/(N m)^2]

    Limits of the weighing (`service.weighing`):
    gate:         mean squared normalised innovation above which an instant does not fit the load
    break_away:   factor on the standard error of friction at rest, for break-away friction
    cold:         factor on the standard error of the drift, for cold oil
    drifted:      largest variance that unknown drift adds, in variances of the row
    memory:       consecutive samples that count as one independent sample
    longest_rest: steps at rest after which a row is not taken into a lift

    Limits of the force (`service.contact.noise`):
    keep:         factor by which an error of the instant fades in a step
    delay_s:      delay of the torque of inertia [s]
    largest:      largest squared normalised residual from which the variance is learned
    learning:     samples in which the learned variance follows
    heaviest:     largest weight of a mass in the bucket [N]

    Room for intermediate results:
    sparse_at, sparse_x: (P + D,) places and values of the numbers of a vector that are not zero (`weighed.quadratic`)
    nonzero:      (R, P) places of the columns of the tares that are not zero, of each row
    nonzeros:     (R,) number of these places
    tare_columns: (R, P) columns of the tares; also the rows of the tool
    short_work:   (4 max(R, 4),)
    matrix:       (max(R, 4), max(R, 4))
    work:         as long as the longest row

    arrays:       the lists of arrays, kept so that the memory of the fields above remains
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
    longest_rest: Number
    keep: Number
    delay_s: Number
    largest: Number
    learning: Number
    heaviest: Number
    changing: Counts
    load_at: Counts
    sparse_at: Counts
    nonzero: Counts
    nonzeros: Counts
    load: Numbers
    values: Numbers
    covariance: Numbers
    row_error: Numbers
    dry: Numbers
    by_load: Numbers
    prior: Numbers
    short_work: Numbers
    tare_columns: Numbers
    matrix: Numbers
    work: Numbers
    sparse_x: Numbers
    arrays: object

    def __init__(self, sizes: Sequence[int], limits: Sequence[float], counts: list[Any], numbers: list[Any]) -> None:
        """Set the constants of identified parameters, and room for intermediate results, from lists.

        sizes:   numbers of measured torques (r), columns (k), tares (p), cylinders (c), drifts (d) and unknowns at the
                 tool (t); first columns of friction at rest, of the tool and of Coulomb friction
        limits:  factor on the residual torque, relative standard error of weights and forces by it, model error as a
                 share of the torque; limits of the weighing (gate to longest_rest) and of the force (keep to heaviest),
                 as in `solving.Limits`
        counts:  arrays of integers: columns of the drift, places of a load among the tares, and three arrays of room
        numbers: arrays of numbers: shares of a load in the tares, tares, their covariance, errors of the rows [N m],
                 Coulomb frictions [N], prior information on the force; four arrays of room; room for a sparse vector;
                 share of each cylinder's force by which its friction increases
        """
        self.arrays = (counts, numbers)
        self.r, self.k, self.p, self.c, self.d, self.t, self.at_rest, self.tip = (sizes[i] for i in range(8))
        self.scale, self.scale_error, self.relative, self.gate, self.break_away = (limits[i] for i in range(5))
        self.cold, self.drifted, self.memory, self.longest_rest = (limits[i] for i in range(5, 9))
        self.keep, self.delay_s, self.largest, self.learning = (limits[i] for i in range(9, 13))
        self.heaviest = limits[13]
        self.changing, self.load_at = as_counts(counts[0]), as_counts(counts[1])
        self.sparse_at, self.nonzero = as_counts(counts[2]), as_counts(counts[3])
        self.nonzeros = as_counts(counts[4])
        self.load, self.values = as_numbers(numbers[0]), as_numbers(numbers[1])
        self.covariance, self.row_error = as_numbers(numbers[2]), as_numbers(numbers[3])
        self.dry, self.prior = as_numbers(numbers[4]), as_numbers(numbers[5])
        self.short_work, self.tare_columns = as_numbers(numbers[6]), as_numbers(numbers[7])
        self.matrix, self.work = as_numbers(numbers[8]), as_numbers(numbers[9])
        self.sparse_x = as_numbers(numbers[10])
        self.by_load = as_numbers(numbers[11])
        self.loads, self.dry_size, self.coulomb = len(numbers[0]), len(numbers[4]), sizes[8]


@inner
def factor(matrix: Numbers, size: Count, usable: Numbers) -> None:
    """Replace a symmetric positive definite matrix by its Cholesky factor L, of the usable rows and columns alone.

    A pivot that rounding makes negative is replaced by 1e-300.

    Read:
    usable: (size,) 1 where a row can be used, else 0; the other rows and columns are unchanged

    Read and written:
    matrix: (size, size), of which only the lower triangle is used
    """
    for i in range(size):
        for j in range(i + 1):
            if usable[i] != 0.0 and usable[j] != 0.0:
                total = matrix[i * size + j]
                for k in range(j):
                    if usable[k] != 0.0:
                        total -= matrix[i * size + k] * matrix[j * size + k]
                matrix[i * size + j] = sqrt(max(total, 1e-300)) if i == j else total / matrix[j * size + j]


@inner
def forward(matrix: Numbers, size: Count, usable: Numbers, x: Numbers, x_at: Count) -> None:
    """Replace x by L^-1 x for the usable rows, and by 0 in the others.

    Read:
    matrix: (size, size), whose lower triangle is the Cholesky factor L of the usable rows (`factor`)
    usable: (size,) 1 where a row can be used, else 0

    Read and written:
    x:      contains the vector (size,) from `x_at` on
    """
    for i in range(size):
        total = x[x_at + i]
        for k in range(i):
            total -= matrix[i * size + k] * x[x_at + k] if usable[k] != 0.0 else 0.0
        x[x_at + i] = total / matrix[i * size + i] if usable[i] != 0.0 else 0.0


@inner
def backward(matrix: Numbers, size: Count, usable: Numbers, x: Numbers, x_at: Count) -> None:
    """Replace x by L'^-1 x for the usable rows, and by 0 in the others.

    Read:
    matrix: (size, size), whose lower triangle is the Cholesky factor L of the usable rows (`factor`)
    usable: (size,) 1 where a row can be used, else 0

    Read and written:
    x:      contains the vector (size,) from `x_at` on
    """
    for i in range(size - 1, -1, -1):
        total = x[x_at + i]
        for k in range(i + 1, size):
            total -= matrix[k * size + i] * x[x_at + k] if usable[k] != 0.0 else 0.0
        x[x_at + i] = total / matrix[i * size + i] if usable[i] != 0.0 else 0.0


@inner
def invert(matrix: Numbers, size: Count, inverse: Numbers, inverse_at: Count) -> None:
    """Compute the inverse of a symmetric positive definite matrix by its Cholesky factor L, column by column.

    A pivot that rounding makes negative is replaced by 1e-300.

    Read and destroyed:
    matrix:  (size, size), of which only the lower triangle is used; it is replaced by L

    Written:
    inverse: gets the whole inverse (size, size) from `inverse_at` on; it may be another part of the array `matrix`
    """
    for i in range(size):
        for j in range(i + 1):
            total = matrix[i * size + j]
            for k in range(j):
                total -= matrix[i * size + k] * matrix[j * size + k]
            matrix[i * size + j] = sqrt(max(total, 1e-300)) if i == j else total / matrix[j * size + j]
    for column in range(size):
        for i in range(size):  # L^-1 of a column of the unit matrix
            total = 1.0 if i == column else 0.0
            for k in range(i):
                total -= matrix[i * size + k] * inverse[inverse_at + k * size + column]
            inverse[inverse_at + i * size + column] = total / matrix[i * size + i]
        for i in range(size - 1, -1, -1):  # L'^-1 of that
            total = inverse[inverse_at + i * size + column]
            for k in range(i + 1, size):
                total -= matrix[k * size + i] * inverse[inverse_at + k * size + column]
            inverse[inverse_at + i * size + column] = total / matrix[i * size + i]
