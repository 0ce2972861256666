"""What the kernel knows of identified parameters: for the torque that they leave, the load and the force at the tool;
`solving.py` makes it."""

from collections.abc import Sequence
from typing import Any

from cylforce.estimation.kernel.restricted import Count, Counts, Number, Numbers, as_counts, as_numbers, record


@record
class KernelSolver:
    """R rows of K columns, of which the first P are those of the tares; C cylinders; D drifting parameters, T unknowns
    at the tool.

    `changing` (D,): columns of the drift; `at_rest`, `tip`: first columns of friction at rest and of the tool;
    `load_at` (M, 2) and `load` (M,): numbers that are not zero of the (P, 4) table from a load to parameters; `values`
    (P,), `covariance` (P, P), `row_error` (R,) of the tares; `dry` (C,): Coulomb friction, none: empty; `prior` (T, T):
    information on the force. The limits are those of `service`, by the same names. Places of intermediate results end
    the list: they serve one thread."""

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
        self.loads, self.dry_size = len(numbers[0]), len(numbers[4])
