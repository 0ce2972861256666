"""A run in pieces: whoever moves the machine sees the sensor readings before deciding on the next move."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .engine import Engine
from .machine import RUN, Machine, signals_of, stream
from .plan import RATE, Path, empty
from .site import Site

Array = NDArray[np.float64]
REMEMBERED = round(0.5 * RATE)  # rows: longer than any sensor's lag and skew


class Session:
    """The empty machine under an operator's hands. `path.now` is where its cylinders were last commanded to."""

    def __init__(self, machine: Machine, *, seed: int = 0) -> None:
        rng = stream(machine.seed, RUN, seed)
        self._pitch, self._roll = (float(np.radians(x)) for x in rng.uniform(-1.0, 1.0, 2) * (3.0, 2.0))
        self._machine, self._rng = machine, rng
        self.site = Site(machine.geometry, rng)
        self.path = Path(self.site.posture())
        self.seconds = 0.0
        self._engine: Engine | None = None
        self._fast = np.zeros((0, 11))

    def move(self) -> Array:
        """Go through what the path has now, and begin a new one at its end: samples (T, S)."""
        plan = empty(self.path.done(), 0.0)
        plan = replace(plan, kelvin=self.site.kelvin(self.seconds, plan.rows), begin=self.seconds)
        self.path = Path(self.path.now)
        if self._engine is None:
            self._engine = Engine(self._machine.plant(self._pitch, self._roll), plan)
            trace = self._engine.run()
        else:
            trace = self._engine.go_on(plan)
        self.seconds += plan.rows / RATE
        before = len(self._fast) // 10
        self._fast = np.concatenate([self._fast, trace.fast])
        kelvin = np.concatenate([np.full(before, plan.kelvin[0]), plan.kelvin])
        seen = signals_of(self._fast, self._pitch, self._roll)
        self._fast = self._fast[-10 * REMEMBERED :]
        return np.asarray(self._machine.sensors.measure(seen, kelvin, 0, self._rng)[before:])
