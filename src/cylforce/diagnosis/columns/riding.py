"""How the base goes that carries the first link: its rate, the columns of its motion, and whether that is news."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.numbers import SHAKES, STANDING
from cylforce.effects.effect import Halves, Parameter
from cylforce.effects.fault import BaseMotion
from cylforce.estimation.filters import denoised
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind


class Riding(NamedTuple):
    """Whether the base moves at all, as one does that gives way to the arm's forces, and whether it moves in the faulty
    recordings far more than in the clean ones."""

    always: bool
    more: bool


def riding(clean: Sequence[Array], faulty: Sequence[Array]) -> Riding:
    """From the base's rates (T,) [rad/s] in every recording."""
    usual, now = (float(np.sqrt(np.mean(np.concatenate(x) ** 2))) if x else 0.0 for x in (clean, faulty))
    return Riding(max(usual, now) > STANDING, now > SHAKES * max(usual, STANDING))


def quiet(machine: Machine, values: Array, rate_hz: float) -> Array:
    """Samples (T, S) with the pitch without its sensor's noise, which the rate would be full of, and a regression on it
    too small by."""
    found = values.copy()
    for k, signal in enumerate(machine.signals):
        if signal.kind is Kind.PITCH:
            found[:, k] = denoised(values[:, k], rate_hz)
    return found


@dataclass(frozen=True)
class Carried:
    """A motion of the base with rates (T,) [rad/s], as an effect of the regressor; `base` (N, 3): see its columns."""

    effect: BaseMotion
    turning: Array
    base: Array

    def parameters(self, machine: Machine) -> tuple[Parameter, ...]:
        """One of each size."""
        return tuple(Parameter(f"{k}.{self.effect.about.name}", u) for k, u in enumerate(self.effect.units))

    def halves(self, machine: Machine, moving: Motion) -> Halves:
        """Columns (T, N, M)."""
        return self.effect.halves(machine, moving, self.turning, self.base)
