"""A fleet of one type: what is usual, what changed, and every machine's course, from its recordings' evidence alone.
The order in which the recordings come does not matter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import Model
from cylforce.fleet.causes import Culprit, culprits
from cylforce.fleet.changes import LONGEST, Altered, Shape, changes
from cylforce.fleet.coordinates import Coordinate, coordinates, data_sheet, joint_coordinates, joint_directions
from cylforce.fleet.courses import Course, course
from cylforce.fleet.evidence import Evidence
from cylforce.fleet.gaussians import Belonging, Beside, in_turn, loosened
from cylforce.fleet.history import History
from cylforce.fleet.usual import Levels, Usual, learnt, stated
from cylforce.signals.estimate import Array

ROUNDS = 2  # of learning what is usual without what changed, and finding what changed by what is usual; chosen


class Dated(NamedTuple):
    """A recording of a machine at the time `t` [d]."""

    t: float
    evidence: Evidence


class MachineTold(NamedTuple):
    """What is told of one machine: its course in SI units, and its changes."""

    course: Course
    altered: tuple[Altered, ...]

    @property
    def lasting(self) -> tuple[Altered, ...]:
        """Without single days."""
        return tuple(each for each in self.altered if each.shape is not Shape.DAY)


class Fleet(NamedTuple):
    """All machines of one type: the `quantities` (K,) that are followed; what is `usual` of `known` (K',), in SI units:
    the same, then what moves several of them together; what is told of each machine by name."""

    quantities: tuple[Coordinate, ...]
    known: tuple[Coordinate, ...]
    usual: Usual
    machines: Mapping[str, MachineTold]


def fleet(model: Model, recordings: Mapping[str, Sequence[Dated]], beside: Beside = in_turn) -> Fleet:
    """The fleet of machines by name, each with its recordings in order of time. `beside`: who does what can be done at
    the same time; it changes nothing of what comes out."""
    return _Learning(model, {name: recordings[name][-LONGEST:] for name in sorted(recordings)}, beside).told


@dataclass(frozen=True)
class _Learning:
    """In units of the stated difference from day to day, `_unit` (K',): the K quantities, then those that move several
    of them together."""

    model: Model
    recordings: Mapping[str, Sequence[Dated]]
    beside: Beside

    @cached_property
    def _followed(self) -> tuple[Coordinate, ...]:
        return coordinates(self.model)

    @cached_property
    def _sheet(self) -> Array:
        return data_sheet(self.model)

    @cached_property
    def _known(self) -> tuple[Coordinate, ...]:
        return (*self._followed, *joint_coordinates(self.model))

    @cached_property
    def _unit(self) -> Array:
        return np.array([c.daily for c in self._known])

    @cached_property
    def _before(self) -> Usual:
        """What is stated beforehand."""
        mean = np.zeros(len(self._known))
        mean[: len(self._followed)] = self._sheet
        constant = np.array([c.constant for c in self._known])
        return stated(mean / self._unit, constant / self._unit, np.ones(len(self._unit)))

    @cached_property
    def _wholes(self) -> list[Array]:
        """(K, K') of each machine: the quantities as sums of what is estimated."""
        found = []
        for group in self.recordings.values():
            own = self._pooled([dated.evidence for dated in group])
            found.append(np.column_stack([np.eye(len(own)), joint_directions(self.model, own)]) * self._unit)
        return found

    def _pooled(self, each: Sequence[Evidence]) -> Array:
        """A machine's quantities (K,) as if no day differed from another."""
        mean, precision = self._sheet, np.diag([c.constant**-2.0 for c in self._followed])
        information = np.sum([e.information.sum(axis=0) for e in each], axis=0) + precision
        pull = np.sum([e.pull.sum(axis=0) for e in each], axis=0) + precision @ mean
        return np.asarray(np.linalg.solve(information, pull))

    @cached_property
    def _levels(self) -> Levels:
        counts = [len(group) for group in self.recordings.values()]
        machine = np.repeat(np.arange(len(counts)), counts)
        each = [dated.evidence for group in self.recordings.values() for dated in group]
        wholes = [self._wholes[k] for k in machine]
        information = np.concatenate([w.T @ e.information @ w for w, e in zip(wholes, each, strict=True)])
        pull = np.concatenate([e.pull @ w for w, e in zip(wholes, each, strict=True)])
        own = np.repeat(np.arange(len(each)), [len(e.parts) for e in each])
        return Levels(Belonging(information, pull, own), machine)

    @property
    def told(self) -> Fleet:
        """Everything."""
        usual, days = learnt(self._levels, self._before, beside=self.beside)
        altered = self._altered(usual, days)
        for _ in range(1, ROUNDS):
            usual, days = learnt(self._levels, self._before, usual, self._in_order(altered), self.beside)
            altered = self._altered(usual, days)
        courses = self.beside(lambda k: self._course(days, usual, k, altered[k]), range(len(altered)))
        each = zip(self.recordings, courses, altered, strict=True)
        told = {name: MachineTold(course, tuple(changed)) for name, course, changed in each}
        parts = ("mean", "between", "days", "within")
        in_si = usual._replace(**{part: getattr(usual, part) * self._unit for part in parts})
        return Fleet(self._followed, self._known, in_si, told)

    def _own(self, k: int) -> NDArray[np.intp]:
        return np.flatnonzero(self._levels.machine == k)

    def _altered(self, usual: Usual, days: Belonging) -> list[list[Altered]]:
        """The changes of every machine."""
        steady = loosened(days.information, days.pull, usual.days**2, self.beside)
        found = culprits(self.model.machine, self._known, usual.days * self._unit)
        scaled = [c._replace(directions=c.directions / self._unit[:, None]) for c in found]
        own = range(len(self.recordings))
        return self.beside(lambda k: self._of_machine(k, steady, usual, scaled), own)

    def _of_machine(self, k: int, steady: tuple[Array, Array], usual: Usual, found: Sequence[Culprit]) -> list[Altered]:
        own = self._own(k)
        if len(own) < 2:
            return []
        t = np.array([dated.t for dated in list(self.recordings.values())[k]])
        return changes(History(t, steady[0][own], steady[1][own], usual.mean, usual.between), found)

    def _in_order(self, altered: Sequence[Sequence[Altered]]) -> NDArray[np.intp]:
        """Numbers of the recordings before the first change of their machine that are no single days."""
        kept = []
        for k, own in enumerate(map(self._own, range(len(altered)))):
            lasting = [a.first for a in altered[k] if a.shape is not Shape.DAY]
            single = [a.first for a in altered[k] if a.shape is Shape.DAY]
            kept += [own[i] for i in range(min(lasting, default=len(own))) if i not in single]
        return np.array(kept or range(len(self._levels.machine)), dtype=np.intp)

    def _course(self, days: Belonging, usual: Usual, k: int, altered: Sequence[Altered]) -> Course:
        own = self._own(k)
        firsts = sorted({0, *(a.first for a in altered if a.shape is Shape.STEP)})
        past = np.array([max((f for f in firsts if f < i), default=0) for i in range(len(own))])
        return course(days.chosen(own), usual, past, self._wholes[k])
