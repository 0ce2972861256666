"""The diagnosis: why a machine differs from its model. `diagnose` compares recordings with a healthy machine.

The modules stand in the order of the work: regressors, statistics, model, likelihood, search, decide, explain."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cylforce.diagnosis.decide import (
    SURE,
    FreeEvidence,
    HypothesisEvidence,
    Verdict,
    as_simulated,
    costs,
    first_effect,
    one_answer,
)
from cylforce.diagnosis.explain import (
    Cause,
    Picture,
    Refit,
    Simulated,
    Simulation,
    Spot,
    cause_of_incident,
    causes_of,
    objection_to_magnitude,
    objection_to_simulation,
    refitted,
    refitted_sheet,
    unexplained_shape,
    where,
    worst_place,
)
from cylforce.diagnosis.model import HealthyMachine, KnowledgeSource, fitted_parameters, noisy_twin, with_noise
from cylforce.diagnosis.model import identified as model_identified
from cylforce.diagnosis.regressors import Regressors
from cylforce.diagnosis.search import (
    NO_GAP,
    UNKNOWN,
    Candidate,
    FieldQuestion,
    Found,
    Key,
    examined,
    without_gap,
)
from cylforce.diagnosis.statistics import rms
from cylforce.effects.library import Proposal
from cylforce.estimation.model import Model
from cylforce.readings.constants import BLOCK_ROWS, HALF
from cylforce.readings.recording import Recording
from cylforce.readings.zeros import Zero
from cylforce.signals.estimate import Array
from cylforce.signals.parallel import ParallelMap, sequential_map


@dataclass(frozen=True)
class Named:
    """Cause that the diagnosis names.

    cause:      the effect with its magnitude
    confidence: its probability
    share:      its share of the torque that all named causes add
    rivals:     causes that it might be confused with
    same_as:    another name for the same change; None if there is none
    """

    cause: Cause
    confidence: float
    share: float
    rivals: tuple[Key, ...]
    same_as: Key | None = None


@dataclass(frozen=True)
class Diagnosis:
    """Answer of the diagnosis.

    verdict:   the conclusion
    named:     the causes, the main one first
    evidence:  hypotheses and probabilities
    simulated: the gap before and after the named causes
    spots:     joints and regimes, sorted by their gap
    shape:     quantity with which an unexplained residual varies
    refit:     gap that a refit of the model's parameters removes
    parameters_first: whether the refit comes before any effect
    refuted:   sentences on causes that are not named
    picture:   pressures at the joint with the largest gap
    same:      the other name of each cause that has two
    """

    verdict: Verdict
    named: tuple[Named, ...]
    evidence: HypothesisEvidence
    simulated: Simulated
    spots: list[Spot]
    shape: dict[str, Any]
    refit: Refit
    parameters_first: bool = False
    refuted: tuple[str, ...] = ()
    picture: Picture | None = None
    same: dict[Key, Key] = field(default_factory=dict)

    @property
    def needs_parameters(self) -> bool:
        """True where other parameters of the model may be the better answer.

        They are not needed where the residual with the causes is as small as between two recordings of a healthy
        machine. A simulation is no earlier state of the machine: an effect that changes its masses or friction is an
        error of its parameters.
        """
        question = self.evidence.found.question
        if self.evidence.found.work is not None or self.verdict in (Verdict.NO_GAP, Verdict.NOT_OBSERVABLE):
            return False
        simulated = question.machine.source is KnowledgeSource.SIMULATION
        if simulated and any(n.cause.proposal.of_parameters for n in self.named):
            return True
        return not np.all(without_gap(rms(self.simulated.after), question.machine.floor.rms))

    @property
    def only_parameters(self) -> bool:
        """True where the refit is the whole answer: the parameters come first, and no effect is named beside them."""
        return self.parameters_first and not self.named

    @property
    def other_temperature(self) -> bool:
        """True where the gap is what another temperature makes of a healthy machine."""
        healthy = max((c for c in self.evidence.candidates if not c.hypothesis.forms), key=lambda c: c.log)
        warm = healthy.hypothesis.noise.conditions.temperature is not None
        return self.verdict is Verdict.NO_GAP and self.evidence.has_gap and warm


def question_of(
    machine: HealthyMachine,
    recordings: Sequence[Recording],
    rng: np.random.Generator,
    jumps: Mapping[int, float] | None = None,
    zeros: Mapping[int, Zero] | None = None,
    parallel_map: ParallelMap = sequential_map,
) -> FieldQuestion:
    """Return the question of recordings compared with a healthy machine.

    jumps:        evidence [nats] of the number of jumps of a reading, by its signal
    zeros:        readings of pressure sensors without pressure, by their signals
    parallel_map: maps a function, perhaps in parallel
    """
    own, layout = machine.regressors, machine.layout
    twins = [noisy_twin(each, own, machine.sensor_noise, rng) for each in recordings]
    rows = parallel_map(lambda each: own.rows(each, layout.proposals), [*recordings, *twins])
    rows, noisy = rows[: len(recordings)], rows[len(recordings) :]
    seen = [with_noise(layout, machine.floor, *each) for each in zip(recordings, rows, twins, noisy, strict=True)]
    return FieldQuestion(machine, tuple(seen), jumps=jumps or {}, zeros=zeros or {})


def diagnose(
    machine: HealthyMachine,
    recordings: Sequence[Recording],
    rng: np.random.Generator,
    wanted: Callable[[Proposal], bool] = lambda _: True,
    watch: Callable[[str], None] = lambda _: None,
    jumps: Mapping[int, float] | None = None,
    zeros: Mapping[int, Zero] | None = None,
    *,
    identified: bool = True,
    parallel_map: ParallelMap = sequential_map,
) -> Diagnosis:
    """Diagnose recordings of a machine by comparison with its healthy state.

    wanted:       whether an effect may be a cause
    jumps:        evidence [nats] of the number of jumps of a reading, by its signal
    zeros:        readings of pressure sensors without pressure, by their signals
    identified:   whether the parameters are certainly this machine's; else a refit competes with all effects
    parallel_map: maps a function, perhaps in parallel
    """
    watch("columns of every effect")
    question = question_of(machine, recordings, rng, jumps, zeros, parallel_map)
    diagnosis = _answered(question, rng, wanted, watch)
    watch("the model's own parameters")
    if identified or not diagnosis.needs_parameters or diagnosis.refit.share <= HALF:
        return diagnosis
    other = _answered(question.with_free_parameters(diagnosis.refit.values), rng, wanted)
    if not FreeEvidence.of(other.evidence).exceeds(diagnosis.evidence):
        return diagnosis
    return _after_refit(question, diagnosis, other)


def _answered(
    question: FieldQuestion,
    rng: np.random.Generator,
    wanted: Callable[[Proposal], bool],
    watch: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Search for effects and return the answer."""
    found = examined(question, wanted, watch)
    watch("locating the gap, simulating the effects")
    return concluded(found, rng)


def _after_refit(question: FieldQuestion, before: Diagnosis, after: Diagnosis) -> Diagnosis:
    """Return the answer that the parameters come first, with the effects that remain once they are fitted.

    before: answer with the parameters of the healthy machine
    after:  answer with free parameters
    """
    return replace(
        after,
        verdict=after.verdict if after.named else Verdict.NOT_OBSERVABLE,
        spots=before.spots,
        refit=before.refit,
        parameters_first=True,
        picture=worst_place(question, replace(after.simulated, before=before.simulated.before)),
    )


@dataclass(frozen=True)
class SheetGap:
    """Gap of a machine that has only a data sheet: effects cannot be distinguished from its parameters.

    question: the recordings compared with the data sheet
    refit:    gap that identified masses and friction remove
    spots:    joints and regimes, sorted by their gap
    """

    question: FieldQuestion
    refit: Refit
    spots: list[Spot]


def gap_of_sheet(
    sheet: Model,
    friction: Sequence[str],
    recordings: Sequence[Recording],
    sensor_noise: Array,
    rng: np.random.Generator,
) -> SheetGap:
    """Return the gap between recordings and a data sheet, with its refit.

    sheet:    the model without friction, whose prior is the data sheet
    friction: laws that an identification would fit
    """
    model = sheet.with_laws(tuple(friction))
    fitted = Regressors(model, fitted_parameters(model, recordings))
    floor = rms([fitted.rows(each, ()).residual for each in recordings])
    questions = []
    for regressors in (fitted, Regressors(sheet, sheet.prior.mean)):
        covariance, moves = regressors.model.prior.covariance, np.where(floor > 0.0, floor, 1.0)
        machine = model_identified(regressors, (), covariance, moves, recordings, sensor_noise, rng)
        questions.append(question_of(replace(machine, source=KnowledgeSource.DATA_SHEET), recordings, rng))
    refit = refitted_sheet(questions[1], questions[0])
    return SheetGap(questions[1], refit, where(questions[1], questions[1].residuals()))


def concluded(found: Found, rng: np.random.Generator) -> Diagnosis:
    """Return the answer with the least cost whose causes are not contradicted by their simulation.

    A contradicted cause is withdrawn. Bayes' rule holds among the others: the next one is simulated. Beside that, mass
    and first moment of a link are one answer (`one_answer`). At work, no gap and unknown become not observable; so
    does no gap that leaves a visible residual, because the references differ as much.
    """
    question = found.question
    evidence, same = one_answer(HypothesisEvidence(found))
    plain = Simulation(question, None).run((), rng)
    refuted = list[str]()
    while True:
        key = first_effect(evidence)
        cost = costs(evidence, key)
        verdict = min(cost, key=lambda v: cost[v])
        if verdict in (Verdict.NO_GAP, Verdict.UNKNOWN) or key is None:
            if found.work is not None or (verdict is Verdict.NO_GAP and evidence.is_hidden):
                verdict = Verdict.NOT_OBSERVABLE  # unknown loads and contact, or poor references, may hide an effect
            return _answer(evidence, verdict, (), plain, refuted, same)
        named, simulated, objection = _tried(evidence, key, rng)
        if not objection:
            if found.work is None:  # at work nothing is simulated
                verdict = as_simulated(verdict, simulated.closure)
            return _answer(evidence, verdict, named, simulated, refuted, same)
        refuted.append(objection)
        evidence = replace(evidence, withdrawn=evidence.withdrawn | {key})


def _tried(
    evidence: HypothesisEvidence, key: Key, rng: np.random.Generator
) -> tuple[tuple[Cause, ...], Simulated, str]:
    """Return the causes named with the main one, the gap with them simulated, and a reason against the main one.

    The reason is a sentence; it is empty if there is none.
    """
    question = evidence.found.question
    candidate = evidence.best_of(key)
    if candidate is None:
        incident = max((i for i in evidence.incidents if i.key == key), key=lambda i: i.log)
        cause = cause_of_incident(evidence, incident)
        if evidence.found.work is not None:
            return (cause,), Simulation(question, None).run((), rng), objection_to_magnitude(cause)
        simulated = Simulation(question, None).run((cause,), rng)
        objection = objection_to_magnitude(cause) or objection_to_simulation(question, (cause,), simulated)
        return (cause,), simulated, objection
    if evidence.found.work is not None:  # no effect removes contact and loads, most of that gap
        (cause, *_) = causes_of(evidence, candidate)
        return (cause,), Simulation(question, None).run((), rng), objection_to_magnitude(cause)
    by_itself = single_effect(evidence, key, candidate)
    (first,) = causes_of(evidence, by_itself)[:1]
    alone = Simulation(question, by_itself).run((first,), rng)
    objection = objection_to_magnitude(first) or objection_to_simulation(question, (first,), alone)
    both, law_error = causes_of(evidence, candidate), first.proposal.about.torque_error
    more = [c for c in both[1:] if c.probability >= SURE and c.key != UNKNOWN]
    more = [c for c in more if not objection_to_magnitude(c) and _shows(question, c, alone, law_error)]
    if more and not objection_to_magnitude(both[0]):
        causes = (both[0], *more)
        simulated = Simulation(question, candidate).run(causes, rng)
        if not objection_to_simulation(question, causes, simulated):
            return causes, simulated, ""
    return (first,), alone, objection


def single_effect(evidence: HypothesisEvidence, key: Key, candidate: Candidate) -> Candidate:
    """Return the most probable hypothesis of one effect without others, under the conditions of a larger hypothesis.

    candidate: the larger hypothesis, returned if the effect has no hypothesis without others
    """
    own = [c for c in evidence.candidates if len(c.hypothesis.forms) == 1 and c.keys == {key}]
    found = max(own, key=lambda c: c.log + evidence.prior_of(c), default=candidate)
    h, conditions = found.hypothesis, candidate.hypothesis.noise.conditions
    if h.noise.conditions == conditions:
        return found
    case = found.question.without_rows().likelihood()  # the candidate shall not keep its rows
    case = replace(case, nuisance=found.incident.nuisance) if found.incident else case
    return replace(found, hypothesis=case.hypothesis(h.forms, replace(h.noise, conditions=conditions), h.doubt))


def _shows(question: FieldQuestion, cause: Cause, alone: Simulated, law_error: float) -> bool:
    """Return whether the joint most affected by a cause still has a gap with the first cause alone simulated.

    law_error: relative error of the torque of the first cause's law, which the gap must exceed
    """
    torque, floor = rms(added_torque(question, cause)), question.machine.floor.rms
    most = int(np.argmax(torque / floor))
    before, after = (float(rms(each)[most] / floor[most]) for each in (alone.before, alone.after))
    law = law_error**2 * max(before**2 - 1.0, 0.0)
    return after**2 > 1.0 + float(question.machine.spread_of_joints[most]) + law


def added_torque(question: FieldQuestion, cause: Cause) -> list[Array]:
    """Return the torques (T, R) [N m] that a cause adds along each recording, computed from its columns."""
    layout, proposal, found = question.machine.layout, cause.proposal, []
    refined = cause.question.refined
    for n, (seen, span) in enumerate(zip(question.seen, question.spans, strict=True)):
        if refined is not None and refined.proposal is proposal:
            own = refined.columns[n]
        else:
            columns = layout.columns(seen.rows, seen.recording)
            if proposal.clock:
                places: Sequence[int] = [layout.clock] * len(cause.sizes[0])
            elif proposal.course:
                places = layout.incident(proposal)[: cause.sizes.shape[1]]
            else:
                places = layout.places[layout.proposals.index(proposal)]
            own = columns[..., list(places)]
        each = np.nan_to_num(cause.course).T[slice(*span)] @ cause.sizes  # (B, M)
        found.append(np.einsum("trm,tm->tr", own, np.repeat(each, BLOCK_ROWS, axis=0)[: len(seen.rows.t)]))
    return found


def _answer(
    evidence: HypothesisEvidence,
    verdict: Verdict,
    causes: tuple[Cause, ...],
    simulated: Simulated,
    refuted: Sequence[str],
    same: dict[Key, Key],
) -> Diagnosis:
    question = evidence.found.question
    named: list[Named] = []
    if causes:
        squares = [float(np.sum((rms(added_torque(question, c)) / question.machine.floor.rms) ** 2)) for c in causes]
        keys = {c.key for c in causes}
        for k, cause in enumerate(causes):
            rivals = tuple(key for key in evidence.credible if key not in (*keys, NO_GAP, UNKNOWN)) if k == 0 else ()
            share = squares[k] / max(sum(squares), 1e-300)
            named.append(Named(cause, cause.probability, share, rivals, same.get(cause.key)))
    spots = where(question, simulated.before)
    return Diagnosis(
        verdict,
        tuple(named),
        evidence,
        simulated,
        spots,
        unexplained_shape(question, simulated.after),
        refitted(question),
        refuted=tuple(refuted),
        picture=worst_place(question, simulated),
        same=same,
    )
