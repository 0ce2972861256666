"""Filtered rows and factors of recordings, the input of the identification, in constant memory."""

from collections.abc import Iterable, Iterator
from functools import cache
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation import blocks
from cylforce.estimation.blocks import Factors, joined, row_factors
from cylforce.estimation.channels import Moved
from cylforce.estimation.model import CERTAIN_SHARE, Model
from cylforce.estimation.regressor import Rows
from cylforce.signals.estimate import Array

BLOCK_SECONDS = 2.0  # s per block; chosen: longer than the memory of the filters and of friction residuals
CHUNK_SECONDS = 60.0  # s of a recording that are processed at once; chosen: bounds the memory needed
MOST_BLOCKS = 256  # blocks; with more, neighbours are merged; chosen: bounds the memory needed
MOVING = 0.005  # m/s of a cylinder, from which on it counts as moving; chosen
REST_SHARE = 0.1  # of the lever with friction of unknown direction, above which a row is not used; chosen
SEQUENCE = 20  # bits of the maximal-length sequence used as noise: a period of 1e6 samples; chosen
NEAR = 100  # samples over which the noise level is averaged; chosen
NOISE_SHARE = 0.999  # quantile at which differences are cut off, so that jumps do not count as noise; chosen


class Observed(NamedTuple):
    """Filtered rows of a stretch.

    columns: (T, R, P) of the empty machine's parameters
    torque:  (T, R) [N m]; NaN where a row is not usable
    posture: (T, N) joint angles [rad]
    speed:   (T, C) of the cylinders [m/s]
    tool:    (T, R, 3) columns of a force forwards, a force upwards and a moment at the tool
    noise:   (T, R, P+4) change of columns, tool columns and torque by noise as strong as the sensors'
    certain: (T, R) whether the direction of friction is known well enough for the row to be fitted
    zero:    (T, R, C) columns of the zero error of each cylinder's pressures
    """

    columns: Array
    torque: Array
    posture: Array
    speed: Array
    tool: Array
    noise: Array
    certain: NDArray[np.bool_]
    zero: Array


def chunks(model: Model, segments: Iterable[Array]) -> Iterator[Array]:
    """Yield pieces (T, S) of a recording, so that it is processed in constant memory.

    A piece has CHUNK_SECONDS and the settling time of the filters, less at the end of a segment. Pieces overlap by that
    settling time, which `observe` omits, so that only the first samples of a segment are lost. A segment that is not
    longer than the settling time is omitted.

    segments: stretches of samples (T, S) of all signals [SI] without gaps
    """
    step, overlap = int(CHUNK_SECONDS * model.filters.rate_hz), model.settle_steps + 1
    for segment in segments:
        for first in range(0, max(len(segment) - overlap, 1), step):
            piece = segment[first : first + step + overlap]
            if len(piece) > overlap + 1:
                yield piece


def observe(model: Model, values: Array, first: int = 0, *, noisy: bool = True) -> Observed:
    """Return the filtered rows of a stretch of samples: measured joint torques [N m] and the columns that explain them.

    The settling time of the filters is omitted: T samples give T - 1 - `settle_steps` rows of each torque. Rows with an
    unusable lever or unknown direction of friction (a share above REST_SHARE) have NaN as torque.

    values: (T, S) samples of all signals [SI], without gaps
    first:  step of the recording at which the stretch begins, from which the artificial noise is counted (`noise_like`)
    noisy:  whether the sensors' noise is estimated; False: taken as zero, in half the time
    """
    moved = model.channels.run(values)
    rows = model.filtered.run(moved.motion)
    unknown = model.share_at_rest(rows.columns)
    torque = np.where(np.logical_or(unusable(model, moved), unknown > REST_SHARE), np.nan, rows.torque)
    posture = np.diff(moved.motion.a, axis=1, prepend=0.0)
    own, tool = rows.columns[..., : len(model.parameters)], rows.columns[..., model.tool]
    without = np.broadcast_to(0.0, (*torque.shape, model.tool.stop + 1))
    noise, settled = _noise(model, rows, values, first) if noisy else without, slice(model.settle_steps, None)
    parts = (own[settled], torque[settled], posture[settled], moved.motion.speed[settled], tool[settled])
    return Observed(*parts, noise[settled], unknown[settled] < CERTAIN_SHARE, rows.columns[settled][..., model.zero])


def _noise(model: Model, rows: Rows, values: Array, first: int) -> Array:
    """Return the noise of the rows (T, R, P+4): their change by artificial noise as strong as the sensors'.

    There are R rows (measured torques) in each of the T intervals between T + 1 samples. The last axis is the P columns
    of the empty machine, three columns of a force and a moment at the tool, and the torque [N m]. Rows that are not
    usable with the noise have zeros.

    rows:   of the samples without noise
    values: (T + 1, S) samples of all signals [SI]
    first:  step of the recording from which the noise sequence is counted
    """
    moved = model.channels.run(values + noise_like(values, first))
    noisy = model.filtered.run(moved.motion)
    columns = (noisy.columns - rows.columns)[..., : model.tool.stop]
    added = np.concatenate([columns, (noisy.torque - rows.torque)[..., None]], axis=-1)
    return np.where(np.isfinite(added) & np.logical_not(unusable(model, moved))[..., None], added, 0.0)


def unusable(model: Model, moved: Moved) -> NDArray[np.bool_]:
    """Return whether each row (T, R) is spoilt because a lever was unusable within the settling time of the filters."""
    lost = [np.logical_not(np.all(moved.usable[:, acting], axis=1)) for acting in model.acting]
    return np.stack([_stays(bad, model.settle_steps) for bad in lost], axis=-1)


def noise_like(values: Array, first: int) -> Array:
    """Return white noise (T, S) [SI] as strong as that of samples, the same at every call.

    Added to the samples, it shows how much sensor noise changes columns and torque (`_noise`). Each value is plus or
    minus the standard deviation of the sensor's noise at that step. This deviation follows from the third differences
    of the samples, in which smooth motion vanishes: the rms of NEAR of them around the step, each cut off at the
    quantile NOISE_SHARE, over sqrt(1 + 9 + 9 + 1). The signs are a maximal-length sequence, a different part of it for
    each signal.

    values: (T, S) samples of all signals [SI]
    first:  step of the recording at which they begin, so that each step has its own place in the sequence
    """
    from scipy import ndimage

    steps, signals = values.shape
    differences = np.abs(np.diff(values, n=3, axis=0, prepend=values[:2], append=values[-1:]))
    squares = np.minimum(differences, np.quantile(differences, NOISE_SHARE, axis=0)) ** 2 / 20.0
    deviation = np.sqrt(np.maximum(ndimage.uniform_filter1d(squares, min(NEAR, steps), axis=0), 0.0))
    signs = _signs()
    places = first + np.arange(steps)[:, None] + np.arange(signals) * (signs.size // signals)
    return np.asarray(deviation * signs[places % signs.size])


@cache
def _signs() -> Array:
    """Return one period (2^SEQUENCE - 1,) of a maximal-length sequence (pseudo-random bits) as signs 1 and -1."""
    from scipy import signal  # here, because programs that only read results do without scipy

    return np.asarray(2.0 * signal.max_len_seq(SEQUENCE)[0] - 1.0)


def _stays(bad: Array, steps: int) -> Array:
    """Return which samples (T,) are spoilt: the bad ones (T,), and the `steps` samples after each of them.

    The filters still contain the bad sample then."""
    since = np.convolve(bad.astype(np.float64), np.ones(steps + 1))[: bad.size]
    return np.asarray(since > 0.5)


def block_factors(model: Model, observed: Observed, *, noisy: bool = True) -> Factors:
    """Return the triangular factors of a stretch in blocks of BLOCK_SECONDS.

    Columns and marks are in the order of `observed_factors`.

    observed: filtered rows of the stretch
    noisy:    whether `observed.noise` is used; False: taken as zero
    """
    columns, noise = np.concatenate([observed.columns, observed.tool, observed.zero], axis=-1), None
    if noisy:
        noise = np.concatenate(
            [observed.noise[..., :-1], np.zeros_like(observed.zero), observed.noise[..., -1:]], axis=-1
        )
    rows = blocks.BlockRows(columns, observed.torque, noise, observed.certain, _marks(observed))
    return row_factors(rows, int(BLOCK_SECONDS * model.filters.rate_hz))


class TooShortError(ValueError):
    """A recording has no gapless stretch that is long enough."""


def _marks(observed: Observed) -> Array:
    """Return the marks (T, N + 3 C + 2 R) of each sample: figures that describe what the machine does in a block.

    In this order: joint angles (N) [rad]; absolute speed (C) of the cylinders [m/s]; 1 where each extends (C); 1 where
    each retracts (C); measured torque (R) [N m], 0 where the row is not fitted; 1 where the row is fitted (R)."""
    ways = (observed.speed > MOVING, observed.speed < -MOVING)
    fitted = observed.certain & np.isfinite(observed.torque) & np.all(np.isfinite(observed.columns), axis=-1)
    torque = (np.where(fitted, observed.torque, 0.0), fitted)
    return np.concatenate([observed.posture, np.abs(observed.speed), *ways, *torque], axis=1, dtype=np.float64)


def observed_factors(model: Model, segments: Iterable[Array], *, noisy: bool = True) -> Factors:
    """Return the triangular factors of a recording's rows, in blocks, from which the parameters are fitted.

    A block has BLOCK_SECONDS; of a recording with more than MOST_BLOCKS neighbouring blocks are merged.

    segments: stretches of samples (T, S) of all signals [SI] without gaps
    noisy:    whether the sensors' noise is estimated; False: taken as zero, in half the time

    The columns are those of the P parameters, three of a force forwards, a force upwards and a moment at the tool, and
    one per cylinder (C) of its pressures' zero error. The noise of the last C is taken as zero. The marks of a block
    are, in this order:
    posture (N):    mean [rad]
    speed (C):      mean absolute speed of the cylinders [m/s]
    extending (C):  share of time in which they extend
    retracting (C): share of time in which they retract
    torque (R):     mean of the measured torque [N m], which counts as 0 where its row is not fitted
    fitted (R):     share of time in which a row is fitted

    Raises TooShortError with a sentence when no segment is long enough.
    """
    step = int(CHUNK_SECONDS * model.filters.rate_hz)
    stretches = (observe(model, piece, k * step, noisy=noisy) for k, piece in enumerate(chunks(model, segments)))
    parts = (block_factors(model, stretch, noisy=noisy) for stretch in stretches)
    first = next(parts, None)
    if first is None:
        raise TooShortError(
            f"the recording has no gapless stretch longer than {2 * model.settle_steps / model.filters.rate_hz:.1f} s: "
            "record longer, and check that no sensor drops out"
        )
    return joined(chain([first], parts), MOST_BLOCKS)
