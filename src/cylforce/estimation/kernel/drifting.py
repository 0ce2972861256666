"""Constants of one machine for the adaptation of friction and pressure zeros: columns, limits, priors, and room for
intermediate results."""

from collections.abc import Sequence
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, record

USUAL: Count = 4  # place of the usual carry-back, after the load's four deviations from it
DRIFT: Count = 5  # place of the first drift, after the usual carry-back


@record
class KernelDrift:
    """Constants of one machine for the adaptation of friction and pressure zeros while the empty bucket returns.

    There are R rows (measured torques) of K columns. The N = 5 + D unknowns are the deviation of this return's
    carry-back from the usual one, as a load (m, m x, m z, J) (4); the mass of the usual carry-back (1); and the D
    drifts, frictions first, then pressure zeros.

    r, k, n:   sizes R, K, N
    rests:     number of columns in `at_rest`
    coulombs:  number of columns in `coulomb`
    loads:     M, length of `load`

    Limits of the adaptation (`service.adaptation`):
    certain:   largest share of the lever with friction of unknown direction, at which a row is used
    keep:      share of the old information that an update keeps
    memory:    number of updates that count as one independent measurement
    prior:     number of measurements that count as much as the prior spread of the drift
    shown:     share of the difference by which an update changes the drift in kilograms
    mean:      prior mean of the usual carry-back, in its standard errors

    Model:
    changing:  (D,) columns of the drift
    kinds:     (D,) 0 friction, 1 zero
    load_at:   (M, 2) parameter, and component 0 to 3 of a load, of each number of `load`
    at_rest:   columns of friction of unknown direction, at rest
    coulomb:   columns of Coulomb friction
    load:      (M,) share of that parameter in that component
    unit:      (N,) prior standard errors of the unknowns
    low, high: (D,) limits of the drift
    row_error: (R,) standard error of each row [N m]
    alike:     (D, D) inverse of the prior correlation of the drifts, none between kinds
    usual:     (4,) load of one kilogram of the usual carry-back

    Room for intermediate results:
    good:      (R,) rows to use
    rows:      (R, N) their coefficients
    basis:     (R, N) directions in which information is forgotten; then its first row is the estimate
    row:       (N,) one row
    matrix:    (N, N) triangle, then information
    inverse:   (N, N) right-hand side of the triangle (N,), then inverse information
    """

    r: Count
    k: Count
    n: Count
    rests: Count
    coulombs: Count
    loads: Count
    certain: Number
    keep: Number
    memory: Number
    prior: Number
    shown: Number
    mean: Number
    changing: Counts
    kinds: Counts
    load_at: Counts
    good: Counts
    at_rest: Counts
    coulomb: Counts
    load: Numbers
    unit: Numbers
    low: Numbers
    high: Numbers
    row_error: Numbers
    alike: Numbers
    usual: Numbers
    rows: Numbers
    basis: Numbers
    row: Numbers
    matrix: Numbers
    inverse: Numbers
    arrays: object

    def __init__(self, sizes: Sequence[int], limits: Sequence[float], counts: list[Any], numbers: list[Any]) -> None:
        """Set the constants of a machine, and the room for intermediate results, from lists.

        sizes:   numbers of measured torques (r), of columns (k) and of unknowns (n): 5 of the carry-back, D drifts
        limits:  certain, largest share of a lever with friction of unknown direction; keep, share of the information
                 that an update keeps; memory, updates that count as one measurement; prior, measurements for which the
                 prior spread counts; shown, share of an update of the mass; mean, usual carry-back before any return
        counts:  arrays of integers: columns of the drifts and their kinds, places of a load among the parameters, room
                 for the rows to use, columns of friction at rest and of Coulomb friction
        numbers: arrays of numbers: shares of a load in the parameters, prior standard errors of the unknowns, limits of
                 the drift (lowest, highest), errors of the rows [N m], inverse correlation of the drifts, load of one
                 kilogram of carry-back, and five arrays of room
        """
        self.arrays = (counts, numbers)
        self.r, self.k, self.n = sizes[0], sizes[1], sizes[2]
        self.certain, self.keep, self.memory, self.prior, self.shown, self.mean = (limits[i] for i in range(6))
        self.changing, self.kinds = as_counts(counts[0]), as_counts(counts[1])
        self.load_at, self.good = as_counts(counts[2]), as_counts(counts[3])
        self.at_rest, self.coulomb = as_counts(counts[4]), as_counts(counts[5])
        self.rests, self.coulombs, self.loads = len(counts[4]), len(counts[5]), len(numbers[0])
        self.load, self.unit = as_numbers(numbers[0]), as_numbers(numbers[1])
        self.low, self.high, self.row_error = as_numbers(numbers[2]), as_numbers(numbers[3]), as_numbers(numbers[4])
        self.alike, self.usual, self.rows = as_numbers(numbers[5]), as_numbers(numbers[6]), as_numbers(numbers[7])
        self.basis, self.row, self.matrix = as_numbers(numbers[8]), as_numbers(numbers[9]), as_numbers(numbers[10])
        self.inverse = as_numbers(numbers[11])
