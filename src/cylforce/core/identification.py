"""Identification of the dynamic tares from recordings of the empty machine."""

from typing import NamedTuple

import numpy as np

from cylforce.core.model import Model, Tares
from cylforce.regression.batch import Fit, least_squares
from cylforce.regression.regressor import Rows
from cylforce.words.estimate import Array

MIN_SECONDS = 20.0
BLOCK_SECONDS = 2.0  # longer than the memory of filters and friction residuals


class Identification(NamedTuple):
    """The tares, the fit, names of what the recording does not tell, seconds of usable motion."""

    tares: Tares
    fit: Fit
    not_identified: tuple[str, ...]
    seconds: float


class Observed(NamedTuple):
    """Filtered rows of a recording: `columns` (T, R, P), `torque` (T, R) with NaN where not usable, `at_rest` (T, R):
    friction unknown, as a share of the lever; `block` (T,)."""

    columns: Array
    torque: Array
    at_rest: Array
    block: Array


def observe(model: Model, segments: list[Array]) -> Observed:
    """Rows of gapless segments of samples (T, S); the filters' start and unusable levers are masked."""
    parts = [_segment(model, values) for values in segments if len(values) > 2 * model.settle_steps]
    if not parts:
        raise ValueError(
            f"the recording has no gapless stretch longer than {2 * model.settle_steps / model.filters.rate_hz:.1f} s: "
            "record longer, and check that no sensor drops out"
        )
    steps = int(BLOCK_SECONDS * model.filters.rate_hz)
    lengths = [len(p.torque) for p in parts]
    block = np.concatenate([np.arange(n) // steps + 10**6 * k for k, n in enumerate(lengths)])
    rows = Rows(np.concatenate([p.columns for p in parts]), np.concatenate([p.torque for p in parts]))
    return Observed(
        rows.columns[..., : len(model.parameters)],
        rows.torque,
        np.sum(rows.columns[..., model.at_rest], axis=-1),
        block,
    )


def _segment(model: Model, values: Array) -> Rows:
    moved = model.channels.run(values)
    rows = model.filtered.run(moved.motion)
    torque = rows.torque.copy()
    torque[: model.settle_steps] = np.nan
    for k, acting in enumerate(model.acting):
        torque[_stays(~np.all(moved.usable[:, acting], axis=1), model.settle_steps), k] = np.nan
    return Rows(rows.columns, torque)


def _stays(bad: Array, steps: int) -> Array:
    """Also the `steps` samples after each bad one: the filters remember it."""
    since = np.convolve(bad.astype(np.float64), np.ones(steps + 1))[: bad.size]
    return np.asarray(since > 0.5)


def identify(model: Model, segments: list[Array]) -> Identification:
    """Weighted least squares with the data sheet as prior; rows are weighted by what a first fit leaves of each.

    Raises ValueError, in a sentence, when the recording is too short or does not move."""
    seen = observe(model, segments)
    seconds = float(np.sum(np.any(np.isfinite(seen.torque), axis=1)) / model.filters.rate_hz)
    if seconds < MIN_SECONDS:
        raise ValueError(
            f"only {seconds:.0f} s of usable samples; move the empty machine for at least {MIN_SECONDS:.0f} s"
        )
    torque = np.where(_moving(model, seen), seen.torque, np.nan)
    if not np.any(np.isfinite(torque)):
        raise ValueError("no cylinder moves in the recording: move every joint both ways, slowly and fast")
    fit = least_squares(seen.columns, torque, _row_noise(model, seen, torque), model.prior, seen.block)
    names = tuple(p.name for p in model.parameters)
    lost = tuple(name for name, excited in zip(names, fit.excited, strict=True) if not excited)
    return Identification(Tares(names, fit.values, fit.covariance, fit.row_error, True), fit, lost, seconds)


def _row_noise(model: Model, seen: Observed, torque: Array) -> Array:
    """What a fit of each row alone leaves of it (R,). Weights taken from the joint fit's own residuals would let one
    row
    win all: the better it fits, the more it weighs."""
    alone = [
        least_squares(seen.columns[:, [r]], torque[:, [r]], np.ones(1), model.prior, seen.block).row_error[0]
        for r in range(torque.shape[1])
        if np.any(np.isfinite(torque[:, r]))
    ]
    floor = 1e-6 * np.nanstd(torque) + 1e-9
    noise = np.full(torque.shape[1], max(alone, default=1.0) + floor)
    noise[np.any(np.isfinite(torque), axis=0)] = np.array(alone) + floor
    return noise


def _moving(model: Model, seen: Observed) -> Array:
    """Rows (T, R) in which the friction's direction is known well enough."""
    lever = np.nanmax(np.abs(seen.columns[..., _coulomb(model)]), axis=(0, 2))
    return np.asarray(seen.at_rest < REST_SHARE * np.maximum(lever, 1e-9))


def _coulomb(model: Model) -> list[int]:
    return [k for k, p in enumerate(model.parameters) if p.name.endswith(".coulomb")]


REST_SHARE = 0.1  # of the lever: above it a row hardly tells the direction of friction
