"""From hypotheses with their evidence to probabilities: of "no gap", of every effect at its place, of "unknown"."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.inference.discrepancy import LEVELS, SCALES, Scatter, log_prior
from cylforce.diagnosis.inference.hypotheses import Hypothesis, counted
from cylforce.diagnosis.inference.sizes import Column
from cylforce.diagnosis.numbers import HALF, IN_ORDER, LAW, MASS, ODD, SAME, SECOND, SELDOM, TAIL
from cylforce.effects.loads.tip_force import TipForce
from cylforce.signals.estimate import Array

Key = tuple[str, str]  # name and place
NOTHING, UNKNOWN = ("no_gap", ""), ("unknown", "")
CONTACT = TipForce().about.name
NONE = 1e-3  # floors, below which a gap is none at all
LEAST = 1e-300  # probability
CERTAIN = 12.0  # log odds, beyond which the calibration sees no difference
FEATURES = 10


class Happened(NamedTuple):
    """What may happen at moments: its name and place (`UNKNOWN` for a torque at one joint alone), the logarithm of its
    probability with the recording, in which share of the blocks it would be, what it leaves, of the floor, and what is
    left `before` it (None: as much as with no effect); its `usual` size in every
    block (B,), of what is usual."""

    key: Key
    log: float
    busy: float
    rest: float
    before: float | None = None
    usual: Array | None = None


class Belief(NamedTuple):
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

    def but(self, key: Key) -> "Belief":
        """The same, once it is known that it is not this."""
        others = {k: p for k, p in self.of.items() if k != key}
        whole = sum(others.values())
        return self._replace(of={k: p / whole for k, p in others.items()}) if whole > 0.0 else self

    def instead(self, key: Key) -> "Belief":
        """The same where "no gap" means that there is nothing but this."""
        of = self.of | {key: self.of.get(key, 0.0) + self.of.get(NOTHING, 0.0), NOTHING: 0.0}
        return self._replace(of=of)

    @property
    def credible(self) -> tuple[Key, ...]:
        """The smallest set with MASS of the probability, likeliest first."""
        found, mass = list[Key](), 0.0
        for key, p in sorted(self.of.items(), key=lambda item: -item[1]):
            found.append(key)
            mass += p
            if mass >= MASS:
                break
        return tuple(found)


@dataclass(frozen=True)
class Asked:
    """What a search found: forms, hypotheses, what may have happened at moments; the noise that is usual; the gap over
    the floor with nothing fitted; how many `references` there were, and how uncertain they leave the torques of the
    recording, which moves as they do or otherwise, `unsure`, of the floor; whether one effect `only` was asked; whether
    it was `loaded` with a known load; the `incident` that happens in blocks which are set aside, beside which something
    that lasts was asked."""

    forms: tuple[Column, ...]
    hypotheses: tuple[Hypothesis, ...]
    happened: tuple[Happened, ...]
    usual: Scatter
    gap: float
    references: int = 0
    unsure: float = 0.0
    only: bool = False
    loaded: bool = False
    incident: Key | None = None

    @cached_property
    def none(self) -> Hypothesis:
        """Nothing but what is usual."""
        return next(h for h in self.hypotheses if not h.which)

    def key(self, which: int) -> Key:
        """Name and place of a form; all unknown torques are one."""
        p = self.forms[which]
        return UNKNOWN if p.name == UNKNOWN[0] else (p.name, p.at)

    def keys(self, h: Hypothesis) -> frozenset[Key]:
        """Names and places of a hypothesis' forms."""
        return frozenset(self.key(p) for p in h.which)

    @cached_property
    def _best(self) -> dict[frozenset[Key], float]:
        """The largest logarithm of all hypotheses of the same effects, whatever their forms."""
        found: dict[frozenset[Key], float] = {}
        for h in self.hypotheses:
            found[self.keys(h)] = max(h.log, found.get(self.keys(h), -np.inf))
        return found

    def without(self, h: Hypothesis, key: Key) -> float:
        """The logarithm of what the other effects of a hypothesis, or some of them, explain at best."""
        others = self.keys(h) - {key}
        return max(log for some, log in self._best.items() if some <= others)

    def main(self, h: Hypothesis) -> Key:
        """Of several effects the one without which most is lost."""
        return min(self.keys(h), key=lambda k: (self.without(h, k), k))

    @cached_property
    def alone(self) -> dict[Key, tuple[float, float]]:
        """Of every effect by itself the logarithm of its most probable form, and what that leaves, of the floor."""
        found = dict[Key, tuple[float, float]]()
        each = [(self.key(h.which[0]), h.log, h.rest) for h in self.hypotheses if len(h.which) == 1]
        for key, log, rest in (*each, *((h.key, h.log, h.rest) for h in self.happened)):
            found[key] = max(found.get(key, (log, rest)), (log, rest))
        return found

    @cached_property
    def _names(self) -> int:
        return len({*(p.name for p in self.forms), *(h.key[0] for h in self.happened)} - {UNKNOWN[0]})

    @cached_property
    def prior(self) -> dict[int, float]:
        """Log of the prior probability of each form: alike for all names, for all places and forms of a name."""
        found = {}
        for k, p in enumerate(self.forms):
            places = len({q.at for q in self.forms if q.name == p.name})
            forms = sum((q.name, q.at) == (p.name, p.at) for q in self.forms)
            whole = ODD if p.name == UNKNOWN[0] else (1.0 - IN_ORDER - ODD) / self._names
            found[k] = float(np.log((0.5 if p.expected else whole / places) / forms))
        return found

    @cached_property
    def beforehand(self) -> dict[Key, float]:
        """What is believed of recordings that tell nothing: effects that were asked share theirs by their priors."""
        found = {h.key: float(np.exp(self.prior_at_moments(h))) for h in self.happened}
        for h in self.hypotheses:
            if len(h.which) == 1:
                key, log = self.key(h.which[0]), self.prior[h.which[0]]
                found[key] = found.get(key, 0.0) + float(np.exp(log))
        found.pop(UNKNOWN, None)
        whole = sum(found.values()) / (1.0 - IN_ORDER - ODD)
        return {NOTHING: IN_ORDER, UNKNOWN: ODD} | {k: p / whole for k, p in found.items()}

    def tells_nothing(self, happened: Happened) -> bool:
        """Whether it is contact most of the time, of a machine of which no reference shows more: it works."""
        return not self.references and happened.key[0] == CONTACT and happened.busy > SELDOM

    def prior_of(self, h: Hypothesis) -> float:
        """Log of the prior probability of a hypothesis."""
        if not h.which:
            return float(np.log(IN_ORDER))
        more = sum(not self.forms[p].expected for p in h.which) - 1
        return sum(self.prior[p] for p in h.which) + max(more, 0) * float(np.log(SECOND))

    def prior_at_moments(self, happened: Happened) -> float:
        """The same of what happens at moments."""
        if happened.key == UNKNOWN:
            return float(np.log(ODD / sum(h.key == UNKNOWN for h in self.happened)))
        return float(np.log((1.0 - IN_ORDER - ODD) / self._names))

    def share(self, rest: float) -> float:
        """The share of the gap's energy beyond the floor that is explained where `rest` would be left, of the floor; 1
        where that is no more than references leave of each other."""
        gap, left = self.gap**2 - 1.0, rest**2 - 1.0
        return 1.0 - left / gap if min(gap, left) > SAME else 1.0

    def slight(self, happened: Happened) -> bool:
        """Whether what may happen at moments is everyday: without it no more is left than references leave of each
        other, over the whole recording. What has a name is so only where references show what is everyday, and not
        where it alone is asked."""
        before = self.none.rest if happened.before is None else happened.before
        unnamed = happened.key == UNKNOWN
        return (unnamed or (self.references > 0 and not self.only)) and before**2 - 1.0 <= SAME

    @property
    def lasts(self) -> bool:
        """Whether something of the library that lasts is more probable than not."""
        each = zip(self.hypotheses, self.weights, strict=False)
        lasting = sum(w for h, w in each if h.which and UNKNOWN not in self.keys(h))
        return lasting > sum(self.weights) - lasting

    @property
    def beyond(self) -> float:
        """The least that is left, of the floor, without anything that would be a fault: of the gap itself, beside
        everyday differences, beside what happens everyday at moments."""
        light = (h.rest for h in self.happened if h.log > self.none.log and self.slight(h))
        return min(self.gap, self.none.rest, *light)

    def usually(self, noise: Scatter) -> float:
        """How probable it is that discrepancy and noise are what is usual, not out of the tail."""
        found = 1.0
        for r in range(len(noise.rho)):
            flat = np.log(TAIL) - np.log(np.log(LEVELS[-1] / LEVELS[0]) * np.log(SCALES[-1] / SCALES[0]))
            found *= 1.0 - float(np.exp(flat - log_prior(noise.rho[r], noise.v[r], self.usual, r)))
        return found

    def lawful(self, h: Hypothesis) -> float:
        """How probable it is that what a hypothesis leaves is what is usual, or as much as its law is approximate by:
        LAW of the gap, one standard deviation."""
        usual, gap = self.usually(h.noise), self.gap**2 - 1.0
        if not h.which or gap <= 0.0:
            return usual
        return usual + (1.0 - usual) * float(np.exp(-0.5 * max(h.rest**2 - 1.0, 0.0) / gap / LAW**2))

    @cached_property
    def counts(self) -> float:
        """The share of the evidence that counts beside what the likeliest leaves of all that lasts or happens."""
        each = [(h.log + self.prior_of(h), h.rest) for h in self.hypotheses]
        each += [(h.log + self.prior_at_moments(h), h.rest) for h in self.happened]
        return counted(max(each)[1])

    @cached_property
    def weights(self) -> list[float]:
        """Posterior weights of all hypotheses and then of all that happened; the largest is 1."""
        told = [h.log for h in self.hypotheses] + [h.log for h in self.happened]
        before = [self.prior_of(h) for h in self.hypotheses] + [self.prior_at_moments(h) for h in self.happened]
        each = self.counts * (np.array(told) - self.none.log) + np.array(before)
        return list(np.exp(each - np.max(each)).tolist())


def largest_evidence(asked: Asked) -> Belief:
    """The single effect with the most evidence, if it has any; sure of itself."""
    best = max(asked.hypotheses, key=lambda h: h.log if len(h.which) < 2 else -np.inf)
    return Belief({asked.key(best.which[0]) if best.which else NOTHING: 1.0}, ())


def believed(asked: Asked) -> Belief:
    """Bayes' rule over all hypotheses; what of a hypothesis is neither usual nor its law's is unknown, and so is one
    that leaves most of the gap."""
    found: dict[Key, float] = {NOTHING: 0.0, UNKNOWN: 0.0}
    for h, weight in zip(asked.hypotheses, asked.weights, strict=False):
        usual = asked.lawful(h) * float(not h.which or asked.share(h.rest) >= HALF)
        key = asked.main(h) if h.which else NOTHING
        found[key] = found.get(key, 0.0) + weight * usual
        found[UNKNOWN] += weight * (1.0 - usual)
    for happened, weight in zip(asked.happened, asked.weights[len(asked.hypotheses) :], strict=True):
        works = happened.key[0] == CONTACT and happened.busy > SELDOM  # a house may slew all the time
        named = not works and asked.share(happened.rest) >= HALF
        key = NOTHING if asked.slight(happened) else happened.key if named else UNKNOWN
        shares = asked.beforehand if asked.tells_nothing(happened) else {key: 1.0}
        found |= {k: found.get(k, 0.0) + weight * share for k, share in shares.items()}
    whole = sum(found.values())
    found = {k: p / whole for k, p in found.items()}
    return Belief(found, _features(asked, found))


def _features(asked: Asked, found: dict[Key, float]) -> tuple[float, ...]:
    """What the calibration looks at: log odds of the first effect against the second, of all against none; log gap; log
    of what the first leaves by itself, in units of the floor and of what a law leaves of the gap where it is not quite
    the true one; the share of its evidence that the next one lacks; log of one plus the number of references; log of
    how uncertain they leave the torques; log odds of `unknown`; by how many nats that count the first is, by itself,
    ahead of an unknown torque [log of one plus that]: odds end where right and wrong answers look alike; 1 with a known
    load, which tells more and is less sure itself. Zeros where no effect was asked."""
    effects = sorted((k for k in found if k not in (NOTHING, UNKNOWN)), key=lambda k: -found[k])
    if not effects:
        return (0.0,) * FEATURES
    first, none, second = effects[0], asked.none, found[effects[1]] if len(effects) > 1 else 0.0
    log, rest = asked.alone.get(first, (none.log, none.rest))
    rest /= float(np.hypot(1.0, LAW * asked.gap))
    others = [other for k, (other, _) in asked.alone.items() if k not in (first, UNKNOWN)]
    unknown, _ = asked.alone.get(UNKNOWN, (none.log, none.rest))
    ahead, gained, told = (asked.counts * (log - other) for other in (max(others, default=none.log), none.log, unknown))
    return (
        _log_odds(found[first], second),
        _log_odds(sum(found[k] for k in effects), found[NOTHING]),
        float(np.log(max(asked.gap, NONE))),
        float(np.log(max(rest, NONE))),
        max(ahead, 0.0) / max(gained, 1.0),
        float(np.log1p(asked.references)),
        float(np.log(max(asked.unsure, NONE))),
        _log_odds(found[UNKNOWN], 1.0 - found[UNKNOWN]),
        float(np.log1p(max(told, 0.0))),
        float(asked.loaded),
    )


def _log_odds(one: float, other: float) -> float:
    """At most CERTAIN either way."""
    return float(np.clip(np.log(max(one, LEAST) / max(other, LEAST)), -CERTAIN, CERTAIN))
