"""How figures are measured on the crane: as the README beside its recordings does, so that they compare with its own.

Strokes and pressures pass a second-order 2 Hz Butterworth low-pass forward and back, joint torque nothing beyond that;
the first and the last second are left out; a joint's torque counts while its own cylinder moves faster than 1 mm/s."""

from collections.abc import Sequence
from math import nan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from cylforce.estimation.filters import fours
from cylforce.estimation.model import Model
from cylforce.programs.replay import Replayed
from cylforce.signals.estimate import Array, Quantity, Status

CUTOFF_HZ = 2.0
CUT_S = 1.0
SLOWEST = 0.001  # m/s


class Run(NamedTuple):
    """A recording: `columns` (T, R, P), measured `torque` (T, R) [N m], `counts` (T, R): whether a sample counts."""

    columns: Array
    torque: Array
    counts: NDArray[np.bool_]


class Weights(NamedTuple):
    """Weight read on the empty crane [kg] while it is OK: share of the time, mean, standard deviation, mean of the
    published standard errors; then the same while its status is DEGRADED."""

    ok_share: float
    mean_kg: float
    standard_deviation_kg: float
    published_kg: float
    degraded_share: float
    degraded_mean_kg: float
    degraded_standard_deviation_kg: float
    degraded_published_kg: float


def measured(model: Model, values: Array) -> Run:
    """A recording's samples (T, S); the momentum of a column is differenced along it.

    Each joint's own cylinder has the joint's number, as on this crane."""
    b, a = signal.butter(2, CUTOFF_HZ, fs=model.filters.rate_hz)
    channels = model.channels.read(signal.filtfilt(b, a, values, axis=0))
    moving = model.channels.between(fours(channels)).motion
    momentum, static = model.empty.both_halves(moving)
    inside = slice(round(CUT_S * model.filters.rate_hz), -round(CUT_S * model.filters.rate_hz))
    return Run(
        (static + np.gradient(momentum, model.channels.dt, axis=0))[inside],
        model.empty.torque(moving)[inside],
        np.abs(moving.speed[inside]) > SLOWEST,
    )


def unexplained(runs: Sequence[Run], parameters: Array) -> list[float | None]:
    """Rms [N m] of each joint's torque beyond what the parameters (P,) explain; None where the joint never moved."""
    left = [run.torque - run.columns @ parameters for run in runs]
    rows = range(left[0].shape[1])
    found = [np.concatenate([rest[run.counts[:, r], r] for rest, run in zip(left, runs, strict=True)]) for r in rows]
    return [float(np.sqrt(np.mean(rest**2))) if rest.size else None for rest in found]


def moments(runs: Sequence[Run], row: int, wanted: Sequence[int], beside: Sequence[int]) -> Array:
    """The parameters `wanted` from one joint's torque alone, by least squares with those `beside`."""
    use = [*wanted, *beside]
    columns = np.concatenate([run.columns[run.counts[:, row], row] for run in runs])[:, use]
    torque = np.concatenate([run.torque[run.counts[:, row], row] for run in runs])
    return np.asarray(np.linalg.lstsq(columns, torque)[0][: len(wanted)])


def disagreement(runs: Sequence[Run], row: int, wanted: Sequence[int], one: Array, other: Array) -> float:
    """Rms of the difference of two gravity moments along the runs, as a share of the rms of their mean."""
    columns = np.concatenate([run.columns[run.counts[:, row], row] for run in runs])[:, wanted]
    apart, mean = columns @ (one - other), columns @ (one + other) / 2.0
    return float(np.sqrt(np.mean(apart**2) / np.mean(mean**2)))


def weights(replays: Sequence[Replayed]) -> Weights:
    """The weight read on the empty crane, all samples of the replays together."""
    gross = [estimate.gross for found in replays for estimate in found.estimates]
    return Weights(*_spread(gross, Status.OK), *_spread(gross, Status.DEGRADED))


def _spread(gross: Sequence[Quantity], status: Status) -> tuple[float, float, float, float]:
    """Share, mean, standard deviation, mean standard error of what has that status."""
    found = np.array([(q.value, q.standard_error) for q in gross if q.status is status])
    if not found.size:
        return 0.0, nan, nan, nan
    return len(found) / len(gross), float(np.mean(found[:, 0])), float(np.std(found[:, 0])), float(np.mean(found[:, 1]))
