"""Choice of the kernel's form: compiled if it was compiled from this source for this processor, else interpreted."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from importlib import import_module
from importlib.resources import files
from types import SimpleNamespace
from typing import Any, NamedTuple
from zlib import crc32

from cylforce.estimation.kernel import (
    drifting,
    inputs,
    plan,
    pressures,
    pushed,
    recognised,
    rows,
    solver,
    weighed,
)
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.solving import listed

PARTS = (
    "inputs.py",
    "plan.py",
    "bodies.py",
    "columns.py",
    "rows.py",
    "solver.py",
    "weighed.py",
    "pushed.py",
    "recognised.py",
    "drifting.py",
    "pressures.py",
)
COMPILED = "compiled"
INTERPRETED: Any = SimpleNamespace(
    KernelInputs=listed(inputs.KernelInputs),
    receive=inputs.receive,
    usable=inputs.usable,
    stepped=inputs.stepped,
    quantise=inputs.quantise,
    KernelSensors=listed(plan.KernelSensors),
    read_channels=plan.read_channels,
    KernelPlan=listed(plan.KernelPlan),
    KernelSolver=listed(solver.KernelSolver),
    KernelDrift=listed(drifting.KernelDrift),
    advance=rows.advance,
    state_size=rows.state_size,
    rows_size=rows.rows_size,
    **{
        function.__name__: listed(function)
        for function in (
            rows.angle_error_torques,
            rows.moving_signals,
            weighed.residual_torque,
            weighed.gate,
            weighed.take,
            weighed.conclude,
            pushed.tool_force,
            pushed.published_forces,
            weighed.weigh_load,
            weighed.unexplained_torque,
            pushed.learn_noise,
            pushed.widen_load,
            recognised.gather,
            recognised.daily_change,
            recognised.gather_block,
            recognised.torque_per_error,
            recognised.rocking_variance,
            drifting.rows_for_drift,
            drifting.update_drift,
            recognised.turn_force,
            recognised.mass_slopes,
            pressures.may_step,
            pressures.possible_steps,
            pressures.add_group,
            pressures.compare_groups,
            pressures.update_noise,
        )
    },
)


class Choice(NamedTuple):
    """The kernel in use.

    kernel:  compiled or interpreted
    refused: sentence why the compiled one was refused; empty: it runs, or there is none
    """

    kernel: Kernel
    refused: str = ""


@cache
def choice() -> Choice:
    """Return the kernel to use and, if the compiled one was refused, why. The choice is made once per process."""
    return choice_in(__package__)


def choice_in(package: str) -> Choice:
    """Return the compiled kernel of a package, otherwise the interpreted one and why the compiled one was refused.

    The compiled kernel is used if it is beside the source, was compiled from this source (checksum), and can be
    imported by this processor and Python. Source and compiled kernel are read as Python reads them when it imports,
    also from an archive.

    package: name of the package with the source and perhaps the compiled kernel
    """
    here = files(package)
    built = [entry.name for entry in here.iterdir() if entry.name.startswith(f"{COMPILED}.")]
    if not built:
        return Choice(INTERPRETED)
    text = crc32(b"".join((here / name).read_bytes() for name in PARTS))
    try:
        return matching(import_module(f"{package}.{COMPILED}"), text)
    except ImportError as error:
        why = f"{built[0]} is for another processor or Python ({error})"
        return Choice(INTERPRETED, f"the compiled kernel was not taken, the interpreted one runs: {why}")


def matching(compiled: Any, text: int) -> Choice:  # noqa: ANN401 - a compiled module has no types
    """Return the compiled kernel if it was compiled from this source, otherwise the interpreted one and why.

    compiled: imported module, whose `TEXT` is the checksum of the source from which it was compiled
    text:     checksum (CRC 32) of the source
    """
    if getattr(compiled, "TEXT", None) == text:
        return Choice(compiled)
    why = "it was compiled from another version of its source"
    return Choice(INTERPRETED, f"the compiled kernel was not taken, the interpreted one runs: {why}")


_given: ContextVar[Kernel | None] = ContextVar("kernel", default=None)


def chosen() -> Kernel:
    """Return the kernel in use: that of the block `using`, else that of the process."""
    return _given.get() or choice().kernel


@contextmanager
def using(kernel: Kernel) -> Iterator[None]:
    """Let `chosen` return this kernel within the block, to compare kernels or to count their calls."""
    before = _given.set(kernel)
    try:
        yield
    finally:
        _given.reset(before)
