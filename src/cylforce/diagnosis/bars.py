"""What is left of torques, as pressures."""

from collections.abc import Sequence

import numpy as np

from cylforce.diagnosis.problem import Problem, Seen
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.units import BAR


def measured(machine: Machine) -> list[int]:
    """The cylinders (from 0) whose force is measured and tells a torque."""
    acting = {c for c, span in enumerate(machine.spans) if set(span) & set(machine.rows)}
    return [c for c in sorted(acting) if machine.forces_measured[c]]


def bars(problem: Problem, seen: Sequence[Seen], left: Sequence[Array]) -> list[Array]:
    """Residuals (T, R) [N m] of recordings as pressures (T, C) [bar] on the head side of the measured cylinders, the
    rod side as recorded: N m / lever / area. Where several cylinders move a joint they share it by their levers."""
    machine = problem.model.machine
    return [_bars(machine, s.rows.posture, e) for s, e in zip(seen, left, strict=True)]


def _bars(machine: Machine, theta: Array, left: Array) -> Array:
    chosen, rows = measured(machine), list(machine.rows)
    lever = machine.geometry(theta).lever[:, chosen][:, :, rows]  # (T, C, R)
    unknown = np.isnan(left)
    force = np.einsum("trc,tr->tc", np.linalg.pinv(lever), np.where(unknown, 0.0, left))
    acts = np.array([[j in machine.spans[c] for j in rows] for c in chosen])
    lost = np.any(unknown[:, None, :] & acts, axis=-1)
    area = np.array([machine.cylinders[c].area_head for c in chosen])
    return np.asarray(np.where(lost, np.nan, force / area / BAR))
