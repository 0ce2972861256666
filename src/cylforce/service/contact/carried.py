"""The load that the force of the soil does not contain: as the weighing knows it."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.kernel.weighed import COVARIANCE, GRAM, VALUES
from cylforce.estimation.residual import load_spread
from cylforce.mechanics.machine import Machine
from cylforce.service.loading.lift import Lift
from cylforce.signals.quick import new, once

FILLING_S = 5.0  # s of contact in which a bucket can be filled or emptied; chosen


class KnownLoad(NamedTuple):
    """State: the load's (m, m x, m z, J about the last pin) `values` (4,) and `covariance` (4, 4) as last weighed;
    `filling`: seconds of contact since then; whether it is `known` now, because a load hangs and is weighed."""

    values: Numbers
    covariance: Numbers
    filling: float
    known: bool


@dataclass(frozen=True)
class Carrier:
    """The load of one machine."""

    machine: Machine
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def _full(self) -> Numbers:
        """A full bucket (4,)."""
        rated, middle = self.machine.rated_payload, self.machine.payload_reach / 2.0
        return numbers([rated, rated * middle, 0.0, rated * middle**2])

    def begin(self) -> KnownLoad:
        """Nothing is known of the load."""
        return KnownLoad(ZERO * 4, numbers(np.diag(load_spread(self.machine) ** 2).ravel()), 0.0, False)

    def step(self, state: KnownLoad, lift: Lift | None, touching: bool, dt: float) -> KnownLoad:
        """The state after one instant of `dt` [s]: the `lift` where a load hangs."""
        if lift is not None and not touching:
            return new(KnownLoad, (lift.kept[VALUES:COVARIANCE], lift.kept[COVARIANCE:GRAM], 0.0, True))
        return new(KnownLoad, (state.values, state.covariance, state.filling + dt * touching, False))

    def covariance(self, state: KnownLoad) -> Numbers:
        """Covariance (4, 4) of the load: as weighed, and a bucket that fills while it is in contact."""
        if not state.filling:
            return state.covariance
        found = ZERO * 16
        self.kernel.fill(state.covariance, self._full, min(state.filling / FILLING_S, 1.0), found)
        return found
