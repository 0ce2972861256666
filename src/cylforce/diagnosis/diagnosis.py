"""The diagnosis: noise floor, what the machine always was, which effects the faulty recordings have besides."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.correction import Applied, aside, bends, unsure, without
from cylforce.diagnosis.evidence import Blocks, Evidence, own_blocks
from cylforce.diagnosis.floor import noise_floor
from cylforce.diagnosis.problem import TEMPER, Problem, Seen, looked_at
from cylforce.diagnosis.rank import PART, TIE, Ranked, certain, itself, leading, magnitude, plausible, ranking, width
from cylforce.diagnosis.reappearance import reappearance, usual
from cylforce.diagnosis.rows import Recorded, Viewer
from cylforce.diagnosis.selection import selected, settled
from cylforce.diagnosis.unknown import NAME, UNKNOWN
from cylforce.diagnosis.whitening import Floor
from cylforce.effects.fault import Sudden
from cylforce.effects.library import LIBRARY, Group, Proposal, proposals
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

ENOUGH = 12.0  # nats
MINOR = 0.01  # of the energy of what lasts of the gap: a lesser cause is not looked for
FOLDS = 4
WILD = 6.0  # times the median of clean blocks' energy
ROUGH = 0.6  # of a block's energy that an incident may leave
ROUNDS = 6  # at most, in which columns are computed anew at the sizes found
KEPT = 0.5  # of the usable rows, which must be left when effects are taken out at the sizes found
STRAIGHT = 100.0  # nats, below which it goes unnoticed that columns bend
STILL = 0.05  # of a size: a smaller change of it does not bend its columns
NEAR = 0.6  # of the best's score
Watch = Callable[[str], None]


class Cause(NamedTuple):
    """An effect that was found: the option, its total sizes (M,), their standard errors (M,), `size` as one number,
    `score` [nats], of it `returned` by what return pressures say, `inflation` of the blocks' scores with it taken off
    and what is `usual` of it on the machine in order, `rivals`: what else would explain the same; `significance`, in
    standard errors; `ahead`: nats by which what is free at any instant tells more than an effect with more sizes in the
    same blocks."""

    ranked: Ranked
    sizes: Array
    errors: Array
    size: float
    score: float
    returned: float
    inflation: float
    usual: float
    rivals: tuple[Ranked, ...]
    significance: float
    ahead: float

    @property
    def known(self) -> bool:
        """Whether it is an effect, not a torque of which nothing is known."""
        return self.ranked.key[0] != NAME

    @property
    def tempered(self) -> float:
        """The score [nats] if all blocks scatter as they do with this cause taken off."""
        return self.score * TEMPER / max(TEMPER, self.inflation)

    @property
    def misfit(self) -> float:
        """How many times more than usual the blocks' scores scatter: 1 where the form fits."""
        return max(self.inflation / self.usual, 1.0)


class Energy(NamedTuple):
    """Whitened sums of squares of the faulty blocks (B,): with nothing fitted to them, `fixed`, with what the machine
    always was fitted to them too, `before`, and with all causes, `after`; their
    `floor` (B,) from the clean ones; the same of the clean blocks."""

    fixed: Array
    before: Array
    after: Array
    floor: Array
    clean: Array


class Search(NamedTuple):
    """All that was found: the `original` problem, the problem and blocks last looked at, the floor, the causes,
    energies; `first`: the first ranking; `evidence`: the last one, with all causes held; who looked, `viewer`."""

    original: Problem
    problem: Problem
    blocks: Blocks
    floor: Floor
    causes: tuple[Cause, ...]
    energy: Energy
    first: tuple[Ranked, ...]
    evidence: Evidence
    viewer: Viewer


def search(
    viewer: Viewer,
    faulty: Sequence[Recorded | Seen],
    clean: Sequence[Recorded | Seen],
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = lambda _: None,
    known: Array | None = None,
    only: tuple[str, str] | None = None,
) -> Search:
    """Which effects of the library explain what the model leaves of the faulty recordings; `known` (P,): standard
    errors of the viewer's tares, by default the data sheet's; `only`: name and place of the one that may be a cause."""
    wanted = asked(viewer.model.machine, library)
    watch("columns of every effect")
    seen = [looked_at(viewer, group, wanted) for group in (clean, faulty)]
    spread = np.sqrt(np.diag(viewer.model.prior.covariance)) if known is None else known
    problem = Problem(viewer.model, spread, wanted, seen[0], seen[1], only, viewer.tares)
    floor = noise_floor(problem)
    blocks = problem.blocks(floor)
    return _greedy(viewer, problem, blocks, floor, [each.recorded for each in problem.faulty], watch)


def asked(machine: Machine, library: tuple[Group, ...] = LIBRARY) -> tuple[Proposal, ...]:
    """Everything that is asked of the recordings: the library's proposals, and what they must be better than."""
    return proposals(machine, (*library, *UNKNOWN))


class _Taken(NamedTuple):
    """Causes with what of them is taken out of the recordings: their total sizes by name and place, what is then asked,
    its blocks, and the `first` problem without the rows that are set aside."""

    held: list[Ranked]
    applied: dict[tuple[str, str], Array]
    problem: Problem
    blocks: Blocks
    first: Problem


def _greedy(
    viewer: Viewer, problem: Problem, blocks: Blocks, floor: Floor, original: list[Recorded], watch: Watch
) -> Search:
    """Causes one by one, each exchanged as soon as another does better beside the others; if clocks that are apart say
    most, all but these once more, with the clocks put right; what lasts once more where something happens at times;
    then those that are not linear in their size are taken out of the recordings, and what is left is looked at again;
    then each is asked once more whether another does as well beside what was found."""
    worth = _worth(blocks)
    watch("search")
    first = tuple(ranking(problem, Evidence(blocks)))
    held = jumping(viewer, problem, floor, original, first) or selected(problem, blocks, worth)
    start = _Taken([], {}, problem, blocks, problem)
    largest = max(held, key=lambda r: r.score, default=None)
    if largest and largest.clock:
        righted = _righted(viewer, problem, floor, original, start._replace(held=[largest]), watch)
        start, held = (righted, righted.held) if righted.applied else (start, held)
    incidents = [r for r in held if r.option.proposal.course]
    if incidents:
        worth = _worth(start.blocks, incidents)
        held = settled(start.problem, start.blocks, held, worth, kept=tuple(start.applied))
    taken = _taken_out(viewer, problem, floor, original, start._replace(held=held), worth, watch)
    again = _reconsidered(start.problem, start.blocks, taken, tuple(start.applied))
    if [r.key for r in again] != [r.key for r in taken.held]:
        taken = _taken_out(viewer, problem, floor, original, start._replace(held=again), worth, watch)
    evidence = Evidence(taken.blocks, [r.option.term for r in taken.held])
    clean, after = evidence.squares(evidence.held, evidence.fitted)
    base = Evidence(taken.first.blocks(floor))
    _, before = base.squares((), base.fitted)
    usual = _usual(base.blocks)
    _, fixed = base.squares((), problem.fixed(base.blocks, evidence.fitted))
    after = np.where(_rough(taken.held, fixed, after), np.minimum(after, usual), after)
    causes = _causes(problem, start.problem, taken, floor, evidence)
    energy = Energy(fixed, before, after, usual, clean)
    return Search(problem, taken.problem, taken.blocks, floor, causes, energy, first, evidence, viewer)


def jumping(
    viewer: Viewer, problem: Problem, floor: Floor, original: list[Recorded], first: Sequence[Ranked]
) -> list[Ranked]:
    """Of the `first` ranking a cause that jumps, alone, if it is of a plausible size, and nothing does better where its
    jumps are not looked at: what is free at any instant, which then comes before it, follows every one of them."""
    near = {r.key for r in first if r.score >= PART * first[0].score} if first and first[0].free else set()
    sudden = [p for p in problem.proposals if isinstance(p.group[0], Sudden) and (p.name, p.at) in near]
    found = list[Ranked]()
    for option in problem.options(Evidence(problem.blocks(floor)), sudden) if sudden else ():
        left = aside(problem, unsure(problem, viewer, [Applied(option, np.empty(0))], original))
        best = ranking(left, Evidence(left.blocks(floor)))[:1]
        found += [r for r in best if r.option.proposal is option.proposal and plausible(r)]
    return [max(found, key=lambda r: r.score)] if found else []


def _worth(blocks: Blocks, incidents: Sequence[Ranked] = ()) -> float:
    """The nats from which on a cause is looked for, beside `incidents`."""
    evidence = Evidence(blocks, [r.option.term for r in incidents])
    excess = evidence.squares(evidence.held, evidence.fitted)[1] - _usual(blocks)
    lasting = np.delete(excess, own_blocks(evidence.held))
    return max(ENOUGH, MINOR * float(np.sum(lasting)) / (2.0 * TEMPER))


def _righted(
    viewer: Viewer,
    first: Problem,
    floor: Floor,
    original: list[Recorded],
    start: _Taken,
    watch: Watch,
) -> _Taken:
    """The recordings with the clocks that `start` holds put right, and every column computed anew: forces and motion
    belong together now. As they were if the clocks are too near for that."""
    taken = _taken_out(viewer, first, floor, original, start, np.inf, watch)
    if not taken.applied:
        return taken
    faulty = looked_at(viewer, [seen.recorded for seen in taken.problem.faulty], first.proposals)
    problem = replace(taken.problem, faulty=faulty)
    return taken._replace(problem=problem, blocks=problem.blocks(floor))


def _taken_out(
    viewer: Viewer,
    first: Problem,
    floor: Floor,
    original: list[Recorded],
    start: _Taken,
    worth: float,
    watch: Watch,
) -> _Taken:
    """Those that are not linear in their size taken out of the `original` recordings, and what is left looked at again,
    until their sizes stay."""
    taken, rows = start, np.sum(first.blocks(floor).faulty_rows)
    for _ in range(ROUNDS):
        found = _sizes(taken.blocks, taken.held, taken.applied)
        if not _moved(taken.applied, found):
            break
        watch("columns at the sizes found")
        out = _bending(taken.held, found)
        lost = unsure(first, viewer, out, original)
        problem = aside(without(taken.problem, viewer, out, original), lost)
        if np.sum(problem.blocks(floor).faulty_rows) < KEPT * rows:
            break  # at these sizes the machine could not have moved so
        held = settled(problem, problem.blocks(floor), taken.held, worth, kept=tuple(found))
        applied = {key: sizes for key, sizes in found.items() if key in {r.key for r in held}}
        taken = _Taken(held, applied, problem, problem.blocks(floor), aside(first, lost))
    return taken


def _reconsidered(problem: Problem, plain: Blocks, taken: _Taken, kept: Sequence[tuple[str, str]]) -> list[Ranked]:
    """The causes but the `kept` ones, each exchanged for what explains the recordings as they were as well, beside the
    others: whether it was found first is no reason to stay, and what is nothing but its other sizes does not."""
    total = _sizes(taken.blocks, taken.held, taken.applied)
    held, evidence = list(taken.held), Evidence(taken.blocks, [r.option.term for r in taken.held])
    for n, r in enumerate(taken.held):
        if r.key in kept:
            continue
        others = [o for k, o in enumerate(held) if k != n]
        alone = Evidence(plain, [o.option.term for o in others])
        ranked = ranking(problem, alone, besides=others)
        own = next((x for x in ranked if x.key == r.key), r)
        score = max(own.score, _bent(plain, others, evidence, own)) if r.key in taken.applied else own.score
        if r.key in total and not itself(own, total[r.key]):
            ranked, score = [x for x in ranked if x is not own], NEAR * score
        if ranked and ranked[0].key != r.key and ranked[0].score > score - TIE:
            held[n] = ranked[0]
    return held


def _rough(held: Sequence[Ranked], fixed: Array, after: Array) -> NDArray[np.bool_]:
    """Blocks (B,) of which an incident explains most: what happens there for a moment is rougher than any form, and its
    rest is no sign of another cause."""
    here = own_blocks([r.option.term for r in held])
    return np.asarray(np.isin(np.arange(len(fixed)), here) & (after < ROUGH * fixed))


def _usual(blocks: Blocks) -> Array:
    """Whitened sums of squares (B,) that faulty blocks would have if they were clean: as clean blocks have them when
    nothing is fitted to them (every fold predicted from the others; a few that no other stretch is like do not count
    beyond WILD times the median)."""
    count = len(blocks.clean)
    if count < 2 * FOLDS:
        return np.asarray(blocks.faulty_rows, dtype=np.float64)
    fold = np.arange(count) * 4 * FOLDS // count % FOLDS
    left = np.zeros(count)
    for k in range(FOLDS):
        weight = np.concatenate([np.where(fold == k, 0.0, 1.0), np.zeros(len(blocks.faulty))])
        evidence = Evidence(blocks, weight=weight)
        left = np.where(fold == k, evidence.squares((), evidence.fitted)[0], left)
    good = blocks.clean_rows > 0.0
    each = left[good] / blocks.clean_rows[good]
    return np.asarray(
        np.average(np.minimum(each, WILD * np.median(each)), weights=blocks.clean_rows[good]) * blocks.faulty_rows
    )


def _sizes(
    blocks: Blocks, held: Sequence[Ranked], applied: dict[tuple[str, str], Array]
) -> dict[tuple[str, str], Array]:
    """Total sizes of all causes that bend enough to be noticed: what is taken out already and what is left of it."""
    evidence = Evidence(blocks, [r.option.term for r in held])
    k, found = len(blocks.shared), {}
    for r in held:
        m = len(r.option.term.columns)
        plain = r.score >= STRAIGHT or r.key in applied or isinstance(r.option.proposal.group[0], Sudden)
        if bends(r.option) and plain:
            found[r.key] = applied.get(r.key, np.zeros(m)) + evidence.fitted[k : k + m]
        k += m
    return found


def _moved(before: dict[tuple[str, str], Array], after: dict[tuple[str, str], Array]) -> bool:
    """Whether the sizes (M,) of any cause have changed by more than STILL."""
    return any(
        key not in before
        or before[key].shape != sizes.shape
        or float(np.linalg.norm(sizes - before[key])) > STILL * float(np.linalg.norm(sizes))
        for key, sizes in after.items()
    )


def _bending(held: Sequence[Ranked], applied: dict[tuple[str, str], Array]) -> list[Applied]:
    """As they came about, clocks last."""
    return [Applied(r.option, applied[r.key]) for r in sorted(held, key=lambda r: r.clock) if r.key in applied]


def _causes(original: Problem, righted: Problem, taken: _Taken, floor: Floor, evidence: Evidence) -> tuple[Cause, ...]:
    """The causes with their total sizes; a clock's score and rivals are those on the recordings as they were, those of
    all others with the clocks put right; or with all else taken out that bends, if that tells more of it."""
    found, k, blocks, applied = [], len(taken.blocks.shared), taken.blocks, taken.applied
    for r in taken.held:
        m = len(r.option.term.columns)
        others = [o for o in taken.held if o is not r]
        seen = original if r.clock else righted
        plain = seen.blocks(floor)
        own, ranked = _beside(seen, plain, r, others)
        if applied and not (r.clock or r.key in applied):
            own, ranked = max((own, ranked), _beside(taken.problem, blocks, r, others), key=lambda x: x[0].score)
        others_too = (x for x in ranked if x.key != r.key and x.key[0] != NAME)
        rivals = tuple(x for x in others_too if x.score > NEAR * own.score)
        told = Evidence(blocks, [o.option.term for o in others]).of(r.option.term)
        sizes = evidence.fitted[k : k + m] + applied.get(r.key, np.zeros(m))
        form = r.option.proposal.about.form * _extent(r, sizes)
        covariance = told.covariance * reappearance(blocks, r.option.term) + np.diag(form**2)
        errors = np.sqrt(np.diag(covariance))
        free = r.free and r.key[0] != NAME
        scatter = 1.0 if r.free else usual(original.blocks(floor), r.option.term)
        size = certain(r, sizes, covariance) if free else magnitude(r, sizes, errors)
        score = max(own.score, _bent(plain, others, evidence, own)) if r.key in applied else own.score
        sure, ahead = _surest(r, sizes, covariance), _ahead(righted, blocks, r, others) if r.free else np.inf
        found.append(Cause(r, sizes, errors, size, score, own.returned, told.inflation, scatter, rivals, sure, ahead))
        k += m
    return tuple(found)


def _beside(problem: Problem, blocks: Blocks, found: Ranked, others: Sequence[Ranked]) -> tuple[Ranked, list[Ranked]]:
    """A cause and the ranking in which it stands, beside the others."""
    ranked = ranking(problem, Evidence(blocks, [o.option.term for o in others]), besides=others)
    return next((x for x in ranked if x.key == found.key), found), ranked


def _bent(plain: Blocks, others: Sequence[Ranked], evidence: Evidence, own: Ranked) -> float:
    """The score [nats] of a cause whose columns bend: by what is left without it, and with it taken out as it is found;
    its freedom costs as much as where it is linear."""
    without = Evidence(plain, [o.option.term for o in others])
    left = [sum(float(np.sum(x)) for x in e.squares(e.held, e.fitted)) for e in (without, evidence)]
    unit = plain.spread[list(own.option.term.columns)]
    width = np.sqrt(np.diag(own.told.covariance)) / unit
    return (left[0] - left[1]) / (2.0 * TEMPER) + float(np.sum(np.log(np.maximum(width, 1e-300))))


def _surest(found: Ranked, sizes: Array, covariance: Array) -> float:
    """The surest of the sizes along the axes, in standard errors; of a torque of which nothing is known all sizes
    together, if that is more: such go with each other, and none is sure by itself."""
    each, errors = (leading(found, x) for x in (sizes, np.sqrt(np.diag(covariance))))
    surest = float(np.max(np.abs(each) / np.maximum(errors, 1e-300)))
    if found.key[0] != NAME:
        return surest
    return max(surest, float(np.sqrt(sizes @ np.linalg.lstsq(covariance, sizes, rcond=None)[0] / len(sizes))))


def _ahead(problem: Problem, blocks: Blocks, found: Ranked, others: Sequence[Ranked]) -> float:
    """By how many nats what is free at any instant tells more than any other such effect with more sizes would in the
    same blocks, beside all others."""
    hit = np.flatnonzero(np.any(found.option.term.course, axis=0)).tolist()
    least = np.inf
    for places in problem.momentary:
        if len(places) > width(found):
            evidence = Evidence(blocks, [o.option.term for o in others if set(o.option.term.columns) != set(places)])
            own, other = (evidence.of(t, TEMPER).evidence for t in (found.option.term, problem.each_of(places, hit)))
            least = min(least, own - other)
    return least


def _extent(found: Ranked, sizes: Array) -> Array:
    """Of each size (M,) its magnitude; those along the axes have one in common, whose direction is as uncertain."""
    each = sizes.reshape(-1, len(dict.fromkeys(found.option.term.columns))).copy()
    axes = found.option.proposal.about.axes
    each[:, :axes] = np.linalg.norm(each[:, :axes], axis=1, keepdims=True)
    return np.asarray(np.abs(each).ravel())
