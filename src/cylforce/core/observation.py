"""Recordings as filtered rows and their factors: what identification and adaptation work on, in constant memory."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from cylforce.core.model import Model
from cylforce.regression.blocks import Factors, factors, joined
from cylforce.words.estimate import Array

BLOCK_SECONDS = 2.0  # longer than the memory of filters and friction residuals
CHUNK_SECONDS = 60.0  # of a recording that are worked on at once
MOST_BLOCKS = 256  # kept apart; beyond, neighbours merge
MOVING = 0.005  # m/s of a cylinder
REST_SHARE = 0.1  # of the lever: above it a row hardly tells the direction of friction


class Observed(NamedTuple):
    """Filtered rows of a stretch: `columns` (T, R, P), `torque` (T, R) with NaN where not usable, `posture` (T, N)
    joint angles and `speed` (T, C) of the cylinders, `tool` (T, R, 3) columns of a force and moment there."""

    columns: Array
    torque: Array
    posture: Array
    speed: Array
    tool: Array


def chunks(model: Model, segments: Iterable[Array]) -> Iterator[Array]:
    """Gapless segments of samples (T, S) in overlapping pieces of a minute: the overlap is what the filters need to
    settle, so that no sample is lost but the first ones."""
    step, overlap = int(CHUNK_SECONDS * model.filters.rate_hz), model.settle_steps + 1
    for segment in segments:
        for first in range(0, max(len(segment) - overlap, 1), step):
            piece = segment[first : first + step + overlap]
            if len(piece) > overlap + 1:
                yield piece


def observe(model: Model, values: Array) -> Observed:
    """Rows of a gapless stretch of samples (T, S), the filters' start left out; unusable levers and friction of unknown
    direction are masked."""
    moved = model.channels.run(values)
    rows = model.filtered.run(moved.motion)
    torque = rows.torque.copy()
    for k, acting in enumerate(model.acting):
        torque[_stays(np.logical_not(np.all(moved.usable[:, acting], axis=1)), model.settle_steps), k] = np.nan
    torque[np.logical_not(_moving(model, rows.columns))] = np.nan
    posture = np.diff(moved.motion.a, axis=1, prepend=0.0)
    own, tool = rows.columns[..., : len(model.parameters)], rows.columns[..., model.tool]
    whole = Observed(own, torque, posture, moved.motion.speed, tool)
    return Observed(*(part[model.settle_steps :] for part in whole))


def _stays(bad: Array, steps: int) -> Array:
    """Also the `steps` samples after each bad one: the filters remember it."""
    since = np.convolve(bad.astype(np.float64), np.ones(steps + 1))[: bad.size]
    return np.asarray(since > 0.5)


def _moving(model: Model, columns: Array) -> Array:
    """Rows (T, R) in which the direction of friction is known well enough."""
    unknown = np.sum(columns[..., model.at_rest], axis=-1)
    lever = np.sum(np.abs(columns[..., model.coulomb]), axis=-1)
    return np.asarray(unknown < REST_SHARE * (lever + unknown))


def block_factors(model: Model, seen: Observed) -> Factors:
    """Factors of a stretch; see `observed_factors`."""
    columns = np.concatenate([seen.columns, seen.tool], axis=-1)
    return factors(columns, seen.torque, _marks(seen), int(BLOCK_SECONDS * model.filters.rate_hz))


def _marks(seen: Observed) -> Array:
    ways = (seen.speed > MOVING, seen.speed < -MOVING)
    return np.concatenate([seen.posture, np.abs(seen.speed), *ways], axis=1, dtype=np.float64)


def observed_factors(model: Model, segments: Iterable[Array]) -> Factors:
    """Factors of a recording, the tool's columns last; marks are the posture (N), of the cylinders (C) the mean speed,
    the share of time in which they run out, and that in which they run in.

    Raises ValueError, in a sentence, when no stretch is long enough."""
    parts = (block_factors(model, observe(model, piece)) for piece in chunks(model, segments))
    try:
        return joined(parts, MOST_BLOCKS)
    except ValueError:
        raise ValueError(
            f"the recording has no gapless stretch longer than {2 * model.settle_steps / model.filters.rate_hz:.1f} s: "
            "record longer, and check that no sensor drops out"
        ) from None
