"""Recordings as filtered rows and their factors: what identification and adaptation work on, in constant memory."""

from collections.abc import Iterable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, signal

from cylforce.estimation import blocks
from cylforce.estimation.blocks import Factors, joined, row_factors
from cylforce.estimation.channels import Moved
from cylforce.estimation.model import CERTAIN_SHARE, Model
from cylforce.estimation.regressor import Rows
from cylforce.signals.estimate import Array

BLOCK_SECONDS = 2.0  # longer than the memory of filters and friction residuals
CHUNK_SECONDS = 60.0  # of a recording that are worked on at once
MOST_BLOCKS = 256  # kept apart; beyond, neighbours merge
MOVING = 0.005  # m/s of a cylinder
REST_SHARE = 0.1  # of the lever: above it a row hardly tells the direction of friction
SEQUENCE = 20  # bits of the maximal-length sequence that stands in for noise
NEAR = 100  # samples that tell how strong the noise is
USUAL = 0.999  # share of the differences between samples that are taken for noise; larger ones count as these


class Observed(NamedTuple):
    """Filtered rows of a stretch: `columns` (T, R, P), `torque` (T, R) with NaN where not usable, `posture` (T, N)
    joint angles and `speed` (T, C) of the cylinders, `tool` (T, R, 3) columns of a force and moment there; `noise`
    (T, R, P+4): what noise like that of the sensors adds to columns, tool's columns and torque; `certain` (T, R): the
    direction of friction is known so well that the row may be fitted."""

    columns: Array
    torque: Array
    posture: Array
    speed: Array
    tool: Array
    noise: Array
    certain: NDArray[np.bool_]


def chunks(model: Model, segments: Iterable[Array]) -> Iterator[Array]:
    """Gapless segments of samples (T, S) in overlapping pieces of a minute: the overlap is what the filters need to
    settle, so that no sample is lost but the first ones."""
    step, overlap = int(CHUNK_SECONDS * model.filters.rate_hz), model.settle_steps + 1
    for segment in segments:
        for first in range(0, max(len(segment) - overlap, 1), step):
            piece = segment[first : first + step + overlap]
            if len(piece) > overlap + 1:
                yield piece


def observe(model: Model, values: Array, first: int = 0) -> Observed:
    """Rows of a gapless stretch of samples (T, S) from step `first` on, the filters' start left out; unusable levers
    and friction of unknown direction are masked."""
    moved = model.channels.run(values)
    rows = model.filtered.run(moved.motion)
    unknown = model.share_at_rest(rows.columns)
    torque = np.where(np.logical_or(unusable(model, moved), unknown > REST_SHARE), np.nan, rows.torque)
    posture = np.diff(moved.motion.a, axis=1, prepend=0.0)
    own, tool = rows.columns[..., : len(model.parameters)], rows.columns[..., model.tool]
    noise, late = _noise(model, rows, values, first), slice(model.settle_steps, None)
    seen = (own[late], torque[late], posture[late], moved.motion.speed[late], tool[late])
    return Observed(*seen, noise[late], unknown[late] < CERTAIN_SHARE)


def _noise(model: Model, rows: Rows, values: Array, first: int) -> Array:
    """What noise adds to rows (T, R, P+4): the difference that a little more of it makes."""
    moved = model.channels.run(values + noise_like(values, first))
    noisy = model.filtered.run(moved.motion)
    columns = (noisy.columns - rows.columns)[..., : model.tool.stop]
    added = np.concatenate([columns, (noisy.torque - rows.torque)[..., None]], axis=-1)
    return np.where(np.isfinite(added) & np.logical_not(unusable(model, moved))[..., None], added, 0.0)


def unusable(model: Model, moved: Moved) -> NDArray[np.bool_]:
    """Rows (T, R) in which a filter remembers an unusable lever."""
    lost = [np.logical_not(np.all(moved.usable[:, acting], axis=1)) for acting in model.acting]
    return np.stack([_stays(bad, model.settle_steps) for bad in lost], axis=-1)


def noise_like(values: Array, first: int) -> Array:
    """Noise (T, S) as strong as that of the samples (T, S), which their third differences tell (the motion is smooth),
    and white: every signal has its own stretch of a maximal-length sequence of signs, from step `first` on."""
    steps, signals = values.shape
    differences = np.abs(np.diff(values, n=3, axis=0, prepend=values[:2], append=values[-1:]))
    squares = np.minimum(differences, np.quantile(differences, USUAL, axis=0)) ** 2 / 20.0
    size = np.sqrt(np.maximum(ndimage.uniform_filter1d(squares, min(NEAR, steps), axis=0), 0.0))
    signs = _signs()
    places = first + np.arange(steps)[:, None] + np.arange(signals) * (signs.size // signals)
    return np.asarray(size * signs[places % signs.size])


@cache
def _signs() -> Array:
    return np.asarray(2.0 * signal.max_len_seq(SEQUENCE)[0] - 1.0)


def _stays(bad: Array, steps: int) -> Array:
    """Also the `steps` samples after each bad one: the filters remember it."""
    since = np.convolve(bad.astype(np.float64), np.ones(steps + 1))[: bad.size]
    return np.asarray(since > 0.5)


def block_factors(model: Model, seen: Observed) -> Factors:
    """Factors of a stretch; see `observed_factors`."""
    columns = np.concatenate([seen.columns, seen.tool], axis=-1)
    rows = blocks.BlockRows(columns, seen.torque, seen.noise, seen.certain, _marks(seen))
    return row_factors(rows, int(BLOCK_SECONDS * model.filters.rate_hz))


def _marks(seen: Observed) -> Array:
    ways = (seen.speed > MOVING, seen.speed < -MOVING)
    return np.concatenate([seen.posture, np.abs(seen.speed), *ways], axis=1, dtype=np.float64)


def observed_factors(model: Model, segments: Iterable[Array]) -> Factors:
    """Factors of a recording, the tool's columns last; marks are the posture (N), of the cylinders (C) the mean speed,
    the share of time in which they run out, and that in which they run in.

    Raises ValueError, in a sentence, when no stretch is long enough."""
    step = int(CHUNK_SECONDS * model.filters.rate_hz)
    seen = (observe(model, piece, k * step) for k, piece in enumerate(chunks(model, segments)))
    parts = (block_factors(model, stretch) for stretch in seen)
    try:
        return joined(parts, MOST_BLOCKS)
    except ValueError:
        raise ValueError(
            f"the recording has no gapless stretch longer than {2 * model.settle_steps / model.filters.rate_hz:.1f} s: "
            "record longer, and check that no sensor drops out"
        ) from None
