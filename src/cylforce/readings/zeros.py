"""Zeros of pressure sensors, read while the machine stands without pressure."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import BEYOND
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.signals.units import BAR

NAME = PressureOffset().about.name
HEALTHY_PA = PressureOffset().about.low  # standard deviation of the zeros of healthy sensors: the least plausible fault
LARGEST_PA = BEYOND * PressureOffset().about.high  # a larger reading is pressure, not a zero
FARTHEST = 5.0  # standard errors, beyond which a reading says no more; as for return pressures
PARTS = 10  # of the reading, whose means show the standard error of the whole mean, slow noise included
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)


@dataclass(frozen=True)
class Zero:
    """Reading of a pressure sensor without pressure.

    mean:  [Pa]
    error: standard error of the mean [Pa]
    """

    mean: float
    error: float

    def evidence(self, offset: float) -> float:
        """Return the evidence [nats] for a sensor whose zero changed by `offset` [Pa], against an unchanged one."""
        scale = float(np.hypot(self.error, HEALTHY_PA))

        def loss(x: float) -> float:
            return 0.5 * min(x * x, FARTHEST**2)

        return loss(self.mean / scale) - loss((self.mean - offset) / scale)


@dataclass(frozen=True)
class Zeros:
    """Readings of all pressure sensors without pressure.

    by_signal: zeros, by number of the signal
    warnings:  sentences on sensors that show pressure, whose zero is therefore not known
    """

    by_signal: Mapping[int, Zero]
    warnings: tuple[str, ...] = ()


def read_zeros(machine: Machine, values: Array) -> Zeros:
    """Return the zeros that samples (T, S) of a machine without pressure show."""
    found, warnings = dict[int, Zero](), list[str]()
    for number, signal in enumerate(machine.signals):
        if signal.kind not in PRESSURES:
            continue
        column = values[np.isfinite(values[:, number]), number]
        if len(column) < PARTS:
            continue
        parts = [float(np.mean(part)) for part in np.array_split(column, PARTS)]
        mean, error = float(np.mean(column)), float(np.std(parts, ddof=1) / np.sqrt(PARTS))
        if abs(mean) > LARGEST_PA:
            warnings.append(
                f"{signal.name} reads {mean / BAR:.1f} bar though the machine was to stand without pressure: its zero "
                "is not known; lower the tool, stop the engine, move all levers to relieve the lines, and read again"
            )
        else:
            found[number] = Zero(mean, error)
    return Zeros(found, tuple(warnings))
