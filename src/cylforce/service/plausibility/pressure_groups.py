"""Statistics of each pressure by itself: means, variances and white noise of its readings in groups of 0.25 s.

Groups are formed while the pressure's cylinder moves, and separately while it rests but another one moves. The noise is
that of second differences in the quietest tenth of the last 15 s of motion, at most the sensor's stated standard error.
Groups without noise are not used for it."""

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from operator import itemgetter
from typing import Self

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.pressures import GROUP, GROUPS, NOISES
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.mechanics.machine import Machine
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import SIDES

MOVES = 0.02  # m/s of a cylinder from which on a group is one of motion; chosen: far above the noise of a speed
KEPT = 10  # readings that stay when a group has ended: for the fall of a burst hose and as long after it
# Variance between the groups' means over that expected from the noise within them: above this a pressure that was
# constant changes again; a constant exceeds it once in ten hours (chi-squared with 15 degrees of freedom, 1.16e-6: four
# a second, of six pressures)
CHANGES = 56.118 / (GROUPS - 1)
# Median variance within groups over that of their white noise, from second differences: above this, oil oscillates.
# F distribution with 24 and 12.1 degrees of freedom, exceeded by 2 % of single groups of white noise
COLOURED = 3.1795
# A tenth of the groups has less than this share of the white noise's variance: chi-squared with the 12.1 degrees of
# freedom of 23 second differences
TENTH = 0.52701
# Variance of all readings of the last 1 to 4 groups over that of the noise, below which the noise is gone: white noise
# falls below once in ten hours of motion (chi-squared, lower quantiles of 2.9e-7: four a second, of six pressures, four
# limits)
QUIET = (0.14338, 0.29127, 0.38126, 0.44281)

Mask = NDArray[np.bool_]


def pressures(machine: Machine) -> list[int]:
    """Return the numbers (P,) of the signals that are pressures."""
    return [k for k, s in enumerate(machine.signals) if s.kind in SIDES]


def picker(machine: Machine) -> Callable[[Numbers], Numbers]:
    """Return a function that selects a machine's P pressures from the values (S,) of all its signals."""
    signals = pressures(machine)
    if len(signals) > 1:
        pick = itemgetter(*signals)
        return lambda values: array("d", pick(values))
    return lambda values: array("d", [values[k] for k in signals])


class GroupConstants(Constants):
    """Constants of the pressures of one machine.

    signals:   (P,) numbers of the pressures
    pick:      function that selects the pressures (P,) of all signals (S,)
    cylinders: (P,) number of the cylinder of each pressure
    stated:    (P,) variances of the sensors' noise [Pa^2]; infinite where none is stated
    quiet:     variance ratios below which the noise of 1 to 4 groups is gone
    """

    def __init__(self, machine: Machine, kernel: Kernel | None = None) -> None:
        """Collect the pressures among a machine's signals, their cylinders, and their stated noise.

        kernel: form of the kernel; None: the compiled one if there is one
        """
        self.kernel, self.signals, self.pick = kernel or choice.chosen(), pressures(machine), picker(machine)
        self.cylinders = [machine.signals[k].index for k in self.signals]
        self.stated = array("d", [machine.signals[k].standard_error ** 2 or inf for k in self.signals])
        self.quiet = numbers(QUIET)


@dataclass(slots=True)
class GroupStatistics(Estimator):
    """Groups and noise of P pressures, in motion or at rest. Both arrays are flat, the newest group is the last one.

    groups: (4, GROUPS, P) of the last groups: mean [Pa], variance [Pa^2], direction of the cylinder (1 extends, -1
            retracts), variance of the white noise [Pa^2]; 0 before the first groups
    noise:  (NOISES + 1, P): variance of the noise in the last NOISES groups [Pa^2], 0 before the first groups; the last
            row is the number of groups since the noise is gone, 0 where it is not gone
    """

    groups: Numbers
    noise: Numbers

    @classmethod
    def start(cls, size: int) -> Self:
        """Return the statistics of `size` pressures before any reading."""
        return cls(ZERO * (4 * GROUPS * size), ZERO * ((NOISES + 1) * size))

    @property
    def known(self) -> Array:
        """Variances (NOISES, P) of the noise [Pa^2]."""
        return np.frombuffer(self.noise).reshape(NOISES + 1, -1)[:-1]

    @property
    def since(self) -> Array:
        """Number (P,) of groups since the noise is gone; 0 where it is not."""
        return np.asarray(np.frombuffer(self.noise).reshape(NOISES + 1, -1)[-1])

    @property
    def gone(self) -> Mask:
        """Mask (P,), True where the noise is gone."""
        return np.asarray(self.since > 0.0)

    def take(self, c: GroupConstants, readings: Numbers, way: Numbers, which: Mask) -> None:
        """Update means, variances and noise of each pressure with a new group, the last GROUP readings.

        The group of a pressure is added where |way| exceeds MOVES.

        c:        constants of the pressures
        readings: (T, P) [Pa], flat
        way:      (P,) groups in motion: speed of each pressure's cylinder [m/s], extending positive; groups at rest: 1
                  for the pressures to update, else 0
        which:    (P,) True for the pressures whose noise is updated
        """
        size = len(c.signals)
        begin = len(readings) // size - GROUP
        c.kernel.add_group(size, readings, begin, way, MOVES, self.groups)
        group = np.frombuffer(readings, offset=8 * size * begin).reshape(GROUP, size)
        means_and_variances = np.ascontiguousarray(np.frombuffer(self.groups).reshape(4, GROUPS, size)[:2])
        chosen = (means_and_variances, GROUPS, np.asarray(which, dtype=np.float64), c.stated)
        c.kernel.update_noise(size, group, GROUP, *chosen, TENTH, c.quiet, len(QUIET), ZERO * NOISES, self.noise)

    def last_longer(self, moved: Mask) -> None:
        """Count one more group since the noise is gone, for pressures whose noise is gone and that get no group here.

        moved: (P,) True for the pressures to count, whose cylinders moved
        """
        gone = moved & self.gone
        if gone.any():
            longer = np.frombuffer(self.noise).reshape(NOISES + 1, -1).copy()
            longer[-1] += gone
            self.noise = numbers(longer.ravel())

    def learn_anew(self, changes: Mask) -> None:
        """Discard the learned noise of pressures that change again, if it was gone for more than GROUPS groups.

        Such a pressure was not frozen: its noise has become smaller, and is learned anew.

        changes: (P,) True where a pressure changes from group to group by more than its noise explains
        """
        back = changes & (self.since > GROUPS)
        if back.any():
            anew = np.where(back, 0.0, np.frombuffer(self.noise).reshape(NOISES + 1, -1))
            self.noise = numbers(anew.ravel())


@dataclass(slots=True)
class PressureGroups(Estimator):
    """Statistics of the pressures of one machine.

    constants: of the machine
    readings:  the last readings (T, P), flat [Pa]
    fresh:     number of readings of the running group
    motion:    groups while the pressure's own cylinder moves
    rest:      groups while it rests and another one moves; a cylinder at rest may transmit less of the pump's noise
    now:       (P,) pressures of this step [Pa]
    lowest:    lowest pressure of this step [Pa]; infinite without pressures
    ratios:    (2, P) where a group has ended at this step, else empty: variance of the groups' means over that expected
               from the noise within them (-1: not enough groups), and that noise over its white part
    """

    constants: GroupConstants
    readings: Numbers
    fresh: int
    motion: GroupStatistics
    rest: GroupStatistics
    now: Numbers
    lowest: float
    ratios: Numbers

    @classmethod
    def start(cls, constants: GroupConstants) -> Self:
        """Return the statistics of a machine's pressures before any reading: no group, no noise [Pa^2] known."""
        size, empty = len(constants.signals), array("d")
        return cls(
            constants,
            readings=empty,
            fresh=0,
            motion=GroupStatistics.start(size),
            rest=GroupStatistics.start(size),
            now=empty,
            lowest=inf,
            ratios=empty,
        )

    @property
    def recent(self) -> Array:
        """Last readings (T, P) [Pa]."""
        return np.frombuffer(self.readings).reshape(-1, len(self.constants.signals))

    @property
    def ended(self) -> bool:
        """Return whether a group has ended at this step."""
        return self.fresh == GROUP

    @property
    def gone(self) -> Mask:
        """Mask (P,), True where the noise is gone in motion or at rest."""
        return np.asarray(self.motion.gone | self.rest.gone)

    def interrupt(self) -> None:
        """Begin the running group anew, because the measurement stopped."""
        self.readings, self.fresh, self.ratios = array("d"), 0, array("d")

    def update(self, values: Numbers, speed: Numbers) -> None:
        """Append the pressures of one step to the running group, and update the statistics when the group has ended.

        values: (S,) of all signals [SI]
        speed:  (C,) of the cylinders [m/s]
        """
        self.now = self.constants.pick(values)
        self.lowest = min(self.now, default=inf)
        if self.ratios:
            self.ratios = array("d")
        if self.ended:
            self.readings, self.fresh = self.readings[-KEPT * len(self.now) :], 0
        self.readings += self.now
        self.fresh += 1
        if self.ended:
            self._end_group(speed)

    def _end_group(self, speed: Numbers) -> None:
        """Update means, variances and noise with a group of readings that has ended, if a cylinder moved.

        A pressure belongs to the groups in motion if its own cylinder moves, else to those at rest. Ratios of the
        groups in motion are computed, which show whether a pressure changes at all.

        speed: (C,) of the cylinders [m/s], extending positive
        """
        c, size = self.constants, len(self.constants.signals)
        way = array("d", [speed[cylinder] for cylinder in c.cylinders])
        moved = np.array([abs(each) > MOVES for each in way], dtype=bool)
        if not moved.any():
            return
        self.motion.take(c, self.readings, way, moved)
        rested = ~moved
        if rested.any():
            self.rest.take(c, self.readings, array("d", rested.astype(np.float64).tobytes()), rested)
        self.rest.last_longer(moved)
        ratios = ZERO * (2 * size)
        if c.kernel.compare_groups(size, self.motion.groups, ZERO * GROUPS, ratios):
            self.ratios = ratios
            varied, coloured = np.frombuffer(ratios).reshape(2, size)
            changes = (varied > CHANGES) | ((varied >= 0.0) & (coloured > COLOURED))
            if changes.any():
                self.motion.learn_anew(changes)
                self.rest.learn_anew(changes)
