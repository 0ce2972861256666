"""Types of the kernel's functions: one protocol for the compiled and the interpreted form. Each function is documented
in the file that is named above it."""

from collections.abc import Callable
from typing import Protocol

# other names than the classes' own, because the protocol's attributes have those
from cylforce.estimation.kernel.drifting import KernelDrift as Drift
from cylforce.estimation.kernel.inputs import KernelInputs as Inputs
from cylforce.estimation.kernel.plan import KernelPlan as Plan
from cylforce.estimation.kernel.plan import KernelSensors as Sensors
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.kernel.solver import KernelSolver as Solver
from cylforce.signals.estimate import Array

Flat = Numbers | Array  # Python's array where the kernel writes, NumPy's allowed where it only reads


class Kernel(Protocol):
    """Classes of constants, and functions of them and of flat arrays."""

    KernelInputs: Callable[..., Inputs]
    KernelSensors: Callable[..., Sensors]
    KernelPlan: Callable[..., Plan]
    KernelSolver: Callable[..., Solver]
    KernelDrift: Callable[..., Drift]

    # inputs.py
    def receive(
        self, p: Inputs, state: Flat, sorts: Counts, number: int, times: Flat, raw: Flat, moving: Flat, /
    ) -> None: ...
    def usable(self, p: Inputs, state: Flat, t_us: float, sample: Flat, /) -> int: ...
    def stepped(self, p: Inputs, state: Flat, found: Flat, /) -> None: ...
    def quantise(self, size: int, limits: Flat, values: Flat, sent: Counts, /) -> None: ...
    # plan.py
    def sense(self, p: Sensors, values: Flat, into: Flat, /) -> int: ...
    # rows.py
    def advance(self, p: Plan, old: Flat, here: Flat, new: Flat, out: Flat, first: int, /) -> None: ...
    def state_size(self, p: Plan, /) -> int: ...
    def rows_size(self, p: Plan, /) -> int: ...
    def slips(
        self, p: Plan, channels: Flat, values: Flat, joints: Counts, size: int, step: float, torques: Flat, /
    ) -> None: ...
    def moves(self, speed: Flat, size: int, least: float, by: Counts, signals: int, found: Flat, /) -> None: ...
    # weighed.py
    def explain(self, s: Solver, rows: Flat, drift: Flat, residual: Flat, /) -> None: ...
    def gate(
        self,
        s: Solver,
        rows: Flat,
        residual: Flat,
        base_variance: Flat,
        usable: Flat,
        rested: Flat,
        drift: Flat,
        drift_covariance: Flat,
        work: Flat,
        lift: Flat,
        /,
    ) -> int:
        """Return whether an instant fits the load of a lift: 0 no, 1 yes, 2 yes and a usable row moves.

        Which arguments are read and written, with shapes and units: see `weighed.gate`."""

    def take(self, s: Solver, rows: Flat, residual: Flat, work: Flat, lift: Flat, /) -> None: ...
    def conclude(self, s: Solver, lift: Flat, drift: Flat, drift_covariance: Flat, conclusion: Flat, /) -> None: ...
    def weigh_load(
        self,
        s: Solver,
        rows: Flat,
        residual: Flat,
        base_variance: Flat,
        usable: Flat,
        rested: Flat,
        drift: Flat,
        drift_covariance: Flat,
        work: Flat,
        lift: Flat,
        conclusion: Flat,
        /,
    ) -> int:
        """Update the state of a lift with one instant if it fits, and compute the mass and centre of its load.

        Which arguments are read and written, with shapes and units: see `weighed.weigh_load`."""

    def without_load(
        self, s: Solver, rows: Flat, residual: Flat, lift: Flat, unexplained: Flat, values: Flat, /
    ) -> None: ...
    # pushed.py
    def push(
        self,
        s: Solver,
        rows: Flat,
        usable: Flat,
        load: Flat,
        drift: Flat,
        signal_torques: Flat,
        signals: int,
        noise_before: Flat,
        noise: Flat,
        force: Flat,
        /,
    ) -> None:
        """Compute the force at the tool at one instant from the residual torques, with its covariance.

        Which arguments are read and written, with shapes and units: see `pushed.push`."""

    def show(
        self,
        s: Solver,
        force: Flat,
        load: Flat,
        load_covariance: Flat,
        load_known: int,
        clear: float,
        resultant: Flat,
        ground: Flat,
        /,
    ) -> None:
        """Compute the two published forces: the resultant at the tool, and the force of the ground.

        Which arguments are read and written, with shapes and units: see `pushed.show`."""

    def learn(self, s: Solver, force: Flat, good: Flat, load: Flat, noise: Flat, /) -> None: ...
    def fill(self, covariance: Flat, full: Flat, share: float, result: Flat, /) -> None: ...
    # recognised.py
    def gather(
        self,
        s: Solver,
        rows: Flat,
        residual: Flat,
        usable: Flat,
        change: Flat,
        error_torques: Flat,
        signals: int,
        memory: float,
        gram: Flat,
        /,
    ) -> int:
        """Add the normal equations of one instant to those of a block, and return the number of rows added.

        Which arguments are read and written, with shapes and units: see `recognised.gather`."""

    def daily_change(
        self, s: Solver, drift_covariance: Flat, stroke_errors: Flat, frictions: int, unknown: float, change: Flat, /
    ) -> None: ...
    def gather_block(
        self,
        s: Solver,
        rows: Flat,
        usable: Flat,
        drift: Flat,
        drift_covariance: Flat,
        stroke_errors: Flat,
        frictions: int,
        unknown: float,
        error_torques: Flat,
        signals: int,
        memory: float,
        residual: Flat,
        change: Flat,
        friction_drift: Flat,
        gram: Flat,
        /,
    ) -> int:
        """Add the normal equations of one instant to those of a block of the plausibility tests (`gather`).

        Which arguments are read and written, with shapes and units: see `recognised.gather_block`."""

    def error_torques(
        self,
        p: Plan,
        s: Solver,
        rows: Flat,
        channels: Flat,
        load: Flat,
        force_columns: Counts,
        forces: int,
        per_bar: Flat,
        joints: Counts,
        angles: int,
        step: float,
        values: Flat,
        angle_torques: Flat,
        torques: Flat,
        /,
    ) -> None:
        """Compute the residual torque by a unit error of each signal: the sensitivity (R, H) to misleading readings.

        Which arguments are read and written, with shapes and units: see `recognised.error_torques`."""

    def rock(
        self,
        p: Plan,
        s: Solver,
        rows: Flat,
        residual: Flat,
        lift: Flat,
        channels: Flat,
        learning: int,
        tilt_variance: float,
        share: float,
        largest_misfit: float,
        prior: float,
        unexplained: Flat,
        values: Flat,
        levers: Flat,
        variances: Flat,
        base_variance: Flat,
        /,
    ) -> None:
        """Compute the variance that a rocking base adds to each row (measured torque).

        Which arguments are read and written, with shapes and units: see `recognised.rock`."""

    def turn_force(
        self, p: Plan, channels: Flat, x: float, z: float, joints: Counts, angles: int, first: int, torques: Flat, /
    ) -> None: ...
    def mass_slopes(
        self,
        lift_gram: Flat,
        block_gram: Flat,
        size: int,
        prior: Flat,
        memory: float,
        errors: int,
        work: Flat,
        slopes: Flat,
        /,
    ) -> None:
        """Compute the change of the load's mass per unit of each signal's error: the first row of A^-1 B.

        Which arguments are read and written, with shapes and units: see `recognised.mass_slopes`."""

    # followed.py
    def certain(self, a: Drift, columns: Flat, usable: Flat, /) -> int: ...
    def follow(
        self,
        a: Drift,
        number: int,
        columns: Flat,
        residual: Flat,
        base_variance: Flat,
        factor: Flat,
        right: Flat,
        values: Flat,
        scale: Flat,
        mass: float,
        update: Flat,
        /,
    ) -> None:
        """Update the drift of frictions and pressure zeros with one instant of an empty bucket.

        Which arguments are read and written, with shapes and units: see `followed.follow`."""

    # pressures.py
    def suspicious(self, p: int, readings: Flat, before: int, gates: Flat, /) -> int: ...
    def certain_steps(
        self,
        p: int,
        readings: Flat,
        size: int,
        before: int,
        curves: Flat,
        bends: int,
        noise: Flat,
        free: float,
        known: float,
        least: float,
        pairs: Counts,
        swaps: int,
        most: int,
        products: Flat,
        misfit: Flat,
        /,
    ) -> int:
        """Return whether a step can exceed the `least` log likelihood ratio: 1 of one pressure, 2 by a swap of
        plugs, 3 either, 0 none.

        Which arguments are read and written, with shapes and units: see `pressures.certain_steps`."""

    def group(self, p: int, readings: Flat, begin: int, way: Flat, moves: float, groups: Flat, /) -> None: ...
    def compare(self, p: int, groups: Flat, work: Flat, ratios: Flat, /) -> int: ...
    def update_noise(
        self,
        p: int,
        readings: Flat,
        size: int,
        groups: Flat,
        number: int,
        moved: Flat,
        stated: Flat,
        tenth: float,
        quiet: Flat,
        limits: int,
        work: Flat,
        state: Flat,
        /,
    ) -> None:
        """Update the noise of the pressures whose cylinder moved, with one group of readings.

        Which arguments are read and written, with shapes and units: see `pressures.update_noise`."""
