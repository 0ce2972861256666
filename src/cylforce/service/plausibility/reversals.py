"""Pressure steps that dry friction explains.

When a cylinder reverses, its dry friction reverses, too, and the force of the oil follows within one reading: by at
most twice that friction, and towards the new motion. The friction is that of the identification with its present drift.
A larger step is not caused by friction. At rest friction may have any value between both directions, and may step by as
much in either direction."""

from array import array
from dataclasses import dataclass
from math import inf, sqrt
from typing import Self

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.model import Model, Tares
from cylforce.service.adaptation import DriftKnowledge
from cylforce.service.pipeline import Instant
from cylforce.service.plausibility.suspicion import SensorSuspicion
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.kinds import Kind

CLEAR = 3.0  # standard errors of the friction that a step must exceed; by convention
LAWS = ("coulomb", "load_dependent", "stribeck")  # of dry friction


class ReversalConstants(Constants):
    """Dry friction of one machine's cylinders.

    model: of the machine
    tares: of the machine
    steps: largest number of filter steps between a reversal and a step that it explains
    laws:  numbers of the columns of each cylinder's friction that a reversal changes, by their law. The part by which
           friction differs between both directions (`directional`) is not among them: its mean stays
    """

    def __init__(self, model: Model, tares: Tares, steps: int) -> None:
        """Find the parameters of each cylinder's dry friction among the tares.

        model: of the machine
        tares: identified parameters of the empty machine
        steps: largest number of filter steps between a reversal and a step of a pressure that it explains
        """
        self.model, self.tares, self.steps = model, tares, steps
        names = {p.name: k for k, p in enumerate(model.parameters)}
        cylinders = (c.name for c in model.machine.cylinders)
        self.laws = tuple({law: names[f"{c}.{law}"] for law in LAWS if f"{c}.{law}" in names} for c in cylinders)


@dataclass(slots=True)
class Reversals(Estimator):
    """Last reversal of each cylinder.

    constants: of the machine
    at:        (C,) step of the filters at which the cylinder was about to reverse last; -inf: never
    way:       (C,) direction after that reversal: 1 extends, -1 retracts
    """

    constants: ReversalConstants
    at: Numbers
    way: Numbers

    @classmethod
    def start(cls, constants: ReversalConstants) -> Self:
        """Return the state before any reversal."""
        size = len(constants.model.machine.cylinders)
        return cls(constants, at=array("d", [-inf]) * size, way=ZERO * size)

    def clear(self) -> None:
        """Discard all reversals, because the filters begin anew."""
        size = len(self.at)
        self.at, self.way = array("d", [-inf]) * size, ZERO * size

    def update(self, instant: Instant, steps: int) -> None:
        """Note the cylinders that are about to reverse at this step, and their direction after it.

        The mark `reversing` is ahead of the filtered speed, which is delayed: it is still that before the reversal.

        instant: rows of the step, with `reversing` (C,) and `speed` (C,) [m/s] of the cylinders
        steps:   number of steps of the filters so far
        """
        reversing = instant.reversing
        if not any(reversing):
            return
        for c, turns in enumerate(reversing):
            if turns:
                self.at[c], self.way[c] = steps, -1.0 if instant.speed[c] > 0.0 else 1.0

    def explains(
        self, suspicion: SensorSuspicion, steps: int, speed: Numbers, values: Numbers, drift: DriftKnowledge
    ) -> bool:
        """Return whether a reversal of friction explains the suspected step of a pressure.

        The cylinder must rest, or have reversed at most `constants.steps` before; then the force must step in the new
        direction. A reversal changes the force by at most twice the dry friction, which is uncertain by CLEAR standard
        errors.

        suspicion: suspicion of the step, with the pressure that stepped and by how much [Pa]
        steps:     number of steps of the filters so far
        speed:     (C,) present speed of the cylinders [m/s]
        values:    (S,) of all signals [SI]
        drift:     of friction and zeros
        """
        model = self.constants.model
        signal = model.machine.signals[suspicion.signals[0]]
        cylinder, c = model.machine.cylinders[signal.index], signal.index
        rests = abs(speed[c]) < model.filters.direction_speed
        if not rests and not 0 <= steps - self.at[c] <= self.constants.steps:
            return False
        outward = cylinder.area_head if signal.kind is Kind.HEAD_PRESSURE else -cylinder.area_rod
        dry, error = self._dry_friction(c, values, drift)
        push = suspicion.size * outward
        return (rests or push * self.way[c] > 0.0) and abs(push) <= 2.0 * (dry + CLEAR * error)

    def _dry_friction(self, c: int, values: Numbers, drift: DriftKnowledge) -> tuple[float, float]:
        """Return the largest dry friction of a cylinder at its present force [N], and its standard error [N].

        c:      number of the cylinder
        values: (S,) of all signals [SI], which give the force
        drift:  of friction and zeros, added to the identified friction

        The Stribeck part counts as positive: its law is known no better than its size, so that a reversal may increase
        friction by it."""
        laws, tares, model = self.constants.laws[c], self.constants.tares, self.constants.model
        row = np.zeros(len(tares.values))
        row[laws["coulomb"]] = 1.0
        if "load_dependent" in laws:
            row[laws["load_dependent"]] = abs(self._force(c, values))
        if "stribeck" in laws:
            row[laws["stribeck"]] = np.sign(tares.values[laws["stribeck"]])
        adapted = model.changing_friction.index(laws["coulomb"])
        variance = float(row @ tares.covariance @ row + drift.covariance[adapted, adapted])
        return float(row @ tares.values + drift.values[adapted]), sqrt(variance)

    def _force(self, c: int, values: Numbers) -> float:
        """Return the force of a cylinder's oil [N], positive when it pushes: pressures times areas.

        c:      number of the cylinder
        values: (S,) of all signals [SI]
        """
        machine = self.constants.model.machine
        cylinder = machine.cylinders[c]
        outward = {Kind.HEAD_PRESSURE: cylinder.area_head, Kind.ROD_PRESSURE: -cylinder.area_rod}
        own = ((s.kind, x) for s, x in zip(machine.signals, values.tolist(), strict=True) if s.index == c)
        return float(sum(outward.get(kind, 0.0) * x for kind, x in own))
