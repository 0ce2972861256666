"""The machine: links, linkages, cylinders and signals as immutable values; lengths, levers, forces, base parameters."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cylforce.mechanics.chain import Complex, Point, Pose, point, pose
from cylforce.mechanics.linkages import FourBar, Linkage, Linkages
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind, Signal
from cylforce.signals.quick import once
from cylforce.signals.units import STANDARD_GRAVITY

FORCE_KINDS = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)


@dataclass(frozen=True, slots=True)
class Link:
    """A link with its data sheet: pin-to-pin `length` [m], `mass` [kg], centre of gravity (`cx`, `cz`) [m] in its own
    frame (origin at the inner pin, x towards the outer pin), `inertia` [kg m^2] about that centre, the range of its
    joint angle [rad], and each number's standard error. The last link's x axis points at the tool; its `length` is not
    used by the dynamics."""

    name: str
    length: float
    mass: float
    cx: float
    cz: float
    inertia: float
    angle_low: float
    angle_high: float
    mass_error: float
    centre_error: float
    inertia_error: float
    length_error: float = 0.0


@dataclass(frozen=True, slots=True)
class Cylinder:
    """A cylinder (or several in parallel: the areas [m^2] are sums) with its shortest and longest length [m].

    `rod_pressure` [Pa] is assumed where there is no rod-side sensor; `area_error` is the relative standard error of the
    areas, `pin_error` [m] the standard error of every pin's place."""

    name: str
    linkage: Linkage
    area_head: float
    area_rod: float
    length_low: float
    length_high: float
    rod_pressure: float = 0.0
    area_error: float = 0.0
    pin_error: float = 0.0


class Geometry(NamedTuple):
    """Cylinder `length` (..., C) [m], `lever` d(length)/d(angle) (..., C, N) [m/rad], `transmission` (..., C): 0 at a
    dead point of the linkage, 1 far from it (see `linkages.Stretch`)."""

    length: Array
    lever: Array
    transmission: Array


@dataclass(frozen=True)
class Machine:
    """A chain of N links with revolute joints, driven by C cylinders and measured by S signals.

    `tool`: tooth line x + i z [m] in the last link's frame; `rated_payload` [kg]; `payload_reach` [m]: distance of the
    load's centre from the last pin, at most; `slew_axis` [m]: signed distance of the first pin from the slew axis;
    `gravity` [m/s^2] where it works; `curled` [rad]: least and greatest angle of the last joint at which a load is
    booked (None: any); `inertial` x + i z [m]: place of the base's inertial sensor, from the first pin;
    `opens`: the tool empties by opening, as a grab does, not by tilting; `lengths` (N,) [m]: the
    links' pin-to-pin lengths."""

    name: str
    links: tuple[Link, ...]
    cylinders: tuple[Cylinder, ...]
    signals: tuple[Signal, ...]
    tool: complex
    rated_payload: float
    payload_reach: float
    slew_axis: float
    gravity: float = STANDARD_GRAVITY
    curled: tuple[float, float] | None = None
    opens: bool = False
    inertial: complex = 0j
    lengths: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "lengths", np.array([link.length for link in self.links]))

    @property
    def size(self) -> int:
        """Number of links N."""
        return len(self.links)

    @once
    def outward(self) -> Array:
        """(N, N), 1 at [j, k] where link k lies beyond link j (k > j), else 0."""
        return np.triu(np.ones((self.size, self.size)), 1)

    @once
    def identity(self) -> Array:
        """The unit matrix (N, N)."""
        return np.eye(self.size)

    @once
    def reach(self) -> Array:
        """(N, N) [m], l_j at [j, k] where link k lies beyond link j (k > j), else 0."""
        return self.lengths[:, None] * self.outward

    @once
    def arms(self) -> Complex:
        """(N,) [m] vector x + i z from each link's inner pin to its outer pin (last link: to the tool), in its own
        frame."""
        return np.append(self.lengths[:-1], self.tool)

    @once
    def sum_outward(self) -> Array:
        """(N, N) matrix from the generalised forces Q_k of the absolute angles to joint torques: tau_j = sum_{k>=j} Q_k
        (mechanics/README.md, section 3)."""
        return np.triu(np.ones((self.size, self.size)))

    def pose(self, theta: ArrayLike) -> Pose:
        """Pose at joint angles (..., N) [rad]."""
        return pose(self.lengths, theta)

    def geometry(self, theta: ArrayLike) -> Geometry:
        """Lengths, levers and transmissions of all cylinders at joint angles (..., N) [rad]; NaN where a linkage cannot
        be closed."""
        return Geometry(*self._linkages.stretch(self.pose(theta)))

    @once
    def _linkages(self) -> Linkages:
        return Linkages(tuple(cylinder.linkage for cylinder in self.cylinders))

    def tool_point(self, theta: ArrayLike) -> Point:
        """The tooth line's place in chassis axes [m] and its derivatives (..., N) [m/rad]."""
        return point(self.pose(theta), self.size, self.tool)

    @once
    def spans(self) -> tuple[tuple[int, ...], ...]:
        """For each cylinder the joints (from 0) that it acts on."""
        bodies = [[body for body, _ in cylinder.linkage.pins] for cylinder in self.cylinders]
        return tuple(tuple(range(min(b), max(b))) for b in bodies)

    @once
    def four_bars(self) -> dict[str, FourBar]:
        """The four-bar linkages, by name of the cylinder that drives each."""
        return {c.name: c.linkage for c in self.cylinders if isinstance(c.linkage, FourBar)}

    @once
    def carried(self) -> tuple[Cylinder, ...]:
        """The cylinders whose foot is on a link, not on the chassis."""
        return tuple(c for c in self.cylinders if c.linkage.pins[0][0] > 0)

    @once
    def forces_measured(self) -> tuple[bool, ...]:
        """For each cylinder whether its force is measured: by a force pin, or at least by its head-side pressure."""
        seen = {s.index for s in self.signals if s.kind in (Kind.HEAD_PRESSURE, Kind.FORCE_PIN)}
        return tuple(c in seen for c in range(len(self.cylinders)))

    @once
    def rows(self) -> tuple[int, ...]:
        """The joints (from 0) whose torque is measured: at least one cylinder acts on the joint, and the force of every
        cylinder that does is measured."""
        acting = [[c for c, span in enumerate(self.spans) if j in span] for j in range(self.size)]
        return tuple(j for j, cs in enumerate(acting) if cs and all(self.forces_measured[c] for c in cs))

    @once
    def tables(self) -> tuple[tuple[Array, Array] | None, ...]:
        """For each cylinder that acts on one joint: (lengths in ascending order [m], joint angles [rad]), the first
        guess of `joint_angle`; None for the other cylinders."""
        return tuple(self._table(c) for c in range(len(self.cylinders)))

    def _table(self, c: int) -> tuple[Array, Array] | None:
        if len(self.spans[c]) != 1:
            return None
        (j,) = self.spans[c]
        theta = np.zeros((TABLE, self.size))
        theta[:, j] = np.linspace(self.links[j].angle_low, self.links[j].angle_high, TABLE)
        length = self.cylinders[c].linkage.stretch(self.pose(theta)).length
        order = slice(None) if length[-1] > length[0] else slice(None, None, -1)
        return length[order], theta[order, j]

    def joint_angle(self, c: int, length: ArrayLike) -> Array:
        """Joint angle (...,) [rad] from the length (...,) [m] of cylinder `c`, which acts on one joint; NaN outside the
        range. A table gives the first guess, Newton steps refine it (error below 1e-12 rad away from dead points).

        Raises ValueError for a cylinder that acts on several joints."""
        table = self.tables[c]
        if table is None:
            raise ValueError(f"cylinder {self.cylinders[c].name} acts on several joints: its length gives no one angle")
        (j,) = self.spans[c]
        wanted = np.asarray(length, dtype=np.float64)
        theta = np.zeros((*wanted.shape, self.size))
        theta[..., j] = np.interp(wanted, *table, left=np.nan, right=np.nan)
        for _ in range(NEWTON_STEPS):
            s = self.cylinders[c].linkage.stretch(self.pose(theta))
            theta[..., j] -= (s.length - wanted) / s.gradient[..., j]
        return theta[..., j]

    def cylinder_force(self, c: int, head: Array | float, rod: Array | float) -> Array | float:
        """F = p_head A_head - p_rod A_rod (...,) [N] of cylinder `c`, positive when it pushes, from pressures [Pa]
        (mechanics/README.md, section 2)."""
        cylinder = self.cylinders[c]
        return head * cylinder.area_head - rod * cylinder.area_rod


TABLE = 1025  # points of each of `Machine.tables`; chosen: fine enough for the Newton steps below
NEWTON_STEPS = 3  # reach rounding error from that table's first guess


def base_parameters(links: tuple[Link, ...]) -> Array:
    """Phi (3N,) = (J, X, Z) of each link from its data sheet (mechanics/README.md, section 3), mu_j the mass
    beyond link j:
    J = I + m (cx^2 + cz^2) + mu l^2 [kg m^2], X = m cx + mu l, Z = m cz [kg m]."""
    beyond = np.array([sum(k.mass for k in links[j + 1 :]) for j in range(len(links))])
    rows = [
        (
            k.inertia + k.mass * (k.cx**2 + k.cz**2) + mu * k.length**2,
            k.mass * k.cx + mu * k.length,
            k.mass * k.cz,
        )
        for k, mu in zip(links, np.where(np.arange(len(links)) < len(links) - 1, beyond, 0.0), strict=True)
    ]
    return np.array(rows).reshape(-1)


def with_parameters(machine: Machine, phi: Array) -> Machine:
    """The machine whose links have such centres of gravity and inertias that its `base_parameters` are `phi` (3N,);
    masses stay as they were."""
    links = []
    for j, (link, (inertia, x, z)) in enumerate(zip(machine.links, phi.reshape(-1, 3).tolist(), strict=True)):
        mu = sum(other.mass for other in machine.links[j + 1 :])
        cx, cz = (x - mu * link.length) / link.mass, z / link.mass
        own = inertia - link.mass * (cx**2 + cz**2) - mu * link.length**2
        links.append(replace(link, cx=cx, cz=cz, inertia=own))
    return replace(machine, links=tuple(links))


def base_parameter_covariance(links: tuple[Link, ...]) -> Array:
    """Covariance (3N, 3N) of `base_parameters` from the standard errors of the data sheet, by first-order error
    propagation."""
    spread = base_parameter_spread(links)
    return np.asarray(spread @ spread.T)


def base_parameter_spread(links: tuple[Link, ...]) -> Array:
    """(3N, 4N): what a standard error of each figure of the data sheet - mass, centre x, centre z and inertia of each
    link - changes of `base_parameters`."""
    scale = [(k.mass_error, k.centre_error, k.centre_error, k.inertia_error) for k in links]
    gradient = np.concatenate([_mass_gradient(links, j) for j in range(len(links))], axis=1)
    return np.asarray(gradient * np.array(scale).reshape(-1))


def _mass_gradient(links: tuple[Link, ...], j: int) -> Array:
    """d(Phi)/d(mass, cx, cz, inertia) (3N, 4) of link j."""
    k, gradient = links[j], np.zeros((3 * len(links), 4))
    for i in range(j):
        gradient[3 * i : 3 * i + 2, 0] = (links[i].length ** 2, links[i].length)
    gradient[3 * j : 3 * j + 3, 0] = (k.cx**2 + k.cz**2, k.cx, k.cz)
    gradient[3 * j : 3 * j + 3, 1] = (2 * k.mass * k.cx, k.mass, 0.0)
    gradient[3 * j : 3 * j + 3, 2] = (2 * k.mass * k.cz, 0.0, k.mass)
    gradient[3 * j, 3] = 1.0
    return gradient
