"""The forward prediction: how far off would a moving joint be a second later, driven by the pressures that were
measured, the other joints led along their measured way? Restarted again and again: over longer it is an unstable double
integrator and says nothing (no measure of a model).

M_jj(q) d2(error_j)/dt2 = what the model leaves of the torque of joint j."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.problem import Seen
from cylforce.diagnosis.rows import RATE_HZ, Viewer
from cylforce.diagnosis.shrinkage import Gap, courses
from cylforce.diagnosis.verdict import Search
from cylforce.effects.loads.rigid import Rigid
from cylforce.mechanics.motion import motion
from cylforce.signals.estimate import Array

HORIZON_S = 1.0


class Forward(NamedTuple):
    """Error [rad] of the joint angles after `horizon_s`, rms over joints and restarts, with the parameters as they
    were, `before`, and with the causes, `after` (held out); NaN where nothing moves so long."""

    horizon_s: float
    before: float
    after: float


def forward(search: Search, gap: Gap) -> Forward:
    """The prediction before and after."""
    inertia = [_inertia(search.viewer, seen) for seen in search.original.faulty]
    pairs = [(c.before, c.after) for c in courses(search, gap)]
    before, after = (_error([each[k] for each in pairs], inertia) for k in (0, 1))
    return Forward(HORIZON_S, before, after)


def _inertia(viewer: Viewer, seen: Seen) -> Array:
    """M_jj (T, R) [kg m^2] of the measured joints along a recording, its known load included."""
    machine, model = viewer.model.machine, viewer.model
    values = viewer.tares[: 3 * machine.size] + model.load[: 3 * machine.size, 0] * seen.recorded.load
    still, found = np.zeros((len(seen.rows.t), len(machine.cylinders))), []
    for j in machine.rows:
        rates = np.tile(np.eye(machine.size)[j], (len(seen.rows.t), 1))
        momentum = Rigid().halves(machine, motion(machine, seen.rows.posture, rates, still)).momentum
        found.append(np.zeros(len(still)) if momentum is None else momentum[:, j] @ values)
    return np.maximum(np.stack(found, axis=-1), 1.0)


def _error(left: Sequence[Array], inertia: Sequence[Array]) -> float:
    steps = round(HORIZON_S * RATE_HZ)
    ends = [_ends(e / m, steps) for e, m in zip(left, inertia, strict=True)]
    whole = np.concatenate([*ends, np.zeros(0)])
    return float(np.sqrt(np.mean(whole**2))) if whole.size else float("nan")


def _ends(acceleration: Array, steps: int) -> Array:
    """Errors [rad] at the end of each stretch of so many steps in which a joint is known throughout."""
    count = len(acceleration) // steps
    parts = acceleration[: count * steps].reshape(count, steps, -1).swapaxes(1, 2).reshape(-1, steps)
    parts = parts[np.all(np.isfinite(parts), axis=1)]
    remaining = (steps - 0.5 - np.arange(steps)) / RATE_HZ
    return np.asarray(parts @ remaining / RATE_HZ)
