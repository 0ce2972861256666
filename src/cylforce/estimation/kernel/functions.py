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
    def usable(self, p: Inputs, state: Flat, t_us: float, found: Flat, /) -> int: ...
    def stepped(self, p: Inputs, state: Flat, found: Flat, /) -> None: ...
    def quantise(self, size: int, limits: Flat, values: Flat, found: Counts, /) -> None: ...
    # plan.py
    def sense(self, p: Sensors, values: Flat, into: Flat, /) -> int: ...
    # rows.py
    def advance(self, p: Plan, old: Flat, here: Flat, new: Flat, out: Flat, first: int, /) -> None: ...
    def state_size(self, p: Plan, /) -> int: ...
    def rows_size(self, p: Plan, /) -> int: ...
    def slips(
        self, p: Plan, channels: Flat, values: Flat, turned: Counts, size: int, by: float, out: Flat, /
    ) -> None: ...
    def moves(self, speed: Flat, size: int, least: float, by: Counts, signals: int, found: Flat, /) -> None: ...
    # weighed.py
    def explain(self, s: Solver, rows: Flat, drift: Flat, found: Flat, /) -> None: ...
    def gate(
        self,
        s: Solver,
        rows: Flat,
        residual: Flat,
        wider: Flat,
        usable: Flat,
        rested: Flat,
        known: Flat,
        drift_covariance: Flat,
        work: Flat,
        lift: Flat,
        /,
    ) -> int: ...
    def take(self, s: Solver, rows: Flat, residual: Flat, work: Flat, lift: Flat, /) -> None: ...
    def conclude(self, s: Solver, lift: Flat, drift: Flat, drift_covariance: Flat, found: Flat, /) -> None: ...
    def weigh_load(
        self,
        s: Solver,
        rows: Flat,
        residual: Flat,
        wider: Flat,
        usable: Flat,
        rested: Flat,
        known: Flat,
        drift_covariance: Flat,
        work: Flat,
        lift: Flat,
        found: Flat,
        /,
    ) -> int: ...
    def without_load(self, s: Solver, rows: Flat, residual: Flat, lift: Flat, over: Flat, values: Flat, /) -> None: ...
    # pushed.py
    def push(
        self,
        s: Solver,
        rows: Flat,
        usable: Flat,
        load: Flat,
        drift: Flat,
        wrong: Flat,
        errors: int,
        before: Flat,
        new: Flat,
        found: Flat,
        /,
    ) -> None: ...
    def show(
        self,
        s: Solver,
        found: Flat,
        load: Flat,
        covariance: Flat,
        loaded_tool: int,
        clear: float,
        resultant: Flat,
        ground: Flat,
        /,
    ) -> None: ...
    def learn(self, s: Solver, found: Flat, good: Flat, load: Flat, before: Flat, /) -> None: ...
    def fill(self, known: Flat, full: Flat, share: float, found: Flat, /) -> None: ...
    # recognised.py
    def gather(
        self,
        s: Solver,
        rows: Flat,
        residual: Flat,
        usable: Flat,
        change: Flat,
        errors: Flat,
        number: int,
        memory: float,
        gram: Flat,
        /,
    ) -> int: ...
    def daily_change(
        self, s: Solver, drift_covariance: Flat, before: Flat, frictions: int, unknown: float, change: Flat, /
    ) -> None: ...
    def gather_block(
        self,
        s: Solver,
        rows: Flat,
        usable: Flat,
        drift: Flat,
        drift_covariance: Flat,
        before: Flat,
        frictions: int,
        unknown: float,
        errors: Flat,
        number: int,
        memory: float,
        residual: Flat,
        change: Flat,
        expected: Flat,
        gram: Flat,
        /,
    ) -> int: ...
    def error_torques(
        self,
        p: Plan,
        s: Solver,
        rows: Flat,
        channels: Flat,
        load: Flat,
        pressed: Counts,
        presses: int,
        per_bar: Flat,
        turned: Counts,
        turns: int,
        by: float,
        values: Flat,
        angles: Flat,
        out: Flat,
        /,
    ) -> None: ...
    def rock(
        self,
        p: Plan,
        s: Solver,
        rows: Flat,
        residual: Flat,
        lift: Flat,
        channels: Flat,
        learns: int,
        swings: float,
        share: float,
        fits: float,
        prior: float,
        over: Flat,
        values: Flat,
        levers: Flat,
        state: Flat,
        wider: Flat,
        /,
    ) -> None: ...
    def turn_force(
        self, p: Plan, channels: Flat, x: float, z: float, turned: Counts, angles: int, begin: int, out: Flat, /
    ) -> None: ...
    def mass_slopes(
        self, lift: Flat, running: Flat, size: int, prior: Flat, memory: float, errors: int, work: Flat, slopes: Flat, /
    ) -> None: ...
    # followed.py
    def certain(self, a: Drift, columns: Flat, usable: Flat, /) -> int: ...
    def follow(
        self,
        a: Drift,
        number: int,
        columns: Flat,
        residual: Flat,
        wider: Flat,
        factor: Flat,
        right: Flat,
        values: Flat,
        scale: Flat,
        mass: float,
        new: Flat,
        /,
    ) -> None: ...
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
        parts: Flat,
        misfit: Flat,
        /,
    ) -> int: ...
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
    ) -> None: ...
