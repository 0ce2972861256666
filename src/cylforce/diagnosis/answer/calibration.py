"""Probabilities as labelled cases teach them (see `learnt.py`)."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.inference.posterior import LEAST, NOTHING, UNKNOWN, Belief
from cylforce.signals.estimate import Array


class Outcomes(NamedTuple):
    """What labelled cases teach of such an answer: how probable it is that there is no gap, that the first effect is
    the cause, that nothing of the library is, and that another effect is. A multinomial logistic regression on
    features (F,): their `mean` and `scale` (F,), `weights` (4, F+1), a constant last. `tempered`: by which power the
    other effects share what is theirs."""

    mean: tuple[float, ...]
    scale: tuple[float, ...]
    weights: tuple[tuple[float, ...], ...]
    tempered: float

    def __call__(self, features: Sequence[float]) -> Array:
        """The four probabilities (4,)."""
        each = (np.array(features) - np.array(self.mean)) / np.array(self.scale)
        logs = np.array(self.weights) @ np.append(each, 1.0)
        shares = np.exp(logs - np.max(logs))
        return np.asarray(shares / np.sum(shares))


def calibrated(belief: Belief, by: Outcomes) -> Belief:
    """The probabilities as labelled cases teach them; the order of the effects stays, and of two that the model holds
    alike neither is preferred."""
    effects = sorted((k for k in belief.of if k not in (NOTHING, UNKNOWN)), key=lambda k: -belief.of[k])
    if not effects:
        return belief
    none, first, unknown, other = by(belief.features).tolist()
    least = (first + other) / len(effects)  # the first is never less probable than the others
    first, other = max(first, least), min(other, first + other - least)
    if len(effects) < 2:
        return belief._replace(of={NOTHING: none, effects[0]: first, UNKNOWN: unknown + other})
    said = np.array([max(belief.of[k], LEAST) for k in effects])
    said /= np.sum(said)
    alike = max(first - (first + other) * float(said[0]), 0.0)  # what the model itself gives to other effects
    flat = said[1:] ** by.tempered
    shares = other * flat / np.sum(flat) + alike * said[1:] / max(float(np.sum(said[1:])), LEAST)
    if np.max(shares) > first - alike:  # the order stays
        shares = np.minimum(np.full(len(shares), np.mean(shares)), first - alike)
    found = {NOTHING: none, effects[0]: first - alike, UNKNOWN: unknown}
    return belief._replace(of=found | dict(zip(effects[1:], shares.tolist(), strict=True)))
