"""The verdict: which causes are named, with what confidence, what they might be confused with, or that none fits."""

from enum import StrEnum
from typing import NamedTuple

import numpy as np

from cylforce.core.gap.diagnosis import ENOUGH, Cause, Search
from cylforce.core.gap.problem import TEMPER
from cylforce.core.gap.rank import Ranked
from cylforce.core.gap.residuals import contributions, rms
from cylforce.core.gap.residuals import fixed as fixed_residuals

NEGLIGIBLE = 0.5  # of an effect's least plausible size
WORTH = 0.1  # of a joint's gap energy: a smaller part is not named
EXPLAINED, PARTLY = 0.9, 0.7  # of the gap's energy
CLOSE = 0.04  # relative margin of a rival's score
LARGE = 1.0  # of the floor's energy: an excess beyond it is a gap even if nothing explains it
OFF, SURE = 30.0, 100.0  # inflation from which on the shape does not fit, unless the evidence is so many times that


class Verdict(StrEnum):
    """What is concluded."""

    NO_GAP = "no_gap"
    EXPLAINED = "explained"
    PARTLY = "partly_explained"
    AMBIGUOUS = "ambiguous"
    UNKNOWN = "unknown"
    NOT_OBSERVABLE = "not_observable"


class Named(NamedTuple):
    """A cause that is named, its `confidence`, its share of the gap's energy, and what it might be `confused` with."""

    cause: Cause
    confidence: float
    share: float
    confused: tuple[Ranked, ...]


class Judged(NamedTuple):
    """The verdict, the causes named, largest first, and the share of the gap's energy that they explain."""

    verdict: Verdict
    named: tuple[Named, ...]
    explained: float


def judged(search: Search) -> Judged:
    """The verdict on a search."""
    energy = search.energy
    floor = float(np.sum(energy.floor))
    before, after = float(np.sum(energy.before)), float(np.sum(energy.after))
    excess = max(before - floor, before - after, 1e-9)
    explained = float(np.clip((before - after) / excess, 0.0, 1.0))
    shares = _shares(search, excess)
    named = [_named(c, share) for c, share in zip(search.causes, shares, strict=True) if _counts(c, share)]
    named.sort(key=lambda n: -n.cause.score)
    if not named or (not search.original.clean and before <= floor):
        found = max(before, float(np.sum(energy.fixed))) > (1.0 + LARGE) * floor
        return Judged(Verdict.UNKNOWN if found else Verdict.NO_GAP, (), explained)
    if explained < PARTLY or _misfit(named[0].cause):
        return Judged(Verdict.UNKNOWN, (), explained)
    if named[0].confused:
        return Judged(Verdict.AMBIGUOUS, tuple(named), explained)
    return Judged(Verdict.EXPLAINED if explained > EXPLAINED else Verdict.PARTLY, tuple(named), explained)


def _shares(search: Search, whitened: float) -> list[float]:
    """For each cause its share of the gap: of the `whitened` energy by its evidence, or of a joint's energy by what it
    contributes there, whichever is more."""
    parts = contributions(search)
    _, faulty = fixed_residuals(search.original, search.original.blocks(search.floor))
    whole = rms(faulty) ** 2
    excess = np.maximum(whole - search.floor.rms**2, 0.1 * search.floor.rms**2)
    told = [2.0 * TEMPER * cause.score / whitened for cause in search.causes]
    return [float(np.clip(max(np.max(p**2 / excess), t), 0.0, 1.0)) for p, t in zip(parts, told, strict=True)]


def _counts(cause: Cause, share: float) -> bool:
    plausible = cause.size >= NEGLIGIBLE * cause.ranked.option.proposal.about.low
    return plausible and cause.score >= ENOUGH and share >= WORTH


def _misfit(cause: Cause) -> bool:
    """Whether the blocks' scores scatter so much with the cause taken off that its shape cannot be right."""
    return cause.inflation > OFF and cause.score * TEMPER < SURE * cause.inflation


def _named(cause: Cause, share: float) -> Named:
    close = tuple(r for r in cause.rivals if r.score > (1.0 - CLOSE) * cause.score)
    margin = 1.0 - max((r.score for r in cause.rivals), default=0.0) / cause.score
    return Named(cause, float(np.clip(0.5 + margin, 0.0, 0.99)), share, close)
