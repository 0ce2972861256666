"""Centrifugal torques by pinocchio: a house that turns at a constant rate about its own axis, links as bodies with
depth."""

import numpy as np
import pinocchio as pin

from cylforce.mechanics.machine import Machine


def yaw_torque(machine: Machine, a: np.ndarray, rate: float, thin: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(torque of the arm's joints without gravity (N,), values (5N,) of (J, X, Z, D_excess, E)); `thin` (N,) [m]: the
    links' radius of gyration across their own line."""
    model = pin.Model()
    model.gravity.linear = np.zeros(3)
    parent = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "house")
    offset, n = machine.slew_axis, machine.size
    for k, radius in zip(machine.links, thin, strict=True):
        place = pin.SE3(np.eye(3), np.array([offset, 0.0, 0.0]))
        parent = model.addJoint(parent, pin.JointModelRevoluteUnaligned(np.array([0.0, -1.0, 0.0])), place, k.name)
        across = k.mass * radius**2
        along = k.inertia - across
        # moments of inertia of a flat body: about x the spread in z, about z the spread in x, about y both
        inertia = pin.Inertia(k.mass, np.array([k.cx, 0.0, k.cz]), np.diag([across, k.inertia, along]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        offset = k.length
    rates = np.zeros(n + 1)
    rates[0] = rate
    angles = np.concatenate([[0.0], np.diff(a, prepend=0.0)])
    torque = pin.rnea(model, model.createData(), angles, rates, np.zeros(n + 1))[1:]
    return torque, _values(machine, thin)


def _values(machine: Machine, thin: np.ndarray) -> np.ndarray:
    values = []
    for j, k in enumerate(machine.links):
        beyond = sum(other.mass for other in machine.links[j + 1 :])
        length = k.length if j < machine.size - 1 else 0.0
        inertia = k.inertia + k.mass * (k.cx**2 + k.cz**2) + beyond * length**2
        spread = k.mass * thin[j] ** 2 + k.mass * k.cz**2  # int z^2 dm
        values.append((inertia, k.mass * k.cx + beyond * length, k.mass * k.cz, -2 * spread, k.mass * k.cx * k.cz))
    return np.array(values).reshape(-1)
