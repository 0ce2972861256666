"""A machine's quantities over its recordings, with their standard errors, and by how much each recording differs from
the machine's earlier ones and from other machines of its type."""

from typing import NamedTuple

import numpy as np

from cylforce.fleet.gaussians import Belonging, loosened
from cylforce.fleet.usual import Usual
from cylforce.signals.estimate import Array

RIDGE = 1e-9  # of a quantity's usual daily difference: information about what a recording does not move at all


class Course(NamedTuple):
    """n recordings of one machine. `own` (n, K) and `own_error`: by this recording, with what is usual for the type;
    `value` and `error`: with the machine's earlier recordings, too. `expected` (n, K): by the earlier recordings alone.
    `from_past` and `from_type` (n,): the recording's difference from what the earlier ones, and what other machines
    show, rms over its quantities in usual differences: about 1 where it is in order; NaN where there is nothing
    earlier."""

    own: Array
    own_error: Array
    value: Array
    error: Array
    expected: Array
    from_past: Array
    from_type: Array


def course(days: Belonging, usual: Usual, past: Array, whole: Array) -> Course:
    """The course of one machine's recordings `days` (n,) in order of time; `past` (n,): the first recording that counts
    as earlier (after a change, what was before is none); `whole` (K, K'): the quantities that are told, as sums of
    those that are estimated."""
    return Course(*(np.array(part) for part in zip(*_each(days, usual, past, whole), strict=True)))


def _each(days: Belonging, usual: Usual, past: Array, whole: Array) -> list[tuple[Array | float, ...]]:
    steady = loosened(days.information, days.pull, usual.days**2)
    kind = usual.mean, np.diag(usual.between**2 + usual.days**2)
    found: list[tuple[Array | float, ...]] = []
    for k, (information, pull) in enumerate(zip(days.information, days.pull, strict=True)):
        earlier = slice(int(past[k]), k)
        precision = steady[0][earlier].sum(axis=0) + np.diag(usual.between**-2.0)
        covariance = np.linalg.inv(precision)
        mean = covariance @ (steady[1][earlier].sum(axis=0) + usual.between**-2.0 * usual.mean)
        before = mean, covariance + np.diag(usual.days**2)
        own, value = (_updated(information, pull, m, p, whole) for m, p in (kind, before))
        apart = [_apart(information, pull, m, p) for m, p in (before, kind)]
        apart[0] = apart[0] if k > past[k] else np.nan
        found.append((*own, *value, whole @ mean, *apart))
    return found


def _updated(information: Array, pull: Array, mean: Array, covariance: Array, whole: Array) -> tuple[Array, Array]:
    """Mean and standard error (K,) of what N(mean, covariance) and a recording tell together of the `whole` (K, K')."""
    gain = np.linalg.solve(np.eye(len(mean)) + covariance @ information, covariance)
    middle = mean + gain @ (pull - information @ mean)
    return whole @ middle, np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", whole, gain, whole), 0.0))


def _apart(information: Array, pull: Array, mean: Array, covariance: Array) -> float:
    """Distance of what a recording finds from N(mean, covariance), rms over the quantities."""
    whole = information + RIDGE * np.eye(len(mean))
    away = np.linalg.solve(whole, pull + RIDGE * mean) - mean
    square = float(away @ np.linalg.solve(np.linalg.inv(whole) + covariance, away))
    return float(np.sqrt(max(square, 0.0) / len(mean)))
