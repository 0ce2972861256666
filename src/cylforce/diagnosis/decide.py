"""Probabilities of hypotheses from their evidence, and the answer with the least expected cost."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np
from scipy.special import expit, log_expit

from cylforce.diagnosis.constants import (
    CORRELATED_ROWS,
    COSTS,
    SAME_EVIDENCE,
    SAME_MACHINE,
    SECOND_EFFECT,
    VISIBLE,
)
from cylforce.diagnosis.likelihood import Hypothesis, effective_share
from cylforce.diagnosis.model import FOLDS, KnowledgeSource
from cylforce.diagnosis.search import CONTACT, NO_GAP, UNKNOWN, BlockIncident, Candidate, Found, Key, Spill
from cylforce.readings.constants import CREDIBLE, HALF, HEALTHY, UNKNOWN_EFFECT
from cylforce.signals.estimate import Array

# Expectation of the largest of FOLDS exponential energies, over their mean: 1 + 1/2 + ... + 1/FOLDS.
LARGEST_OVER_MEAN = sum(1.0 / k for k in range(1, FOLDS + 1))
SURE = 1.0 / (1.0 + COSTS["unsaid"])  # of one name: from there on a name costs less than "unknown"


class Verdict(StrEnum):
    """Conclusion of a diagnosis."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY = "partly_explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    NOT_OBSERVABLE = "not_observable"


@dataclass(frozen=True)
class HypothesisWeights:
    """Posterior weights; the largest of all is 1.

    candidates: of the hypotheses of lasting effects, in their order
    incidents:  of the incidents of single blocks, in their order
    """

    candidates: list[float]
    incidents: list[float]

    @property
    def whole(self) -> float:
        """Sum of all weights."""
        return sum(self.candidates) + sum(self.incidents)


@dataclass(frozen=True)
class HypothesisEvidence:
    """Competing hypotheses, some of them withdrawn.

    found:     everything that the search found
    withdrawn: causes that their simulation refutes, or that repeat another answer
    """

    found: Found
    withdrawn: frozenset[Key] = frozenset()

    @cached_property
    def candidates(self) -> list[Candidate]:
        """Hypotheses of lasting effects that are not withdrawn."""
        return [c for c in self.found.candidates if not c.keys & self.withdrawn]

    @cached_property
    def incidents(self) -> list[BlockIncident | Spill]:
        """Incidents of single blocks, without lasting effects, that are not withdrawn."""
        return [i for i in self.found.incidents if i.key not in self.withdrawn]

    @cached_property
    def _best(self) -> dict[frozenset[Key], float]:
        found: dict[frozenset[Key], float] = {}
        for c in self.candidates:
            found[c.keys] = max(c.log, found.get(c.keys, -np.inf))
        return found

    def without(self, c: Candidate, key: Key) -> float:
        """Return the largest log probability of a hypothesis of only the other effects, or some of them."""
        others = c.keys - {key}
        return max(log for some, log in self._best.items() if some <= others)

    def main(self, c: Candidate) -> Key:
        """Return the main effect of a hypothesis: the one whose removal costs the most evidence."""
        return min(c.keys, key=lambda k: (self.without(c, k), k))

    # Prior

    @cached_property
    def names(self) -> int:
        """Number of effect names that share the prior of the library; it depends on the question.

        All names with a form count, also of forms that the search does not try, and loads that spill or shift. Jumps
        count only if a reading jumps. Contact and slewing count, but not in working recordings, where they are certain.
        """
        names = {f.name for f in self.found.question.forms} | {i.key[0] for i in self.found.incidents}
        if self.found.work is None:
            names |= self.found.question.incident_forms.keys()
        return len(names - {UNKNOWN[0]})

    @cached_property
    def _prior(self) -> dict[Key, float]:
        """Log prior of each form: equal for all names, and within a name for all its locations and forms.

        Half of the unknown cause's prior is that of torques in single blocks, which are incidents.
        """
        forms, found = self.found.question.forms, dict[Key, float]()
        for form in forms:
            places = len({f.at for f in forms if f.name == form.name})
            shapes = sum(f.key == form.key for f in forms)
            whole = UNKNOWN_EFFECT / 2.0 if form.name == UNKNOWN[0] else (1.0 - HEALTHY - UNKNOWN_EFFECT) / self.names
            found[form.key] = float(np.log(whole / places / shapes))
        return found

    def prior_of(self, c: Candidate) -> float:
        """Return the log prior probability of a hypothesis."""
        if self.is_contact_alone(c):
            return self._log_prior_with_transient(self._log_prior_of_name, c.before)
        if not c.hypothesis.forms:
            return float(np.log(HEALTHY))
        more = len(c.hypothesis.forms) - 1 + (c.beside_contact and self.found.work is None)
        own = sum(self._prior[c.question.forms[p].key] for p in c.hypothesis.forms)
        return own + more * float(np.log(SECOND_EFFECT))

    @property
    def _log_prior_of_name(self) -> float:
        return float(np.log((1.0 - HEALTHY - UNKNOWN_EFFECT) / self.names))

    def is_contact_alone(self, c: Candidate) -> bool:
        """Return whether a hypothesis has no effect, but contact in some rows; never in a working recording."""
        return not c.hypothesis.forms and c.beside_contact and self.found.work is None

    @property
    def _contact(self) -> Key:
        """Answer for contact alone in some rows; unknown if contact is withdrawn or not wanted."""
        contacts = [i for i in self.incidents if i.key[0] == CONTACT]
        return max(contacts, key=lambda i: i.log).key if contacts else UNKNOWN

    def prior_of_incident(self, i: BlockIncident | Spill) -> float:
        """Return the log prior probability of an incident of single blocks; a healthy machine has transients, too."""
        return self._log_prior_with_transient(self._log_prior_of_real_incident(i), i.before)

    def _log_prior_of_real_incident(self, i: BlockIncident | Spill) -> float:
        """Return the log prior probability of an incident that is no transient of a healthy machine."""
        if i.key == UNKNOWN:
            return float(np.log(UNKNOWN_EFFECT / 2.0 / max(sum(j.key == UNKNOWN for j in self.incidents), 1)))
        name = self._log_prior_of_name
        if isinstance(i, Spill):  # evidence of each load by itself, but a model error of the work is common to them
            return name + effective_share(i.rest) * i.odds
        return name - float(np.log(self.found.question.incident_forms[i.key[0]]))

    def _log_transient_ratio(self, before: float) -> float:
        """Return the log density of a residual on healthy machines, over that with contact or an incident.

        It is infinite where the residual is no gap: a healthy machine is never called faulty then.
        before: residual if contact or the incident is not removed, in noise floors
        """
        return np.inf if before**2 - 1.0 <= self.same_machine else self._log_density_ratio(before)

    def _log_prior_with_transient(self, real: float, before: float) -> float:
        """Return the log prior probability that contact or an incident is real, or a transient of a healthy machine.

        real:   log prior probability that it is real
        before: residual if it is not removed, in noise floors
        """
        ratio = self._log_transient_ratio(before)
        return float(np.logaddexp(np.log(HEALTHY) + log_expit(ratio), real + log_expit(-ratio)))

    def _transient_share(self, real: float, before: float) -> float:
        """Return the probability that contact or an incident is a transient of a healthy machine and not real.

        real:   log prior probability that it is real
        before: residual if it is not removed, in noise floors
        """
        return float(expit(np.log(HEALTHY) - real + self._log_transient_ratio(before)))

    # Posterior

    @cached_property
    def gap(self) -> float:
        """Gap at the worst joint, in noise floors: residual without effects, with the healthy machine's parameters."""
        return float(np.max(self.found.gaps))

    @property
    def has_gap(self) -> bool:
        """True where the gap is larger than between two recordings of a healthy machine."""
        return self.gap**2 - 1.0 > self.same_machine

    @property
    def is_hidden(self) -> bool:
        """True where a healthy machine leaves a visible residual, because its references differ as much.

        That of contact alone and of an incident is the residual with its torque not removed.
        """
        without_effects = [c for c in self.candidates if not c.hypothesis.forms]
        likeliest = max([*without_effects, *self.incidents], key=self._log_weight)
        lasts = isinstance(likeliest, Candidate) and not self.is_contact_alone(likeliest)
        residual = likeliest.rest if lasts else likeliest.before
        return residual**2 - 1.0 > VISIBLE

    def probability_healthy(self, residual: float) -> float:
        """Return the probability that a residual is a healthy machine's, not one of a cause that the library lacks.

        residual: at the worst joint, in noise floors
        """
        return float(expit(np.log(HEALTHY / UNKNOWN_EFFECT) + self._log_density_ratio(residual)))

    def _log_density_ratio(self, residual: float) -> float:
        """Return the log density of a residual's energy on healthy machines, over that with other causes.

        The energy beyond the noise floor is exponential on healthy machines. With other causes it has a broad
        distribution around VISIBLE.
        residual: at the worst joint, in noise floors
        """
        energy, mean = max(residual**2 - 1.0, 0.0), self._mean_energy
        if energy == 0.0:
            return np.inf
        if not np.isfinite(energy):
            return -np.inf
        healthy = -energy / mean - float(np.log(mean))  # log of exp(-x/m) / m
        other = float(np.log(2.0 * VISIBLE * energy)) - 3.0 * float(np.log(energy + VISIBLE))  # of 2 V x / (x + V)^3
        return healthy - other

    @property
    def same_machine(self) -> float:
        """Energy by which two recordings of this machine may differ, in squared floors."""
        return self.found.question.machine.spread

    @property
    def _mean_energy(self) -> float:
        """Mean energy by which recordings of this machine differ, in squared floors; at least SAME_MACHINE.

        `same_machine` is the largest of FOLDS such energies.
        """
        return max(SAME_MACHINE, self.same_machine / LARGEST_OVER_MEAN)

    @cached_property
    def strength(self) -> float:
        """Factor that tempers all evidence.

        It follows from the refitted residual of the likeliest hypothesis, or from the larger one with which parts of
        the references predict each other: both are model error. All evidence counts as model error with unknown loads
        and contact, and with oil of another temperature: references do not show that motion and that friction.
        """
        each = [*self.candidates, *self.incidents]
        likeliest = max(each, key=lambda h: h.log + self._log_prior(h))
        other_oil = isinstance(likeliest, Candidate) and likeliest.hypothesis.noise.conditions.other_oil
        if self.found.work is not None or other_oil:
            return 1.0 / CORRELATED_ROWS
        return effective_share(max(likeliest.rest, float(np.sqrt(1.0 + self._mean_energy))))

    def _log_prior(self, h: Candidate | BlockIncident | Spill) -> float:
        """Return the log prior probability of a hypothesis or incident."""
        return self.prior_of(h) if isinstance(h, Candidate) else self.prior_of_incident(h)

    def _log_weight(self, h: Candidate | BlockIncident | Spill) -> float:
        """Return the log posterior weight of a hypothesis or incident, relative to the healthy machine's evidence."""
        return self.strength * (h.log - self.found.healthy.log) + self._log_prior(h)

    @cached_property
    def weights(self) -> HypothesisWeights:
        """Posterior weights of all hypotheses."""
        candidates = [self._log_weight(c) for c in self.candidates]
        incidents = [self._log_weight(i) for i in self.incidents]
        largest = max([*candidates, *incidents])
        return HypothesisWeights(
            candidates=np.exp(np.array(candidates) - largest).tolist(),
            incidents=np.exp(np.array(incidents) - largest).tolist(),
        )

    def usual(self, hypothesis: Hypothesis) -> float:
        """Return the probability that the residual of a hypothesis is that of a healthy machine."""
        return hypothesis.noise.probability_usual(self.found.case.machine.noise)

    def lawful(self, c: Candidate) -> float:
        """Return the probability that the residual of a hypothesis is a healthy one, or the error of its law.

        The level of the residual does not count in working recordings: references do not show the model error of work.
        The probability is 1 for effects that leave at most one noise floor, whatever the noise: a cause that the
        library lacks, but that looks like one of its effects, counts as that effect.
        """
        healthy = self.usual(c.hypothesis)
        if self.found.work is None:
            healthy *= self.probability_healthy(c.rest)
        forms = c.hypothesis.forms
        if not forms:
            return healthy
        main = self.main(c)
        law = max(c.question.forms[p].torque_error for p in forms if c.key(p) == main)
        return healthy + (1.0 - healthy) * self._error_of_law(max(c.rest**2 - 1.0, 0.0), law)

    def _error_of_law(self, left: float, law: float) -> float:
        """Return the probability that a residual is the error of a law that made the gap.

        left: its energy beyond the noise floor, in squared floors
        law:  relative error of the law's torque
        """
        gap = self.gap**2 - 1.0
        return float(np.exp(-0.5 * left / gap / law**2)) if gap > 0.0 else 0.0

    @cached_property
    def posterior(self) -> dict[Key, float]:
        """Posterior probability of no gap, of each effect at its location, and of a cause that the library lacks.

        It is normalised over the candidates and incidents that the search kept. Beside Bayes' rule:

        - Weight of a hypothesis goes to the unknown cause as far as its residual is neither a healthy one nor the error
          of its law.
        - Weight of an incident goes to no gap as far as it is a transient; so does that of contact alone in some rows.
        - Without a gap, the unknown cause's probability goes to no gap.
        """
        found: dict[Key, float] = {NO_GAP: 0.0, UNKNOWN: 0.0}

        def add(key: Key, weight: float) -> None:
            found[key] = found.get(key, 0.0) + weight

        for c, weight in zip(self.candidates, self.weights.candidates, strict=True):
            lawful = self.lawful(c)
            add(UNKNOWN, weight * (1.0 - lawful))
            if self.is_contact_alone(c):
                transient = self._transient_share(self._log_prior_of_name, c.before)
                add(NO_GAP, weight * lawful * transient)
                add(self._contact, weight * lawful * (1.0 - transient))
            else:
                add(self.main(c) if c.hypothesis.forms else NO_GAP, weight * lawful)
        for i, weight in zip(self.incidents, self.weights.incidents, strict=True):
            transient = self._transient_share(self._log_prior_of_real_incident(i), i.before)
            add(NO_GAP, weight * transient)
            add(i.key, weight * (1.0 - transient))
        if not self.has_gap:
            found[NO_GAP], found[UNKNOWN] = found[NO_GAP] + found[UNKNOWN], 0.0
        whole = sum(found.values())
        return {k: p / whole for k, p in found.items()} if whole > 0.0 else {UNKNOWN: 1.0}

    def is_transient(self, i: BlockIncident | Spill) -> bool:
        """Return whether an incident is a healthy machine's transient, more probably than not."""
        return self._transient_share(self._log_prior_of_real_incident(i), i.before) > HALF

    @property
    def first(self) -> Key:
        """Likeliest answer."""
        return max(self.posterior, key=lambda k: self.posterior[k])

    @property
    def credible(self) -> tuple[Key, ...]:
        """Smallest set with CREDIBLE of the probability, the likeliest first."""
        found, mass = list[Key](), 0.0
        for key, p in sorted(self.posterior.items(), key=lambda item: -item[1]):
            found.append(key)
            mass += p
            if mass >= CREDIBLE:
                break
        return tuple(found)

    @cached_property
    def alone(self) -> Mapping[Key, float]:
        """Log probability of the most probable form of each effect, as the only effect."""
        found: dict[Key, float] = {}
        for c in self.candidates:
            if len(c.hypothesis.forms) == 1 and c.incident is None:
                key = c.key(c.hypothesis.forms[0])
                found[key] = max(found.get(key, -np.inf), c.log)
        for i in self.incidents:
            found[i.key] = max(found.get(i.key, -np.inf), i.log)
        return found

    def best_of(self, key: Key) -> Candidate | None:
        """Return the most probable hypothesis with `key` as its main effect."""
        own = [c for c in self.candidates if c.hypothesis.forms and self.main(c) == key]
        return max(own, key=lambda c: c.log + self.prior_of(c)) if own else None


def costs(evidence: HypothesisEvidence, key: Key | None) -> dict[Verdict, float]:
    """Return the expected cost of every answer, in units of a wrong name.

    key: the cause that would be named; None if there is none
    """
    posterior = evidence.posterior
    none, odd = posterior.get(NO_GAP, 0.0), posterior.get(UNKNOWN, 0.0)
    effect, first = 1.0 - none - odd, posterior.get(key, 0.0) if key else 0.0
    found = {Verdict.NO_GAP: COSTS["missed"] * (effect + odd), Verdict.UNKNOWN: COSTS["unsaid"] * effect + none}
    rivals = [posterior[k] for k in evidence.credible if k not in (key, UNKNOWN, NO_GAP)]
    if 0.0 < first < SURE:
        held = first + sum(rivals)
        checks = first + sum(k * p for k, p in enumerate(rivals, 1))
        found[Verdict.AMBIGUOUS] = none + COSTS["rival"] * checks + COSTS["wrong_set"] * max(1.0 - none - held, 0.0)
    if first >= SURE:
        found[Verdict.EXPLAINED] = 1.0 - first
    return found


def as_simulated(verdict: Verdict, closure: float) -> Verdict:
    """Return the verdict after the simulation of the named causes.

    closure: share of the gap's energy that they remove; NaN where the gap is too small for a share
    """
    return Verdict.PARTLY if verdict is Verdict.EXPLAINED and closure < HALF else verdict


@dataclass(frozen=True)
class FreeEvidence:
    """Evidence of hypotheses with parameters as uncertain as those of the data sheet.

    logs:     (H,) log probability of the recordings under each
    priors:   (H,) log prior of its effects beside other parameters
    strength: factor that tempers the evidence
    """

    logs: Array
    priors: Array
    strength: float

    @classmethod
    def of(cls, free: HypothesisEvidence) -> "FreeEvidence":
        """Return the evidence of hypotheses with free parameters."""
        more = float(np.log(SECOND_EFFECT))  # of an effect beside other parameters
        healthy = [not c.hypothesis.forms and not free.is_contact_alone(c) for c in free.candidates]
        priors = [0.0 if h else free.prior_of(c) + more for c, h in zip(free.candidates, healthy, strict=True)]
        priors += [free.prior_of_incident(i) + more for i in free.incidents]
        logs = [c.log for c in free.candidates] + [i.log for i in free.incidents]
        return cls(np.array(logs), np.array(priors), free.strength)

    def exceeds(self, known: HypothesisEvidence) -> bool:
        """Return whether parameters other than the references' are the likeliest explanation.

        They compete with all hypotheses as one more name. Their prior is the data sheet's: many free parameters cost
        evidence, so that a single effect with the same residual is likelier. A simulation is no earlier state of the
        machine: an effect that changes its masses or friction is an error of its parameters.
        known: hypotheses with the parameters from the references
        """
        strength = min(known.strength, self.strength)
        name = float(np.log((1.0 - HEALTHY - UNKNOWN_EFFECT) / known.names))  # of other parameters
        simulated = known.found.question.machine.source is KnowledgeSource.SIMULATION
        own = [c for c in known.candidates if not (simulated and c.changes_parameters)]
        as_known = [strength * c.log + known.prior_of(c) for c in own]
        as_known += [strength * i.log + known.prior_of_incident(i) for i in known.incidents]
        return name + float(np.max(strength * self.logs + self.priors)) > max(as_known)


def first_effect(evidence: HypothesisEvidence) -> Key | None:
    """Return the likeliest effect; None if every one is excluded."""
    effects = [k for k, p in evidence.posterior.items() if k not in (NO_GAP, UNKNOWN) and p > 0.0]
    return max(effects, key=lambda k: evidence.posterior[k]) if effects else None


SAME_CHANGE = ("extra_mass", "first_moment_change")  # an added mass moves its link's centre of gravity


def one_answer(evidence: HypothesisEvidence) -> tuple[HypothesisEvidence, dict[Key, Key]]:
    """Return the evidence with a mass and a first moment of one link as one answer, and the other name of each cause.

    If their evidence differs by less than SAME_EVIDENCE, the more probable one stays. Both stay if the likeliest
    hypothesis has both, or if neither is in the credible set.
    """
    same: dict[Key, Key] = {}
    for at in sorted({at for _, at in evidence.alone}):
        both = [(name, at) for name in SAME_CHANGE]
        if not all(key in evidence.alone for key in both) or not set(both) & set(evidence.credible):
            continue
        logs = [evidence.alone[key] for key in both]
        if abs(logs[0] - logs[1]) >= SAME_EVIDENCE:
            continue
        own = [c for c in evidence.candidates if c.keys & set(both)]
        likeliest = max(own, key=lambda c: c.log + evidence.prior_of(c), default=None)
        lacking = [key for key in both if likeliest is not None and key not in likeliest.keys]
        if lacking:
            kept = next(key for key in both if key != lacking[0])
            evidence = replace(evidence, withdrawn=evidence.withdrawn | {lacking[0]})
            same[kept] = lacking[0]
    return evidence, same
