"""The kernel's solver of a model and its tares, and the conversion of arrays for the kernel."""

from array import array
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solver import KernelSolver
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.residual import RELATIVE, by_load
from cylforce.signals.estimate import Array

ZERO = array("d", [0.0])


class Limits(NamedTuple):
    """Limits of the service that the kernel uses; 1 where a caller does not use one.

    Weighing (`service.weighing`):
    gate:         mean squared normalised innovation above which an instant does not fit the load
    break_away:   factor on the standard error of friction at rest, for break-away friction
    cold:         factor on the standard error of the drift, for cold oil
    drifted:      largest variance that unknown drift adds, in variances of the row
    memory:       consecutive samples that count as one independent sample
    longest_rest: steps at rest after which a row is not taken into a lift

    Force at the tool (`service.contact.noise`):
    keep:         factor by which an error of the instant fades in a step
    delay_s:      delay of the torque of inertia [s]
    largest:      largest squared normalised residual from which the variance is learned
    learning:     samples in which the learned variance follows
    heaviest:     largest weight of a mass in the bucket [N]
    """

    gate: float = 1.0
    break_away: float = 1.0
    cold: float = 1.0
    drifted: float = 1.0
    memory: float = 1.0
    longest_rest: float = 1.0
    keep: float = 1.0
    delay_s: float = 1.0
    largest: float = 1.0
    learning: float = 1.0
    heaviest: float = 1.0


NO_LIMITS = Limits()


def solver(
    model: Model,
    tares: Tares,
    kernel: Kernel,
    limits: Limits = NO_LIMITS,
    prior: Array | None = None,
) -> KernelSolver:
    """Return the constants of a model and its identified parameters, in the form in which the kernel takes them.

    With them the kernel computes the residual torque, the load and the force at the tool.

    tares:  identified parameters of the empty machine
    kernel: form of the kernel, compiled or interpreted
    limits: of the service
    prior:  (T, T) prior information on the force x, z [1/N^2] and moment [1/(N m)^2] at the tool; T = 3, or 2 without
            the moment; None: no information, T = 3
    """
    rows, size, tools = len(model.machine.rows), len(model.parameters), 3 if prior is None else len(prior)
    cylinders, drifts = len(model.machine.cylinders), len(model.changing)
    columns = len(model.filtered.regressor.names)
    sizes = [rows, columns, size, cylinders, drifts, tools, model.at_rest.start, model.tool.start]
    sizes.append(next(iter(model.coulomb), 0))
    places = np.argwhere(model.load)
    dry = np.abs(tares.values[model.coulomb])
    errors = np.broadcast_to(tares.row_error, (rows,))
    parts = [model.load[tuple(places.T)], tares.values, tares.covariance, errors, dry]
    parts.append(np.zeros((tools, tools)) if prior is None else prior)
    most = max(rows, 4)
    signals = cylinders + model.machine.size
    longest = max(size, drifts + 5 + signals, 4 * most)
    room = [4 * most, rows * size + 2 * tools * most, most * most, longest, size + drifts]
    parts += [*(np.zeros(each) for each in room), by_load(model, tares.values)]
    return kernel.KernelSolver(
        counts(sizes),
        numbers([tares.scale, tares.reported_scale_error, RELATIVE, *limits]),
        [
            counts(model.changing.tolist()),
            counts(places.ravel().tolist()),
            *(counts([0] * each) for each in (size + drifts, rows * size, rows)),
        ],
        [numbers(np.ravel(part).tolist()) for part in parts],
    )


def room(size: int) -> Numbers:
    """Return an array of `size` zeros, for results of the kernel."""
    return ZERO * size


def listed(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return an interpreted function of the kernel that also takes NumPy arrays.

    NumPy arrays are passed as lists, which the interpreter reads several times faster. An argument that the function
    writes must be an array of the kernel (`array.array`), which is passed as it is: a list would be a copy."""

    def called(*arguments: Any) -> Any:  # noqa: ANN401 - what the function takes and gives
        return function(*[plain(each) for each in arguments])

    return called


def plain(values: Any) -> Any:  # noqa: ANN401 - an argument of the kernel
    """Return an argument of the kernel for its interpreted form: arrays as lists, which the interpreter reads faster.

    A NumPy array becomes a list, a list of the kernel's arrays a list of lists; any other argument stays as it is."""
    if isinstance(values, np.ndarray):
        return values.ravel().tolist()
    return [each.tolist() for each in values] if isinstance(values, list) else values
