"""Layers that decide: from hypotheses with their evidence to probabilities of "no gap", of every effect at its place,
and of "unknown"."""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from layers.bayes import Case, Hypothesis
from layers.discrepancy import APART, LEVELS, SCALES, TAIL, Moments, Noise, log_prior
from layers.statistics import Column

Array = NDArray[np.float64]
Key = tuple[str, str]  # name and place; ("", "") is no gap, ("unknown", "") anything that the library lacks
NOTHING, UNKNOWN = ("", ""), ("unknown", "")
IN_ORDER, ODD = 0.5, 0.1  # prior probability of a machine in order, and of what the library lacks; the rest: an effect
SECOND = 0.1  # prior probability of one more effect
CONTACT = "soil_contact"
MUCH = 1.5  # floors left by the best hypothesis: contact is asked for
HALF = 0.5  # of the gap, which an effect must explain: the most of it
LITTLE = 0.1  # of the floor's energy, beyond which there is a gap to explain
SETTLING = 4  # rounds in which the blocks with contact are found
SELDOM = 0.4  # of all blocks: contact in more of them is the machine's work, and nothing is said
MASS = 0.9  # of the credible set
RIDGE = 1.0  # precision of the calibration's coefficients, in standard deviations of its features
ROUNDS = 50  # of Newton's method


class Answer(NamedTuple):
    """Probabilities by key, and what the calibration looks at."""

    of: dict[Key, float]
    features: tuple[float, ...]

    @property
    def first(self) -> Key:
        """The likeliest."""
        return max(self.of, key=lambda k: self.of[k])

    @property
    def probability(self) -> float:
        """Of the first."""
        return self.of[self.first]

    @property
    def credible(self) -> set[Key]:
        """The smallest set with MASS of the probability."""
        found, mass = set[Key](), 0.0
        for key, p in sorted(self.of.items(), key=lambda item: -item[1]):
            found.add(key)
            mass += p
            if mass >= MASS:
                break
        return found


@dataclass(frozen=True)
class Asked:
    """What a search found: proposals, hypotheses, what is usual; the log of the probability of contact, in which share
    of the blocks it would be; the gap over the floor with nothing fitted."""

    proposals: tuple[Column, ...]
    hypotheses: tuple[Hypothesis, ...]
    usual: Noise
    contact: float
    busy: float
    rest: float
    gap: float

    @classmethod
    def of(cls, case: Case, moments: Moments | None = None) -> "Asked":
        """Search a recording as one in the air and, if much is left, once with forces at the teeth."""
        found = case.searched(range(len(case.scene.proposals)))
        gap, contact, busy, rest = case.rest(np.append(-case.mean, 1.0)), -np.inf, 0.0, 1.0
        if min(h.rest for h in found) > MUCH and moments:
            contact, busy, rest = _touched(case, moments)
        return cls(case.scene.proposals, tuple(found), case.usual, contact, busy, rest, gap)

    @cached_property
    def none(self) -> Hypothesis:
        """Nothing but what is usual."""
        return next(h for h in self.hypotheses if not h.which)

    def key(self, which: int) -> Key:
        """Name and place of a proposal; all unknown torques are one."""
        p = self.proposals[which]
        return UNKNOWN if p.name == UNKNOWN[0] else (p.name, p.at)

    def main(self, h: Hypothesis) -> Key:
        """Of several effects the one without which most is lost."""
        alone = {g.which: g.log for g in self.hypotheses}
        others = {p: max((alone.get(tuple(x for x in h.which if x != p), -np.inf),)) for p in h.which}
        return self.key(min(h.which, key=lambda p: others[p]))

    @cached_property
    def prior(self) -> dict[int, float]:
        """Log of the prior probability of each proposal: alike for all names, for all places and forms of a name."""
        names = {p.name for p in self.proposals if p.name != UNKNOWN[0]} | {CONTACT}
        found = {}
        for k, p in enumerate(self.proposals):
            places = len({q.at for q in self.proposals if q.name == p.name})
            forms = sum((q.name, q.at) == (p.name, p.at) for q in self.proposals)
            whole = ODD if p.name == UNKNOWN[0] else (1.0 - IN_ORDER - ODD) / len(names)
            found[k] = float(np.log(whole / (places * forms)))
        return found

    def prior_of(self, h: Hypothesis) -> float:
        """Log of the prior probability of a hypothesis."""
        if not h.which:
            return float(np.log(IN_ORDER))
        return sum(self.prior[p] for p in h.which) + (len(h.which) - 1) * float(np.log(SECOND))

    def explained(self, h: Hypothesis) -> float:
        """The share of the gap's energy beyond the floor that a hypothesis explains; 1 of none."""
        return self.share(h.rest) if h.which else 1.0

    def share(self, rest: float) -> float:
        """The same of what would be left, of the floor; 1 where there is no gap."""
        gap = self.gap**2 - 1.0
        return 1.0 - max(rest**2 - 1.0, 0.0) / gap if gap > LITTLE else 1.0

    def usually(self, noise: Noise) -> float:
        """How probable it is that discrepancy and noise are what is usual, not out of the tail."""
        found = 1.0
        for r in range(len(noise.rho)):
            flat = np.log(TAIL) - np.log(np.log(LEVELS[-1] / LEVELS[0]) * np.log(SCALES[-1] / SCALES[0]))
            found *= 1.0 - float(np.exp(flat - log_prior(noise.rho[r], noise.v[r], self.usual, r)))
        return found


def _touched(case: Case, moments: Moments) -> tuple[float, float, float]:
    """Log of the probability that nothing but forces at the teeth happens, in the blocks where it is most probable,
    the share of these, and what is left, of the floor."""
    noise, left = case.usual, np.append(-case.mean, 1.0)
    log, rest, where = -np.inf, np.inf, moments.happening(left, noise)
    for _ in range(SETTLING):
        teeth = replace(case, moments=moments.only(where))
        found = teeth.hypothesis((), noise)
        log, noise = found.log + moments.prior(where), found.noise
        left = teeth.under((), teeth.state(noise))[2]
        rest, again = teeth.rest(left, noise), moments.happening(left, noise)
        if np.array_equal(again, where):
            break
        where = again
    return log, float(np.mean(where)), rest


def largest_evidence(asked: Asked) -> Answer:
    """The single effect with the most evidence, if it has any; sure of itself."""
    best = max(asked.hypotheses, key=lambda h: h.log if len(h.which) < 2 else -np.inf)
    return Answer({asked.key(best.which[0]) if best.which else NOTHING: 1.0}, ())


def selected(asked: Asked) -> Answer:
    """Bayes' rule over all hypotheses; what of a hypothesis is out of the noise's tail is unknown, and so is one that
    leaves most of the gap."""
    logs = np.array([h.log + asked.prior_of(h) for h in asked.hypotheses])
    names = len({p.name for p in asked.proposals})
    contact = asked.contact + float(np.log((1.0 - IN_ORDER - ODD) / names))
    top = max(float(np.max(logs)), contact)
    weights, found = np.exp(logs - top), dict[Key, float]()
    for h, weight in zip(asked.hypotheses, weights.tolist(), strict=True):
        usual = asked.usually(h.noise) * float(asked.explained(h) >= HALF)
        key = asked.main(h) if h.which else NOTHING
        found[key] = found.get(key, 0.0) + weight * usual
        found[UNKNOWN] = found.get(UNKNOWN, 0.0) + weight * (1.0 - usual)
    named = asked.busy <= SELDOM and asked.share(asked.rest) >= HALF
    touching = (CONTACT, "bucket") if named else UNKNOWN
    found[touching] = found.get(touching, 0.0) + float(np.exp(contact - top))
    whole = sum(found.values())
    found = {k: p / whole for k, p in found.items()}
    return Answer(found, _features(asked, found))


def _features(asked: Asked, found: dict[Key, float]) -> tuple[float, ...]:
    """Log odds of the first against the second, log gap, share of the gap's energy that the best hypothesis explains
    beyond the usual, change of the discrepancy under it, what it leaves; whether the first is an effect."""
    each = sorted(found.values(), reverse=True)
    best = max(asked.hypotheses, key=lambda h: h.log + asked.prior_of(h))
    odds = np.log(max(each[0], 1e-12) / max(each[1] if len(each) > 1 else 0.0, 1e-12))
    change = float(np.max(np.abs(np.log(best.noise.rho / asked.usual.rho)))) / APART[0]
    first = max(found, key=lambda k: found[k])
    effect = float(first not in {NOTHING, UNKNOWN})
    lead = (best.log - asked.none.log) / 50.0
    return (
        min(odds, 12.0),
        float(np.log(asked.gap)),
        max(asked.explained(best), -1.0),
        change,
        effect,
        min(lead, 4.0),
    )


def calibrated(told: Sequence[tuple[Answer, bool, Hashable]], fitted: Sequence[bool]) -> list[Answer]:
    """The answers with the first's probability from a logistic regression on the features, fitted to those cases of all
    other groups (machines) that may be `fitted`."""
    features = np.array([a.features for a, *_ in told])
    right, may = np.array([float(r) for _, r, _ in told]), np.array(fitted)
    found = []
    for (answer, _, group), own in zip(told, features, strict=True):
        others = may & np.array([g != group for *_, g in told])
        p = _logistic(features[others], right[others])(own)
        rest = 1.0 - answer.probability
        scaled = {k: v * (1.0 - p) / rest if rest > 1e-12 else 0.0 for k, v in answer.of.items()}
        found.append(answer._replace(of=scaled | {answer.first: p}))
    return found


class _Fitted(NamedTuple):
    mean: Array
    scale: Array
    weights: Array

    def __call__(self, x: Array) -> float:
        each = np.append((x - self.mean) / self.scale, 1.0)
        return float(1.0 / (1.0 + np.exp(-each @ self.weights)))


def _logistic(features: Array, right: Array) -> _Fitted:
    """Ridge logistic regression by Newton's method."""
    mean, scale = features.mean(axis=0), features.std(axis=0) + 1e-9
    x = np.column_stack([(features - mean) / scale, np.ones(len(features))])
    ridge = np.diag(np.append(np.full(features.shape[1], RIDGE), 1e-3))
    weights = np.zeros(x.shape[1])
    for _ in range(ROUNDS):
        p = 1.0 / (1.0 + np.exp(-x @ weights))
        gradient = x.T @ (right - p) - ridge @ weights
        weights += np.linalg.solve((x * (p * (1.0 - p))[:, None]).T @ x + ridge, gradient)
    return _Fitted(mean, scale, weights)
