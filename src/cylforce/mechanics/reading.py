"""Compute angles, cylinder forces and torques directly from raw signals, without filters."""

import numpy as np

from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

FITTED_S = 0.3  # s, length of a fitted parabola: short beside a move, long enough for a resolution of 1 mrad; chosen


def angle_signal(machine: Machine, joint: int) -> int | None:
    """Return the number of the signal that measures a joint's angle or its link's inclination; None: there is none.

    Where there are both, it is the first of them in the machine's list of signals.
    """
    kinds = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION)
    matching = [k for k, s in enumerate(machine.signals) if s.kind in kinds and s.index == joint]
    return matching[0] if matching else None


def cylinder_forces(machine: Machine, values: Array) -> Array:
    """Return the forces (T, C) [N] of all cylinders from signals (T, S) [SI]; 0 where a force is not measured.

    A positive force pushes. The reading is that of the force pin, else the force is computed from the pressures. A rod
    side without a sensor has the `rod_pressure` of its cylinder.
    """
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
    """Return rough joint angles (T, N) [rad] from signals (T, S) [SI], unfiltered and not unwrapped.

    The sensor of a joint is its `angle_signal`. An encoder's reading is taken as it is, an inclinometer's less the
    inclination of the next link inwards. A joint without both has the middle of its range, also where the length of its
    cylinder is measured.
    """
    angles = np.tile([(link.angle_low + link.angle_high) / 2.0 for link in machine.links], (len(values), 1))
    for joint in range(machine.size):
        signal = angle_signal(machine, joint)
        if signal is not None:
            angles[:, joint] = values[:, signal]
            if machine.signals[signal].kind is Kind.LINK_INCLINATION:
                angles[:, joint] -= pitch(machine, values) + angles[:, :joint].sum(axis=1)
    return angles


def pitch(machine: Machine, values: Array) -> Array:
    """Return the pitch (T,) [rad] of the house from signals (T, S) [SI]; 0 where none is measured."""
    matching = [k for k, signal in enumerate(machine.signals) if signal.kind is Kind.PITCH]
    return values[:, matching[0]] if matching else np.zeros(len(values))


def measured_torque(machine: Machine, values: Array, joint: int) -> Array:
    """Return the torque (T,) [N m] of the cylinders on a joint from signals (T, S) [SI], unfiltered.

    It is positive where it turns the joint towards larger angles. The posture is that of `joint_angles`, the forces are
    those of `cylinder_forces`; a cylinder whose force is not measured counts as without force.

    joint: number of the joint, from 0
    """
    at, forces = machine.pose(joint_angles(machine, values)), cylinder_forces(machine, values)
    acting = [c for c, span in enumerate(machine.spans) if joint in span]
    levers = [machine.cylinders[c].linkage.stretch(at).gradient[:, joint] for c in acting]
    return sum((forces[:, c] * lever for c, lever in zip(acting, levers, strict=True)), np.zeros(len(values)))


def rigid_torque(machine: Machine, values: Array, t: Array, joint: int) -> Array:
    """Return the torque (T,) [N m] that holds and moves the links from a joint outwards, by the data sheet's masses.

    The cylinders supply this torque plus their own friction. The posture is that of `joint_angles` and the measured
    pitch, roll and slewing are ignored. Accelerations are those of parabolas fitted over FITTED_S. The torque is 0
    throughout where there are fewer than three samples, or samples are FITTED_S or more apart.

    values: signals (T, S) [SI]
    t: evenly spaced times (T,) [s]
    joint: number of the joint, from 0
    """
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
        """Return the second time derivative of x (T, ...), of fitted parabolas, in its unit per s^2."""
        return np.asarray(savgol_filter(x, window, 2, deriv=2, delta=step, axis=0))

    # torque about the joint: sum of (centre - pin) x m (a + g) and I d^2(angle)/dt^2 over the links from it outwards
    pushed = (accelerated(centre.real) + 1j * (accelerated(centre.imag) + machine.gravity)) * [x.mass for x in links]
    turned = accelerated(angles.cumsum(axis=1)) * [link.inertia for link in links]
    about = (np.conj(centre - at.origin[:, 1 + joint, None]) * pushed).imag
    return np.asarray(np.sum((about + turned)[:, joint:], axis=1))


def followed(course: Array, t: Array, constant: float) -> Array:
    """Return a signal (T,) after a first-order lag, settled at the first sample, in the unit of the signal.

    course: signal (T,) without the lag
    t: evenly spaced times (T,) [s]
    constant: time constant [s]
    """
    from scipy.signal import lfilter  # not needed by the service, which measures without it

    keep = float(np.exp(-np.mean(np.diff(t)) / constant)) if len(t) > 1 else 0.0
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], course, zi=[keep * course[0]])[0])
