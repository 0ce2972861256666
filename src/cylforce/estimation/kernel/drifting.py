"""Constants of one machine for the adaptation of friction and pressure zeros: columns, limits, priors, and room for
intermediate results."""

from collections.abc import Sequence
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, record

USUAL: Count = 4  # place of the usual amount, after the load's four deviations from it
DRIFT: Count = 5  # place of the first drift, after the usual amount


@record
class KernelDrift:
    """Constants of R rows of K columns with N = 5 + D unknowns: deviation of this return's load from the usual one (4),
    the usual amount, the drift (D).

    rests, coulombs, loads: numbers of columns of each kind below
    certain, keep, memory, prior, shown: limits of `service.adaptation`
    mean:             prior mean of the usual amount, in its standard errors
    changing:         (D,) columns of the drift
    kinds:            (D,) 0 friction, 1 zero
    load_at:          (M, 2) parameter and component of a load
    at_rest, coulomb: columns of friction at rest, and of Coulomb friction
    load:             (M,) share of that parameter in that component
    unit:             (N,) prior standard errors
    low, high:        (D,) limits of the drift
    row_error:        (R,) standard error of each row [N m]
    alike:            (D, D) inverse of the prior correlation of the drifts, none between kinds
    usual:            (4,) load of one kilogram of the usual amount
    good, rows, basis, each, square, inverse: room for intermediate results
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
    each: Numbers
    square: Numbers
    inverse: Numbers
    arrays: object

    def __init__(self, sizes: Sequence[int], limits: Sequence[float], counts: list[Any], numbers: list[Any]) -> None:
        """Everything in the order of the fields."""
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
        self.basis, self.each, self.square = as_numbers(numbers[8]), as_numbers(numbers[9]), as_numbers(numbers[10])
        self.inverse = as_numbers(numbers[11])
