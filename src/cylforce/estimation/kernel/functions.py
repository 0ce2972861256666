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
        self, p: Inputs, state: Flat, frame_kinds: Counts, number: int, times: Flat, raw: Flat, moving: Flat, /
    ) -> None: ...
    def usable(self, p: Inputs, state: Flat, t_us: float, sample: Flat, /) -> int: ...
    def stepped(self, p: Inputs, state: Flat, has_step: Flat, /) -> None: ...
    def quantise(self, size: int, limits: Flat, values: Flat, sent: Counts, /) -> None: ...
    # plan.py
    def read_channels(self, p: Sensors, values: Flat, into: Flat, /) -> int: ...
    # rows.py
    def advance(self, p: Plan, old: Flat, channels: Flat, new: Flat, out: Flat, first: int, /) -> None: ...
    def state_size(self, p: Plan, /) -> int: ...
    def rows_size(self, p: Plan, /) -> int: ...
    def angle_error_torques(
        self, p: Plan, channels: Flat, values: Flat, joints: Counts, size: int, step: float, torques: Flat, /
    ) -> None: ...
    def moving_signals(
        self, speed: Flat, size: int, least: float, by: Counts, signals: int, should_change: Flat, /
    ) -> None: ...
    # weighed.py
    def residual_torque(self, s: Solver, rows: Flat, drift: Flat, residual: Flat, /) -> None: ...
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
        """Return whether an instant fits the load of a lift.

        0: it does not fit, or no row is usable. 1: it fits. 2: it fits, and a usable row belongs to a joint that moves.

        Read: `rows` (columns, then measured torques [N m]), `residual` (residual torques [N m], their variances), the
        variance by a rocking base [N^2 m^2] (`base_variance`), which rows are `usable`, the steps for which each has
        `rested`, the `drift` of friction and zeros with `drift_covariance`, the state of the `lift`. Written: `work`,
        the rows to be taken. Shapes and units: `weighed.gate`."""

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

        Arguments and result are those of `gate`: the instant (`rows`, `residual`, `base_variance`, `usable`), the steps
        for which each row has `rested`, the `drift` with `drift_covariance`. `lift` is updated, `work` is written as by
        `gate`, `conclusion` is written: mass [kg], centre [m], their standard errors. Shapes and units:
        `weighed.weigh_load`."""

    def unexplained_torque(
        self, s: Solver, rows: Flat, residual: Flat, lift: Flat, unexplained: Flat, values: Flat, /
    ) -> None: ...
    # pushed.py
    def tool_force(
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

        Read are `rows` (columns and measured torques [N m]), which are `usable`, the `load` in the bucket (m, m x, m z,
        J), the `drift` of friction and zeros, `signal_torques` [N m] by the probable error of each of `signals`
        signals, and the errors of the torques before this instant (`noise_before`). These errors after it (`noise`) and
        the `force` are written. Shapes and units: `pushed.tool_force`."""

    def published_forces(
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
        """Compute the two published forces, resultant and force of the ground, from the result `force` of `tool_force`.

        The force of the ground is the resultant less that of the `load` (m, m x, m z, J) with `load_covariance`; unless
        `load_known`, it is the resultant less the weight of the mass that explains most of it. `clear` is the ratio of
        a force to its standard error across, above which its direction is certain. `resultant` and `ground` are
        written: components [N], direction [rad], standard errors. Shapes: `pushed.published_forces`."""

    def learn_noise(self, s: Solver, force: Flat, good: Flat, load: Flat, noise: Flat, /) -> None: ...
    def widen_load(self, covariance: Flat, full: Flat, share: float, result: Flat, /) -> None: ...
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

        A row is the residual torque [N m] of one measured joint, if it is `usable` and in motion. Its unknowns are a
        load, changes of friction and zeros in units of `change`, and an error of each of `signals` signals, which
        causes `error_torques` [N m per unit]. `rows` are the columns, `residual` the residual torques with their
        variances; `memory` samples count as one. `gram`, the sums of products, is updated. Shapes:
        `recognised.gather`."""

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

        The residual torque is computed here from `rows` (columns and measured torques) less the `drift` of the
        frictions, the first `frictions` drifts. The unit of a change of friction or zero is its standard error between
        strokes (`stroke_errors`), of a friction wider by `unknown` as long as `drift_covariance` is large. `usable`,
        `error_torques`, `signals` and `memory` are those of `gather`. `residual`, `change` and `friction_drift` are
        room, `gram` is updated. Shapes: `recognised.gather_block`."""

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

        The signals are `forces` cylinder forces [bar over the head area], with `force_columns` among the columns
        (`rows`) and `per_bar` [N/bar], then `angles` joint angles [rad] of `joints`, varied by `step` [rad] at the
        present `channels` with the `load` in the bucket. `values` and `angle_torques` are room. Shapes and units:
        `recognised.torque_per_error`."""

    def rocking_variance(
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

        While `learning`, the `variances` of the base's accelerations [m^2/s^4] move by `share` towards the square of
        the acceleration that best explains the residual torque less that of the load of the `lift` (`rows`, `residual`
        at these `channels`). They do not if the mean square of that torque over its variance exceeds `largest_misfit`.
        `prior` is the prior information on an acceleration, `tilt_variance` the least variance, from the tilt.
        `unexplained`, `values` and `levers` are room. Shapes and units: `recognised.rocking_variance`."""

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

        Read are the sums of products of a lift's ended blocks (`lift_gram`) and of the running block (`block_gram`),
        equations of `size` numbers of which `errors` belong to errors of signals, and the `prior` information on the
        load. `memory` samples count as one; `work` is room. Shapes and units: `recognised.mass_slopes`."""

    # drifting.py
    def rows_for_drift(self, a: Drift, columns: Flat, usable: Flat, /) -> int: ...
    def update_drift(
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

        Read are the instant's `columns` and `residual` torques of the `number` rows that `rows_for_drift` listed, the
        variance by a rocking base (`base_variance`), and from the last update the information (`factor`, `right`), the
        drift (`values`), the `scale` of its spread, and the `mass` [kg] that the empty bucket would show without this
        drift. `update` is written: these parts anew, and the drift's covariance. Shapes and units:
        `drifting.update_drift`."""

    # pressures.py
    def may_step(self, p: int, readings: Flat, before: int, gates: Flat, /) -> int: ...
    def possible_steps(
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
        """Return whether a step is possible: 1 of one of `p` pressures, 2 by a swap of plugs, 3 either, 0 none.

        `bends` smooth `curves` through `size` readings [Pa], with a step after `before` of them and without, are
        compared by their likelihood: `noise` is the sensors' variance [Pa^2], `free` and `known` are degrees of
        freedom. The log likelihood ratio must exceed `least`. `pairs` lists `swaps` swaps of at most `most` pairs.
        `products` (room) and `misfit`, minus each log likelihood, are written. Shapes and units:
        `pressures.possible_steps`."""

    def add_group(self, p: int, readings: Flat, begin: int, way: Flat, moves: float, groups: Flat, /) -> None: ...
    def compare_groups(self, p: int, groups: Flat, work: Flat, ratios: Flat, /) -> int: ...
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
        """Update the noise of those of `p` pressures whose cylinder `moved`, with one group of `size` readings [Pa].

        A noise is gone if the last groups vary less than the `limits` limits in `quiet`, shares of the noise before;
        `tenth` is the first decile of the noise of groups as a share of the white noise. Read are means and variances
        of the last `number` `groups` and the `stated` variances of the sensors [Pa^2]. `work` is room, `state` is
        updated: noise of earlier groups, number of groups since it is gone; once gone, it remains so here. Shapes:
        `pressures.update_noise`."""
