"""Random chains of links, and the same chain for an independent rigid-body library (pinocchio)."""

import numpy as np
import pinocchio as pin

from cylforce.mechanics.machine import Link, Machine


def chain(rng: np.random.Generator, n: int) -> tuple[Link, ...]:
    """Random links."""
    return tuple(
        Link(f"link{j}", *rng.uniform((1, 100, 0.2, -0.5, 10), (6, 2000, 3, 0.5, 3000)), -3, 3, 0.1, 0.1, 0.1)
        for j in range(n)
    )


def machine(links: tuple[Link, ...]) -> Machine:
    """A chain without cylinders: only its rigid columns are asked for."""
    return Machine("chain", links, (), (), 1 + 0j, 1000.0, 1.0, 0.0)


def oracle(links: tuple[Link, ...], g: float) -> tuple[pin.Model, pin.Data]:
    """The same chain for pinocchio: rotation from x towards z is about -y."""
    model = pin.Model()
    model.gravity.linear = np.array([0, 0, -g])
    parent, offset = 0, 0.0
    for k in links:
        place = pin.SE3(np.eye(3), np.array([offset, 0, 0]))
        parent = model.addJoint(parent, pin.JointModelRevoluteUnaligned(np.array([0.0, -1.0, 0.0])), place, k.name)
        inertia = pin.Inertia(k.mass, np.array([k.cx, 0, k.cz]), np.diag([1.0, k.inertia, 1.0]))
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        offset = k.length
    return model, model.createData()
