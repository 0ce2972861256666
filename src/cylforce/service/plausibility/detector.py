"""Base of all detectors: a detector tests for one way in which signals contradict each other or themselves.

A new detector is one file in `detectors` with a subclass of `Detector`, and one line in `table.py`. A fault that no
detector reports yet needs a member of `SensorFault` (`suspicion.py`), and its code and sentence in
`programs/live/sensor_messages.py`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import Model, Tares
from cylforce.service.plausibility.blocks import EVERY, BlockConstants, BlockGatherer
from cylforce.service.plausibility.pressure_groups import GroupConstants, PressureGroups
from cylforce.service.plausibility.sample import MonitorSample
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.service.snapshot import Constants, Estimator

__all__ = ["EVERY", "Detector", "Features", "Interruption", "MarkedPressures", "MonitoredMachine", "suspicion_of"]


C = TypeVar("C", bound=Constants)


class MonitoredMachine(Constants):
    """Constants of a machine whose signals are monitored.

    model:        of the machine
    tares:        of the machine
    rated_force:  at the tool [N]
    groups:       constants of the statistics of the pressures
    blocks:       constants of the seconds of motion
    """

    def __init__(self, model: Model, tares: Tares, rated_force: float) -> None:
        self.model, self.tares, self.rated_force = model, tares, rated_force
        self.groups, self.blocks = GroupConstants(model.machine), BlockConstants(model, tares)
        self._made: dict[object, Constants] = {}

    def constants(self, kind: "Callable[[MonitoredMachine], C]") -> C:
        """Return the constants of a detector; they are made at the first call, and the same object at later calls.

        kind: class of the constants
        """
        if kind not in self._made:
            self._made[kind] = kind(self)
        return cast(C, self._made[kind])


@dataclass(slots=True)
class Features:
    """Quantities of a step that several detectors use, computed once.

    now:    the step
    groups: statistics of the pressures, including this step
    blocks: seconds of motion, including this sample
    """

    now: MonitorSample
    groups: PressureGroups
    blocks: BlockGatherer


@dataclass(frozen=True, slots=True)
class Interruption:
    """Cause of an interruption of the measurement, as far as detectors use it.

    frozen:       whether a signal was frozen while none is suspected: votes without a suspicion were caused by that
                  signal
    out_of_range: numbers of the signals outside their range
    """

    frozen: bool
    out_of_range: tuple[int, ...]


class Detector(Estimator):
    """Base of all detectors.

    The monitor reads `report` at the steps at which it changes, and at each sample while there is a suspicion. While a
    detector is `unsure`, nothing is booked.

    report: present suspicion of the detector
    """

    __slots__ = ()
    report: SensorSuspicion

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the detector before any sample."""
        raise NotImplementedError

    @property
    def unsure(self) -> bool:
        """Return whether there is evidence, but too little for a suspicion."""
        return False

    def on_step(self, features: Features) -> None:
        """Update the detector with a step."""

    def on_sample(self, features: Features) -> None:
        """Update the detector with every EVERY-th step.

        `features.blocks.ended` is true at the end of a block of one second; `.block` then is that block, or None where
        the machine hardly moved.
        """

    def interrupt(self, why: Interruption) -> None:
        """Discard data that an interruption of the measurement makes invalid."""


@dataclass(slots=True)
class MarkedPressures(Detector):
    """Base of the detectors that mark single pressures.

    constants: of the pressures
    marked:    (P,) True where a pressure is suspected
    report:    present suspicion
    """

    constants: GroupConstants
    marked: NDArray[np.bool_]
    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the state before any reading."""
        return cls(machine.groups, np.zeros(len(machine.groups.signals), dtype=bool))

    def mark(self, marked: NDArray[np.bool_], cause: SensorFault) -> None:
        """Replace the marks by `marked` (P,), and report the marked pressures as rejected if the marks have changed.

        cause: fault that is reported
        """
        if (marked != self.marked).any():
            self.marked, self.report = marked, suspicion_of(marked, self.constants.signals, cause)


def suspicion_of(
    marked: NDArray[np.bool_], signals: list[int], cause: SensorFault, level: Level = Level.REJECTED
) -> SensorSuspicion:
    """Return the suspicion of the signals that are marked; NOTHING_SUSPECTED where none is.

    marked:  (P,) True where a signal is suspected
    signals: (P,) numbers of the signals
    cause:   suspected fault
    level:   of the suspicion
    """
    numbers = tuple(signal for signal, each in zip(signals, marked.tolist(), strict=True) if each)
    return SensorSuspicion(level, cause, numbers) if numbers else NOTHING_SUSPECTED
