"""The verdict once it is known where the gap is, before any effect is thought of."""

from collections.abc import Sequence

import numpy as np

from cylforce.diagnosis.answer.shrinkage import Gap, tried
from cylforce.diagnosis.answer.verdict import Judged, Search, Verdict, judged, searched
from cylforce.diagnosis.answer.where import Spot
from cylforce.diagnosis.inference.found import Found, without
from cylforce.diagnosis.inference.posterior import NOTHING, UNKNOWN
from cylforce.diagnosis.inference.residuals import without_gap
from cylforce.diagnosis.numbers import GAP

Tested = tuple[Search, Judged, Gap, str]  # what is believed, the verdict, the gap once simulated, a warning


def next_cause(everything: Found, tested: Tested, rng: np.random.Generator, surely: bool = False) -> Tested:
    """Return the answer with the most probable cause that its simulation does not refute.

    A refuted cause is withdrawn, and the probabilities of the others are renormalised. Where nothing is named among
    these, the gap stays unexplained: a wrong law of one effect is no sign of a healthy machine.
    surely: whether "no gap" is excluded
    """
    search, verdict, size, warning = tested
    while verdict.refuted and not verdict.named:
        everything = without(everything, verdict.refuted[-1])
        search = searched(everything, surely=surely)
        asked = judged(everything, search)
        if not asked.named:
            return search, verdict, size, warning
        search, after, size, more = tried(search, asked, rng)
        verdict = after._replace(refuted=(*verdict.refuted, *after.refuted))
        warning = "; ".join(filter(None, (warning, more)))
        tested = search, verdict, size, warning
    return tested


def insisted(
    everything: Found,
    tested: Tested,
    plain: Gap,
    spots: Sequence[Spot],
    rng: np.random.Generator,
) -> Tested:
    """What is believed, the verdict, the gap and a warning, once it is known where the gap without any effect, `plain`,
    is: at a joint that differs from what is normal and leaves twice the floor there surely is one."""
    tested = next_cause(everything, tested, rng)
    search, before, *_ = tested
    large = {spot.channel for spot in spots if spot.found} & _beyond(search, plain)
    if not large or search.working or not search.original.clean or search.belief.of.get(NOTHING, 0.0) <= 0.0:
        return tested
    for refuted in before.refuted:
        everything = without(everything, refuted)
    sure = searched(everything, surely=True)
    return next_cause(everything, tried(sure, judged(everything, sure), rng), rng, surely=True)


def _beyond(search: Search, size: Gap) -> set[str]:
    """The joints that leave twice the floor."""
    names = [search.viewer.model.machine.links[k].name for k in search.viewer.model.machine.rows]
    return {name for name, x, floor in zip(names, size.fixed, size.floor, strict=True) if x >= GAP * floor > 0.0}


def located(
    search: Search, verdict: Judged, size: Gap, plain: Gap, spots: Sequence[Spot]
) -> tuple[Search, Judged, Gap]:
    """What is believed, the verdict, and the gap; `plain`: without any effect. Where a joint differs from what is
    normal, or all of them leave twice the floor, "no gap" is not said, though a machine in order may differ so where it
    moves otherwise than its references: the recordings do not suffice.
    Where no joint leaves more than the references leave of each other, there is no gap, whatever would explain it: what
    lasts would show in it."""
    found = any(spot.found for spot in spots)
    if not found and verdict.verdict is not Verdict.NOT_OBSERVABLE and usual(search, plain):
        return none(search), Judged(Verdict.NO_GAP, (), 0.0), plain
    moved = (plain.floor > 0.0) & (plain.fixed > 0.0)  # a joint that rests tells nothing
    floors = (plain.fixed[moved] / plain.floor[moved]) ** 2
    large = search.original.floor_known and np.any(moved) and float(np.mean(floors)) >= GAP**2
    hidden = (found or large) and verdict.verdict is Verdict.NO_GAP
    return search, verdict._replace(verdict=Verdict.NOT_OBSERVABLE) if hidden else verdict, size


def usual(search: Search, size: Gap) -> bool:
    """Whether the field leaves no more than references leave of each other at any joint, and what was found would have
    to show there, not at moments or in the clocks alone."""
    if (
        search.working
        or not search.original.floor_known
        or not all(c.lasts and not c.proposal.clock for c in search.causes)
    ):
        return False
    return bool(np.all(without_gap(size.fixed, size.floor)))


def none(search: Search) -> Search:
    """The same without a gap: an effect that may be there all the same makes none."""
    odd = search.belief.of.get(UNKNOWN, 0.0)
    first = tuple(suspect._replace(probability=0.0) for suspect in search.first)
    return search._replace(belief=search.belief._replace(of={NOTHING: 1.0 - odd, UNKNOWN: odd}), first=first)
