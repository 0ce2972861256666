"""A detector: one way in which signals contradict each other or themselves. A new one is one file with a class as this,
and one line in `table.py`."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Self, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import Model, Tares
from cylforce.service.plausibility.blocks import EVERY, BlockConstants, BlockGatherer
from cylforce.service.plausibility.pressure_groups import GroupConstants, PressureGroups
from cylforce.service.plausibility.sample import MonitorSample
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorDoubt, SensorFault
from cylforce.service.snapshot import Constants, Estimator

__all__ = ["EVERY", "Description", "Detector", "Features", "Interruption", "MonitoredMachine", "doubt_of"]


@dataclass(frozen=True, slots=True)
class Description:
    """What a detector does, in words for its chapter.

    faults:    that it reports
    looks_at:  its input
    residual:  what it compares with the threshold
    threshold: with its origin
    levels:    suspected, rejected, latched: when
    recovery:  when the suspicion ends
    """

    faults: tuple[SensorFault, ...]
    looks_at: str
    residual: str
    threshold: str
    levels: str
    recovery: str


C = TypeVar("C", bound=Constants)


class MonitoredMachine(Constants):
    """A machine whose signals are monitored.

    model, tares: of the machine
    rated_force:  at the tool [N]
    groups:       constants of the statistics of the pressures
    blocks:       constants of the seconds of motion
    """

    def __init__(self, model: Model, tares: Tares, rated_force: float) -> None:
        self.model, self.tares, self.rated_force = model, tares, rated_force
        self.groups, self.blocks = GroupConstants(model.machine), BlockConstants(model, tares)
        self._made: dict[object, Constants] = {}

    def constants(self, kind: "Callable[[MonitoredMachine], C]") -> C:
        """Return the constants of a detector, made once."""
        if kind not in self._made:
            self._made[kind] = kind(self)
        return cast(C, self._made[kind])


@dataclass(slots=True)
class Features:
    """What several detectors need of a step, computed once.

    now:    the step
    groups: statistics of the pressures, with this step
    blocks: seconds of motion, with this sample
    """

    now: MonitorSample
    groups: PressureGroups
    blocks: BlockGatherer


@dataclass(frozen=True, slots=True)
class Interruption:
    """Why the measurement stopped, as far as it matters.

    frozen:  whether a signal was frozen, and none is suspected: votes that led to nothing were about that
    strayed: numbers of the signals outside their range
    """

    frozen: bool
    strayed: tuple[int, ...]


class Detector(Estimator):
    """Base of all detectors.

    A detector keeps its present report in `doubt`; it is taken at the steps at which it changes, and at each sample
    while something is suspected. `unsure` is some evidence, too little for a suspicion: nothing is booked meanwhile.
    """

    __slots__ = ()
    DESCRIPTION: ClassVar[Description]
    doubt: SensorDoubt

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the detector before any sample."""
        raise NotImplementedError

    @property
    def unsure(self) -> bool:
        """Whether there is evidence, too little for a suspicion."""
        return False

    def on_step(self, features: Features) -> None:
        """Take a step."""

    def on_sample(self, features: Features) -> None:
        """Take every EVERY-th step; `features.blocks.ended` and `.block` tell whether a second of motion has ended."""

    def interrupt(self, why: Interruption) -> None:
        """Drop what an interruption of the measurement makes worthless."""


def doubt_of(
    marked: NDArray[np.bool_], signals: list[int], cause: SensorFault, level: Level = Level.REJECTED
) -> SensorDoubt:
    """Return the suspicion of those of the `signals` (P,) that are `marked` (P,), if any are."""
    numbers = tuple(signal for signal, each in zip(signals, marked.tolist(), strict=True) if each)
    return SensorDoubt(level, cause, numbers) if numbers else NOTHING_SUSPECTED
