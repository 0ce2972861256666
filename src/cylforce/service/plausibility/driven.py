"""Do the forces belong to the motion? What the tool touches is passive: soil resists, and springs back by centimetres;
a load hangs. Where the measured force, less that of any load, drives the tool over half a metre, pressures are not
those of this motion: they are exchanged, or dead.

A load that is weighed is subtracted with its whole force: its weight, its inertia, and the centrifugal force while the
house slews. One sample alone does not count: where a fast arm stops or turns, its inertia, known to a few per cent, may
show at one. A wheel loader drives into the heap, which then pushes its tool: there only the vertical part counts."""

from dataclasses import dataclass
from math import hypot, sqrt
from typing import NamedTuple

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.mechanics.machine import Machine
from cylforce.service.contact.hanging_mass import hanging_weight
from cylforce.service.plausibility.suspicion import Level
from cylforce.signals.estimate import Array, Force, Status
from cylforce.signals.kinds import Kind
from cylforce.signals.quick import once

# m over which the tool is driven, from which on the forces are doubted or rejected; chosen
FARTHEST = {Level.DOUBTED: 0.25, Level.REJECTED: 0.5}
LEAST = 0.02  # times the rated force: smallest driving force that counts; chosen
SURE = 5.0  # standard errors that it must exceed; chosen
SLOWEST = 0.05  # m/s of the tool below which its direction is not known; chosen
DRIVES = 2  # links of an arm that digs by driving: arm and bucket of a wheel loader


class Driven(NamedTuple):
    """State: the `path` [m] over which the tool was driven, and the torque left of each joint, integrated along it:
    `strain` (R,) [N m m]; whether it was driven at the last sample (`drives`), and the path [m] of one `alone`.

    first:    the direction of motion (x, z) in which it was driven first; zeros: in none
    opposite: m of the path in directions opposite to it"""

    path: float
    strain: Array
    drives: bool = False
    alone: float = 0.0
    first: tuple[float, float] = (0.0, 0.0)
    opposite: float = 0.0

    @property
    def confirmed(self) -> bool:
        """Whether the tool was driven in both directions of motion, each by as much as begins a doubt."""
        return min(self.path - self.opposite, self.opposite) > FARTHEST[Level.DOUBTED]

    @property
    def level(self) -> Level:
        """How surely the forces do not belong to the motion."""
        return Level.of(self.path, FARTHEST)


@dataclass(frozen=True)
class Driving:
    """The work of the surroundings on one machine's tool."""

    machine: Machine
    rated_force: float
    seconds: float  # between two steps

    @once
    def _stands(self) -> bool:
        """Whether the machine stands while it digs: it has a slew sensor, and is no wheel loader.

        A loader's arm has two links, with which its teeth go straight through the heap only if it drives. A gyro on it
        measures how it steers."""
        slews = any(s.kind in (Kind.SLEW_RATE, Kind.SLEW_ANGLE) for s in self.machine.signals)
        return slews and self.machine.size != DRIVES

    def begin(self) -> Driven:
        """Nothing was driven."""
        return Driven(0.0, np.zeros(len(self.machine.rows)))

    def step(
        self, state: Driven, resultant: Force, velocity: complex, torque: Numbers, beside: Force | None = None
    ) -> Driven:
        """Return the state after one step. What resists takes back as much of the path.

        resultant: force of all that acts on the tool
        velocity:  of the tool, x + i z [m/s]
        torque:    (R,) residual torque of the tares [N m]
        beside:    the resultant less the force of the load that is weighed; None while none is"""
        speed = abs(velocity)
        if speed < SLOWEST or resultant.x.status is Status.INVALID or resultant.z.status is Status.INVALID:
            return state._replace(drives=False, alone=0.0) if state.drives else state
        along, way = velocity / speed, speed * self.seconds
        if not self._pushes(resultant, along) or not (beside is None or self._pushes(beside, along)):
            return state._replace(path=state.path - way, drives=False, alone=0.0) if state.path > way else self.begin()
        if not state.drives:
            return state._replace(drives=True, alone=way)
        way += state.alone
        first, strain = state.first, state.strain + way * np.abs(torque)
        first = first if any(first) else (along.real, along.imag)
        back = way if along.real * first[0] + along.imag * first[1] < 0.0 else 0.0
        return Driven(state.path + way, strain, drives=True, first=first, opposite=state.opposite + back)

    def _pushes(self, force: Force, along: complex) -> bool:
        """Return whether a force, less what a hanging mass explains of it, drives the tool in the direction `along`."""
        if force.x.status is Status.INVALID or force.z.status is Status.INVALID:
            return False
        (xx, xz, zz), x, z = force.covariance, force.x.value, force.z.value
        x *= self._stands  # the heap's push says nothing of the mass either
        if along.imag < 0.0:  # a load drives what it hangs from downwards only
            z += hanging_weight(x, z, xx, xz, self.machine.rated_payload)
        push = x * along.real + z * along.imag
        error = sqrt(abs(along.real**2 * xx + 2.0 * along.real * along.imag * xz + along.imag**2 * zz))
        return push > max(LEAST * self.rated_force, SURE * hypot(error, 1.0))
