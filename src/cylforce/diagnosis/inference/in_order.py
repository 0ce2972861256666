"""The machine in order, as its references show it: its parameters, its noise, how much it differs from one recording to
the next."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cylforce.diagnosis.columns.statistics import SMOOTH
from cylforce.diagnosis.inference.discrepancy import Scatter, Sums, allowed, settled_noise, together
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.inference.sizes import Terms
from cylforce.diagnosis.numbers import FROM_START_TO_START, RUN_TO_RUN, UNSEEN, UNSURE, USUALLY
from cylforce.signals.estimate import Array

LEAST = 1e-6  # information beside a prior of one: less is rounding
FEWEST = 3  # references, from which on everyday differences are learnt
TIMES = (1.0, 2.0, 4.0, 8.0)  # the stated differences: a factor of two is one standard deviation of what is stated


@dataclass(frozen=True)
class InOrder:
    """A machine as its references show it; `everyday`: how large an everyday difference is, of an effect's least
    plausible size; `identified` (P, P): without references, covariance of the parameters by the identification, in
    units of the prior spread."""

    scene: Terms
    references: tuple[Sums, ...]
    everyday: Mapping[str, float]
    joints: int = 0
    identified: Array | None = None

    @cached_property
    def _all(self) -> Sums:
        return together(self.references)

    @cached_property
    def fit(self) -> tuple[Scatter, Array, Array]:
        """Noise, mean (K,) and covariance (K, K)."""
        if not self.references:
            return self._unseen()
        size, shown = len(self.scene.spread), self._all
        precision = (self.scene.always / self.scene.spread) ** -2.0
        noise = Scatter(np.full(len(shown.rows), 1.0), np.full(len(shown.rows), 1.0))
        mean, covariance = np.zeros(size), np.zeros((size, size))
        energies = np.zeros(len(shown.rows)), np.zeros((len(shown.rows), SMOOTH))
        for _ in range(6):
            told, (common, vague) = shown.information(noise), shown.common(noise)
            covariance, mean = _posterior(told[:-1, :-1], told[:-1, -1] - common, vague, precision)
            energies = shown.energies(np.append(-mean, 1.0), covariance)
            noise = _where_shown(settled_noise(shown, energies, None), shown.rows)
        level = np.where(shown.rows > 0.0, allowed(shown, *energies), noise.rho)
        return noise._replace(rho=level), mean, covariance

    def _unseen(self) -> tuple[Scatter, Array, Array]:
        """The same without references: parameters as they were identified, no effects, the noise told by the floor."""
        size, joints = len(self.scene.spread), self.joints
        known = np.where(np.arange(size) < self.scene.first, (self.scene.always / self.scene.spread) ** 2, 0.0)
        covariance = np.diag(known)
        if self.identified is not None:
            count = len(self.identified)
            covariance[:count, :count] = self.identified
        return Scatter(np.full(joints, UNSEEN), np.ones(joints), UNSURE), np.zeros(size), covariance

    def with_everyday(self, everyday: Mapping[str, float]) -> "InOrder":
        """The same machine with other everyday differences; its references are not fitted again."""
        found = replace(self, everyday=everyday)
        found.__dict__["fit"] = self.fit
        return found

    @property
    def noise(self) -> Scatter:
        """As the references show it."""
        return self.fit[0]

    @property
    def covariance(self) -> Array:
        """Of all columns (K, K), as the references tell them."""
        return self.fit[2]

    @property
    def left(self) -> Array:
        """What the fit leaves of the references at each joint (R,), of the floor (rms)."""
        coefficients = np.append(-self.fit[1], 1.0)
        energy = np.einsum("i,rij,j->r", coefficients, self._all.whole, coefficients)
        return np.asarray(np.sqrt(np.maximum(energy, 0.0) / np.maximum(self._all.rows, 1.0)))

    @cached_property
    def usual(self) -> Array:
        """Everyday differences (K,), standard deviations in units of the prior spread: as stated, times what makes each
        reference most probable by the others; first of what differs from run to run, then of all."""
        found = self._stated
        if len(self.references) < FEWEST:
            return found
        own, rest = np.zeros(len(found), dtype=np.bool_), np.ones(len(found), dtype=np.bool_)
        own[[k for p in self.scene.forms if p.name in RUN_TO_RUN for k in p.columns]] = True
        rest[[k for p in self.scene.forms if p.name in FROM_START_TO_START for k in p.columns]] = False
        for which in (own, rest & ~own):
            log = [self._probable(np.where(which, times * found, found)) - 0.5 * np.log2(times) ** 2 for times in TIMES]
            found = np.where(which, TIMES[int(np.argmax(log))] * found, found)
        return found

    def _probable(self, usual: Array) -> float:
        """The log of the probability of each reference by the others, summed, with everyday differences (K,)."""
        log = 0.0
        for each, (noise, mean, covariance) in zip(self.references, self._others, strict=True):
            case = Inference(self.scene, each, noise, mean, covariance, usual)
            log += case.hypothesis((), noise).log
        return log

    @cached_property
    def _others(self) -> list[tuple[Scatter, Array, Array]]:
        """Noise, mean and covariance by all references but each."""
        kept = range(len(self.references))
        return [replace(self, references=tuple(self.references[i] for i in kept if i != k)).fit for k in kept]

    @cached_property
    def _stated(self) -> Array:
        """As stated, and the share of what the references show by which a law is only approximate."""
        found, shown = np.zeros(len(self.scene.spread)), np.abs(self.fit[1])
        for p in self.scene.forms:
            own = list(p.columns)
            least = self.everyday.get(p.name, USUALLY) * p.low / self.scene.spread[own[0]]
            found[own] = np.hypot(least, p.form * shown[own])
        return found

    def asked(self, recording: Sums) -> "Inference":
        """The question put to a recording."""
        noise, mean, covariance = self.fit
        case = Inference(self.scene, recording, noise, mean, covariance, self.usual)
        return case.unsure(self._impossible(mean))

    def _impossible(self, mean: Array) -> list[list[int]]:
        """Columns of every error of readings or geometry, at its place, that the references show (K,) with a sign it
        cannot have, such as a sensor that is early: they show it for something else, such as a law of friction that
        nobody wrote, and another motion or a load may not show it."""
        found: dict[tuple[str, str, int], set[int]] = {}
        for form in self.scene.forms:
            if form.reads and form.sign:
                found.setdefault((form.name, form.at, form.sign), set()).update(form.columns)
        sizes = self.scene.spread * mean
        return [sorted(own) for (*_, sign), own in found.items() if sign * np.sum(sizes[list(own)]) < 0.0]


def _where_shown(noise: Scatter, rows: Array) -> Scatter:
    """The noise, of joints (R,) that no reference moves what is usual without references."""
    shown = rows > 0.0
    found = (np.where(shown, noise.rho, UNSEEN), np.where(shown, noise.v, 1.0))
    return Scatter(*found, np.where(shown, 1.0, UNSURE))


def _posterior(information: Array, score: Array, vague: Array, precision: Array) -> tuple[Array, Array]:
    """Covariance (K, K) and mean (K,) of sizes with a prior precision (K,), whose score is uncertain beyond the noise
    by samples `vague` (S, K), V in all: it tells I (I + V)^-1 I of them. In units of the prior, by I's square root."""
    unit = precision**-0.5
    values, vectors = np.linalg.eigh(information * np.outer(unit, unit))
    root = np.sqrt(np.maximum(values, 0.0))
    back = np.where(values > LEAST, 1.0 / np.maximum(root, LEAST), 0.0)
    unsure = (vague * unit) @ vectors * back
    less = np.linalg.inv(np.eye(len(unit)) + unsure.T @ unsure)
    known = vectors * root
    covariance = np.linalg.inv(np.eye(len(unit)) + known @ less @ known.T)
    mean = covariance @ (known @ (less @ (back * (vectors.T @ (score * unit)))))
    return np.asarray(covariance * np.outer(unit, unit)), np.asarray(mean * unit)
