"""Angles, cylinder forces and torques directly from raw signals, without filters."""

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

FITTED_S = 0.3  # s: short beside a move, long enough for angles that are read to a milliradian; chosen


def angle_signal(machine: Machine, joint: int) -> int | None:
    """Number of the signal that measures a joint's angle or its link's inclination; None where there is none."""
    kinds = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
    found = [k for k, s in enumerate(machine.signals) if s.kind in kinds and s.index == joint]
    return found[0] if found else None


def cylinder_forces(machine: Machine, values: Array) -> Array:
    """Forces (T, C) [N] of all cylinders from signals (T, S) in SI units; 0 where not measured."""
    place = {(s.kind, s.index): k for k, s in enumerate(machine.signals)}
    forces = np.zeros((len(values), len(machine.cylinders)))
    for c, cylinder in enumerate(machine.cylinders):
        if (Kind.FORCE_PIN, c) in place:
            forces[:, c] = values[:, place[Kind.FORCE_PIN, c]]
        elif (Kind.HEAD_PRESSURE, c) in place:
            rod = place.get((Kind.ROD_PRESSURE, c))
            other = cylinder.rod_pressure if rod is None else values[:, rod]
            forces[:, c] = machine.cylinder_force(c, values[:, place[Kind.HEAD_PRESSURE, c]], other)
    return forces


def joint_angles(machine: Machine, values: Array) -> Array:
    """Joint angles (T, N) [rad] from signals (T, S): the reading of the joint's own sensor, an inclination less that of
    the next link inwards, else the middle of the joint's range. A rough posture only."""
    angles = np.tile([(link.angle_low + link.angle_high) / 2.0 for link in machine.links], (len(values), 1))
    for joint in range(machine.size):
        signal = angle_signal(machine, joint)
        if signal is not None:
            angles[:, joint] = values[:, signal]
            if machine.signals[signal].kind is Kind.LINK_INCLINATION:
                angles[:, joint] -= pitch(machine, values) + angles[:, :joint].sum(axis=1)
    return angles


def pitch(machine: Machine, values: Array) -> Array:
    """Pitch (T,) [rad] of the house from signals (T, S); 0 where none is measured."""
    found = [k for k, signal in enumerate(machine.signals) if signal.kind is Kind.PITCH]
    return values[:, found[0]] if found else np.zeros(len(values))


def measured_torque(machine: Machine, values: Array, joint: int) -> Array:
    """Torque (T,) [N m] of the cylinders on a joint from signals (T, S), unfiltered, at the posture of
    `joint_angles`."""
    at, forces = machine.pose(joint_angles(machine, values)), cylinder_forces(machine, values)
    acting = [c for c, span in enumerate(machine.spans) if joint in span]
    levers = [machine.cylinders[c].linkage.stretch(at).gradient[:, joint] for c in acting]
    return sum((forces[:, c] * lever for c, lever in zip(acting, levers, strict=True)), np.zeros(len(values)))


def rigid_torque(machine: Machine, values: Array, t: Array, joint: int) -> Array:
    """Torque (T,) [N m] that holds and moves the links from a joint outwards, by their data sheets' masses, at the
    posture of `joint_angles` and the measured pitch, at times t (T,) [s]: what the cylinders supply, less their own
    friction. Accelerations are those of parabolas fitted over `FITTED_S`."""
    from scipy.signal import savgol_filter  # not needed by the service, which needs no accelerations

    step = float(np.mean(np.diff(t))) if len(t) > 1 else 1.0
    window = min(2 * round(FITTED_S / step / 2.0) + 1, len(t) - 1 + len(t) % 2)
    if window < 3:
        return np.zeros(len(t))
    angles = joint_angles(machine, values)
    angles[:, 0] += pitch(machine, values)
    at, links = machine.pose(angles), machine.links
    centre = at.origin[:, 1:] + at.turn[:, 1:] * [complex(link.cx, link.cz) for link in links]

    def accelerated(x: Array) -> Array:
        return np.asarray(savgol_filter(x, window, 2, deriv=2, delta=step, axis=0))

    pushed = (accelerated(centre.real) + 1j * (accelerated(centre.imag) + machine.gravity)) * [x.mass for x in links]
    turned = accelerated(angles.cumsum(axis=1)) * [link.inertia for link in links]
    about = (np.conj(centre - at.origin[:, 1 + joint, None]) * pushed).imag
    return np.asarray(np.sum((about + turned)[:, joint:], axis=1))


def followed(course: Array, t: Array, constant: float) -> Array:
    """First-order lag of a signal `course` (T,) at evenly spaced times t (T,) [s] with a time `constant` [s]; settled
    at the first sample."""
    from scipy.signal import lfilter  # not needed by the service, which measures without it

    keep = float(np.exp(-np.mean(np.diff(t)) / constant)) if len(t) > 1 else 0.0
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], course, zi=[keep * course[0]])[0])
