"""The search for the most probable hypotheses: a beam of more and more forms."""

from collections.abc import Sequence

import numpy as np

from cylforce.diagnosis.inference.discrepancy import likeliest
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference, counted
from cylforce.diagnosis.inference.sizes import WIDE, Marginal, beside, positive
from cylforce.diagnosis.numbers import IN_ORDER, ODD, SECOND, STEADY
from cylforce.signals.estimate import Array

WIDTH, DEEPEST = 2, 8  # of the beam
KEPT = 8  # hypotheses of a beam that are refined


def searched(case: Inference, asked: Sequence[int]) -> list[Hypothesis]:
    """Hypotheses of more and more forms, as long as one form more is worth its prior, each with everyday differences
    under which it is probable; first of those forms that are expected, then beside them of all."""
    beam = [case.hypothesis((), case.usual._replace(everyday=share)) for share in STEADY]
    found = dict[tuple[int, ...], Hypothesis]({(): max(beam, key=lambda h: h.log)})
    if expected := [p for p in asked if case.scene.forms[p].expected]:
        beam = _grown(case, found, beam, expected, 0.0)
        if beam[0].rest <= 1.0:
            return list(found.values())  # the floor is all that is left: it was not measured on other recordings
    _grown(case, found, beam, asked, -float(np.log(SECOND * (1.0 - IN_ORDER - ODD) / max(len(asked), 1))))
    return list(found.values())


def _grown(
    case: Inference,
    found: dict[tuple[int, ...], Hypothesis],
    beam: list[Hypothesis],
    asked: Sequence[int],
    worth: float,
) -> list[Hypothesis]:
    """The last beam that was worth [nats] one form more; all hypotheses go to `found`."""
    for _ in range(DEEPEST):
        grown, grown_from = dict[tuple[int, ...], Hypothesis](), dict[tuple[int, ...], tuple[int, ...]]()
        for base in sorted(beam, key=lambda h: -h.log):
            for p in screened(case, base, asked)[:KEPT]:
                which = tuple(sorted((*base.which, p)))
                if which in found or grown_from.setdefault(which, base.which) != base.which:
                    continue  # known, or from a likelier one, beside which it is doubted as it should be
                h = case.with_more(base, p)
                if which not in grown or h.log > grown[which].log:
                    grown[which] = h
        first = sorted(grown.values(), key=lambda h: -h.log)[:WIDTH]
        best = sorted((case.likeliest(h.which, h.noise, h.doubt) for h in first), key=lambda h: -h.log)
        found |= grown | {h.which: h for h in best}
        gained = max((counted(h.rest) * (h.log - max(b.log for b in beam)) for h in best), default=-np.inf)
        if not best or (len(best[0].which) > 1 and gained < worth):
            break
        beam = best
    return beam


def screened(case: Inference, base: Hypothesis, asked: Sequence[int]) -> list[int]:
    """Proposals beside a hypothesis, most promising first: at its noise, and with the noise that would then be
    likeliest; beside what happens at moments at its noise alone."""
    state, named = case.state(base.noise), {case.scene.forms[p][:2] for p in base.which}
    free = [p for p in asked if case.scene.forms[p][:2] not in named]
    if case.moments:
        each = {p: (*base.which, p) for p in free}
        return sorted(free, key=lambda p: case.doubted(each[p], base) - case.under(each[p], state)[0])
    if not free:
        return []
    left, shift = _with_each(case, base.which, free, state)
    _, log = likeliest(case.sums, *case.sums.plain(left), case.usual)
    log -= 0.5 * np.einsum("hi,hi->h", shift, shift @ case.precision(base.noise)[0])
    return [free[k] for k in np.argsort(-log).tolist()]


def _with_each(case: Inference, which: tuple[int, ...], free: list[int], state: Marginal) -> tuple[Array, Array]:
    """What is left with each of some forms (H, K+1) beside those of a hypothesis, and where the nuisances are then
    (H, K): all forms with as many sizes at once."""
    gain, size = state.covariance @ state.known, len(state.score)
    whole = state.known - state.known @ gain
    left, shift = np.ones((len(free), size + 1)), np.empty((len(free), size))
    alike = dict[int, list[int]]()
    for k, p in enumerate(free):
        alike.setdefault(len(case.scene.forms[p].columns), []).append(k)
    for at in alike.values():
        each = [(*which, free[k]) for k in at]
        own = np.array([case.own(w) for w in each])
        certain = np.array([np.concatenate([beside(case.scene.forms[p]) for p in w]) for w in each])
        precision = np.where(certain > 0.0, certain, WIDE)
        known = positive(whole[own[:, :, None], own[:, None, :]]) + precision[:, :, None] * np.eye(own.shape[1])
        score = state.score[own] - precision * np.array([case.already(w) for w in each])
        more = np.linalg.solve(known, score[..., None])[..., 0]
        shift[at] = state.fitted - np.einsum("khm,hm->hk", gain[:, own], more)
        left[at, :-1] = -case.mean - shift[at]
        np.subtract.at(left, (np.array(at)[:, None], own), more)
    return left, shift
