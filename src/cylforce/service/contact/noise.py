"""Force at the tool at an instant, and the errors of the torques from which it is computed.

One part of the errors is learned in the air. Two have a known cause: delayed torque of inertia, and friction of a
cylinder that reverses. The arithmetic is the kernel's (estimation/kernel/pushed.py)."""

from array import array
from dataclasses import dataclass
from typing import Self

import numpy as np

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.layout import ForceLayout
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO, Limits, solver
from cylforce.estimation.model import Model, Tares
from cylforce.service.contact.hanging_mass import HEAVIEST
from cylforce.service.force import CLEAR, prior
from cylforce.service.pipeline import Instant
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array
from cylforce.signals.units import STANDARD_GRAVITY

# The figures below are measured on machines of another generator: see tools/studies/README.md.
PRIOR = 5.0  # times the row error of the weighing: standard error of a row before the machine has moved in the air
LATE_S = 0.034  # s: delay of the torque of inertia; its error is its change within this time
FADING_S = 0.045  # s in which such an error fades: the delay of the measured speed
LEARNING_S = 20.0  # s of motion in the air in which the learned variance follows; chosen
LARGEST = 9.0  # normalised square at which a sample is cut off in learning, so that a blow is not noise; chosen

SHOWN = 14  # numbers of a force, see `pushed.publish`


@dataclass(slots=True)
class SolvedForce:
    """The force that explains the residual torque of one instant.

    x, z:       components, forwards and upwards [N]
    xx, xz, zz: their covariance, without undetected errors of signals and without the error of the scale [N^2]
    weight:     weight of the mass in the bucket that explains most of the force [N]
    clearness:  f' C^-1 f, with f the force less that weight, (x, z + weight), and C its covariance
    numbers:    all results of the kernel (`ForceLayout`)
    """

    x: float
    z: float
    xx: float
    xz: float
    zz: float
    weight: float
    clearness: float
    numbers: Numbers


class NoiseConstants(Constants):
    """Constants of the torque errors of one machine.

    layout:  names of the places in the kernel's results
    size:    count of numbers in the part of the state that an interruption clears (`TorqueNoise.numbers`)
    learned: (R,) prior variance of each row [N^2 m^2]
    """

    def __init__(self, model: Model, tares: Tares, rated_force: float, kernel: Kernel | None = None) -> None:
        """Compute the constants of the errors of the measured torques; times become factors and numbers of steps.

        model:       of the machine
        tares:       identified parameters of the empty machine, with the error of each row [N m]
        rated_force: largest force that can be published, the prior standard error of a force [N]
        kernel:      form of the kernel; None: the compiled one if there is one
        """
        self.kernel, rows = kernel or choice.chosen(), len(model.machine.rows)
        self.layout = ForceLayout(rows)
        self.size = rows**2 + len(model.machine.cylinders)
        rate_hz = model.filters.rate_hz
        keep = float(np.exp(-1.0 / (FADING_S * rate_hz)))
        heaviest = HEAVIEST * model.machine.rated_payload * STANDARD_GRAVITY
        limits = Limits(keep=keep, delay_s=LATE_S, largest=LARGEST, learning=LEARNING_S * rate_hz, heaviest=heaviest)
        self.solver = solver(model, tares, self.kernel, limits, prior(model.machine, rated_force))
        learned = np.broadcast_to((PRIOR * tares.row_error) ** 2, (rows,))
        self.learned = array("d", learned.tolist())


@dataclass(slots=True)
class TorqueNoise(Estimator):
    """Errors of the rows of an instant.

    The torque of inertia is delayed while the acceleration changes. The sign of friction is uncertain while a cylinder
    reverses. All other errors are learned from the residual torque in the air.

    constants: of the machine
    numbers:   three parts, as the kernel keeps them: covariance (R, R) of the delayed torque of inertia [N^2 m^2];
               reversing (C,), 1 where a cylinder reverses, then fading; learned variance (R,) [N^2 m^2]
    """

    constants: NoiseConstants
    numbers: Numbers

    @classmethod
    def start(cls, constants: NoiseConstants) -> Self:
        """Return the state before any sample."""
        return cls(constants, ZERO * constants.size + constants.learned)

    def interrupt(self) -> None:
        """Keep only the learned variance after an interruption of the measurement."""
        size = self.constants.size
        self.numbers = ZERO * size + self.numbers[size:]

    def solve(self, instant: Instant, usable: Numbers, load: Numbers, drift: Array, undetected: Array) -> SolvedForce:
        """Return the force at the tool [N] that explains the residual torques of the usable rows, with its covariance.

        The errors of the rows are updated first: delayed torque of inertia, and friction of cylinders that reverse.

        instant:    filtered rows of the step
        usable:     (R,) 1 where the row of a measured joint torque can be used, else 0
        load:       (4,) in the bucket: m, m x, m z, J about the last pin [kg, kg m, kg m, kg m^2]
        drift:      (D,) change of friction [N, N s/m] and pressure zeros [N] since the identification
        undetected: (R, H) torques by the probable error of each of H signals [N m]
        """
        c, place = self.constants, self.constants.layout
        after, found = ZERO * len(self.numbers), ZERO * place.size
        errors = undetected.shape[1]
        c.kernel.tool_force(
            c.solver, instant.numbers, usable, load, drift, undetected, errors, self.numbers, after, found
        )
        self.numbers = after
        return SolvedForce(
            found[place.x],
            found[place.z],
            found[place.xx],
            found[place.xz],
            found[place.zz],
            found[place.weight],
            found[place.clearness],
            found,
        )

    def learn(self, solved: SolvedForce, load: Numbers, good: Numbers) -> None:
        """Update the learned variances of the rows [N^2 m^2] in the air, where the load explains the whole torque.

        solved: force of this instant
        load:   (4,) in the bucket: m, m x, m z, J about the last pin [kg, kg m, kg m, kg m^2]
        good:   (R,) 1 for the rows to learn from, else 0
        """
        self.constants.kernel.learn_noise(self.constants.solver, solved.numbers, good, load, self.numbers)

    def show(
        self, solved: SolvedForce, load: Numbers, covariance: Numbers, late: tuple[float, float], *, loaded: bool
    ) -> tuple[Numbers, Numbers]:
        """Return the published numbers (SHOWN,) of the resultant and of the soil force (`pushed.publish`).

        They are components, magnitude [N] and direction [rad] with their standard errors. The error by latency is
        added to the covariance of both forces.

        solved:     force that explains the residual torque of the instant
        load:       (4,) in the bucket: m, m x, m z, J about the last pin [kg, kg m, kg m, kg m^2]
        covariance: (4, 4) of the load
        late:       error (x, z) of both forces by their latency [N]
        loaded:     whether the soil force is the resultant less this load; else less the mass that explains most of it
        """
        c, place, (late_x, late_z) = self.constants, self.constants.layout, late
        numbers = solved.numbers[:]
        numbers[place.wider_xx] += late_x * late_x
        numbers[place.wider_xz] += late_x * late_z
        numbers[place.wider_zz] += late_z * late_z
        resultant, soil = ZERO * SHOWN, ZERO * SHOWN
        c.kernel.published_forces(c.solver, numbers, load, covariance, loaded, CLEAR, resultant, soil)
        return resultant, soil
