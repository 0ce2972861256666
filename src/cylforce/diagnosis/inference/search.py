"""The search: noise floor, what the machine always was, hypotheses with their evidence, the most probable ones looked
at again at their sizes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from cylforce.diagnosis.columns.floor import noise_floor
from cylforce.diagnosis.columns.problem import Identified, Problem, Seen, looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference import candidates
from cylforce.diagnosis.inference.asking import Asking, identified_floor, noisy
from cylforce.diagnosis.inference.at_sizes import AtSizes
from cylforce.diagnosis.inference.beam import screened, searched
from cylforce.diagnosis.inference.discrepancy import Sums
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.inference.moments import Blocks, changed, digging, happening, likelier
from cylforce.diagnosis.inference.posterior import CONTACT, UNKNOWN, Asked, Happened
from cylforce.diagnosis.inference.residuals import clean as cleaned
from cylforce.diagnosis.inference.residuals import counting, hung, residuals, unforced
from cylforce.diagnosis.inference.working import AtWork, at_work
from cylforce.diagnosis.numbers import EVERYDAY, GAP, HALF, IDENTIFIED, LAW, SELDOM
from cylforce.diagnosis.recordings.glitches import NAME as GLITCH
from cylforce.diagnosis.recordings.glitches import Jumping, jumping
from cylforce.effects.incidents.payload_spill import PayloadSpill
from cylforce.effects.library import LIBRARY, Group, Proposal, proposals
from cylforce.effects.unknown import UNKNOWN_TORQUES
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

SPILL = PayloadSpill().about.name
AGAIN = 6  # hypotheses that are looked at again at their sizes
Watch = Callable[[str], None]


def asked(
    machine: Machine, library: tuple[Group, ...] = LIBRARY, jumps: Sequence[Jumping] = ()
) -> tuple[Proposal, ...]:
    """Everything that is asked of the recordings: the library's proposals, sensors whose readings were seen to jump,
    and torques of which nothing is known."""
    lasting = tuple(group for group in library if group[0].about.name != GLITCH)
    seen = [each.proposal for each in jumps] if len(lasting) < len(library) else []
    return (*proposals(machine, lasting), *seen, *proposals(machine, UNKNOWN_TORQUES))


def examined(
    viewer: Viewer,
    faulty: Sequence[Recorded | Seen],
    clean: Sequence[Recorded | Seen],
    rng: np.random.Generator,
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = lambda _: None,
    known: Array | None = None,
    only: tuple[str, str] | None = None,
    everyday: Mapping[str, float] = EVERYDAY,
    identified: Identified | None = None,
) -> Found:
    """What may explain what the model leaves of the faulty recordings; `known` (P,): standard errors of the viewer's
    tares, by default the data sheet's; `only`: name and place ("": any) of the one effect that may be a cause;
    `identified`: accuracy of an identification, of a machine without references."""
    field, references = ([r.recorded if isinstance(r, Seen) else r for r in group] for group in (faulty, clean))
    jumps = jumping(viewer.model.machine, field, references, viewer.model.filters.rate_hz)
    wanted = asked(viewer.model.machine, library, jumps)
    watch("columns of every effect")
    groups = (references, field) if jumps else (clean, faulty)  # what was seen lacks the columns of jumps
    seen = [looked_at(viewer, group, wanted) for group in groups]
    spread = np.sqrt(np.diag(viewer.model.prior.covariance)) if known is None else known
    problem = Problem(viewer.model, spread, wanted, seen[0], seen[1], tares=viewer.tares, identified=identified)
    floor = identified_floor(viewer, problem, identified, rng) if identified else noise_floor(problem)
    watch("noise of the columns")
    question = Asking(viewer, problem, floor, noisy(viewer, problem, floor, rng)).believed
    return _Search(question, dict(everyday), only, watch, {j.proposal.where: j.nats for j in jumps}, rng).found()


@dataclass(frozen=True)
class _Search:
    """A search in progress."""

    plain: Asking
    everyday: dict[str, float]
    only: tuple[str, str] | None
    watch: Watch
    jumps: Mapping[int, float]  # evidence [nats] of the number of jumps of a reading, by its signal
    rng: np.random.Generator

    @cached_property
    def _machine(self) -> InOrder:
        return self.plain.machine(self.everyday)

    @cached_property
    def _first(self) -> Inference:
        """The question without a change of load."""
        return self._put(self.plain)

    @cached_property
    def _values(self) -> Array:
        """The machine's columns that last (K,) [of their spread], as its references tell them by the fit of the noise
        floor, without references as it was identified, and where the field's loads hang and how its base goes."""
        problem, known = self.plain.problem, cleaned(self.plain).values
        left = counting(self.plain, residuals(problem, known))
        known = known + hung(problem, self.plain.floor, left)
        return np.asarray(known / problem.spread[: problem.lasting])

    def _left(self, case: Inference) -> Array:
        """Coefficients (K+1,) of what the machine as it was leaves, nothing else fitted to the recording."""
        return np.concatenate([-self._values, -case.mean[len(self._values) :], [1.0]])

    @cached_property
    def _question(self) -> Asking:
        """With the instant at which a known load most probably changed."""
        step = changed(self.plain, self._first, self._left(self._first))
        return replace(self.plain, step=step) if step else self.plain

    @cached_property
    def _case(self) -> Inference:
        if self._question.step is None:
            return self._first
        question = self._question
        recording = question.sums(question.problem.faulty, question.noisy.faulty)
        return replace(self._with_step(question.problem, recording), told=candidates.support(question, self.jumps))

    def _with_step(self, problem: Problem, recording: Sums) -> Inference:
        """A problem's recordings, by their statistics, with what the references show."""
        question = replace(self._question, problem=problem)
        case, size = self._machine.asked(self._first.sums), len(question.scene.spread)
        more = size - len(case.mean)
        covariance = np.zeros((size, size))
        covariance[: size - more, : size - more] = case.covariance
        mean, everyday = (np.append(each, np.zeros(more)) for each in (case.mean, case.everyday))
        return replace(case, scene=question.scene, sums=recording, mean=mean, covariance=covariance, everyday=everyday)

    def _wanted(self, question: Asking) -> list[int]:
        """The forms that may be a cause."""
        forms = [column for _, column in question.forms]
        name, at = self.only or ("", "")
        if not name and self.plain.problem.from_sheet:  # it cannot tell errors of sensors from its own
            return [k for k, f in enumerate(forms) if f.name in IDENTIFIED]
        return [k for k, f in enumerate(forms) if not name or (f.name == name and at in ("", f.at))]

    @cached_property
    def _candidates(self) -> list[int]:
        """Return the forms that may be a cause and act at a joint with a gap; with `only`, at any joint."""
        wanted, unit = self._wanted(self._question), self.plain.problem.spread[: len(self._values)]
        still = set() if self.only else candidates.quiet(self.plain, self._values * unit)
        return candidates.showing(self._question, self._case, wanted, still)

    def found(self, beside: bool = True) -> Found:
        """Everything; `beside`: also what lasts beside what happens at moments."""
        self.watch("hypotheses")
        case, wanted = self._case, self._candidates
        when = happening(self._question, case, self._left(case), self.only)
        hypotheses = searched(case, wanted)
        happened = tuple(each for each, _ in when)
        told = self._told_of(case, tuple(hypotheses), happened)
        apart = beside and bool(self.plain.problem.clean) and self.plain.aside is None and not self.only
        first = likelier(self._question, case, told, when) if apart else None
        if first and told.slight(first[0]):  # what is everyday hides nothing
            return self._beside(first[1]).found()
        known = {h.which for h in hypotheses}
        jumps = [p for p in wanted if self._question.forms[p][1].name == GLITCH]  # told by their number, too
        hypotheses += [case.likeliest((p,), case.usual) for p in jumps if (p,) not in known]
        work = self._at_work(hypotheses, happened)
        if work and work[0].share > SELDOM:
            return self._working(*work)
        if first and (other := self._lasting(*first)):
            return other
        if work:
            happened = self._with_work(happened, *work)
        self.watch("effects at their sizes")
        told, looked = self._again(case, self._told_of(case, tuple(hypotheses), happened))
        blocks = {each.key: where for each, where in when}
        least, plain = case.detectable(told.none.noise), (self.plain, self._first)
        return Found(self._question, self._machine, case, told, looked, blocks, digging(told), least, plain)

    def _lasting(self, happened: Happened, blocks: Blocks) -> Found | None:
        """The same without the blocks in which something happens, if something that lasts shows in the others, where
        the machine does not work. That is wrong with the machine, and comes first."""
        other = self._beside(blocks).found()
        beside = replace(other.asked, incident=happened.key)
        if other.working or not beside.lasts:
            return None
        return replace(other, asked=beside, otherwise=partial(self.found, False))

    def _at_work(
        self, hypotheses: Sequence[Hypothesis], happened: Sequence[Happened]
    ) -> tuple[AtWork, Hypothesis] | None:
        """The machine in order at work, if this is likelier than all that was found, and leaves less of what counts:
        loads and contact together may hide each other from all that is asked by itself. Where references show the
        machine at nothing but work, they tell too little of it to judge by, and it works as it did there."""
        found = [(h.log, h.rest) for h in hypotheses] + [(h.log, h.rest) for h in happened]
        least, unit = min(rest for _, rest in found), self.plain.problem.spread[: len(self._values)]
        worked = self.plain.problem.at_work > SELDOM
        if least <= GAP and not worked:
            return None
        idling = self._idling
        if not (work := at_work(self.plain, self._values * unit, self._put, self.rng, idling)):
            return None
        idle = work.case.likeliest((), work.case.usual)
        if idling:  # each recording was judged by itself
            return (work, idle) if work.share > SELDOM else None
        likelier = least > GAP and idle.log > max(log for log, _ in found) and idle.rest < least
        return (work, idle) if likelier or (worked and work.share > SELDOM) else None

    @cached_property
    def _idling(self) -> frozenset[str]:
        """The recordings, of several, in which nothing but what lasts is found, each diagnosed by itself: they count in
        full beside those in which the machine works."""
        names = {seen.recorded.name for seen in self.plain.problem.faulty}
        return frozenset(n for n in names if len(names) > 1 and self._in(candidates.recorded(self.plain, n)).idles)

    @property
    def idles(self) -> bool:
        """Return whether the machine neither works in the recordings nor something happens at moments."""
        case = self._case
        happened = tuple(each for each, _ in happening(self._question, case, self._left(case), self.only))
        hypotheses = searched(case, self._candidates)
        told, lasts = self._told_of(case, tuple(hypotheses), happened), max(h.log for h in hypotheses)
        at_moments = any(h.log > lasts and not told.slight(h) for h in happened)
        return not at_moments and self._at_work(hypotheses, happened) is None

    def _with_work(self, happened: tuple[Happened, ...], work: AtWork, idle: Hypothesis) -> tuple[Happened, ...]:
        """What may happen at moments, with those in which loads or contact hide the machine: contact, if forces at the
        teeth explain them as well as a law is known, and most is no load. (No polynomial changes as fast.)"""
        left = residuals(self.plain.problem, self._values * self.plain.problem.spread[: len(self._values)])
        rows = [each[each >= 0] for each in work.question.layout or ()]
        push = work.lifts < HALF * work.share and unforced(self.plain, left, rows) <= LAW
        own = [each for each in happened if push and each.key[0] == CONTACT and each.log < idle.log]
        others = tuple(each for each in happened if each not in own)
        return (*others, Happened(own[0].key if own else UNKNOWN, idle.log, work.share, idle.rest))

    def _spills(self, p: Proposal) -> bool:
        """Whether it is a load that falls out, and asked."""
        asked = not self.plain.problem.from_sheet if not self.only else self.only in ((p.name, p.at), (p.name, ""))
        return p.name == SPILL and asked

    def _put(self, question: Asking) -> Inference:
        """The question put to the field's rows that count."""
        recording = question.sums(question.problem.faulty, question.noisy.faulty)
        return replace(self._machine.asked(recording), told=candidates.support(question, self.jumps))

    def _working(self, work: AtWork, idle: Hypothesis) -> Found:
        """What may be the cause beside loads and contact of which nothing is known. It is not looked at again at its
        size: where loads hang, what bends is small beside what its columns leave open."""
        gaps = work.same.rests(self._left(work.same), work.same.usual)
        gap, still = float(np.max(gaps)), set() if self.only else candidates.joints_without_gap(gaps)
        wanted = candidates.showing(self.plain, work.case, self._wanted(self.plain), still)
        if not self._idling:  # a recording in which nothing hangs shows masses in and on the tool
            wanted = [p for p in wanted if not candidates.hangs(self.plain, self.plain.forms[p][0])]
        lost = next((work.lost(idle, gap, p) for p in self.plain.problem.proposals if self._spills(p)), None)
        told = self._told_of(work.case, tuple(searched(work.case, wanted)), (lost.happened,) if lost else ())
        told, least, plain = replace(told, gap=gap), work.case.detectable(told.none.noise), (work.question, work.case)
        return Found(work.question, self._machine, work.case, told, {}, {}, True, least, plain, lost)

    def _told_of(self, case: Inference, hypotheses: tuple[Hypothesis, ...], happened: tuple[Happened, ...]) -> Asked:
        gap = case.rest(self._left(case), case.usual)
        shown = len({seen.recorded.name for seen in self.plain.problem.clean})
        fields = self.plain.problem.of_the_field
        unsure, only = self._first.uncertain(fields), self.only is not None
        loaded = any(seen.recorded.load > 0.0 for seen in self.plain.problem.faulty)
        return Asked(case.scene.forms, hypotheses, happened, case.usual, gap, shown, unsure, only, loaded)

    def _beside(self, blocks: Blocks) -> "_Search":
        """The same search where some blocks do not count."""
        return self._in(replace(self.plain, aside=blocks))

    def _in(self, plain: Asking) -> "_Search":
        """Return a search of the same machine with another question."""
        other = replace(self, plain=plain)
        other.__dict__["_machine"] = self._machine
        return other

    def _again(
        self, case: Inference, told: Asked
    ) -> tuple[Asked, dict[tuple[int, ...], Callable[[], tuple[Problem, Inference]]]]:
        """The most probable hypotheses with the columns of their effects as they are at their sizes, and beside the
        first of them one effect more."""
        order = sorted((h for h in told.hypotheses if h.which), key=lambda h: -h.log - told.prior_of(h))
        found = {h.which: h for h in told.hypotheses}
        again = dict[tuple[int, ...], Callable[[], tuple[Problem, Inference]]]()
        at_sizes = AtSizes(self._question, self._with_step)
        most, own = -np.inf, case  # of the likeliest of these alone: each takes much memory
        # Far from zero, the linear columns of the true effect may fit worse than a sum of wrong ones.
        alone = [h for h in order if len(h.which) == 1]
        for h in {h.which: h for h in (*order[:AGAIN], *alone[:AGAIN])}.values():
            if any(self._question.forms[p][0].bends for p in h.which):
                found[h.which], again[h.which], other = at_sizes.looked_at(case, h)
                if (log := found[h.which].log + told.prior_of(h)) > most:
                    most, own = log, other
        best = max(found.values(), key=lambda h: h.log + told.prior_of(h))
        if best.which in again and len(best.which) == 1:
            for p in screened(own, best, self._candidates)[:AGAIN]:
                more = own.with_more(best, p)
                if more.which not in found or more.log > found[more.which].log:
                    found[more.which], again[more.which] = more, again[best.which]
        return replace(told, hypotheses=tuple(found.values())), again
