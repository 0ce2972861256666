"""Detector of forces that contradict the motion: the measured force drives the tool.

The surroundings of the tool are passive: soil resists, and springs back by centimetres; a load only hangs. If the
measured force, less that of any load, drives the tool over half a metre, pressures are swapped or dead.

The whole force of a weighed load is subtracted: its weight, its inertia, and the centrifugal force while the house
slews. One sample alone does not count: where a fast arm stops or reverses, the error of its inertia, of a few per cent,
may exceed the limit in one sample. A wheel loader drives into the heap, which then pushes its tool. On such a machine
only the vertical part counts."""

from dataclasses import dataclass
from math import hypot, sqrt
from typing import Self

import numpy as np

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.mechanics.machine import FORCE_KINDS
from cylforce.service.contact.hanging_mass import hanging_weight
from cylforce.service.plausibility.detector import (
    EVERY,
    Detector,
    Features,
    Interruption,
    MonitoredMachine,
)
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorFault, SensorSuspicion
from cylforce.service.snapshot import Constants
from cylforce.signals.estimate import Array, Force, Status
from cylforce.signals.kinds import Kind

# m of driven path of the tool from which on the forces are suspected or rejected; chosen
FARTHEST = {Level.SUSPECTED: 0.25, Level.REJECTED: 0.5}
LEAST = 0.02  # times the rated force: smallest driving force that counts; chosen
SURE = 5.0  # standard errors that it must exceed; chosen
SLOWEST = 0.05  # m/s of the tool below which its direction is not known; chosen
DRIVES = 2  # links of an arm that digs by driving: arm and bucket of a wheel loader


class DrivenConstants(Constants):
    """Constants of the driven path of one machine's tool.

    machine: of the model
    seconds: time between two samples [s]
    least:   smallest driving force that counts [N]
    stands:  whether the machine stands while it digs: it has a slew sensor, and is no wheel loader. A loader's arm has
             two links, with which its teeth go straight through the heap only if it drives; a gyro on it measures its
             steering
    outward: (R,) longest reach of the arm beyond each measured joint, by which its torque is divided [m]
    acting:  numbers of the pressures of the cylinders that act on each measured joint
    """

    def __init__(self, monitored: MonitoredMachine) -> None:
        """Compute the smallest driving force that counts [N], the reach of each joint [m], and its pressures.

        monitored: constants of the machine, with the rated force [N]
        """
        model = monitored.model
        machine = self.machine = model.machine
        self.seconds, self.least = EVERY / model.filters.rate_hz, LEAST * monitored.rated_force
        slews = any(s.kind in (Kind.SLEW_RATE, Kind.SLEW_ANGLE) for s in machine.signals)
        self.stands = slews and machine.size != DRIVES
        outward = np.append(machine.lengths[:-1], machine.payload_reach)[::-1].cumsum()[::-1]
        self.outward = outward[list(machine.rows)]
        signals = [(k, s) for k, s in enumerate(machine.signals) if s.kind in FORCE_KINDS]
        self.acting = [tuple(k for k, s in signals if s.index in acting) for acting in model.acting]

    def pushes(self, force: Force, along: complex) -> bool:
        """Return whether a measured force, less the part that a hanging mass explains, clearly drives the tool.

        It drives the tool if its component along the motion exceeds the smallest force that counts, and SURE standard
        errors. The part of a hanging mass is subtracted while the tool moves downwards, where its weight drives it.
        Where the machine drives while it digs (wheel loader), only the vertical component counts.

        force: at the tool, with its covariance
        along: unit vector of the tool's motion, x + i z
        """
        if force.x.status is Status.INVALID or force.z.status is Status.INVALID:
            return False
        (xx, xz, zz), x, z = force.covariance, force.x.value, force.z.value
        x *= self.stands  # the push of a heap is no evidence about the mass either
        if along.imag < 0.0:  # a load drives the tool downwards only
            z += hanging_weight(x, z, xx, xz, self.machine.rated_payload)
        push = x * along.real + z * along.imag
        error = sqrt(abs(along.real**2 * xx + 2.0 * along.real * along.imag * xz + along.imag**2 * zz))
        return push > max(self.least, SURE * hypot(error, 1.0))


@dataclass(slots=True)
class DrivenTool(Detector):
    """Path over which the tool was driven.

    constants: of the machine
    path:      over which the tool was driven [m]
    strain:    (R,) magnitude of the residual torque of each joint, integrated along the path [N m m]
    drives:    whether the tool was driven at the last sample
    alone:     path of one sample that does not count yet [m]
    first:     direction of motion (x, z) in which the tool was driven first; zeros: in none
    opposite:  part of the path in directions opposite to `first` [m]
    report:    present suspicion
    """

    constants: DrivenConstants
    path: float
    strain: Array
    drives: bool
    alone: float
    first: tuple[float, float]
    opposite: float
    report: SensorSuspicion = NOTHING_SUSPECTED

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return the detector before any sample: the tool was not driven by the measured force over any path."""
        return cls(
            machine.constants(DrivenConstants),
            path=0.0,
            strain=np.zeros(len(machine.model.machine.rows)),
            drives=False,
            alone=0.0,
            first=(0.0, 0.0),
            opposite=0.0,
        )

    @property
    def level(self) -> Level:
        """Level of the suspicion that the forces contradict the motion."""
        return Level.of(self.path, FARTHEST)

    @property
    def confirmed(self) -> bool:
        """Return whether the tool was driven in both directions, by as much as begins a suspicion in each."""
        return min(self.path - self.opposite, self.opposite) > FARTHEST[Level.SUSPECTED]

    def interrupt(self, why: Interruption) -> None:
        """Reset the path; the suspicion stays until the next sample."""
        self._begin()

    def _begin(self) -> None:
        self.path, self.strain, self.first, self.opposite = 0.0, np.zeros_like(self.strain), (0.0, 0.0), 0.0
        self.drives, self.alone = False, 0.0

    def on_sample(self, features: Features) -> None:
        """Update the driven path with the forces of a sample, and the suspicion by its length.

        The pressures of the joint with the largest residual torque over its reach, summed along the path, are the
        suspected ones. A force that a weighed load explains is no driving force.
        """
        now = features.now
        soil = now.forces.soil if now.weighed else None
        self.take(now.forces.resultant, now.instant.velocity, now.residual, soil)
        level = self.level
        if level is Level.FINE:
            self.report = NOTHING_SUSPECTED
        else:
            joint = int((self.strain / self.constants.outward).argmax())
            signals = self.constants.acting[joint]
            self.report = SensorSuspicion(level, SensorFault.CONTRADICTS_MOTION, signals, confirmed=self.confirmed)

    def take(self, resultant: Force, velocity: complex, residual: Numbers, soil: Force | None = None) -> None:
        """Update the path with one sample. A force that resists reduces the path by the way of that sample.

        The way of a driven sample counts as soon as the next sample is driven, too. A sample of a slow tool, or without
        a known force, leaves the path unchanged.

        resultant: force of all that acts on the tool
        velocity:  of the tool, x + i z [m/s]
        residual:  (R,) measured joint torques less those of the empty machine [N m]
        soil:      the resultant less the force of the weighed load; None: no load is weighed
        """
        speed, c = abs(velocity), self.constants
        if speed < SLOWEST or resultant.x.status is Status.INVALID or resultant.z.status is Status.INVALID:
            self.drives, self.alone = False, 0.0
            return
        along, way = velocity / speed, speed * c.seconds
        if not c.pushes(resultant, along) or not (soil is None or c.pushes(soil, along)):
            self._resist(way)
            return
        if not self.drives:
            self.drives, self.alone = True, way
            return
        way += self.alone
        self.alone = 0.0
        self.strain = self.strain + way * np.abs(residual)
        if not any(self.first):
            self.first = (along.real, along.imag)
        if along.real * self.first[0] + along.imag * self.first[1] < 0.0:
            self.opposite += way
        self.path += way

    def _resist(self, way: float) -> None:
        """Reduce the path by `way` [m]; reset the whole state where the path is no longer than that."""
        if self.path > way:
            self.path -= way
            self.drives, self.alone = False, 0.0
        else:
            self._begin()
