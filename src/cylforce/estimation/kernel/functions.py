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

        Read are the instant's columns and measured torques (`rows`), its residual torques with their variances, the
        variance by a rocking base, which rows are usable and how long each has rested, the drift of friction and zeros
        with its covariance, and the lift. `work` is written. Shapes and units: `weighed.gate`."""

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

        The arguments are those of `gate`, whose result is returned. `lift` is updated; `conclusion` is written: mass
        [kg], centre [m], their standard errors. Shapes and units: `weighed.weigh_load`."""

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
        """Compute the force at the tool [N] at one instant from the residual torques, with its covariance.

        Read are the instant's columns and measured torques (`rows`), which are usable, the load (m, m x, m z, J) in the
        bucket, the drift of friction and zeros, the torques [N m] by the probable error of each signal, and the errors
        of the torques before this instant. These errors after it, and the force, are written. Shapes: `pushed.push`."""

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
        """Compute the two published forces, resultant at the tool and force of the ground, from a result of `push`.

        The force of the ground is the resultant less the load (m, m x, m z, J), or less an unknown weight unless
        `load_known`. `clear` is the ratio of a force to its standard error across, above which its direction is
        certain. The forces are written: components [N], direction [rad], errors. Shapes: `pushed.show`."""

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
        """Add the normal equations of one instant to those of a block of motion, and return the number of rows added.

        A row is the residual torque [N m] of one measured joint; its unknowns are a load, changes of friction and zeros
        in units of `change`, and an error of each of `signals` signals, which causes `error_torques` [N m per unit].
        `memory` samples count as one. `gram`, the sums of products, is updated. Shapes: `recognised.gather`."""

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
        """Add the normal equations of one instant to those of a block of the plausibility tests, as `gather` does.

        The residual torque is computed here, from columns and torques (`rows`) less the drift of the frictions. The
        unit of a change of friction or zero follows from `stroke_errors`, of a friction not yet known wider by
        `unknown`. `residual`, `change` and `friction_drift` are room, `gram` is updated. Shapes:
        `recognised.gather_block`."""

    def torque_per_error(
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
        """Compute the residual torque (R, H) that one unit of error of each of H signals causes, into `torques`.

        The signals are cylinder forces [bar over the head area] and joint angles [rad], varied by `step` [rad] at the
        present channels. Read are the columns of the forces and the load in the bucket, too; `values` and
        `angle_torques` are room. Shapes and units: `recognised.torque_per_error`."""

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
        """Compute the variance [N^2 m^2] that a rocking base adds to each row (measured torque), into `base_variance`.

        While `learning`, the variances of the base's accelerations [m^2/s^4] are updated from the torque that the load
        of the lift does not explain, unless its misfit is too large; the tilt gives their least value. `unexplained`,
        `values` and `levers` are room. Shapes and units: `recognised.rock`."""

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
        """Compute the change of the load's mass [kg] per unit of each signal's error, into `slopes`.

        Read are the sums of products of a lift's ended blocks and of the running block (`gather`), equations of `size`
        numbers of which `errors` belong to errors of signals, and the prior information on the load. `memory` samples
        count as one. Shapes and units: `recognised.mass_slopes`."""

    # drifting.py
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

        Read are the instant's columns and residual torques of the `number` rows that `certain` listed, the variance by
        a rocking base, and from the last update the information (factor, right), drift, scale of its spread, and mass
        [kg] that the empty bucket would show. `update` is written, with the same parts. Shapes: `drifting.follow`."""

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
        """Return whether readings show a step: 1 of one of `p` pressures, 2 by a swap of plugs, 3 either, 0 none.

        Smooth curves through the readings [Pa], with a step after `before` of them and without, are compared by their
        likelihood with the sensors' noise; the ratio must exceed `least`. `products` and `misfit` are written. Shapes
        and units: `pressures.certain_steps`."""

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
        """Update the noise of the pressures whose cylinder `moved`, with one group of `size` readings [Pa].

        A noise that has become smaller than the limits `quiet`, as shares of the earlier noise, is gone. Read are means
        and variances of the last groups and the variances of the sensors' data sheets [Pa^2]; `work` is room, `state`
        (noise of earlier groups, number of groups since it is gone) is updated. Shapes: `pressures.update_noise`."""
