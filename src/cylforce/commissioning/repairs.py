"""Which single correction of the machine file, or of the wiring, would make a recording fit: each is tried on the last
samples of the recording, and ranked by the Bayesian information criterion (`explained.criterion`)."""

from collections.abc import Callable, Collection, Iterator
from dataclasses import fields, replace
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from cylforce.commissioning.common_scale import common_scale, rescaled
from cylforce.commissioning.emptiness import FITTING, not_empty
from cylforce.commissioning.explained import FAR, criterion, quality, row_noise, unseen
from cylforce.commissioning.wiring import PLACES, PRESSURES, SHORT_S, Exchange, exchanges, misfit, swapped
from cylforce.estimation.batch import least_squares
from cylforce.estimation.blocks import Factors, chosen, residual_squares
from cylforce.estimation.model import Model
from cylforce.estimation.observation import observed_factors
from cylforce.mechanics.linkages import FourBar, Linkage, Triangle
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.unwrapping import Unwrapping
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

TYPICAL = 0.01  # of a joint's torque (rms): what machines in order leave unexplained
DECISIVE = 10.0  # difference of the criterion beyond which an explanation is better: "very strong" evidence (Kass and
# Raftery 1995, doi:10.1080/01621459.1995.10476572)
MOST = 3  # corrections that are named
BORES, LENGTHS = (0.7, 1.4), (0.7, 1.4)  # times what the file says: range in which a bore or length is searched
OFFSETS = np.radians(45.0)  # range in which a zero of an angle is searched
STEPS = 10  # of such a search
HOPELESS = 1e12  # criterion that stands for infinite in a search
ANGLES = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
SCALE = "scale"  # cause: the common scale of all measured forces


class Case(NamedTuple):
    """What may be wrong: a model and samples (T, S)."""

    model: Model
    values: Array


class Repair(NamedTuple):
    """A correction: its `cause` as in `wiring.Suspicion`, its `words`, its `score` (`explained.criterion`), and the
    `case` so corrected."""

    cause: str
    words: str
    score: float
    case: Case


class SizeSearch(NamedTuple):
    """A correction whose size is searched within `limits`: its `cause`, the case so `changed`, and the correction in
    words."""

    cause: str
    limits: tuple[float, float]
    changed: Callable[[float], Case]
    words: Callable[[float], str]


def repairs(case: Case, cylinders: Collection[int]) -> tuple[Repair, ...]:
    """The corrections of any of the `cylinders`, of angles and of lengths with which `case` is in order: the best one,
    then those that are not decisively worse. None when no single one is decisively better than the case as it is."""
    if len(case.values) < SHORT_S * case.model.filters.rate_hz:
        return ()
    tried = [Repair(words, words, score_of(changed), changed) for words, changed in _exchanged(case, cylinders)]
    tried += [_searched(search) for search in _searches(case, cylinders)]
    tried += _rescaled(case)
    there = min(score_of(case), HOPELESS)
    ranked = sorted((t for t in tried if t.score < there - DECISIVE), key=lambda t: t.score)
    good: list[Repair] = []
    for found in ranked:
        if len(good) == MOST or (good and found.score > good[0].score + DECISIVE):
            break
        good += [found] if in_order(found.case) else []
    return tuple(good)


def score_of(case: Case, added: int = 0) -> float:
    """The criterion of a fit of the empty machine to the samples, with `added` sizes that were searched; infinite when
    a joint that moved is never seen."""
    model, fitted = case.model, _factors(case)
    if fitted is None or not np.any(fitted.samples) or any(unseen(model, fitted)):
        return np.inf
    found = least_squares(fitted, typical_error(fitted), model.prior).values
    return criterion(model, fitted, np.sum(residual_squares(fitted, found), axis=0), found, added)


def typical_error(fitted: Factors) -> Array:
    """What machines in order leave unexplained of each joint's torque (R,) [N m]."""
    squares, samples = np.sum(fitted.triangle[..., -1] ** 2, axis=(0, 2)), np.sum(fitted.samples, axis=0)
    return np.asarray(np.maximum(TYPICAL * np.sqrt(squares / np.maximum(samples, 1.0)), 1.0))


def in_order(case: Case) -> bool:
    """Whether the samples, by themselves, are those of a machine in order, empty and clear of the ground."""
    model = case.model
    whole = observed_factors(model, [case.values])
    fitted = chosen(whole, list(range(len(model.parameters))))
    noise = row_noise(fitted, model.prior)
    fit = least_squares(fitted, noise, model.prior)
    good = misfit(fitted, fit.row_error) < FITTING
    near = quality(model, fitted, fit.values, fit.covariance).distance < FAR
    return bool(good and near and not_empty(model, whole, noise, fit) is None)


def _factors(case: Case) -> Factors | None:
    try:
        whole = observed_factors(case.model, [case.values], noisy=False)
    except ValueError:
        return None
    return chosen(whole, list(range(len(case.model.parameters))))


def _exchanged(case: Case, cylinders: Collection[int]) -> Iterator[tuple[str, Case]]:
    """Corrections without a size: sensors exchanged, pins mirrored, angles counted the other way."""
    model, values = case
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
    """The same side of two cylinders."""
    for kind in PRESSURES:
        places = [k for k, s in enumerate(machine.signals) if s.kind is kind]
        yield from (((a,), (b,)) for a, b in combinations(places, 2))


def _mirrored(linkage: Linkage) -> Iterator[tuple[str, Linkage]]:
    """(what is corrected, the linkage so corrected)"""
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
    """Corrections with a size: bores, zeros of angles, lengths of links."""
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
    """A case with other readings, whose angles have the whole turns that the joints then allow."""
    return Case(model, Unwrapping(model.machine).of(values))


def _rescaled(case: Case) -> list[Repair]:
    """The correction of the common scale of all pressures; none where the data sheet does not exclude that they are
    right."""
    fitted = _factors(case)
    if fitted is None or not np.any(fitted.samples):
        return []
    found = common_scale(case.model, fitted, typical_error(fitted))
    if not found.is_wrong or found.factor <= 0.0:
        return []
    changed = Case(case.model, rescaled(case.model, case.values, found.factor))
    return [Repair(SCALE, f"all pressures corrected, which are {found.words}", score_of(changed, 1), changed)]


def _moved(case: Case, k: int, by: float) -> Case:
    return _read_anew(case.model, _turned(case.values, k, by, 1.0))


def _bored(case: Case, c: int, factor: float) -> Case:
    """Another bore, the rod as it is."""
    cylinders = list(case.model.machine.cylinders)
    head, rod = cylinders[c].area_head * factor**2, cylinders[c].area_head - cylinders[c].area_rod
    cylinders[c] = replace(cylinders[c], area_head=head, area_rod=head - rod)
    return _with_machine(case, replace(case.model.machine, cylinders=tuple(cylinders)))


def _lengthened(case: Case, j: int, factor: float) -> Case:
    links = list(case.model.machine.links)
    links[j] = replace(links[j], length=links[j].length * factor)
    return _with_machine(case, replace(case.model.machine, links=tuple(links)))


def _linked(case: Case, c: int, linkage: Linkage) -> Case:
    cylinders = list(case.model.machine.cylinders)
    cylinders[c] = replace(cylinders[c], linkage=linkage)
    return _with_machine(case, replace(case.model.machine, cylinders=tuple(cylinders)))


def _with_machine(case: Case, machine: Machine) -> Case:
    return Case(Model(machine, case.model.filters, case.model.friction), case.values)


def _searched(search: SizeSearch) -> Repair:
    from scipy import optimize

    def score(size: float) -> float:
        return min(score_of(search.changed(size), 1), HOPELESS)

    found = optimize.minimize_scalar(score, bounds=search.limits, method="bounded", options={"maxiter": STEPS})
    size = float(found.x)
    return Repair(search.cause, search.words(size), float(found.fun), search.changed(size))


def _percent(name: str) -> Callable[[float], str]:
    return lambda f: f"{name} {100.0 * abs(f - 1.0):.0f} % {'larger' if f > 1.0 else 'smaller'}"


def _degrees(name: str) -> Callable[[float], str]:
    return lambda d: f"{name} moved by {np.degrees(d):+.0f} deg"


def _turned(values: Array, k: int, about: float, sign: float) -> Array:
    """Samples with signal `k` replaced by about + sign * signal."""
    changed = values.copy()
    changed[:, k] = about + sign * values[:, k]
    return changed
