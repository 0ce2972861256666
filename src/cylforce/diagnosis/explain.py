"""Explanation of an answer: named causes are simulated, and the gap that remains is described.

The description has the closure, the joints and regimes with a gap, the shape of an unexplained residual, and the
gap that a refit of the parameters removes. Nothing here overwrites a decision: where a simulation contradicts a
cause, `concluded` withdraws it, and Bayes' rule holds among the others.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy import stats
from scipy.special import xlogy

from cylforce.diagnosis.constants import DETECTABLE, LEAST_SHARE, SAME_MACHINE
from cylforce.diagnosis.decide import HypothesisEvidence
from cylforce.diagnosis.likelihood import Likelihood, Nuisance
from cylforce.diagnosis.model import (
    CENTRE,
    FOLDS,
    GROWTH_S,
    REGIMES,
    HealthyMachine,
    mean_squares,
    regime,
)
from cylforce.diagnosis.regressors import courses
from cylforce.diagnosis.search import BlockIncident, Candidate, FieldQuestion, Found, Key, Spill, without_gap
from cylforce.diagnosis.statistics import Mask, rms
from cylforce.effects.fault import BEYOND, INCIDENTAL, SHAPES, Place, TimeCourse
from cylforce.effects.imposed import imposed
from cylforce.effects.library import Group, Proposal
from cylforce.effects.loads.carried import RAMP
from cylforce.estimation.model import Model
from cylforce.readings.constants import BLOCK_ROWS, CREDIBLE, HALF, LOAD_CENTRE
from cylforce.signals.estimate import Array
from cylforce.signals.units import BAR

INTERVAL = 1.6449  # standard errors of a 90 % interval
SPAN = 5  # blocks that are held out and drawn together: fifteen seconds
DRAWS = 400  # of the bootstrap of a closure
SMALL_GAP = 0.1  # of the floor's energy: a smaller gap has no meaningful share
WIDEST = 0.2  # width of an interval of the closure beyond which no share is given
UNSEEN_SPREAD = (0.03, 0.01)  # by which that interval is wider than drawn blocks show (fit: tools/withheld_trial)
FALSE_DISCOVERIES = 0.05  # share among the places that are reported
ENERGY_MARGIN = 2.0  # factor on the energy by which a healthy machine may differ from itself in a regime
FEWEST_ROWS = 20  # of a regime in a span
PARTS = 8  # of a block, within which an incident counts as constant


# Causes


@dataclass(frozen=True)
class Cause:
    """Effect that the search found, ready to be named.

    key:         name and location
    proposal:    the effect
    question:    the recordings, corrected for it
    form:        number of its form; None of an incident
    sizes:       (W, M) sizes [SI], one row of each window of an incident
    errors:      (W, M) standard errors
    course:      (W, B) its course over the blocks; NaN in the block in which a load changes
    probability: of this cause
    nats:        evidence against its absence
    when:        its time in words; empty of a lasting effect
    """

    key: Key
    proposal: Proposal
    question: FieldQuestion
    form: int | None
    sizes: Array
    errors: Array
    course: Array
    probability: float
    nats: float
    when: str = ""

    @property
    def lasts(self) -> bool:
        """True where the effect has the same sizes as long as it is present."""
        return self.form is not None

    @property
    def interval(self) -> tuple[float, float, float]:
        """Magnitude with the bounds of its 90 % interval; of several windows the root mean square."""
        about = self.proposal.about
        each = self.sizes[:, : about.axes]
        if about.axes == 1 and len(self.sizes) == 1:
            value = float(each[0, 0])
        else:
            sign = np.sign(each[0, 0]) if each.size == 1 else about.sign or 1
            value = float(sign * np.sqrt(np.mean(np.sum(each**2, axis=1))))
        error = float(np.sqrt(np.mean(self.errors[:, : about.axes] ** 2)))
        return value, value - INTERVAL * error, value + INTERVAL * error

    @property
    def excludes_zero(self) -> bool:
        """Whether the 90 % interval of the magnitude excludes zero."""
        _, low, high = self.interval
        return not low <= 0.0 <= high


def causes_of(evidence: HypothesisEvidence, candidate: Candidate) -> list[Cause]:
    """Return the effects of a hypothesis, the main one first."""
    question, h, found, k = candidate.question, candidate.hypothesis, [], 0
    main = evidence.main(candidate)
    for p in h.forms:
        form = question.forms[p]
        m = len(form.columns)
        unit = question.unit_of(p)
        sizes, errors = form.bounded(h.sizes[k : k + m] * unit), h.errors[k : k + m] * unit
        k += m
        key = candidate.key(p)
        probability = evidence.posterior.get(key, 0.0) if key == main else _included(evidence, key)
        nats = h.log - evidence.without(candidate, key)
        errors = np.hypot(errors, form.law_error * np.abs(sizes))
        found.append(_cause(question, key, p, (sizes, errors), probability, nats))
    return sorted(found, key=lambda c: c.key != main)


def _included(evidence: HypothesisEvidence, key: Key) -> float:
    """Return the probability that an effect is present, alone or beside others."""
    each = zip(evidence.candidates, evidence.weights.candidates, strict=True)
    return sum(weight for c, weight in each if key in c.keys) / evidence.weights.whole


def _cause(
    question: FieldQuestion, key: Key, form: int, sizes: tuple[Array, Array], probability: float, nats: float
) -> Cause:
    proposal, count = question.proposals[form], len(question.times)
    course, rows, when = np.ones((1, count)), 1, ""
    if proposal.course is TimeCourse.CLOCK:
        course, rows = np.stack([course[0], question.times / GROWTH_S]), 2
    elif proposal.course is TimeCourse.AFTER and question.step:
        number = np.arange(count)
        first, last = question.step.first, question.step.last
        course = np.where(number == first, np.nan, (number > first) & (number < last))[None]
        when = f"from {question.times[first]:.0f} s on"
    value, error = (x.reshape(rows, -1) for x in sizes)
    return Cause(key, proposal, question, form, value, error, course, probability, nats, when)


def cause_of_incident(evidence: HypothesisEvidence, incident: BlockIncident | Spill) -> Cause:
    """Return the cause of an incident, with sizes of its own in each block or at each time."""
    if isinstance(incident, Spill):
        probability = evidence.posterior.get(incident.key, 0.0)
        nats, when = incident.log + incident.odds - evidence.found.healthy.log, f"{len(incident.sizes)} times"
        sizes, errors = incident.sizes, incident.errors
        own = evidence.found.question
        return Cause(
            incident.key, incident.proposal, own, None, sizes, errors, incident.course, probability, nats, when
        )
    question, case = evidence.found.question, evidence.found.case
    held = replace(case, nuisance=incident.nuisance)
    h = held.hypothesis((), case.machine.noise)
    residual = held.under((), held.state(h.noise))[2]
    sizes, covariance = incident.nuisance.expected(residual, h.noise)
    where, layout = incident.sizes > 0.0, question.machine.layout
    columns = [k - layout.size for k in layout.places[layout.proposals.index(incident.proposal)]]
    unit = incident.sizes[where, None] * layout.typical[columns]
    errors = np.sqrt(np.einsum("bii->bi", covariance)) * unit
    return Cause(
        incident.key,
        incident.proposal,
        question,
        None,
        sizes * unit,
        errors,
        np.eye(len(where))[where],
        evidence.posterior.get(incident.key, 0.0),
        incident.log - evidence.found.healthy.log,
        f"{np.count_nonzero(where)} times",
    )


def objection_to_magnitude(cause: Cause) -> str:
    """Return a sentence why the magnitude excludes a cause; empty if it does not.

    A magnitude at its bound indicates another cause. An interval that contains zero indicates no cause.
    """
    name = "{}@{}".format(*cause.key)
    if cause.form is not None:
        form = cause.question.forms[cause.form]
        magnitude = float(np.linalg.norm(cause.sizes.ravel()[: form.components]))
        if magnitude >= BEYOND * form.high * (1.0 - 1e-6):
            bound = "its magnitude is at the largest plausible one, so that it stands for something else"
            return f"{name}: {bound}: not named"
    return "" if cause.excludes_zero else f"{name}: the 90 % interval of its magnitude contains zero: not named"


# Causes simulated


def blocks_of(question: FieldQuestion, causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """Return causes as blocks `[[effects]]` for the simulated machine.

    Clocks come last, because they shift all readings.
    """
    machine, groups = (
        question.machine.regressors.model.machine,
        tuple(p.group for p in question.machine.layout.proposals),
    )
    found = []
    for cause in sorted(causes, key=lambda c: c.proposal.clock):
        for block in _blocks_of(question, cause):
            try:
                _read(machine, block, groups)
            except ValueError:  # a size that is uncertain may come out implausible, or of the wrong sign
                continue
            found.append(block)
    return found


def _read(machine: Any, block: dict[str, Any], groups: tuple[Group, ...]) -> Any:  # noqa: ANN401 - see `imposed`
    begin, end = block.get("from_s", 0.0), block.get("until_s", np.inf)
    words = (machine, block["name"], block["at"], block["value"])
    return imposed(*words, shape=block.get("shape"), begin=begin, end=end, library=groups)


def _blocks_of(question: FieldQuestion, cause: Cause) -> Iterator[dict[str, Any]]:
    plain: dict[str, Any] = {"name": cause.proposal.name, "at": cause.proposal.at}
    plain |= {"shape": cause.proposal.shape} if cause.proposal.shape else {}
    course = cause.proposal.course
    if course is TimeCourse.WINDOWS:
        for sizes, block in zip(cause.sizes, np.argmax(cause.course, axis=1).tolist(), strict=True):
            yield from (plain | part for part in _window(question, cause, sizes, block))
    elif course is TimeCourse.CLOCK:
        yield plain | {"value": [float(cause.sizes[0, 0]), float(cause.sizes[1, 0]) / GROWTH_S]}
    elif course is TimeCourse.AFTER:
        for sizes, there in zip(cause.sizes, cause.course > 0.0, strict=True):
            if np.any(there):
                yield plain | {"value": sizes.tolist()} | _span(question, there)
    else:
        yield plain | {"value": cause.sizes.ravel().tolist()}


def _window(question: FieldQuestion, cause: Cause, sizes: Array, block: int) -> Iterator[dict[str, Any]]:
    """Yield the course of one block in PARTS intervals; a force at the teeth fades while the next one begins."""
    regressors = question.machine.regressors
    length = BLOCK_ROWS / regressors.rows_hz
    start = float(question.times[block]) - length / 2.0 - regressors.lag
    over = RAMP / 2.0 if cause.proposal.about.place is Place.TOOL else 0.0
    within = courses((np.arange(PARTS) + 0.5) / PARTS)
    for k, part in enumerate(within.T @ sizes.reshape(SHAPES, -1)):
        if cause.proposal.about.sign * part[0] < 0.0:  # a polynomial of an impossible sign is left out
            continue
        begin, end = start + np.array([k, k + 1]) * length / PARTS
        yield {"value": part.tolist(), "from_s": max(float(begin) - over, 0.0), "until_s": float(end) + over}


def _span(question: FieldQuestion, there: Mask) -> dict[str, float]:
    """Return begin and end [s] of a changed load: from the first to the last block in which it is present."""
    regressors, half = question.machine.regressors, BLOCK_ROWS / question.machine.regressors.rows_hz / 2.0
    numbers = np.flatnonzero(there)
    t = question.times[numbers]
    return {"from_s": max(float(t[0]) - half - regressors.lag, 0.0), "until_s": float(t[-1]) + half}


@dataclass(frozen=True)
class Simulated:
    """Gap before and after causes are switched on in the simulated machine.

    before:  residuals (T, R) [N m] of every recording without the causes. If the oil has another temperature, friction
             and sensor zeros are fitted
    after:   residuals (T, R) [N m] with them; the magnitudes of each span are fitted without that span
    closure: share of the gap's energy that is removed; of the gap that the parameters leave, if the question fits them;
             NaN where that gap is too small for a share
    low:     lower bound of its 90 % interval
    high:    upper bound of its 90 % interval
    """

    before: list[Array]
    after: list[Array]
    closure: float
    low: float
    high: float

    @property
    def removed(self) -> float:
        """Torque [N m, rms] that the causes remove."""
        squares = [float(np.nanmean(np.concatenate(e) ** 2)) for e in (self.before, self.after)]
        return float(np.sqrt(max(squares[0] - squares[1], 0.0)))

    @property
    def share(self) -> tuple[float, float, float]:
        """Closure with its interval; NaN where the interval is wider than WIDEST."""
        return (self.closure, self.low, self.high) if self.high - self.low <= WIDEST else (np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Simulation:
    """Simulation of the causes of one hypothesis, along the recordings of a question.

    question:  the recordings, not corrected
    candidate: the hypothesis, with the recordings corrected for its effects; None of incidents
    """

    question: FieldQuestion
    candidate: Candidate | None

    def run(self, causes: Sequence[Cause], rng: np.random.Generator) -> Simulated:
        """Return the gap before and after causes; incidents have the sizes of their own blocks.

        Where the machine is refitted (`FieldQuestion.refits`), the closure compares its fit without the causes with its
        fit beside them.
        """
        before = self._counted(self._residuals((), None))
        refit = after = before
        if any(not c.lasts for c in causes) or (causes and self.candidate is None):
            after = self._residuals(causes, None)
        elif causes:
            after = self._held_out(lambda kept: self._residuals(causes, kept))
            refit = self._held_out(self._refitted) if self._refits else before
        after, refit = (
            [np.where(np.isnan(a), np.nan, b) for a, b in zip(before, each, strict=True)] for each in (after, refit)
        )
        before = refit if self._has_other_oil else before  # the causes do not account for the oil
        machine = self.question.machine
        value, (low, high) = closure(
            np.concatenate([mean_squares(e) for e in refit]),
            np.concatenate([mean_squares(e) for e in after]),
            machine,
            rng,
        )
        return Simulated(before, after, value, low, high)

    @property
    def _refits(self) -> bool:
        return self.candidate is not None and self.question.refits(self.candidate.hypothesis.noise.conditions)

    @property
    def _has_other_oil(self) -> bool:
        return self.candidate is not None and self.candidate.hypothesis.noise.conditions.other_oil

    def _counted(self, residuals: list[Array]) -> list[Array]:
        """Return residuals (T, R) with NaN in rows with incident or contact beside the causes."""
        if self.candidate is None or not self.candidate.beside_contact:
            return residuals
        rows = self.candidate.counted()
        return [np.where(own[:, None], e, np.nan) for own, e in zip(rows, residuals, strict=True)]

    def _held_out(self, fitted: Callable[[Mask], list[Array]]) -> list[Array]:
        """Return residuals (T, R) in which each fold of spans is that of a fit to the other folds."""
        fold = (np.arange(len(self.question.times)) // SPAN) % FOLDS
        found = fitted(fold != 0)
        for k in range(1, FOLDS):
            other = fitted(fold != k)
            found = [
                self._chosen(a, b, fold == k, span)
                for a, b, span in zip(found, other, self.question.spans, strict=True)
            ]
        return found

    @staticmethod
    def _chosen(one: Array, other: Array, second: Mask, span: tuple[int, int]) -> Array:
        on = np.repeat(second[slice(*span)], BLOCK_ROWS)[: len(one)]
        return np.where(on[:, None], other, one)

    @cached_property
    def _corrected(self) -> FieldQuestion:
        """Question of the hypothesis, of its own: the corrected rows that it computes are freed with the simulation."""
        return (self.candidate.question if self.candidate else self.question).without_rows()

    def _residuals(self, causes: Sequence[Cause], kept: Mask | None) -> list[Array]:
        """Return residuals (T, R) with causes, their magnitudes fitted to the kept blocks (B,)."""
        if not causes:
            return self.question.residuals()
        sized, coefficients = self._fitted(causes, kept)
        effects = [
            _read(
                self.question.machine.regressors.model.machine,
                block,
                tuple(p.group for p in self.question.machine.layout.proposals),
            )
            for block in blocks_of(self.question, sized)
        ]
        seen = []
        for each in self.question.seen:
            load = self._load(each.recording.name, each.recording.load_kg, coefficients)
            try:
                rows = self.question.machine.regressors.simulated(each.recording, each.rows, effects, load)
            except ValueError:  # more load is spilled than carried: an impossible cause explains nothing
                rows = each.rows
            seen.append(replace(each, rows=rows))
        return replace(self.question, as_read=tuple(seen)).residuals(coefficients)

    def _load(self, name: str, load_kg: float, coefficients: Array) -> Array:
        found = np.array([load_kg, 0.0, 0.0, 0.0])
        if load_kg:
            at = self.question.machine.layout.size + CENTRE * self.question.loaded.index(name)
            found[1:] = -coefficients[at : at + CENTRE] * LOAD_CENTRE
        return found

    def _fitted(self, causes: Sequence[Cause], kept: Mask | None) -> tuple[list[Cause], Array]:
        """Return causes with magnitudes fitted to the kept blocks, and the coefficients (K'+1,) of their residual."""
        if self.candidate is None or any(not c.lasts for c in causes):
            return list(causes), self.question.plain
        other, whole = self._corrected, self.candidate.hypothesis
        forms = tuple(c.form for c in causes if c.form is not None)
        cases = [self._case(other, mask) for mask in (None, kept)]
        first, now = (case.fitted(forms, case.state(whole.noise))[1] for case in cases)
        sized, more, k = [], np.zeros(other.size + (len(other.refined.unit) if other.refined else 0)), 0
        for cause in causes:
            form = other.forms[cause.form or 0]
            m, unit = len(form.columns), other.unit_of(cause.form or 0)
            change = form.bounded(now.sizes[k : k + m] * unit) - form.bounded(first.sizes[k : k + m] * unit)
            sizes = form.bounded(cause.sizes.ravel() + change).reshape(cause.sizes.shape)
            more[list(form.columns)] = now.more[k : k + m]
            sized.append(replace(cause, sizes=sizes))
            k += m
        return sized, other.beside(more, cases[1], whole.noise.conditions)

    def _case(self, question: FieldQuestion, kept: Mask | None) -> Likelihood:
        """Return the likelihood of a question's kept blocks (B,), with the incident beside the causes."""
        case = question.likelihood(kept)
        nuisance = self._nuisance(kept)
        return case if nuisance is None else replace(case, nuisance=nuisance)

    def _refitted(self, kept: Mask) -> list[Array]:
        """Return residuals (T, R) without causes, the parameters fitted to the kept blocks (B,)."""
        if self.candidate is None:
            return self.question.residuals()
        plain, conditions = self.question, self.candidate.hypothesis.noise.conditions
        if self.candidate.question.laid is not None:
            plain = self.candidate.question.uncorrected().with_refined(None)
        return self.question.residuals(plain.beside(np.zeros(plain.size), self._case(plain, kept), conditions))

    def _nuisance(self, mask: Mask | None) -> Nuisance | None:
        """Return the nuisance of the incident's blocks, or of those among some blocks (B,)."""
        incident = self.candidate.incident if self.candidate else None
        if incident is None:
            return None
        return incident.nuisance if mask is None else incident.nuisance.only(mask[incident.sizes > 0.0])


def closure(
    before: Array, after: Array, machine: HealthyMachine, rng: np.random.Generator
) -> tuple[float, tuple[float, float]]:
    """Return 1 - (MSE after - floor) / (MSE before - floor), joints weighted by their floor, and its 90 % interval.

    The interval is a bootstrap over spans of blocks (B, R). The floor lies between the residual of references that were
    fitted and of references that were not: its draws are mixtures of both. Where the gap of all joints together is
    below SMALL_GAP of the floor's energy, the joints with a gap count alone; NaN if there is none.
    """
    unit = np.nanmean(machine.floor_unseen, axis=0)
    whole = [x / unit for x in (before, after, machine.floor_seen, machine.floor_unseen)]
    counted = np.isfinite(before)
    level = np.sqrt(np.sum(before, axis=0, where=counted) / np.maximum(np.sum(counted, axis=0), 1))
    gap = ~without_gap(level, machine.floor.rms) & np.isfinite(unit)
    for joints in (np.ones_like(gap), gap):
        a, b, seen, unseen = (_in_spans(x[:, joints]) for x in whole)
        kept = np.all([np.any(np.isfinite(x), axis=1) for x in (a, b)], axis=0)
        a, b = (np.nanmean(x[kept], axis=1) for x in (a, b))
        seen, unseen = (np.nanmean(x[np.any(np.isfinite(x), axis=1)], axis=1) for x in (seen, unseen))
        middle = float(np.mean(seen) + np.mean(unseen)) / 2.0 if np.any(joints) else np.nan
        if len(a) and float(np.mean(a)) - middle >= SMALL_GAP * middle:
            break
    else:
        return float("nan"), (float("nan"), float("nan"))
    each = []
    for _ in range(DRAWS):
        k, m, n = (rng.integers(0, len(x), len(x)) for x in (a, seen, unseen))
        mixed = rng.uniform()
        each.append(_share(a[k], b[k], mixed * float(np.mean(seen[m])) + (1.0 - mixed) * float(np.mean(unseen[n]))))
    low, high = np.quantile(each, [(1.0 - CREDIBLE) / 2.0, (1.0 + CREDIBLE) / 2.0])
    return _share(a, b, middle), (float(low) - UNSEEN_SPREAD[0], min(float(high) + UNSEEN_SPREAD[1], 1.0))


def _share(before: Array, after: Array, floor: float) -> float:
    excess = float(np.mean(before)) - floor
    return min(1.0 - (float(np.mean(after)) - floor) / excess, 1.0) if excess > 0.0 else 0.0


def _in_spans(squares: Array) -> Array:
    count = -(-len(squares) // SPAN)
    padded = np.full((count * SPAN, squares.shape[1]), np.nan)
    padded[: len(squares)] = squares
    return padded.reshape(count, SPAN * squares.shape[1])


def least_closure(law_error: float) -> float:
    """Return the smallest closure at which a cause is likelier right than wrong.

    The remaining share of the gap's energy has the density exp(-x / m) / m under the right law, with m = 2 k^2. Under a
    wrong law it is uniform between 0 and 1. The densities are equal at the closure 1 - x = 1 + m ln m. That closure is
    smallest at m = 1 / e (k = 0.43); a larger k counts as this one.
    law_error: k, relative error of the torque of its law
    """
    mean = min(2.0 * law_error**2, np.exp(-1.0))
    return float(1.0 + xlogy(mean, mean))


def objection_to_simulation(question: FieldQuestion, causes: Sequence[Cause], found: Simulated) -> str:
    """Return a sentence why the simulation excludes causes; empty if it does not.

    The closure of the causes must be positive and reach `least_closure`; of several causes, that of the least accurate
    law. The difference between two recordings of a healthy machine is added to the closure. No joint and no weight may
    become worse by more than that difference.
    """
    names = " and ".join("{}@{}".format(*cause.key) for cause in causes)
    closed = found.high if all(c.lasts for c in causes) else found.closure
    if np.isnan(closed):
        return f"no difference remains that {names} could explain: not named"
    if found.closure <= 0.0:
        return f"simulated with {names}, the difference to the recordings does not become smaller: not named"
    floor, machine = question.machine.floor.rms, question.machine.regressors.model.machine
    spread, known = question.machine.spread_of_joints, floor > 0.0
    before, after = (rms(each) ** 2 for each in (found.before, found.after))
    gap = float(np.mean(before[known] / floor[known] ** 2)) - 1.0
    healthy = float(np.mean(spread[known]) / max(gap, SAME_MACHINE))
    if closed + healthy < min(least_closure(c.proposal.about.torque_error) for c in causes):
        return f"simulated with {names}, much of the difference to the recordings remains: not named"
    worse = after - before > spread * floor**2
    if np.any(worse):
        joint = machine.links[machine.rows[int(np.argmax(worse))]].name
        return f"simulated with {names}, the {joint} differs more from the recordings than before: not named"
    unit = _weight_of_floor(question)
    weight_before, weight_after = (weight_error(question, each) / unit for each in (found.before, found.after))
    if weight_after**2 - weight_before**2 > np.min(spread):
        return f"simulated with {names}, weights are more wrong than before: not named"
    return ""


def _weight_of_floor(question: FieldQuestion) -> float:
    """Return the weight [kg] whose torque along the recordings is the noise floor (mean square of joints)."""
    mass = INCIDENTAL.index("load.mass")
    torque = rms([np.where(np.isfinite(s.rows.residual), s.rows.incidental[..., mass], np.nan) for s in question.seen])
    return float(1.0 / np.sqrt(np.mean((torque / question.machine.floor.rms) ** 2)))


def weight_error(question: FieldQuestion, residuals: Sequence[Array]) -> float:
    """Return the weighing error [kg], rms over the recordings, that corresponds to residuals (T, R) [N m]."""
    names = ("load.mass", "load.X", "load.Z", "load.J")
    pairs = [(s, e) for s, e in zip(question.seen, residuals, strict=True) if np.any(np.isfinite(e))]
    each = [_incident_fit(question, s.rows.incidental, e, names)[0] for s, e in pairs] or [0.0]
    return float(np.sqrt(np.mean(np.square(each))))


def force_error(question: FieldQuestion, residuals: Sequence[Array]) -> float:
    """Return the steady force at the teeth [N], rms over blocks, that corresponds to residuals (T, R) [N m]."""
    each = []
    for s, e in zip(question.seen, residuals, strict=True):
        for k in range(0, len(e), BLOCK_ROWS):
            part = slice(k, k + BLOCK_ROWS)
            if np.any(np.isfinite(e[part])):
                each.append(_incident_fit(question, s.rows.incidental[part], e[part], ("tip.x.0", "tip.z.0")))
    return float(np.sqrt(np.mean(np.sum(np.square(each), axis=1)))) if each else 0.0


def _incident_fit(
    question: FieldQuestion, incidental: NDArray[np.float32], residual: Array, names: Sequence[str]
) -> Array:
    """Return the sizes (I,) of incidental columns fitted to a residual (T, R), joints weighted by their floor."""
    columns, good = [INCIDENTAL.index(name) for name in names], np.isfinite(residual)
    unit, floor = question.machine.layout.typical[columns], question.machine.floor.rms
    x = (incidental[..., columns] * unit / floor[:, None])[good]
    y = (residual / floor)[good]
    return np.asarray(np.linalg.solve(x.T @ x + np.eye(len(unit)), x.T @ y) * unit)


# Where


@dataclass(frozen=True)
class Spot:
    """Residual of a joint in a regime.

    joint:    name of the link
    regime:   name of the rows, such as "loaded"
    residual: rms in these rows [N m]
    healthy:  rms of a healthy machine in these rows [N m]
    share:    share of the joint's excess energy
    p:        probability of such a residual on a machine with ENERGY_MARGIN times the healthy energy
    found:    whether it is a discovery at a false discovery rate of 5 %
    """

    joint: str
    regime: str
    residual: float
    healthy: float
    share: float
    p: float
    found: bool

    @property
    def floors(self) -> float:
        """Residual in noise floors."""
        return self.residual / max(self.healthy, 1e-9)


def where(question: FieldQuestion, residuals: Sequence[Array]) -> list[Spot]:
    """Return joints and regimes, sorted by residual over noise floor, the largest first."""
    machine = question.machine
    model, spots = machine.regressors.model, []
    for r, joint in enumerate(model.machine.rows):
        floor = float(machine.floor.rms[r])
        rows = sum(int(np.sum(np.isfinite(e[:, r]))) for e in residuals)
        excess = float(rms(residuals)[r] ** 2 - floor**2) * rows
        for k, name in enumerate(REGIMES):
            healthy = (
                floor
                if machine.regimes is None or not np.isfinite(machine.regimes[k, r])
                else float(machine.regimes[k, r])
            )
            spans, energy, count = [], 0.0, 0
            for s, e in zip(question.seen, residuals, strict=True):
                here = np.where(regime(name, s.rows, s.recording, model.acting[r][0], joint), e[:, r], np.nan)
                for first in range(0, len(here), SPAN * BLOCK_ROWS):
                    part = here[first : first + SPAN * BLOCK_ROWS]
                    part = part[np.isfinite(part)]
                    if len(part) >= FEWEST_ROWS:
                        spans.append(float(np.mean(part**2)))
                        energy, count = energy + float(np.sum(part**2)), count + len(part)
            if len(spans) >= 2:
                p = _p_value(np.log(np.array(spans) + 1e-12) - np.log(ENERGY_MARGIN * healthy**2))
                share = (energy - healthy**2 * count) / excess if excess > 0.0 else 0.0
                rest = float(np.sqrt(energy / count))
                spots.append(
                    Spot(
                        model.machine.links[joint].name,
                        name,
                        rest,
                        healthy,
                        float(np.clip(share, 0.0, 1.0)),
                        p,
                        found=False,
                    )
                )
    order = sorted(spots, key=lambda s: s.p)
    last = max((k for k, s in enumerate(order, 1) if s.p <= FALSE_DISCOVERIES * k / len(order)), default=0)
    marked = [replace(s, found=k < last) for k, s in enumerate(order)]
    ratio = dict(
        zip((model.machine.links[j].name for j in model.machine.rows), rms(residuals) / machine.floor.rms, strict=True)
    )
    return sorted(marked, key=lambda s: (-ratio[s.joint], -s.floors))


def _p_value(logs: Array) -> float:
    """Return the one-sided probability (Student) that the mean log energy of spans exceeds 0 by chance."""
    error = max(float(np.std(logs, ddof=1)), 0.1) / np.sqrt(len(logs))
    return float(stats.t.sf(np.mean(logs) / error, len(logs) - 1))


@dataclass(frozen=True)
class Picture:
    """Pressure over time at the joint with the largest gap: measured, and simulated before and after the causes.

    cylinder: its name
    t:        (T,) [s]
    measured: (T,) head-side pressure [bar]
    before:   (T,) head-side pressure simulated without the causes [bar]
    after:    (T,) head-side pressure simulated with the causes [bar]
    """

    cylinder: str
    t: Array
    measured: Array
    before: Array
    after: Array


def worst_place(question: FieldQuestion, found: Simulated) -> Picture | None:
    """Return the fifteen seconds with the largest residual over its floor; None where no cylinder moves the joint."""
    machine = question.machine.regressors.model.machine
    ratio = rms(found.before) / question.machine.floor.rms
    r = int(np.argmax(ratio))
    joint, width = machine.rows[r], SPAN * BLOCK_ROWS
    best = (-1.0, 0, 0)
    for n, e in enumerate(found.before):
        for first in range(0, max(len(e) - width, 1), BLOCK_ROWS):
            part = e[first : first + width, r]
            energy = float(np.nansum(part**2))
            best = max(best, (energy, n, first))
    _, n, first = best
    seen, span = question.seen[n], slice(first, first + width)
    own = next((c for c, joints in enumerate(machine.spans) if joint in joints and machine.forces_measured[c]), None)
    if own is None:
        return None
    lever = machine.geometry(seen.rows.posture[span]).lever[:, own, joint]
    scale = np.where(np.abs(lever) > 1e-3, lever, np.nan) * machine.cylinders[own].area_head * BAR
    measured = seen.rows.force[span, own] / machine.cylinders[own].area_head / BAR
    before, after = (measured - e[span, r] / scale for e in (found.before[n], found.after[n]))
    return Picture(machine.cylinders[own].name, seen.rows.t[span], measured, before, after)


# Shape of an unexplained residual


def quantities(question: FieldQuestion, row: int) -> tuple[list[tuple[str, str, Array]], Array]:
    """Return quantities on which a residual of a joint may depend, and the direction (T,) of its cylinder, -1..1.

    Each quantity has a name, a detail and values (T,).
    """
    machine, own = question.machine.regressors.model.machine, question.machine.regressors.model.acting[row][0]
    rows = [s.rows for s in question.seen]
    speed, force = np.concatenate([r.speed for r in rows]), np.concatenate([r.force for r in rows])
    found = [
        ("position", "", np.concatenate([r.posture[:, machine.rows[row]] for r in rows])),
        ("speed", "", np.arcsinh(speed[:, own] / 0.01)),
        *(
            ("load", f"force of the {machine.cylinders[c].name} cylinder", force[:, c])
            for c in sorted(range(len(machine.cylinders)), key=lambda c: c != own)
        ),
        ("time", "", np.concatenate([r.t for r in rows])),
    ]
    return found, np.asarray(np.tanh(speed[:, own] / 0.01))


def unexplained_shape(question: FieldQuestion, residuals: Sequence[Array]) -> dict[str, Any]:
    """Return the quantity with which an unexplained residual varies, at the joint that has most of it.

    The share of each quantity is the excess energy that a curve over it predicts on spans that it was not fitted to.
    """
    machine, floor = question.machine.regressors.model.machine, question.machine.floor.rms
    row = int(np.argmax(rms(residuals) / floor))
    span = np.concatenate([1000 * k + np.arange(len(e)) // (SPAN * BLOCK_ROWS) for k, e in enumerate(residuals)])
    torque = np.concatenate([e[:, row] for e in residuals])
    good = np.isfinite(torque)
    excess = max(float(np.mean(torque[good] ** 2) - floor[row] ** 2), 1e-9)
    each, direction = quantities(question, row)
    found = []
    for name, detail, values in each:
        share = _predicted_energy(torque[good], _curve(values, direction)[good], span[good] % 2) / excess
        found.append((name, detail, float(np.clip(share, 0.0, 1.0))))
    found.sort(key=lambda f: -f[2])
    if found[0][2] < LEAST_SHARE:
        few = _in_few_blocks(torque, float(floor[row])) / excess
        found.insert(0, ("moments", "", float(np.clip(few, 0.0, 1.0))) if few > HALF else ("none", "", 0.0))
    (name, detail, share), *others = found
    at = machine.links[machine.rows[row]].name
    alternatives = [{"of": n, "detail": d, "share": s} for n, d, s in others if s][:3]
    return {"at": at, "of": name, "detail": detail, "share": share, "alternatives": alternatives}


def _curve(x: Array, direction: Array) -> Array:
    """Return the columns (T, 16) of a smooth curve over x (T,), and of another one that reverses with the direction."""
    low, high = np.percentile(x, [1.0, 99.0])
    bends = legvander(np.clip(2.0 * (x - low) / max(high - low, 1e-9) - 1.0, -1.0, 1.0), 7)
    return np.hstack([bends, bends * direction[:, None]])


def _predicted_energy(torque: Array, columns: Array, fold: Array) -> float:
    """Return the mean square that columns remove from each half when fitted to the other half."""
    rest = 0.0
    for k in (0, 1):
        if not np.any(fold == k) or not np.any(fold != k):
            return 0.0
        sizes = np.linalg.lstsq(columns[fold != k], torque[fold != k], rcond=1e-6)[0]
        rest += float(np.sum((torque[fold == k] - columns[fold == k] @ sizes) ** 2))
    return float(np.mean(torque**2)) - rest / len(torque)


def _in_few_blocks(torque: Array, floor: float) -> float:
    """Return the mean square above the noise floor in the worst tenth of the blocks."""
    blocks = np.array_split(torque, -(-len(torque) // BLOCK_ROWS))
    above = np.sort([float(np.nansum(b**2 - floor**2)) for b in blocks])[::-1]
    return float(np.sum(above[: -(-len(above) // 10)])) / max(int(np.sum(np.isfinite(torque))), 1)


# Magnitudes that would be detected


def smallest_detectable(found: Found) -> dict[Key, float]:
    """Return the smallest detectable magnitude [SI] of each effect at each location, of its most visible form.

    It is DETECTABLE standard errors on a healthy machine; infinite where the recordings do not show the effect.
    """
    case, smallest = found.case, dict[Key, float]()
    state = case.state(found.healthy.hypothesis.noise)
    for form in case.forms:
        if not form.columns or form.columns[0] >= len(case.unit):
            continue
        k = form.columns[0]
        information = float(state.information([k])[0, 0])
        error = float(case.unit[k]) * information**-0.5 if information > 0.0 else np.inf
        smallest[form.key] = min(DETECTABLE * error, smallest.get(form.key, np.inf))
    return smallest


# Refit of the model's parameters


@dataclass(frozen=True)
class ParameterChange:
    """Parameter of the model before and after a refit.

    name:   of the parameter
    unit:   of the parameter
    before: value before the refit
    after:  value after it
    torque: torque that the change adds along the recordings [N m, rms]
    shift:  the change in standard errors of the data sheet
    """

    name: str
    unit: str
    before: float
    after: float
    torque: float
    shift: float


@dataclass(frozen=True)
class Refit:
    """Gap before and after the model's parameters are fitted to the recordings.

    before:  (R,) residual torque before the fit [N m, rms]
    after:   (R,) residual torque after it [N m, rms]
    share:   share of the gap's energy above the noise floor that the fit removes; of a data sheet of the whole energy
    changes: the parameters, the one with the most torque first
    values:  (F,) changes of the parameters and of the bars of linkages, in SI units
    """

    before: Array
    after: Array
    share: float
    changes: tuple[ParameterChange, ...]
    values: Array

    @property
    def clear(self) -> tuple[ParameterChange, ...]:
        """The changes that add more torque than the fit leaves at any joint; the largest one if there are none.

        Empty if the fit does not reduce the difference, as with contact or unknown loads, which hide the parameters.
        """
        if self.share <= 0.0:
            return ()
        found = tuple(change for change in self.changes if change.torque > float(np.max(self.after)))
        return found or self.changes[:1]


def refitted(question: FieldQuestion) -> Refit:
    """Return the reported residual before and after a least-squares refit of the parameters, with their prior."""
    layout, machine = question.machine.layout, question.machine
    size, residuals = layout.first, question.residuals()
    rows = np.maximum(np.sum([np.sum(np.isfinite(e), axis=0) for e in residuals], axis=0), 1)
    unit = layout.unit[:size]
    normal = np.diag(unit**-2.0) * float(np.mean(machine.floor.rms**2)) / float(np.sum(rows))
    score, columns = np.zeros(size), []
    for s, e in zip(question.seen, residuals, strict=True):
        x = np.concatenate([s.rows.base, s.rows.bars], axis=-1)
        columns.append(x)
        for r in range(e.shape[1]):
            good, part = np.isfinite(e[:, r]), 1.0 / (rows[r] * len(rows))
            normal += part * x[good, r].T @ x[good, r]
            score += part * x[good, r].T @ e[good, r]
    values = np.linalg.solve(normal, score)
    after = rms([e - x @ values for x, e in zip(columns, residuals, strict=True)])
    count = len(machine.regressors.parameters)
    old = machine.regressors.parameters + machine.values[:count]
    changes = _changes(machine.regressors.model, old, old + values[:count], [s.rows.base for s in question.seen])
    before = rms(residuals)
    share = _energy_share(before, after, machine.floor.rms)
    return Refit(before, after, share, changes, np.asarray(values, dtype=np.float64))


def refitted_sheet(sheet: FieldQuestion, fitted: FieldQuestion) -> Refit:
    """Return the gap of a data sheet before and after masses and friction are identified from the recordings.

    sheet:  the recordings compared with the data sheet, which has no friction
    fitted: the same recordings compared with parameters fitted to them
    """
    own, other = sheet.machine.regressors, fitted.machine.regressors
    names = [p.name for p in other.model.parameters]
    old = np.zeros(len(names))
    for parameter, value in zip(own.model.parameters, own.parameters.tolist(), strict=True):
        old[names.index(parameter.name)] = value
    before, after = rms(sheet.residuals()), rms(fitted.residuals())
    changes = _changes(other.model, old, other.parameters, [s.rows.base for s in fitted.seen])
    share = 1.0 - float(np.sum(after**2) / max(float(np.sum(before**2)), 1e-300))
    return Refit(before, after, share, changes, other.parameters - old)


def _energy_share(before: Array, after: Array, floor: Array) -> float:
    known = floor > 0.0
    excess, left = (float(np.mean((e[known] / floor[known]) ** 2)) - 1.0 for e in (before, after))
    return min(1.0 - left / excess, 1.0) if excess > 0.0 else 0.0


def _changes(model: Model, before: Array, after: Array, base: Sequence[Array]) -> tuple[ParameterChange, ...]:
    columns = np.concatenate([b[..., : len(before)] for b in base])
    torque = np.sqrt(np.nanmean(np.nansum((columns * (after - before)) ** 2, axis=1), axis=0))
    shift = (after - before) / np.sqrt(np.diag(model.prior.covariance))
    each = zip(model.parameters, *(x.tolist() for x in (before, after, torque, shift)), strict=True)
    changes = [ParameterChange(p.name, p.unit, *numbers) for p, *numbers in each]
    return tuple(sorted(changes, key=lambda change: -change.torque))
