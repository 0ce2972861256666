"""References that are unlike the other references. They are compared by prediction: each with the parameters of the
others, the data sheet as prior. Where its load hangs, each one tells for itself."""

from collections.abc import Mapping, Sequence

import numpy as np

from cylforce.diagnosis.columns.problem import Problem, Seen, looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import CENTRE, Viewer
from cylforce.diagnosis.numbers import GAP
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

FEWEST = 3  # references, of which one can be told from the others
ENOUGH = 200  # rows of a joint, ten seconds, to compare it
LOAD = len(CENTRE)
Gram = Array  # (R, P + LOAD + 2, P + LOAD + 2) of a recording's columns, those of its load, torque [N m] and ones


def strange(model: Model, clean: Sequence[Recorded]) -> list[str]:
    """Names of references that are unlike the others."""
    grams, unlike = _grams(model, clean), list[str]()
    while len(grams) >= FEWEST and (worst := _worst(model, grams)):
        unlike.append(worst)
        grams.pop(worst)
    return unlike


def contradiction(model: Model, clean: Sequence[Recorded]) -> float:
    """How many times as much two references leave of a joint [rms], fitted together, as each of them by itself; 0 of
    more or fewer references, and where no joint moves in both."""
    grams = list(_grams(model, clean).values())
    if len(grams) != FEWEST - 1:
        return 0.0
    both, found = _values(model, grams), 0.0
    moved = np.min([gram[:, -1, -1] for gram in grams], axis=0) >= ENOUGH
    for gram in grams:
        ratio = _left(gram, both) / (_left(gram, _values(model, [gram])) + 1e-9)
        found = max(found, float(np.sqrt(np.max(ratio, where=moved, initial=0.0))))
    return found


def _grams(model: Model, clean: Sequence[Recorded]) -> dict[str, Gram]:
    """By recording, which has one load."""
    viewer, found = Viewer(model, np.zeros(len(model.parameters))), dict[str, Gram]()
    for each in clean:
        (seen,) = looked_at(viewer, [each], ())
        found[each.name] = found.get(each.name, 0.0) + _gram(model, seen)
    return found


def _gram(model: Model, seen: Seen) -> Gram:
    size, problem = len(model.parameters), Problem(model, np.sqrt(np.diag(model.prior.covariance)), (), (seen,), ())
    whole, first = problem.columns(seen), problem.of_load(seen)
    load = np.zeros((*whole.shape[:2], LOAD)) if first is None else whole[..., first : first + LOAD]
    one = np.ones((*whole.shape[:2], 1))
    columns = np.concatenate([whole[..., :size], load, whole[..., -1:], one], axis=-1)
    columns = np.where(np.all(np.isfinite(columns), axis=-1, keepdims=True), columns, 0.0)
    return np.asarray(np.einsum("tri,trj->rij", columns, columns))


def _weighted(gram: Gram, by: Gram) -> Array:
    """The sum over joints, each in units of a tenth of its torque in `by`."""
    unit = 0.01 * by[:, -2, -2] / np.maximum(by[:, -1, -1], 1.0) + 1.0
    return np.asarray(np.sum(gram / unit[:, None, None], axis=0))


def _values(model: Model, grams: Sequence[Gram]) -> Array:
    """Parameters (P,) of recordings, the data sheet as prior."""
    size, by = len(model.parameters), np.sum(grams, axis=0)
    whole = np.zeros((size + 1, size + 1))
    kept, load = [*range(size), -2], slice(size, size + LOAD)
    for gram in grams:
        each = _weighted(gram, by)
        both = each[load, :][:, kept]
        hangs = np.linalg.solve(each[load, load] + np.diag(np.array(CENTRE) ** -2.0), both)
        whole += each[np.ix_(kept, kept)] - both.T @ hangs
    prior = np.linalg.inv(model.prior.covariance)
    return np.asarray(np.linalg.solve(whole[:-1, :-1] + prior, whole[:-1, -1] + prior @ model.prior.mean))


def _left(gram: Gram, values: Array) -> Array:
    """Squares (R,) that parameters (P,) leave, wherever the load hangs."""
    size, each = len(values), _weighted(gram, gram)
    load = slice(size, size + LOAD)
    hangs = np.linalg.solve(
        each[load, load] + np.diag(np.array(CENTRE) ** -2.0), each[load, -2] - each[load, :size] @ values
    )
    coefficients = np.concatenate([-values, -hangs, [1.0, 0.0]])
    return np.asarray(np.maximum(np.einsum("i,rij,j->r", coefficients, gram, coefficients), 0.0))


def _predicted(model: Model, grams: Mapping[str, Gram]) -> dict[str, Array]:
    """What the others' parameters leave of each, mean squares (R,); NaN where it hardly moves."""
    found = {}
    for name, gram in grams.items():
        others = [g for n, g in grams.items() if n != name]
        rows = np.minimum(gram[:, -1, -1], np.sum(others, axis=0)[:, -1, -1])
        left = _left(gram, _values(model, others)) / np.maximum(gram[:, -1, -1], 1.0)
        found[name] = np.where(rows < ENOUGH, np.nan, left)
    return found


def _worst(model: Model, grams: Mapping[str, Gram]) -> str:
    """The reference that the others predict GAP times as badly as they predict one another without it, and as it is
    predicted by itself; "" if none."""
    whole, unlike = _predicted(model, grams), dict[str, float]()
    for name in grams:
        rest = _predicted(model, {n: g for n, g in grams.items() if n != name})
        among = np.array(list(rest.values()))
        known = np.any(np.isfinite(among), axis=0) & np.isfinite(whole[name])
        if np.any(known):
            own = _left(grams[name], _values(model, [grams[name]])) / np.maximum(grams[name][:, -1, -1], 1.0)
            usual = np.fmax(np.nanmax(among[:, known], axis=0), own[known]) + 1e-9
            unlike[name] = float(np.max(whole[name][known] / usual))
    name = max(unlike, key=lambda n: unlike[n], default="")
    return name if name and unlike[name] > GAP**2 else ""
