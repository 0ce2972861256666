"""Evaluate a fleet of one type: usual spreads, changes, and every machine's course, from its recordings' statistics
alone.

The order in which the recordings come does not matter.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import Model
from cylforce.fleet.causes import ChangeCause, possible_causes
from cylforce.fleet.changes import LONGEST, MachineChange, Shape, changes
from cylforce.fleet.coordinates import Coordinate, coordinates, data_sheet, joint_coordinates, joint_directions
from cylforce.fleet.courses import Course, course
from cylforce.fleet.evidence import Evidence
from cylforce.fleet.gaussians import GroupedGaussians, with_added_variance
from cylforce.fleet.history import History
from cylforce.fleet.usual import Levels, Usual, learn_usual, prior_usual
from cylforce.signals.estimate import Array
from cylforce.signals.parallel import ParallelMap, sequential_map

ROUNDS = 2  # rounds of estimating the usual spreads without changed recordings, and the changes by these; chosen


class Dated(NamedTuple):
    """A recording of a machine.

    t: time [d]
    evidence: its statistics
    """

    t: float
    evidence: Evidence


class MachineResult(NamedTuple):
    """Results of one machine.

    course: its course [SI]
    altered: its changes
    """

    course: Course
    altered: tuple[MachineChange, ...]

    @property
    def lasting(self) -> tuple[MachineChange, ...]:
        """Return the changes without single days."""
        return tuple(change for change in self.altered if change.shape is not Shape.DAY)


class Fleet(NamedTuple):
    """Machines of one type.

    quantities: (K,) quantities of each machine
    known: (K',) these, then those that change several of them together
    usual: usual values and spreads of `known` [SI]
    machines: results of each machine, by name
    """

    quantities: tuple[Coordinate, ...]
    known: tuple[Coordinate, ...]
    usual: Usual
    machines: Mapping[str, MachineResult]


def fleet(model: Model, recordings: Mapping[str, Sequence[Dated]], parallel_map: ParallelMap = sequential_map) -> Fleet:
    """Return the results of a fleet.

    recordings: by name of the machine its recordings in order of time
    parallel_map: maps a function, perhaps in parallel; it does not change the results
    """
    return _Learning(model, {name: recordings[name][-LONGEST:] for name in sorted(recordings)}, parallel_map).result


@dataclass(frozen=True)
class _Learning:
    """The evaluation, in units of the stated day-to-day spread.

    model: model of the type
    recordings: by name of the machine its recordings in order of time
    parallel_map: maps a function, perhaps in parallel
    """

    model: Model
    recordings: Mapping[str, Sequence[Dated]]
    parallel_map: ParallelMap

    @cached_property
    def _followed(self) -> tuple[Coordinate, ...]:
        """Return the K quantities that are followed."""
        return coordinates(self.model)

    @cached_property
    def _sheet(self) -> Array:
        """Return the values (K,) of the data sheet."""
        return data_sheet(self.model)

    @cached_property
    def _known(self) -> tuple[Coordinate, ...]:
        """Return the K' estimated quantities: those followed, then those that move several of them together."""
        return (*self._followed, *joint_coordinates(self.model))

    @cached_property
    def _unit(self) -> Array:
        """Return the unit (K',) of each estimated quantity: its stated day-to-day spread."""
        return np.array([c.daily for c in self._known])

    @cached_property
    def _before(self) -> Usual:
        """Return the stated spreads."""
        mean = np.zeros(len(self._known))
        mean[: len(self._followed)] = self._sheet
        constant = np.array([c.constant for c in self._known])
        return prior_usual(mean / self._unit, constant / self._unit, np.ones(len(self._unit)))

    @cached_property
    def _wholes(self) -> list[Array]:
        """Return for each machine the matrix (K, K') from the estimated quantities to those followed."""
        matrices = []
        for group in self.recordings.values():
            pooled = self._pooled([dated.evidence for dated in group])
            matrices.append(np.column_stack([np.eye(len(pooled)), joint_directions(self.model, pooled)]) * self._unit)
        return matrices

    def _pooled(self, recorded: Sequence[Evidence]) -> Array:
        """Return a machine's quantities (K,) without day-to-day differences."""
        mean, precision = self._sheet, np.diag([c.constant**-2.0 for c in self._followed])
        information = np.sum([e.information.sum(axis=0) for e in recorded], axis=0) + precision
        pull = np.sum([e.pull.sum(axis=0) for e in recorded], axis=0) + precision @ mean
        return np.asarray(np.linalg.solve(information, pull))

    @cached_property
    def _levels(self) -> Levels:
        """Return the minutes of all recordings, grouped by recording and machine."""
        counts = [len(group) for group in self.recordings.values()]
        machine = np.repeat(np.arange(len(counts)), counts)
        recorded = [dated.evidence for group in self.recordings.values() for dated in group]
        wholes = [self._wholes[k] for k in machine]
        information = np.concatenate([w.T @ e.information @ w for w, e in zip(wholes, recorded, strict=True)])
        pull = np.concatenate([e.pull @ w for w, e in zip(wholes, recorded, strict=True)])
        recording = np.repeat(np.arange(len(recorded)), [len(e.parts) for e in recorded])
        return Levels(GroupedGaussians(information, pull, recording), machine)

    @property
    def result(self) -> Fleet:
        """Return the results of all machines."""
        usual, days = learn_usual(self._levels, self._before, parallel_map=self.parallel_map)
        altered = self._altered(usual, days)
        for _ in range(1, ROUNDS):
            usual, days = learn_usual(self._levels, self._before, usual, self._healthy(altered), self.parallel_map)
            altered = self._altered(usual, days)
        courses = self.parallel_map(lambda k: self._course(days, usual, k, altered[k]), range(len(altered)))
        machines = {
            name: MachineResult(course=course, altered=tuple(changed))
            for name, course, changed in zip(self.recordings, courses, altered, strict=True)
        }
        parts = ("mean", "between", "days", "within")
        in_si = usual._replace(**{part: getattr(usual, part) * self._unit for part in parts})
        return Fleet(quantities=self._followed, known=self._known, usual=in_si, machines=machines)

    def _recordings_of(self, k: int) -> NDArray[np.intp]:
        """Return the numbers of the recordings of machine k."""
        return np.flatnonzero(self._levels.machine == k)

    def _altered(self, usual: Usual, days: GroupedGaussians) -> list[list[MachineChange]]:
        """Return the changes of every machine."""
        steady = with_added_variance(days.information, days.pull, usual.days**2, self.parallel_map)
        causes = possible_causes(self.model.machine, self._known, usual.days * self._unit)
        scaled = [c._replace(directions=c.directions / self._unit[:, None]) for c in causes]
        machines = range(len(self.recordings))
        return self.parallel_map(lambda k: self._of_machine(k, steady, usual, scaled), machines)

    def _of_machine(
        self, k: int, steady: tuple[Array, Array], usual: Usual, causes: Sequence[ChangeCause]
    ) -> list[MachineChange]:
        """Return the changes of machine k; `steady`: information and pull about its constant values."""
        numbers = self._recordings_of(k)
        if len(numbers) < 2:
            return []
        information, pull = steady
        history = History(
            t=np.array([dated.t for dated in list(self.recordings.values())[k]]),
            information=information[numbers],
            pull=pull[numbers],
            mean=usual.mean,
            spread=usual.between,
        )
        return changes(history, causes)

    def _healthy(self, altered: Sequence[Sequence[MachineChange]]) -> NDArray[np.intp]:
        """Return the numbers of the recordings before the first change of their machine, without single days."""
        healthy = []
        for k, numbers in enumerate(map(self._recordings_of, range(len(altered)))):
            lasting = [a.first for a in altered[k] if a.shape is not Shape.DAY]
            single = [a.first for a in altered[k] if a.shape is Shape.DAY]
            healthy += [numbers[i] for i in range(min(lasting, default=len(numbers))) if i not in single]
        return np.array(healthy or range(len(self._levels.machine)), dtype=np.intp)

    def _course(self, days: GroupedGaussians, usual: Usual, k: int, altered: Sequence[MachineChange]) -> Course:
        """Return the course of machine k; after a step the recordings before do not count as earlier."""
        numbers = self._recordings_of(k)
        firsts = sorted({0, *(a.first for a in altered if a.shape is Shape.STEP)})
        past = np.array([max((f for f in firsts if f < i), default=0) for i in range(len(numbers))])
        return course(days.chosen(numbers), usual, past, self._wholes[k])
