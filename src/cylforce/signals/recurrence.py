"""Recurrences along samples, in which each value follows from the one before.

Blocks of samples are processed beside one another. First the effect of each whole block on the value before it is
computed, then the values within the blocks."""

from math import isqrt

import numpy as np

from cylforce.signals.estimate import Array


def clipped(steps: Array, most: float) -> Array:
    """Return z (T,) with z_k = z_(k-1) + steps_k, clipped to -most..most at each step, from 0 before the first step.

    This is the play operator: it follows a motion to and fro up to `most`, and then slides.
    Several clipped steps in a row are again one step between two limits, so that a block of them is three numbers.

    steps: (T,) change of z at each step
    most:  limit of |z|, in the unit of the steps
    """
    rows, last = _blocks(steps, 0.0), len(steps)
    step, low, high = np.zeros(rows.shape[1]), np.full(rows.shape[1], -np.inf), np.full(rows.shape[1], np.inf)
    for row in rows:
        step += row
        for limit in (low, high):
            _within(limit, row, most)
    z, value = np.empty_like(step), 0.0
    for block, parts in enumerate(zip(step.tolist(), low.tolist(), high.tolist(), strict=True)):
        z[block], value = value, min(max(value + parts[0], parts[1]), parts[2])
    found = np.empty_like(rows)
    for row, into in zip(rows, found, strict=True):
        into[:] = _within(z, row, most)
    return found.T.ravel()[:last]


def _within(value: Array, step: Array, most: float) -> Array:
    """Add one step (B,) to one value of each block (B,), clip the sums to -most..most, and return them.

    `value` is written in place and is the array returned. All three are in the unit of the steps.
    """
    value += step
    np.maximum(value, -most, out=value)
    return np.minimum(value, most, out=value)


def followed(aims: Array, kept: Array) -> Array:
    """Return z (T,) with z_k = aim_k + (z_(k-1) - aim_k) kept_k, from 0 before the first step.

    Each step moves the value towards an aim of its own.
    Several such steps in a row are one step z factor + offset, so that a block of them is two numbers.

    aims: (T,) aim of each step
    kept: (T,) share of the distance from the aim that a step keeps, 0 to 1
    """
    keep, add, last = _blocks(kept, 1.0), _blocks(aims * (1.0 - kept), 0.0), len(aims)
    factor, offset = np.ones(keep.shape[1]), np.zeros(keep.shape[1])
    for row, more in zip(keep, add, strict=True):
        factor *= row
        offset *= row
        offset += more
    z, value = np.empty_like(factor), 0.0
    for block, (times, plus) in enumerate(zip(factor.tolist(), offset.tolist(), strict=True)):
        z[block], value = value, value * times + plus
    found = np.empty_like(keep)
    for row, more, into in zip(keep, add, found, strict=True):
        z *= row
        z += more
        into[:] = z
    return found.T.ravel()[:last]


def _blocks(values: Array, filler: float) -> Array:
    """Return values (T,) as columns (L, B): B consecutive blocks of L samples, one block in each column.

    L is about the square root of T.

    filler: value with which the last block is filled up
    """
    length = isqrt(len(values)) + 1
    count = -(-len(values) // length)
    whole = np.full(length * count, filler)
    whole[: len(values)] = values
    return np.ascontiguousarray(whole.reshape(count, length).T)
