"""Identification of the dynamic tares from recordings of the empty machine: joint least squares with the data sheet as
prior, and friction laws chosen by what they predict, not by habit."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.consistency import consistent, violations
from cylforce.commissioning.suspicion import doubt
from cylforce.commissioning.wiring import SignalHistory, gathered, nothing
from cylforce.estimation.batch import Fit, Prior, least_squares, predicted
from cylforce.estimation.blocks import Factors, chosen, of_row, settled
from cylforce.estimation.model import FRICTION, TYPICAL, Model, Tares
from cylforce.estimation.observation import observed_factors
from cylforce.signals.estimate import Array

MIN_SECONDS = 20.0
ONE_WAY, ONE_WAY_SECONDS = 0.05, 2.0  # share of a cylinder's motion below which a way was not moved; motion that counts
FOLDS = 5
CERTAIN = ("coulomb", "delay", "load_dependent")  # laws that no machine is without
BEYOND = 0.005  # of the force: friction under a load against that of the empty machine, continued
TOLD = 0.5  # of the prior's standard error: a parameter above it is not told by the recording


class Identification(NamedTuple):
    """The `model` with the friction laws that were chosen, its `tares`, the fit, names of what the recording does not
    tell, seconds of usable motion, and per friction law tried the mean squared prediction error held out (1: the
    row's own noise); sentences for the physical laws that the fit breaks."""

    model: Model
    tares: Tares
    fit: Fit
    not_identified: tuple[str, ...]
    seconds: float
    held_out: dict[str, float]
    violations: tuple[str, ...]


def identify(
    model: Model, segments: Iterable[Array], *, two_steps: bool = False, enforce: bool = False, refuse: bool = True
) -> Identification:
    """Tares from gapless segments of samples (T, S). `model.friction` are the laws to choose from; CERTAIN ones always
    stay. `two_steps`: the paper's procedure, static parameters from slow moves, then dynamic ones; else all at once.
    `enforce`: the nearest physically consistent tares. `refuse`: look for the signatures of a load, of contact, of dead
    or misplaced sensors and of wrong piston areas.

    Raises ValueError, in a sentence, when the recording is too short, does not move, moves a cylinder one way only, or
    is refused."""
    evidence = [nothing(model.machine)]
    whole = observed_factors(model, _watched(model, segments, evidence))
    held = chosen(whole, list(range(len(model.parameters))))
    seconds = _enough(model, held)
    noise = row_noise(held, model.prior)
    if refuse:
        sentence = doubt(model, whole, noise, least_squares(held, noise, model.prior), evidence[0])
        if sentence is not None:
            raise ValueError(sentence)
    laws, errors = _choose(model, held, noise)
    best = Model(model.machine, model.filters, laws)
    fewer = chosen(held, _of(model, best))
    fit = _two_steps(best, fewer, noise) if two_steps else least_squares(fewer, noise, best.prior)
    fit = as_usual(best, fit)
    names = tuple(p.name for p in best.parameters)
    seen = np.sum(held.samples, axis=0) > 0  # a joint that never moved stays as uncertain as its data sheet
    left = np.where(seen, np.maximum(fit.row_error, 1e-3 * noise + 1e-9), best.data_sheet.row_error)
    covariance = under_load(best, fit.covariance)
    tares = Tares(laws, names, fit.values, covariance, left, True, 1.0, best.scale_error)
    return Identification(
        best,
        consistent(best, tares) if enforce else tares,
        fit,
        _not_told(best, fit),
        seconds,
        errors,
        violations(best, fit.values, np.sqrt(np.diag(fit.covariance))),
    )


def as_usual(model: Model, fit: Fit) -> Fit:
    """The fit with each coefficient that has a usual value, and of which the recording tells less than its prior, held
    down to that value, the others following as the recording demands: a faint pull from residuals that no law explains
    is no measurement. What is unknown of it stays in the covariance."""
    values, prior = fit.values.copy(), model.prior
    for k, p in enumerate(model.parameters):
        law = p.name.rpartition(".")[2]
        if law in TYPICAL and values[k] > prior.mean[k] and fit.covariance[k, k] > TOLD**2 * prior.covariance[k, k]:
            values += fit.covariance[:, k] / fit.covariance[k, k] * (prior.mean[k] - values[k])
    return fit._replace(values=values)


def under_load(model: Model, covariance: Array) -> Array:
    """`covariance` (P, P) of what the empty machine tells, with what its friction may be BEYOND that under a load: the
    law is a straight line through forces that the empty machine never reaches. Each coefficient is left so uncertain,
    and the other parameters follow as the recording demands, so that the empty machine is as well known as before."""
    wider = covariance.copy()
    for k, p in enumerate(model.parameters):
        if p.name.endswith(".load_dependent"):
            along = covariance[:, k] / covariance[k, k]
            wider += BEYOND**2 * np.outer(along, along)
    return wider


def _watched(model: Model, segments: Iterable[Array], evidence: list[SignalHistory]) -> Iterator[Array]:
    """The segments; what their raw samples tell is gathered in `evidence` as they pass."""
    for segment in segments:
        evidence[0] = gathered(model, evidence[0], segment, joins=False)
        yield segment


def _enough(model: Model, held: Factors) -> float:
    """Seconds of usable motion. Raises ValueError, in a sentence, when there is too little."""
    seconds = float(np.max(np.sum(held.samples + held.others, axis=0)) / model.filters.rate_hz)
    if seconds == 0.0:
        raise ValueError("no cylinder moves in the recording: move every joint both ways, slowly and fast")
    if seconds < MIN_SECONDS:
        raise ValueError(
            f"only {seconds:.0f} s of usable motion; move the empty machine for at least {MIN_SECONDS:.0f} s"
        )
    _check_both_ways(model, held)
    return seconds


def _check_both_ways(model: Model, held: Factors) -> None:
    """What runs one way only has a friction that looks like weight. Raises ValueError."""
    n, c = model.machine.size, len(model.machine.cylinders)
    weight = np.max(held.samples, axis=1) / model.filters.rate_hz
    ways = weight @ held.mark[:, n + c :]
    for cylinder, out, into in zip(model.machine.cylinders, ways[:c], ways[c:], strict=True):
        if max(out, into) > ONE_WAY_SECONDS and min(out, into) < ONE_WAY * (out + into):
            raise ValueError(
                f"the {cylinder.name} cylinder moves {'out' if out > into else 'in'} only, so that its friction cannot "
                "be told from weight: move it both ways"
            )


def _two_steps(model: Model, held: Factors, noise: Array) -> Fit:
    """Static parameters from the slower half of the blocks, inertia and viscous friction as the data
    sheet has them; then those others from all blocks with the static ones settled (paper, section 6)."""
    dynamic = [k for k, p in enumerate(model.parameters) if p.name.endswith((".J", ".viscous"))]
    static = [k for k in range(len(model.parameters)) if k not in dynamic]
    n = model.machine.size
    speed = held.mark[:, n : n + len(model.machine.cylinders)].max(axis=1)
    slow = Factors(*(part[speed <= np.median(speed)] for part in held))
    first = least_squares(settled(slow, dynamic, model.prior.mean[dynamic]), noise, _marginal(model.prior, static))
    second = least_squares(settled(held, static, first.values), noise, _marginal(model.prior, dynamic))
    values, covariance = np.zeros(len(model.parameters)), np.zeros((len(model.parameters),) * 2)
    excited = np.zeros(len(model.parameters), dtype=bool)
    for part, fit in ((static, first), (dynamic, second)):
        values[part], excited[part] = fit.values, fit.excited
        covariance[np.ix_(part, part)] = fit.covariance
    return second._replace(values=values, covariance=covariance, excited=excited)


def _marginal(prior: Prior, part: list[int]) -> Prior:
    return Prior(prior.mean[part], prior.covariance[np.ix_(part, part)])


def row_noise(held: Factors, prior: Prior) -> Array:
    """What a fit of each row alone leaves of it (R,). Weights taken from the joint fit's own residuals would let one
    row win all: the better it fits, the more it weighs."""
    rows = range(held.samples.shape[1])
    alone = [_alone(held, prior, r) if np.any(held.samples[:, r]) else np.nan for r in rows]
    return np.asarray(np.where(np.isnan(alone), np.nanmax(alone), alone))


def _alone(held: Factors, prior: Prior, r: int) -> float:
    one = of_row(held, r)
    size = np.sqrt(np.sum(one.triangle[..., -1] ** 2) / np.sum(one.samples))
    return float(least_squares(one, np.array([size + 1e-9]), prior).row_error[0] + 1e-6 * size + 1e-9)


def _of(model: Model, part: Model) -> list[int]:
    """The columns of a model with fewer friction laws among those of `model`."""
    place = {p.name: k for k, p in enumerate(model.parameters)}
    return [place[p.name] for p in part.parameters]


def _choose(model: Model, held: Factors, noise: Array) -> tuple[tuple[str, ...], dict[str, float]]:
    """Friction laws by held-out prediction: blocks of like posture are left out together, so that what is scored is
    prediction into postures that were not seen. A law joins when it predicts better by more than two standard errors
    over the folds. Certain are Coulomb friction, the delay (every sensor lags, and viscous friction would take its
    place, with too small a standard error) and friction that grows with the load: the empty machine may not need it to
    explain itself, the loaded one does, and left out it would be taken for known."""
    folds = _folds(model, held)
    laws = tuple(law for law in model.friction if law in CERTAIN) or model.friction[:1]
    best = _errors(model, laws, held, noise, folds)
    told = {laws[0]: float(np.mean(best))}
    for law in [law for law in model.friction if law not in laws]:
        error = _errors(model, (*laws, law), held, noise, folds)
        told[law] = float(np.mean(error))
        gain = best - error
        if np.mean(gain) > 2.0 * np.std(gain) / np.sqrt(max(len(gain) - 1, 1)):
            laws, best = (*laws, law), error
    return tuple(sorted(laws, key=FRICTION.index)), told


def _folds(model: Model, held: Factors) -> Array:
    """The fold (B,) of each block: neighbours along the direction in which the postures differ most."""
    posture = held.mark[:, : model.machine.size]
    _, _, axes = np.linalg.svd(posture - posture.mean(axis=0), full_matrices=False)
    order = np.argsort(posture @ axes[0], kind="stable")
    fold = np.empty(len(order))
    fold[order] = np.arange(len(order)) * FOLDS // max(len(order), 1)
    return fold


def _errors(model: Model, laws: tuple[str, ...], held: Factors, noise: Array, folds: Array) -> Array:
    """Mean squared prediction error of every fold from the others."""
    part = Model(model.machine, model.filters, laws)
    fewer = chosen(held, _of(model, part))
    memory = least_squares(fewer, noise, part.prior).memory
    each = (predicted(fewer, noise, part.prior, memory, folds == k) for k in np.unique(folds))
    return np.array([np.mean(error) for error in each])


def _not_told(model: Model, fit: Fit) -> tuple[str, ...]:
    """Parameters of which the recording tells less than the data sheet does."""
    prior = np.sqrt(np.diag(model.prior.covariance))
    found = np.sqrt(np.diag(fit.covariance))
    lost = np.logical_or(np.logical_not(fit.excited), found > TOLD * prior)
    return tuple(p.name for p, is_lost in zip(model.parameters, lost, strict=True) if is_lost)
