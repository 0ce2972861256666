"""Identification of the dynamic tares from recordings of the empty machine: one least-squares fit of all parameters
with the data sheet as prior. Optional friction laws are used only when they improve the prediction of data not
fitted."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.common_scale import CommonScale, common_scale
from cylforce.commissioning.consistency import consistent, violations
from cylforce.commissioning.explained import quality, row_noise
from cylforce.commissioning.repairs import Case
from cylforce.commissioning.soundness import soundness
from cylforce.commissioning.suspicion import doubt
from cylforce.commissioning.wiring import SignalHistory, gathered, nothing
from cylforce.commissioning.zeros import between_strokes, correlation
from cylforce.estimation.attachment import with_tool
from cylforce.estimation.batch import Fit, least_squares, predicted
from cylforce.estimation.blocks import Factors, chosen, settled
from cylforce.estimation.model import BARS, EXPECTED, FRICTION, TYPICAL, Model, Tares
from cylforce.estimation.observation import observed_factors
from cylforce.estimation.priors.prior import Prior
from cylforce.signals.estimate import Array

MIN_SECONDS = 20.0  # s of usable motion that a recording must contain; chosen
ONE_WAY = 0.05  # of a cylinder's motion: with less in one direction it moved in the other one only; chosen
ONE_WAY_SECONDS = 2.0  # s of motion of a cylinder, below which its directions are not checked; chosen
FOLDS = 5  # parts of the recording for the choice of friction laws by prediction; chosen
CERTAIN = ("coulomb", "delay", "load_dependent", BARS)  # laws that are always in the model; see `_choose`
# Of the force: additional standard error of load-dependent friction beyond the measured forces. Fitted: with 0.005 the
# weights of 12 reference machines without a known lift were wrong by 1.6 of their standard errors, rms.
BEYOND = 0.008
DETERMINED = 0.5  # times the prior's standard error: above it the recording does not determine a parameter; chosen


class Identification(NamedTuple):
    """The `model` with the friction laws that were chosen, its `tares`, the fit, names of what the recording does not
    determine, seconds of usable motion, and per friction law tried the mean squared prediction error in data left out
    of the fit (1: the row's own noise); sentences for the physical laws that the fit violates; share of each joint's
    torque that is `explained` (R,), NaN where a joint was not seen; `warnings` that go with the tares into service;
    `by_masses`: the common scale of the pressures by the data sheet's masses, None with another tool, which takes the
    scale of the standard tool."""

    model: Model
    tares: Tares
    fit: Fit
    not_identified: tuple[str, ...]
    seconds: float
    held_out: dict[str, float]
    violations: tuple[str, ...]
    explained: Array
    warnings: tuple[str, ...]
    by_masses: CommonScale | None = None

    @property
    def knows_scale(self) -> bool:
        """Whether a known weight was lifted; else the scale and its error are those of the data sheet."""
        return self.tares.common_error == 0.0 or self.tares.scale_error != self.model.scale_error


def identify(
    model: Model, segments: Iterable[Array], *, two_steps: bool = False, enforce: bool = False, refuse: bool = True
) -> Identification:
    """Tares from gapless segments of samples (T, S). `model.friction` are the laws to choose from; CERTAIN ones always
    stay. `two_steps`: the paper's procedure, static parameters from slow moves, then dynamic ones; else all at once.
    `enforce`: the nearest physically consistent tares. `refuse`: look for the signatures of a load, of contact, of dead
    or misplaced sensors, of wrong piston areas and of a wrong scale of all pressures.

    Raises ValueError, in a sentence, when the recording is too short, does not move, moves a cylinder one way only, or
    is refused, or when a joint's torque stays unexplained (`soundness`)."""
    evidence = [nothing(model.machine)]
    whole = observed_factors(model, watched(model, segments, evidence))
    factors = chosen(whole, list(range(len(model.parameters))))
    seconds = enough(model, factors)
    noise = row_noise(factors, model.prior)
    if refuse:
        sentence = doubt(model, whole, evidence[0])
        if sentence is not None:
            raise ValueError(sentence)
    laws, errors = _laws(model, factors, noise)
    best = model.with_laws(laws)
    fewer = chosen(factors, _of(model, best))
    fit = _two_steps(best, fewer, noise) if two_steps else least_squares(fewer, noise, best.prior)
    fit = as_usual(best, fit)
    names = tuple(p.name for p in best.parameters)
    seen = np.sum(factors.samples, axis=0) > 0  # a joint that never moved stays as uncertain as its data sheet
    left = np.where(seen, np.maximum(fit.row_error, 1e-3 * noise + 1e-9), best.data_sheet.row_error)
    covariance = under_load(best, fit.covariance)
    lasting = correlation(best, fewer, fit.values, left)
    differ = between_strokes(best, _beside_tool(model, best, whole), fit.values, left)
    masses = common_scale(best, fewer, noise)
    rest = (best.scale_error, lasting, differ, masses.error)
    tares = Tares(laws, names, fit.values, covariance, left, True, 1.0, *rest)
    broken = violations(best, fit.values, np.sqrt(np.diag(fit.covariance)))
    found = quality(best, fewer, fit.values, fit.covariance)
    sound = soundness(Case(model, evidence[0].kept), found, broken)
    if refuse and sound.refusal is not None:
        raise ValueError(sound.refusal)
    obeying = consistent(best, tares) if enforce else tares
    lost = _not_told(best, fit)
    warnings = (*((masses.sentence,) if masses.is_wrong else ()), *sound.warnings)
    return Identification(best, obeying, fit, lost, seconds, errors, broken, found.explained, warnings, masses)


def as_usual(model: Model, fit: Fit) -> Fit:
    """The fit with some coefficients set back to their typical value (`model.TYPICAL`): those that came out larger
    although the recording hardly determines them, because model errors can cause that. The other parameters change by
    their covariance with them; the covariance itself remains."""
    values, prior = fit.values.copy(), model.prior
    for k, p in enumerate(model.parameters):
        law = p.name.rpartition(".")[2]
        uncertain = fit.covariance[k, k] > DETERMINED**2 * prior.covariance[k, k]
        if law in TYPICAL and values[k] > prior.mean[k] and uncertain:
            values += fit.covariance[:, k] / fit.covariance[k, k] * (prior.mean[k] - values[k])
    return fit._replace(values=values)


def under_load(model: Model, covariance: Array) -> Array:
    """`covariance` (P, P) from the empty machine, increased for use under load: load-dependent friction is extrapolated
    there to forces that the empty machine never reaches, with an additional standard error BEYOND of each coefficient.
    The other parameters are correlated with it such that the error on the empty machine does not increase."""
    wider = covariance.copy()
    for k, p in enumerate(model.parameters):
        if p.name.endswith(".load_dependent"):
            along = covariance[:, k] / covariance[k, k]
            wider += BEYOND**2 * np.outer(along, along)
    return wider


def watched(model: Model, segments: Iterable[Array], evidence: list[SignalHistory]) -> Iterator[Array]:
    """The segments unchanged; `evidence` (a list of one) is updated with their raw samples as they pass."""
    for segment in segments:
        evidence[0] = gathered(model, evidence[0], segment, joins=False)
        yield segment


def enough(model: Model, factors: Factors) -> float:
    """Time of usable motion [s]. Raises ValueError, in one sentence, when it is too short or in one direction only."""
    seconds = float(np.max(np.sum(factors.samples + factors.others, axis=0)) / model.filters.rate_hz)
    if seconds == 0.0:
        raise ValueError("no cylinder moves in the recording: move every joint both ways, slowly and fast")
    if seconds < MIN_SECONDS:
        raise ValueError(
            f"only {seconds:.0f} s of usable motion; move the empty machine for at least {MIN_SECONDS:.0f} s"
        )
    _check_both_ways(model, factors)
    return seconds


def _check_both_ways(model: Model, factors: Factors) -> None:
    """Raises ValueError, in one sentence, when a cylinder moves in one direction only: its friction cannot then be
    distinguished from weight."""
    n, c = model.machine.size, len(model.machine.cylinders)
    weight = np.max(factors.samples, axis=1) / model.filters.rate_hz
    ways = weight @ factors.mark[:, n + c : n + 3 * c]
    for cylinder, out, into in zip(model.machine.cylinders, ways[:c], ways[c:], strict=True):
        if max(out, into) > ONE_WAY_SECONDS and min(out, into) < ONE_WAY * (out + into):
            raise ValueError(
                f"the {cylinder.name} cylinder moves {'out' if out > into else 'in'} only, so that its friction cannot "
                "be distinguished from weight: move it both ways"
            )


def _two_steps(model: Model, factors: Factors, noise: Array) -> Fit:
    """Fit in two steps (paper, section 6): static parameters from the slower half of the blocks, with inertia and
    viscous friction fixed at the prior means; then inertia and viscous friction from all blocks, with the static
    parameters fixed. The covariance between both groups is set to zero."""
    dynamic = [k for k, p in enumerate(model.parameters) if p.name.endswith((".J", ".viscous"))]
    static = [k for k in range(len(model.parameters)) if k not in dynamic]
    n = model.machine.size
    speed = factors.mark[:, n : n + len(model.machine.cylinders)].max(axis=1)
    slow = Factors(*(part[speed <= np.median(speed)] for part in factors))
    first = least_squares(settled(slow, dynamic, model.prior.mean[dynamic]), noise, _marginal(model.prior, static))
    second = least_squares(settled(factors, static, first.values), noise, _marginal(model.prior, dynamic))
    values, covariance = np.zeros(len(model.parameters)), np.zeros((len(model.parameters),) * 2)
    excited = np.zeros(len(model.parameters), dtype=bool)
    for part, fit in ((static, first), (dynamic, second)):
        values[part], excited[part] = fit.values, fit.excited
        covariance[np.ix_(part, part)] = fit.covariance
    return second._replace(values=values, covariance=covariance, excited=excited)


def _marginal(prior: Prior, part: list[int]) -> Prior:
    return Prior(prior.mean[part], prior.covariance[np.ix_(part, part)])


def _of(model: Model, part: Model) -> list[int]:
    """The columns of a model with fewer friction laws among those of `model`."""
    place = {p.name: k for k, p in enumerate(model.parameters)}
    return [place[p.name] for p in part.parameters]


def _beside_tool(model: Model, part: Model, whole: Factors) -> Factors:
    """The factors `whole` of `model` with the parameters of `part` alone; the columns that follow remain."""
    return chosen(whole, [*_of(model, part), *range(len(model.parameters), whole.triangle.shape[-1] - 1)])


def _laws(model: Model, factors: Factors, noise: Array) -> tuple[tuple[str, ...], dict[str, float]]:
    """As `_choose`, without the bars of linkages where the recording does not tell all of them: the links contain them
    then, as in the data sheet."""
    laws, errors = _choose(model, model.friction, factors, noise)
    part = model.with_laws(laws)
    untold = _not_told(part, least_squares(chosen(factors, _of(model, part)), noise, part.prior))
    if not any(name.endswith(f".{BARS}") for name in untold):
        return laws, errors
    return _choose(model, tuple(law for law in model.friction if law != BARS), factors, noise)


def _choose(
    model: Model, allowed: tuple[str, ...], factors: Factors, noise: Array
) -> tuple[tuple[str, ...], dict[str, float]]:
    """(Chosen friction laws among those `allowed`, mean squared prediction error of each tried), by cross-validation:
    blocks of similar posture form a fold, so that postures are predicted which the fit did not contain. A law is added
    when it improves the prediction by more than two standard errors over the folds. The laws in CERTAIN are always in:
    Coulomb friction; the delay, because every sensor lags, and viscous friction would take its place with too small a
    standard error; load-dependent friction, which the empty machine may not show but the loaded machine has; the bars
    of linkages, which look like the links' weight on level ground, and show on a slope."""
    folds = _folds(model, factors)
    laws = tuple(law for law in allowed if law in CERTAIN) or allowed[:1]
    best = _errors(model, laws, factors, noise, folds)
    errors = {laws[0]: float(np.mean(best))}
    for law in [law for law in allowed if law not in laws]:
        error = _errors(model, (*laws, law), factors, noise, folds)
        errors[law] = float(np.mean(error))
        gain = best - error
        if np.mean(gain) > 2.0 * np.std(gain) / np.sqrt(max(len(gain) - 1, 1)):
            laws, best = (*laws, law), error
    return tuple(sorted(laws, key=FRICTION.index)), errors


def _folds(model: Model, factors: Factors) -> Array:
    """Number of the fold (B,) of each block: blocks are sorted along the direction in which the postures differ most,
    and divided into FOLDS equal parts."""
    posture = factors.mark[:, : model.machine.size]
    _, _, axes = np.linalg.svd(posture - posture.mean(axis=0), full_matrices=False)
    order = np.argsort(posture @ axes[0], kind="stable")
    fold = np.empty(len(order))
    fold[order] = np.arange(len(order)) * FOLDS // max(len(order), 1)
    return fold


def _errors(model: Model, laws: tuple[str, ...], factors: Factors, noise: Array, folds: Array) -> Array:
    """Mean squared prediction error of every fold by a fit of the other folds."""
    part = model.with_laws(laws)
    fewer = chosen(factors, _of(model, part))
    memory = least_squares(fewer, noise, part.prior).memory
    each = (predicted(fewer, noise, part.prior, memory, folds == k) for k in np.unique(folds))
    return np.array([np.mean(error) for error in each])


def _not_told(model: Model, fit: Fit) -> tuple[str, ...]:
    """Names of the parameters that are not known clearly better than by the data sheet (DETERMINED)."""
    prior = np.sqrt(np.diag(model.sheet.prior.covariance))
    found = np.sqrt(np.diag(fit.covariance))
    lost = np.logical_or(np.logical_not(fit.excited), found > DETERMINED * prior)
    return tuple(p.name for p, is_lost in zip(model.parameters, lost, strict=True) if is_lost)


def attachment_prior(common: Tares, standard: Model, other: Model) -> Prior:
    """What is known of the machine with another tool before it moves: the common arm, the tool's data sheet, and that
    friction is another one on another day (`EXPECTED`)."""
    known = with_tool(common, standard, other)
    changes = np.zeros(len(known.values))
    changes[other.changing_friction] = EXPECTED.friction * known.values[other.changing_friction]
    return Prior(known.values, known.covariance + np.diag(changes**2))


def identify_attachment(
    common: Tares, standard: Model, other: Model, segments: Iterable[Array], *, refuse: bool = True
) -> Identification:
    """Tares of `other`, which is `standard` with another tool, from gapless segments of samples (T, S) of the empty
    machine; both models have the friction laws of the `common` tares, which were identified with the standard tool.

    Raises ValueError, in a sentence, as `identify`."""
    evidence = [nothing(other.machine)]
    whole = observed_factors(other, watched(other, segments, evidence))
    factors = chosen(whole, list(range(len(other.parameters))))
    seconds = enough(other, factors)
    sentence = doubt(other, whole, evidence[0]) if refuse else None
    if sentence is not None:
        raise ValueError(sentence)
    prior = attachment_prior(common, standard, other)
    fit = least_squares(factors, row_noise(factors, prior), prior)
    seen = np.sum(factors.samples, axis=0) > 0
    left = np.where(seen, np.maximum(fit.row_error, 1e-3 * common.row_error), common.row_error)
    tares = common._replace(values=fit.values, covariance=under_load(other, fit.covariance), row_error=left)
    explained = quality(other, factors, fit.values, fit.covariance).explained
    lost = tuple(p.name for p, found in zip(other.parameters, fit.excited, strict=True) if not found)
    return Identification(other, tares, fit, lost, seconds, {}, (), explained, ())
