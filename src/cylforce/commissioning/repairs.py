"""Find the single correction of the machine file, or of the wiring, that makes a recording fit.

Each correction is tried on the last samples of the recording. They are ranked by the Bayesian information criterion
(`explained.criterion`).
"""

from collections.abc import Callable, Collection, Iterator
from dataclasses import fields, replace
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from cylforce.commissioning.common_scale import common_scale, rescaled
from cylforce.commissioning.emptiness import FITTING, load_or_contact
from cylforce.commissioning.explained import FAR, criterion, quality, row_noise, unseen
from cylforce.commissioning.wiring import PLACES, PRESSURES, SHORT_S, Exchange, exchanges, misfit, swapped
from cylforce.estimation.batch import converged, least_squares
from cylforce.estimation.blocks import Factors, chosen, residual_squares
from cylforce.estimation.model import Model
from cylforce.estimation.observation import observed_factors
from cylforce.mechanics.linkages import FourBar, Linkage, Triangle
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.unwrapping import Unwrapping
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

TYPICAL = 0.01  # unexplained share (rms) of a joint's torque on a healthy machine, from tools/studies/unexplained.py
# Difference of the criterion beyond which an explanation is better: "very strong" evidence (Kass and Raftery 1995,
# doi:10.1080/01621459.1995.10476572).
DECISIVE = 10.0
MOST = 3  # corrections that are named; chosen
BORES, LENGTHS = (0.7, 1.4), (0.7, 1.4)  # range in which a bore or length is searched, times the file's value; chosen
OFFSETS = np.radians(45.0)  # rad, range in which a zero of an angle is searched; chosen
STEPS = 10  # steps of such a search; chosen
HOPELESS = 1e12  # criterion that stands for infinite in a search
ANGLES = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
SCALE = "scale"  # cause: the common scale of all measured forces


class Case(NamedTuple):
    """A model and the recording that it should explain.

    model: model of the empty machine, perhaps wrong
    values: (T, S) samples [SI]
    """

    model: Model
    values: Array


class Repair(NamedTuple):
    """A correction that was tried.

    cause: short name, as in `wiring.Suspicion`
    words: the correction in words
    score: criterion of the fit after it (`explained.criterion`); the smaller, the better
    case: the case so corrected
    """

    cause: str
    words: str
    score: float
    case: Case


class SizeSearch(NamedTuple):
    """A correction whose size is searched.

    cause: short name, as in `wiring.Suspicion`
    limits: range of the size: a factor on the file's value, or an angle [rad]
    changed: function of the size that returns the corrected case
    words: function of the size that returns the correction in words
    """

    cause: str
    limits: tuple[float, float]
    changed: Callable[[float], Case]
    words: Callable[[float], str]


def repairs(case: Case, cylinders: Collection[int]) -> tuple[Repair, ...]:
    """Return the single corrections with which a case is healthy: the best one, then those that are not decisively
    worse.

    Corrections of some cylinders (bore, pins, exchanged pressures), of all position sensors, of all links' lengths and
    of the common scale are tried. The result is empty when the case has too few samples (SHORT_S), or when no healthy
    correction is decisively better than none.

    cylinders: numbers of these cylinders
    """
    if len(case.values) < SHORT_S * case.model.filters.rate_hz:
        return ()
    tried = [Repair(words, words, case_score(changed), changed) for words, changed in _exchanged(case, cylinders)]
    tried += [_searched(search) for search in _searches(case, cylinders)]
    tried += _rescaled(case)
    uncorrected = min(case_score(case), HOPELESS)
    ranked = sorted((t for t in tried if t.score < uncorrected - DECISIVE), key=lambda t: t.score)
    good: list[Repair] = []
    for repair in ranked:
        if len(good) == MOST or (good and repair.score > good[0].score + DECISIVE):
            break
        good += [repair] if is_healthy(repair.case) else []
    return tuple(good)


def case_score(case: Case, added: int = 0) -> float:
    """Return the information criterion of a fit of the empty machine to the samples; the smaller, the better.

    It is `explained.criterion`, infinite when a joint that moved is never usable.

    added: number of sizes that were searched
    """
    model, fitted = case.model, _factors(case)
    if fitted is None or not np.any(fitted.samples) or any(unseen(model, fitted)):
        return np.inf
    values = converged(fitted, typical_error(fitted), model.prior).values
    return criterion(model, fitted, np.sum(residual_squares(fitted, values), axis=0), values, added)


def typical_error(fitted: Factors) -> Array:
    """Return the residual torque (R,) [N m] of each joint on a healthy machine: the share TYPICAL of the joint's rms
    torque, at least 1 N m.

    fitted: factors of the recording
    """
    squares, samples = np.sum(fitted.triangle[..., -1] ** 2, axis=(0, 2)), np.sum(fitted.samples, axis=0)
    return np.asarray(np.maximum(TYPICAL * np.sqrt(squares / np.maximum(samples, 1.0)), 1.0))


def is_healthy(case: Case) -> bool:
    """Return whether the samples alone are those of a healthy machine, empty and clear of the ground."""
    model = case.model
    whole = observed_factors(model, [case.values])
    fitted = chosen(whole, list(range(len(model.parameters))))
    noise = row_noise(fitted, model.prior)
    fit = least_squares(fitted, noise, model.prior)
    fits = misfit(fitted, fit.row_error) < FITTING
    near = quality(model, fitted, fit.values, fit.covariance).distance < FAR
    return bool(fits and near and load_or_contact(model, whole, noise, fit) is None)


def _factors(case: Case) -> Factors | None:
    """Return the factors of the model's columns without sensor noise; None where no row can be computed."""
    try:
        whole = observed_factors(case.model, [case.values], noisy=False)
    except ValueError:
        return None
    return chosen(whole, list(range(len(case.model.parameters))))


def _exchanged(case: Case, cylinders: Collection[int]) -> Iterator[tuple[str, Case]]:
    """Yield corrections without a size, in words and applied: sensors exchanged, pins mirrored, signs of angles
    changed.

    cylinders: numbers of the cylinders whose pressures and pins are tried; position sensors are tried at all joints
    """
    model, values = case.model, case.values
    signals = model.machine.signals
    for pair in (*exchanges(model.machine), *_single_pressures(model.machine)):
        if any(signals[k].kind in PLACES or signals[k].index in cylinders for k in pair[0] + pair[1]):
            first, second = (" and ".join(signals[k].name for k in part) for part in pair)
            yield f"{first} exchanged with {second}", _read_anew(model, swapped(values, pair))
    for c in cylinders:
        cylinder = model.machine.cylinders[c]
        for words, linkage in _mirrored(cylinder.linkage):
            yield f"{words} of the {cylinder.name} cylinder changed", _linked(case, c, linkage)
    for k, signal in enumerate(model.machine.signals):
        if signal.kind in ANGLES:
            link = model.machine.links[signal.index]
            for about in (0.0, link.angle_low + link.angle_high):
                yield f"the other sign of {signal.name}", _read_anew(model, _turned(values, k, about, -1.0))


def _single_pressures(machine: Machine) -> Iterator[Exchange]:
    """Yield the exchanges of the same side of two cylinders."""
    for kind in PRESSURES:
        places = [k for k, s in enumerate(machine.signals) if s.kind is kind]
        yield from (((a,), (b,)) for a, b in combinations(places, 2))


def _mirrored(linkage: Linkage) -> Iterator[tuple[str, Linkage]]:
    """Yield corrections in words, each with the corrected linkage: one pin mirrored, or the side of a four-bar changed.

    A pin is mirrored in the x or in the z axis of its body.
    """
    if not isinstance(linkage, Triangle | FourBar):
        return
    for name in (f.name for f in fields(linkage) if isinstance(getattr(linkage, f.name), tuple)):
        body, at = getattr(linkage, name)
        for axis, mirrored in (("z", at.conjugate()), ("x", -at.conjugate())):
            changes: dict[str, Any] = {name: (body, mirrored)}
            yield f"the sign of {axis} in {name} at_m", replace(linkage, **changes)
    if isinstance(linkage, FourBar):
        yield "the side", replace(linkage, side=-linkage.side)


def _searches(case: Case, cylinders: Collection[int]) -> Iterator[SizeSearch]:
    """Yield the corrections with a size: bores, zeros of all angle sensors, lengths of all links but the last.

    cylinders: numbers of the cylinders whose bores are tried
    """
    model = case.model
    for c in cylinders:
        name = f"bore_mm of {model.machine.cylinders[c].name}"
        yield SizeSearch(name, BORES, partial(_bored, case, c), _percent(name))
    for k, signal in enumerate(model.machine.signals):
        if signal.kind in ANGLES:
            name = f"the zero of {signal.name}"
            yield SizeSearch(name, (-OFFSETS, OFFSETS), partial(_moved, case, k), _degrees(name))
    for j, link in enumerate(model.machine.links[:-1]):
        name = f"length_m of {link.name}"
        yield SizeSearch(name, LENGTHS, partial(_lengthened, case, j), _percent(name))


def _read_anew(model: Model, values: Array) -> Case:
    """Return a case with other readings (T, S) [SI], their angles unwrapped within the ranges of the joints."""
    return Case(model, Unwrapping(model.machine).of(values))


def _rescaled(case: Case) -> list[Repair]:
    """Return the correction of the common scale of all pressures; empty where the data sheet allows that they are
    right.
    """
    fitted = _factors(case)
    if fitted is None or not np.any(fitted.samples):
        return []
    scale = common_scale(case.model, fitted, typical_error(fitted))
    if not scale.is_wrong or scale.factor <= 0.0:
        return []
    changed = Case(case.model, rescaled(case.model, case.values, scale.factor))
    return [Repair(SCALE, f"all pressures corrected, which are {scale.words}", case_score(changed, 1), changed)]


def _moved(case: Case, k: int, by: float) -> Case:
    """Return the case with the zero of angle signal k moved `by` an angle [rad]."""
    return _read_anew(case.model, _turned(case.values, k, by, 1.0))


def _bored(case: Case, c: int, factor: float) -> Case:
    """Return the case with another bore of cylinder c, times the file's, and the rod unchanged."""
    cylinders = list(case.model.machine.cylinders)
    head, rod = cylinders[c].area_head * factor**2, cylinders[c].area_head - cylinders[c].area_rod
    cylinders[c] = replace(cylinders[c], area_head=head, area_rod=head - rod)
    return _with_machine(case, replace(case.model.machine, cylinders=tuple(cylinders)))


def _lengthened(case: Case, j: int, factor: float) -> Case:
    """Return the case with another length of link j, times the file's."""
    links = list(case.model.machine.links)
    links[j] = replace(links[j], length=links[j].length * factor)
    return _with_machine(case, replace(case.model.machine, links=tuple(links)))


def _linked(case: Case, c: int, linkage: Linkage) -> Case:
    """Return the case with another linkage of cylinder c."""
    cylinders = list(case.model.machine.cylinders)
    cylinders[c] = replace(cylinders[c], linkage=linkage)
    return _with_machine(case, replace(case.model.machine, cylinders=tuple(cylinders)))


def _with_machine(case: Case, machine: Machine) -> Case:
    """Return the case with another machine, of the same filters and friction laws."""
    return Case(Model(machine, case.model.filters, case.model.friction), case.values)


def _searched(search: SizeSearch) -> Repair:
    """Return the correction with the best size within its limits."""
    from scipy import optimize

    def score(size: float) -> float:
        """Return the information criterion for a size, finite also where the case cannot be computed."""
        return min(case_score(search.changed(size), 1), HOPELESS)

    optimum = optimize.minimize_scalar(score, bounds=search.limits, method="bounded", options={"maxiter": STEPS})
    size = float(optimum.x)
    return Repair(search.cause, search.words(size), float(optimum.fun), search.changed(size))


def _percent(name: str) -> Callable[[float], str]:
    """Return a function that words a factor as the per cent by which a figure becomes larger or smaller."""
    return lambda factor: f"{name} {100.0 * abs(factor - 1.0):.0f} % {'larger' if factor > 1.0 else 'smaller'}"


def _degrees(name: str) -> Callable[[float], str]:
    """Return a function that words an angle [rad] as the degrees by which a zero moves."""
    return lambda angle: f"{name} moved by {np.degrees(angle):+.0f} deg"


def _turned(values: Array, k: int, about: float, sign: float) -> Array:
    """Return samples (T, S) with angle signal k replaced by about + sign * signal; `about`: angle [rad]."""
    changed = values.copy()
    changed[:, k] = about + sign * values[:, k]
    return changed
