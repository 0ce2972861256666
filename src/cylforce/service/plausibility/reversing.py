"""Is a pressure's leap that of its cylinder's friction? When a cylinder turns round, its dry friction turns round, too,
and the oil's force follows within one reading: by no more than twice that friction, and towards the new motion. How
large it is, the identification knows, and the adaptation what it is now. What leaps farther is no friction. At rest
friction may be anything between both, and change as far either way."""

from array import array
from dataclasses import dataclass
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.model import Model, Tares
from cylforce.service.adaptation import Drift
from cylforce.service.pipeline import Instant
from cylforce.service.plausibility.changing import NONE
from cylforce.service.plausibility.suspicion import SensorDoubt
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import once

CLEAR = 3.0  # standard errors of the friction that a leap must exceed; by convention
LAWS = ("coulomb", "load_dependent", "stribeck")  # of dry friction


class Turns(NamedTuple):
    """State: the filters' steps `at` which each cylinder (C,) was seen to turn round last, and the `way` (C,) that it
    takes then: 1 extends, -1 retracts."""

    at: Numbers = NONE
    way: Numbers = NONE


@dataclass(frozen=True)
class Reversing:
    """The dry friction of one machine's cylinders. `steps`: those of the filters for which a leap is looked at."""

    model: Model
    tares: Tares
    steps: int

    @once
    def _laws(self) -> tuple[dict[str, int], ...]:
        """Of each cylinder the columns of what a reversal turns round, by their law. Friction that is larger one way
        than the other (`directional`) is not among them: its mean is what it was."""
        names = {p.name: k for k, p in enumerate(self.model.parameters)}
        each = (c.name for c in self.model.machine.cylinders)
        return tuple({law: names[f"{c}.{law}"] for law in LAWS if f"{c}.{law}" in names} for c in each)

    def begin(self) -> Turns:
        """Nothing has turned."""
        size = len(self.model.machine.cylinders)
        return Turns(array("d", [-inf]) * size, ZERO * size)

    def step(self, state: Turns, instant: Instant, steps: int) -> Turns:
        """The state after one step, the filters' `steps` so far. The pipeline's speeds are late; it looks ahead by as
        much."""
        if not instant.reverses:
            return state
        at, way = state.at[:], state.way[:]
        for c, turns in enumerate(instant.reversing):
            if turns:
                at[c], way[c] = steps, -1.0 if instant.speed[c] > 0.0 else 1.0
        return Turns(at, way)

    def explains(
        self, state: Turns, steps: int, doubt: SensorDoubt, speed: Numbers, values: Numbers, drift: Drift
    ) -> bool:
        """Whether the step of a pressure that is doubted, at the last of the filters' `steps`, may be friction that
        turned round; `speed` (C,) [m/s] of the cylinders now, `values` (S,) of all signals."""
        signal = self.model.machine.signals[doubt.signals[0]]
        cylinder, c = self.model.machine.cylinders[signal.index], signal.index
        rests = abs(speed[c]) < self.model.filters.direction_speed
        if not rests and not 0 <= steps - state.at[c] <= self.steps:
            return False
        outward = cylinder.area_head if signal.kind is Kind.HEAD_PRESSURE else -cylinder.area_rod
        dry, error = self._dry(c, values, drift)
        push = doubt.size * outward
        return (rests or push * state.way[c] > 0.0) and abs(push) <= 2.0 * (dry + CLEAR * error)

    def _dry(self, c: int, values: Numbers, drift: Drift) -> tuple[float, float]:
        """The most dry friction of a cylinder [N] and its standard error, at its force. By what it differs in creeping,
        it may be more when it turns round: the form of that is known no better than its size."""
        laws, tares = self._laws[c], self.tares
        row = np.zeros(len(tares.values))
        row[laws["coulomb"]] = 1.0
        if "load_dependent" in laws:
            row[laws["load_dependent"]] = abs(self._force(c, values))
        if "stribeck" in laws:
            row[laws["stribeck"]] = np.sign(tares.values[laws["stribeck"]])
        adapted = self.model.changing_friction.index(laws["coulomb"])
        variance = float(row @ tares.covariance @ row + drift.covariance[adapted, adapted])
        return float(row @ tares.values + drift.values[adapted]), sqrt(variance)

    def _force(self, c: int, values: Numbers) -> float:
        """Force of a cylinder's oil [N]."""
        cylinder, signals = self.model.machine.cylinders[c], self.model.machine.signals
        outward = {Kind.HEAD_PRESSURE: cylinder.area_head, Kind.ROD_PRESSURE: -cylinder.area_rod}
        own = ((s.kind, x) for s, x in zip(signals, values.tolist(), strict=True) if s.index == c)
        return float(sum(outward.get(kind, 0.0) * x for kind, x in own))
