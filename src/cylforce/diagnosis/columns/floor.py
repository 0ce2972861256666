"""What the machine always was, and the noise floor: what least squares of clean recordings tell, and leave."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cylforce.diagnosis.columns.problem import Problem, looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import BLOCK, Viewer
from cylforce.diagnosis.columns.whitening import Floor, floor_of
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

FIRST_GUESS = 0.1  # of the torque's rms: noise before anything is known


def fitted_tares(model: Model, clean: Sequence[Recorded]) -> Array:
    """Parameters (P,) by least squares of clean recordings, the data sheet as prior; what is not known of a load is
    fitted beside them, every row counted by what the first round leaves."""
    viewer, count = Viewer(model, np.zeros(len(model.parameters))), len(model.parameters)
    spread = np.sqrt(np.diag(model.prior.covariance))
    problem = Problem(model, spread, (), looked_at(viewer, clean, ()), ())
    columns, size = [problem.columns(seen) for seen in problem.clean], problem.lasting
    prior, mean = np.diag(problem.spread[:size] ** -2.0), np.zeros(size)
    prior[:count, :count], mean[:count] = np.linalg.inv(model.prior.covariance), model.prior.mean
    scale, values = FIRST_GUESS * np.sqrt(_mean(np.concatenate([c[..., -1] for c in columns]) ** 2)) + 1e-9, mean
    for _ in range(2):
        floor = Floor(scale, np.zeros((len(scale), 1)), scale)
        gram = np.sum([normal(c, floor, range(size)) for c in columns], axis=0)
        values = np.linalg.solve(gram[:, :-1] + prior, gram[:, -1] + prior @ mean)
        left = np.concatenate([c[..., -1] - c[..., :size] @ values for c in columns])
        scale = np.sqrt(_mean(left**2)) + 1e-9
    return np.asarray(values[:count])


def noise_floor(problem: Problem) -> Floor:
    """From the clean recordings' residual, with `Problem.mechanical` fitted: base parameters, what is unknown of loads
    and bars, every law of friction. Columns of sensors and of geometry are none of them: they hold the readings
    themselves, noise included, and least squares would cancel it with them (errors in variables). Without clean
    recordings, and at joints that these do not move, the faulty ones' is all there is: what every fifth of them leaves,
    predicted from the others, with all effects fitted, for they hold the effect that is sought."""
    floor = _floor(problem)
    rows = np.sum([np.sum(np.isfinite(seen.rows.left), axis=0) for seen in problem.clean], axis=0)
    if not problem.clean or np.all(rows > 0):
        return floor
    other, shown = _floor(replace(problem, clean=())), rows > 0
    parts = zip((floor.rms, floor.white), (other.rms, other.white), strict=True)
    rms, white = (np.where(shown, a, b) for a, b in parts)
    return Floor(rms, np.where(shown[:, None], floor.memory, other.memory), white)


def _floor(problem: Problem) -> Floor:
    held = problem.clean or problem.faulty
    columns = [problem.columns(seen) for seen in held]
    scale = FIRST_GUESS * np.sqrt(_mean(np.concatenate([c[..., -1] for c in columns]) ** 2)) + 1e-9
    chosen = list(problem.of_the_floor)
    floor = Floor(scale, np.zeros((len(scale), 1)), scale)
    for _ in range(2):
        whole = np.sum([normal(c, floor, chosen) for c in columns], axis=0)
        values = ridge(problem, whole)
        left = [c[..., -1] - c[..., chosen] @ values for c in columns]
        if not problem.clean:
            left = [_predicted(problem, c, whole, floor) for c in columns]
        floor = floor_of(left)
    return floor


def _mean(x: Array) -> Array:
    """Mean (R,) over time of what is known; 1 where nothing is."""
    good = np.isfinite(x)
    count = np.sum(good, axis=0)
    return np.asarray(np.where(count > 0, np.sum(np.where(good, x, 0.0), axis=0) / np.maximum(count, 1), 1.0))


def ridge(problem: Problem, gram: Array) -> Array:
    """Values of the columns `of_the_floor` that fit normal equations (K, K+1)."""
    prior = np.diag(problem.always[list(problem.of_the_floor)] ** -2.0)
    return np.asarray(np.linalg.solve(gram[:, :-1] + prior, gram[:, -1]))


def _predicted(problem: Problem, columns: Array, whole: Array, floor: Floor) -> Array:
    """Residual (T, R) of every fifth part of a recording, predicted from all else."""
    found, chosen = np.full(columns.shape[:2], np.nan), list(problem.of_the_floor)
    part = np.arange(len(columns)) // (5 * BLOCK) % 5
    for k in range(5):
        here = columns[part == k]
        values = ridge(problem, whole - normal(here, floor, chosen))
        found[part == k] = here[..., -1] - here[..., chosen] @ values
    return found


def normal(columns: Array, floor: Floor, chosen: Sequence[int]) -> Array:
    """Normal equations (K, K+1) of chosen columns (T, R, N), rows weighed by the floor."""
    own = columns[..., [*chosen, -1]]
    found = np.zeros((own.shape[-1], own.shape[-1]))
    for r in range(columns.shape[1]):
        good = np.all(np.isfinite(own[:, r]), axis=1)
        part = own[good, r] / floor.rms[r]
        found += part.T @ part
    return found[:-1]
