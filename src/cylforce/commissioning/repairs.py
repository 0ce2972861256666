"""Which single correction of the machine file, or of the wiring, would make a recording fit: each is tried on the last
samples of the recording, and ranked by what it leaves unexplained and by how far its parameters lie from the data
sheet."""

from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import fields, replace
from functools import partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy import optimize

from cylforce.commissioning.explained import unseen
from cylforce.commissioning.wiring import PLACES, PRESSURES, SHORT_S, Exchange, exchanges, swapped
from cylforce.estimation.batch import least_squares
from cylforce.estimation.blocks import chosen, residual_squares
from cylforce.estimation.model import Model
from cylforce.estimation.observation import observed_factors
from cylforce.mechanics.linkages import FourBar, Linkage, Triangle
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

TYPICAL = 0.01  # of a joint's torque (rms): what machines in order leave unexplained
BETTER = 0.25  # of the misfit of the file as it is that a correction may leave to be named
ALIKE = 2.0  # times the misfit of the best correction: others within it are named, too
AS_MANY = 0.8  # of the usable samples that a correction must keep
MOST = 3  # corrections that are named
BORES, LENGTHS = (0.7, 1.4), (0.7, 1.4)  # times what the file says: range in which a bore or length is searched
OFFSETS = np.radians(45.0)  # range in which a zero of an angle is searched
STEPS = 10  # of such a search
HOPELESS = 1e12  # misfit that stands for infinite in a search
ANGLES = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)


class Case(NamedTuple):
    """What may be wrong: a model and samples (T, S)."""

    model: Model
    values: Array


class Repair(NamedTuple):
    """A correction in words, and its `misfit` (`misfit_of`)."""

    words: str
    misfit: float


class SizeSearch(NamedTuple):
    """A correction whose size is searched within `limits`: the case so `changed`, and the correction in words."""

    limits: tuple[float, float]
    changed: Callable[[float], Case]
    words: Callable[[float], str]


def repairs(case: Case, cylinders: Collection[int]) -> tuple[Repair, ...]:
    """The corrections of any of the `cylinders`, of angles and of lengths that make `case` fit, the best first; none
    when no single one does."""
    if len(case.values) < SHORT_S * case.model.filters.rate_hz:
        return ()
    there, samples = misfit_of(case)
    tried = [Repair(words, _kept(changed, samples)) for words, changed in _exchanged(case, cylinders)]
    good = _good(tried, there)
    if not good:
        good = _good([_searched(search, samples) for search in _searches(case, cylinders)], there)
    return tuple(found for found in good if found.misfit < ALIKE * good[0].misfit)[:MOST]


def misfit_of(case: Case) -> tuple[float, float]:
    """(misfit, number of usable samples) of a fit to the samples alone; the misfit is the mean square of what is left
    of each joint's torque in units of TYPICAL of it, plus the squared distance from the data sheet per base parameter,
    in its variances: about 1 for a machine in order."""
    model, size = case.model, 3 * case.model.machine.size
    try:
        fitted = chosen(observed_factors(model, [case.values]), list(range(len(model.parameters))))
    except ValueError:
        return np.inf, 0.0
    samples = np.sum(fitted.samples, axis=0)
    seen = samples > 0
    if not np.any(seen) or any(unseen(model, fitted)):
        return np.inf, float(np.sum(samples))
    torque = np.sqrt(np.sum(fitted.triangle[..., -1] ** 2, axis=(0, 2)) / np.maximum(samples, 1.0))
    error = np.maximum(TYPICAL * torque, 1.0)
    found = least_squares(fitted, error, model.prior).values
    left = np.sum(residual_squares(fitted, found), axis=0)[seen] / samples[seen] / error[seen] ** 2
    away = (found - model.prior.mean)[:size]
    distance = float(away @ np.linalg.solve(model.prior.covariance[:size, :size], away)) / size
    return float(np.mean(left)) + distance, float(np.sum(samples))


def _kept(case: Case, samples: float) -> float:
    """The misfit, infinite when too few samples are usable."""
    misfit, usable = misfit_of(case)
    return misfit if usable >= AS_MANY * samples else np.inf


def _good(tried: Iterable[Repair], there: float) -> list[Repair]:
    return sorted((t for t in tried if t.misfit < BETTER * there), key=lambda t: t.misfit)


def _exchanged(case: Case, cylinders: Collection[int]) -> Iterator[tuple[str, Case]]:
    """Corrections without a size: sensors exchanged, pins mirrored, angles counted the other way."""
    model, values = case
    signals = model.machine.signals
    for pair in (*exchanges(model.machine), *_single_pressures(model.machine)):
        if any(signals[k].kind in PLACES or signals[k].index in cylinders for k in pair[0] + pair[1]):
            first, second = (" and ".join(signals[k].name for k in part) for part in pair)
            yield f"{first} exchanged with {second}", Case(model, swapped(values, pair))
    for c in cylinders:
        cylinder = model.machine.cylinders[c]
        for words, linkage in _mirrored(cylinder.linkage):
            yield f"{words} of the {cylinder.name} cylinder changed", _linked(case, c, linkage)
    for k, signal in enumerate(model.machine.signals):
        if signal.kind in ANGLES:
            link = model.machine.links[signal.index]
            for about in (0.0, link.angle_low + link.angle_high):
                yield f"the other sign of {signal.name}", Case(model, _turned(values, k, about, -1.0))


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
        words = _percent(f"bore_mm of {model.machine.cylinders[c].name}")
        yield SizeSearch(BORES, partial(_bored, case, c), words)
    for k, signal in enumerate(model.machine.signals):
        if signal.kind in ANGLES:
            yield SizeSearch((-OFFSETS, OFFSETS), partial(_moved, case, k), _degrees(signal.name))
    for j, link in enumerate(model.machine.links[:-1]):
        yield SizeSearch(LENGTHS, partial(_lengthened, case, j), _percent(f"length_m of {link.name}"))


def _moved(case: Case, k: int, by: float) -> Case:
    return Case(case.model, _turned(case.values, k, by, 1.0))


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


def _searched(search: SizeSearch, samples: float) -> Repair:
    def misfit(size: float) -> float:
        return min(_kept(search.changed(size), samples), HOPELESS)

    found = optimize.minimize_scalar(misfit, bounds=search.limits, method="bounded", options={"maxiter": STEPS})
    return Repair(search.words(float(found.x)), float(found.fun))


def _percent(name: str) -> Callable[[float], str]:
    return lambda f: f"{name} {100.0 * abs(f - 1.0):.0f} % {'larger' if f > 1.0 else 'smaller'}"


def _degrees(name: str) -> Callable[[float], str]:
    return lambda d: f"the zero of {name} moved by {np.degrees(d):+.0f} deg"


def _turned(values: Array, k: int, about: float, sign: float) -> Array:
    """Samples with signal `k` replaced by about + sign * signal."""
    changed = values.copy()
    changed[:, k] = about + sign * values[:, k]
    return changed
