"""Hypotheses that are withdrawn from what was found, so that Bayes' rule holds among the others: a cause that its own
simulation refutes, and one of two causes that are one answer."""

from dataclasses import replace

from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.hypotheses import Hypothesis
from cylforce.diagnosis.inference.posterior import Asked, Key
from cylforce.diagnosis.numbers import ALIKE
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange

WEIGHT = (ExtraMass().about.name, FirstMomentChange().about.name)


def without(found: Found, cause: Key) -> Found:
    """Return what was found without every hypothesis that holds a cause."""
    told = found.asked
    hypotheses = tuple(h for h in told.hypotheses if cause not in told.keys(h))
    happened = tuple(h for h in told.happened if h.key != cause)
    return replace(found, asked=replace(told, hypotheses=hypotheses, happened=happened))


def one_answer(found: Found) -> Found:
    """Return what was found with a mass and a first moment of the same link as one answer.

    An added mass moves the link's centre of gravity. Where the evidence of both differs by less than ALIKE, the more
    probable one stays, and `same` holds the other. Where the most probable hypothesis has both, both stay.
    """
    for at in sorted({at for _, at in found.asked.alone}):
        both = [(name, at) for name in WEIGHT]
        if all(key in found.asked.alone for key in both) and (other := _less(found.asked, both)):
            (kept,) = (key for key in both if key != other)
            found = replace(without(found, other), same={**found.same, kept: other})
    return found


def _less(told: Asked, both: list[Key]) -> Key | None:
    """Return the one of two causes that the most probable hypothesis with any of them lacks, if no evidence separates
    the two."""
    logs = [told.alone[key][0] for key in both]
    if abs(logs[0] - logs[1]) >= ALIKE:
        return None

    def probability(h: Hypothesis) -> float:
        return h.log + told.prior_of(h)

    first = max((h for h in told.hypotheses if not told.keys(h).isdisjoint(both)), key=probability)
    lacking = [key for key in both if key not in told.keys(first)]
    return lacking[0] if lacking else None
