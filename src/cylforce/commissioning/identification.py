"""Identification of the dynamic tares from recordings of the empty machine.

One least-squares fit determines all parameters, with the data sheet as prior. Optional friction laws are used only when
they improve the prediction of data that were not fitted.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from cylforce.commissioning.common_scale import CommonScale, common_scale
from cylforce.commissioning.consistency import consistent, violations
from cylforce.commissioning.explained import quality, row_noise
from cylforce.commissioning.repairs import Case
from cylforce.commissioning.soundness import soundness
from cylforce.commissioning.suspicion import refusal_sentence
from cylforce.commissioning.wiring import SignalHistory, empty_history, extended_history
from cylforce.commissioning.zeros import between_strokes, correlation
from cylforce.estimation.attachment import with_tool
from cylforce.estimation.batch import Fit, converged, least_squares, predicted
from cylforce.estimation.blocks import Factors, chosen, settled
from cylforce.estimation.model import BARS, EXPECTED, FRICTION, TYPICAL, Model, Tares
from cylforce.estimation.observation import observed_factors
from cylforce.estimation.priors.prior import Prior
from cylforce.signals.estimate import Array

MIN_SECONDS = 20.0  # s of usable motion that a recording must contain; chosen
ONE_WAY = 0.05  # share of a cylinder's motion in one direction below which it moved in the other one only; chosen
ONE_WAY_SECONDS = 2.0  # s of motion of a cylinder below which its directions are not checked; chosen
FOLDS = 5  # parts of the recording for the choice of friction laws by prediction; chosen
CERTAIN = ("coulomb", "delay", "load_dependent", BARS)  # laws that are always in the model; see `_choose`
# Additional standard error of load-dependent friction beyond the measured forces, as a share of the force. Fitted: with
# 0.005 the weights of 12 reference machines without a known lift were wrong by 1.6 of their standard errors, rms.
BEYOND = 0.008
DETERMINED = 0.5  # standard error above which the recording does not determine a parameter, in the prior's; chosen


class Identification(NamedTuple):
    """Result of an identification.

    model: the model with the friction laws that were chosen
    tares: the identified parameters
    fit: the least-squares fit, whose covariance is not yet increased for use under load
    not_identified: names of the parameters that the recording does not determine
    seconds: time of usable motion [s]
    held_out: per friction law tried the mean squared prediction error in data left out of the fit; 1: the row's own
        noise; the first entry, under the name of one law, is the error of all laws that are always in the model
    violations: sentences of the physical laws that the fit violates
    explained: (R,) share of each joint's torque that is explained; NaN: the joint's torque was never usable
    warnings: sentences that go with the tares into service
    by_masses: common scale of the pressures by the data sheet's masses; None with another tool, which takes the scale
        of the standard tool
    """

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
    def scale_measured(self) -> bool:
        """Return whether a known weight was lifted; else the scale and its error are those of the data sheet."""
        return self.tares.common_error == 0.0 or self.tares.scale_error != self.model.scale_error


def identify(
    model: Model, segments: Iterable[Array], *, two_steps: bool = False, enforce: bool = False, refuse: bool = True
) -> Identification:
    """Identify the tares from gapless segments of samples (T, S) of the empty machine.

    Raises ValueError, in a sentence, when the recording is too short, does not move, moves a cylinder one way only, or
    is refused, when a joint's torque stays unexplained (`soundness`), or when no consistent tares are found.

    model: its `friction` are the laws to choose from; laws in CERTAIN always stay
    two_steps: use the paper's procedure, static parameters from slow moves, then dynamic ones; else all at once
    enforce: return the nearest physically consistent tares
    refuse: check for the signatures of a load, of contact, of dead or misplaced sensors, of wrong piston areas and of a
        wrong scale of all pressures; without it no such check is made, and what `soundness` refuses becomes a warning
    """
    evidence = [empty_history(model.machine)]
    whole = observed_factors(model, recorded_history(model, segments, evidence))
    factors = chosen(whole, list(range(len(model.parameters))))
    seconds = usable_seconds(model, factors)
    noise = row_noise(factors, model.prior)
    if refuse:
        sentence = refusal_sentence(model, whole, evidence[0])
        if sentence is not None:
            raise ValueError(sentence)
    laws, errors = _laws(model, factors, noise)
    best = model.with_laws(laws)
    fewer = chosen(factors, _columns_of(model, best))
    fit = _two_steps(best, fewer, noise) if two_steps else least_squares(fewer, noise, best.prior)
    fit = with_typical_friction(best, fit)
    names = tuple(p.name for p in best.parameters)
    measured = np.sum(factors.samples, axis=0) > 0  # a joint that never moved stays as uncertain as its data sheet
    row_error = np.where(measured, np.maximum(fit.row_error, 1e-3 * noise + 1e-9), best.data_sheet.row_error)
    masses = common_scale(best, fewer, noise)
    tares = Tares(
        friction=laws,
        names=names,
        values=fit.values,
        covariance=extrapolated_covariance(best, fit.covariance),
        row_error=row_error,
        identified=True,
        scale=1.0,
        scale_error=best.scale_error,
        correlation=correlation(best, fewer, fit.values, row_error),
        between_strokes=between_strokes(best, _with_tool_columns(model, best, whole), fit.values, row_error),
        common_error=masses.error,
    )
    broken = violations(best, fit.values, np.sqrt(np.diag(fit.covariance)))
    fit_quality = quality(best, fewer, fit.values, fit.covariance)
    verdict = soundness(Case(model, evidence[0].kept), fit_quality, broken)
    if refuse and verdict.refusal is not None:
        raise ValueError(verdict.refusal)
    return Identification(
        model=best,
        tares=consistent(best, tares) if enforce else tares,
        fit=fit,
        not_identified=_undetermined(best, fit),
        seconds=seconds,
        held_out=errors,
        violations=broken,
        explained=fit_quality.explained,
        warnings=(*((masses.sentence,) if masses.is_wrong else ()), *verdict.warnings),
        by_masses=masses,
    )


def with_typical_friction(model: Model, fit: Fit) -> Fit:
    """Return the fit with undetermined friction coefficients above their typical value set back to it.

    Concerned are the coefficients of `model.TYPICAL` that came out larger although the recording hardly determines
    them: model errors can cause that. The other parameters change by their covariance with them. The covariance itself
    remains.
    """
    values, prior = fit.values.copy(), model.prior
    for k, p in enumerate(model.parameters):
        law = p.name.rpartition(".")[2]
        uncertain = fit.covariance[k, k] > DETERMINED**2 * prior.covariance[k, k]
        if law in TYPICAL and values[k] > prior.mean[k] and uncertain:
            values += fit.covariance[:, k] / fit.covariance[k, k] * (prior.mean[k] - values[k])
    return fit._replace(values=values)


def extrapolated_covariance(model: Model, covariance: Array) -> Array:
    """Return the covariance (P, P) from the empty machine, increased for use under load.

    Load-dependent friction is extrapolated to forces that the empty machine never reaches, with an additional standard
    error BEYOND of each coefficient. The other parameters are correlated with it such that the error on the empty
    machine does not increase.
    """
    wider = covariance.copy()
    for k, p in enumerate(model.parameters):
        if p.name.endswith(".load_dependent"):
            along = covariance[:, k] / covariance[k, k]
            wider += BEYOND**2 * np.outer(along, along)
    return wider


def recorded_history(model: Model, segments: Iterable[Array], evidence: list[SignalHistory]) -> Iterator[Array]:
    """Yield the segments unchanged, and update their history as they pass.

    segments: samples (T, S) without gaps [SI]
    evidence: a list of one history, which is replaced
    """
    for segment in segments:
        evidence[0] = extended_history(model, evidence[0], segment, joins=False)
        yield segment


def usable_seconds(model: Model, factors: Factors) -> float:
    """Return the time of usable motion [s], of the measured joint with most of it, rows set aside included.

    Raises ValueError, in one sentence, when it is too short, or when a cylinder moves in one direction only.
    """
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
    """Raise ValueError, in one sentence, when a cylinder moves in one direction only (ONE_WAY).

    Its friction cannot then be distinguished from weight. Cylinders that hardly move are not checked (ONE_WAY_SECONDS).
    """
    n, c = model.machine.size, len(model.machine.cylinders)
    block_s = np.max(factors.samples, axis=1) / model.filters.rate_hz
    ways = block_s @ factors.mark[:, n + c : n + 3 * c]
    for cylinder, out, into in zip(model.machine.cylinders, ways[:c], ways[c:], strict=True):
        if max(out, into) > ONE_WAY_SECONDS and min(out, into) < ONE_WAY * (out + into):
            raise ValueError(
                f"the {cylinder.name} cylinder moves {'out' if out > into else 'in'} only, so that its friction cannot "
                "be distinguished from weight: move it both ways"
            )


def _two_steps(model: Model, factors: Factors, noise: Array) -> Fit:
    """Fit in two steps (paper, section 6).

    First, static parameters are fitted to the slower half of the blocks, with inertia and viscous friction fixed at the
    prior means. Then inertia and viscous friction are fitted to all blocks, with the static parameters fixed. The
    covariance between both groups is set to zero.

    factors: factors of the model's columns
    noise: (R,) rms residual of each torque fitted alone [N m]
    """
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
    """Return the prior of some of the parameters; `part`: their numbers."""
    return Prior(prior.mean[part], prior.covariance[np.ix_(part, part)])


def _columns_of(model: Model, part: Model) -> list[int]:
    """Return the numbers of the columns of `part`, a model with fewer friction laws, among those of `model`."""
    place = {p.name: k for k, p in enumerate(model.parameters)}
    return [place[p.name] for p in part.parameters]


def _with_tool_columns(model: Model, part: Model, whole: Factors) -> Factors:
    """Return the factors of `whole` for the parameters of `part`, then for all columns after those of the parameters.

    model: model of `whole`
    part: the model with fewer friction laws
    whole: factors of the parameters of `model`, of the tool and of the pressures' zero errors
    """
    return chosen(whole, [*_columns_of(model, part), *range(len(model.parameters), whole.triangle.shape[-1] - 1)])


def _laws(model: Model, factors: Factors, noise: Array) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return the friction laws and prediction errors of `_choose`.

    Where the recording does not determine the weight of the bars of all linkages, it is not among the laws. The links'
    parameters then contain the bars, as in the data sheet.

    factors: factors of the model's columns
    noise: (R,) rms residual of each torque fitted alone [N m]
    """
    laws, errors = _choose(model, model.friction, factors, noise)
    part = model.with_laws(laws)
    undetermined = _undetermined(part, least_squares(chosen(factors, _columns_of(model, part)), noise, part.prior))
    if not any(name.endswith(f".{BARS}") for name in undetermined):
        return laws, errors
    return _choose(model, tuple(law for law in model.friction if law != BARS), factors, noise)


def _choose(
    model: Model, allowed: tuple[str, ...], factors: Factors, noise: Array
) -> tuple[tuple[str, ...], dict[str, float]]:
    """Choose friction laws by cross-validation; return them, and the mean squared prediction error of each law tried.

    The error of a law is that of a fit with it and the laws chosen before, in squared standard errors of the rows.
    Blocks of similar posture form a fold, so that postures are predicted which the fit did not contain. A law is added
    when it improves the prediction by more than two standard errors over the folds. The laws in CERTAIN are always in:
    Coulomb friction; the delay, because every sensor lags, and viscous friction would replace it with too small a
    standard error; load-dependent friction, which the empty machine may not show but the loaded machine has; the bars
    of linkages, which resemble the links' weight on level ground, but not on a slope.

    allowed: laws among which is chosen
    factors: factors of the model's columns
    noise: (R,) standard error of each row [N m]
    """
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
    """Return the number of the fold (B,) of each block.

    Blocks are sorted along the direction in which the postures differ most, and divided into FOLDS equal groups.
    """
    posture = factors.mark[:, : model.machine.size]
    axes = np.linalg.svd(posture - posture.mean(axis=0), full_matrices=False).Vh
    order = np.argsort(posture @ axes[0], kind="stable")
    fold = np.empty(len(order))
    fold[order] = np.arange(len(order)) * FOLDS // max(len(order), 1)
    return fold


def _errors(model: Model, laws: tuple[str, ...], factors: Factors, noise: Array, folds: Array) -> Array:
    """Return the mean squared prediction error (F,) of each of F folds by a fit of the other folds.

    Its unit is the square of the rows' standard errors.

    factors: factors of B blocks, for all columns of `model`
    noise: (R,) standard error of each row [N m]
    folds: (B,) number of the fold of each block
    """
    part = model.with_laws(laws)
    fewer = chosen(factors, _columns_of(model, part))
    memory = converged(fewer, noise, part.prior).memory
    squares = (predicted(fewer, noise, part.prior, memory, folds == k) for k in np.unique(folds))
    return np.array([np.mean(of_fold) for of_fold in squares])


def _undetermined(model: Model, fit: Fit) -> tuple[str, ...]:
    """Return the names of the parameters that are not clearly better determined than by the data sheet (DETERMINED)."""
    prior_error = np.sqrt(np.diag(model.sheet.prior.covariance))
    fit_error = np.sqrt(np.diag(fit.covariance))
    weak = np.logical_or(np.logical_not(fit.excited), fit_error > DETERMINED * prior_error)
    return tuple(p.name for p, is_weak in zip(model.parameters, weak, strict=True) if is_weak)


def attachment_prior(identified: Tares, standard: Model, other: Model) -> Prior:
    """Return the prior of the machine with another tool before it moves.

    It combines the identified arm and the tool's data sheet (`with_tool`). Each Coulomb and viscous friction may also
    have changed, independently of the others, with the standard error `EXPECTED.friction` (a chosen share) times its
    identified value.

    identified: tares identified with the standard tool
    standard, other: model with the standard tool and with the other tool
    """
    known = with_tool(identified, standard, other)
    changes = np.zeros(len(known.values))
    changes[other.changing_friction] = EXPECTED.friction * known.values[other.changing_friction]
    return Prior(known.values, known.covariance + np.diag(changes**2))


def identify_attachment(
    identified: Tares, standard: Model, other: Model, segments: Iterable[Array], *, refuse: bool = True
) -> Identification:
    """Identify the tares of the machine with another tool from gapless segments of samples (T, S) of the empty machine.

    Both models have the friction laws of `identified`. Raises ValueError, in a sentence, as `identify`.

    identified: tares identified with the standard tool
    standard, other: model with the standard tool and with the other tool
    refuse: as in `identify`
    """
    evidence = [empty_history(other.machine)]
    whole = observed_factors(other, recorded_history(other, segments, evidence))
    factors = chosen(whole, list(range(len(other.parameters))))
    seconds = usable_seconds(other, factors)
    sentence = refusal_sentence(other, whole, evidence[0]) if refuse else None
    if sentence is not None:
        raise ValueError(sentence)
    prior = attachment_prior(identified, standard, other)
    fit = least_squares(factors, row_noise(factors, prior), prior)
    measured = np.sum(factors.samples, axis=0) > 0
    tares = identified._replace(
        values=fit.values,
        covariance=extrapolated_covariance(other, fit.covariance),
        row_error=np.where(measured, np.maximum(fit.row_error, 1e-3 * identified.row_error), identified.row_error),
    )
    return Identification(
        model=other,
        tares=tares,
        fit=fit,
        not_identified=tuple(p.name for p, ok in zip(other.parameters, fit.excited, strict=True) if not ok),
        seconds=seconds,
        held_out={},
        violations=(),
        explained=quality(other, factors, fit.values, fit.covariance).explained,
        warnings=(),
    )
