"""The machine: links, linkages, cylinders and signals as immutable values.

Computes cylinder lengths, levers and forces, and the base parameters of the links from the data sheet.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cylforce.mechanics.chain import Complex, Point, Pose, point, pose
from cylforce.mechanics.linkages import FourBar, Linkage, Linkages
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind, Signal
from cylforce.signals.units import STANDARD_GRAVITY

FORCE_KINDS = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE, Kind.FORCE_PIN)
TOLERANCE_OVER_ERROR = 3.0**0.5  # tolerance over standard error: half-width of a uniform distribution (GUM 4.3.7)


@dataclass(frozen=True, slots=True)
class Link:
    """A link with the figures of its data sheet and their standard errors.

    The link's own frame has its origin at the inner pin and its x axis towards the outer pin. The x axis of the last
    link points at the tool.

    name: name in the machine file
    length: distance from inner to outer pin [m]; not used by the dynamics of the last link
    mass: [kg]
    cx: centre of gravity along the link's x axis [m]
    cz: centre of gravity along the link's z axis [m]
    inertia: moment of inertia about the centre of gravity [kg m^2]
    angle_low: least joint angle [rad]
    angle_high: greatest joint angle [rad]
    mass_error: standard error of `mass` [kg]
    centre_error: standard error of `cx` and of `cz` [m]
    inertia_error: standard error of `inertia` [kg m^2]
    length_error: standard error of `length` [m]
    """

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
    """A cylinder, or several in parallel.

    name: name in the machine file
    linkage: how it drives its joints
    area_head: piston area of the head side [m^2], summed over parallel cylinders
    area_rod: piston area of the rod side [m^2], summed over parallel cylinders
    length_low: shortest length [m]
    length_high: longest length [m]
    rod_pressure: pressure assumed on the rod side where there is no sensor [Pa]
    area_error: relative standard error of the areas
    pin_error: standard error of the place of every pin [m]
    """

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
    """Lengths of C cylinders and their derivatives by N joint angles.

    length: (..., C) pin-to-pin length [m]
    lever: (..., C, N) d(length)/d(angle) [m/rad]
    transmission: (..., C) 0 at a dead point of the linkage, 1 far from it (see `linkages.Stretch`)
    """

    length: Array
    lever: Array
    transmission: Array


@dataclass(frozen=True)
class Machine:
    """A chain of N links with revolute joints, driven by C cylinders and measured by S signals.

    name: name in the machine file
    links: the N links, from the house outwards
    cylinders: the C cylinders
    signals: the S measured signals, in the order of a sample
    tool: tooth line x + i z in the last link's frame [m]
    rated_payload: [kg]
    payload_reach: largest distance of the load's centre from the last pin [m]
    slew_axis: signed distance of the first pin from the slew axis [m]
    gravity: gravity where the machine works [m/s^2]
    curled: least and greatest angle of the last joint at which a load is booked [rad]; None: any
    opens: whether the tool empties by opening, as a grab does, not by tilting
    inertial: place x + i z of the base's inertial sensor, from the first pin [m]
    lengths: (N,) pin-to-pin lengths of the links [m]
    """

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
        """Return the number of links N."""
        return len(self.links)

    @cached_property
    def outward(self) -> Array:
        """Return a matrix (N, N) with 1 at [j, k] where link k lies beyond link j (k > j), else 0."""
        return np.triu(np.ones((self.size, self.size)), 1)

    @cached_property
    def identity(self) -> Array:
        """Return the unit matrix (N, N)."""
        return np.eye(self.size)

    @cached_property
    def reach(self) -> Array:
        """Return a matrix (N, N) [m] with l_j at [j, k] where link k lies beyond link j (k > j), else 0."""
        return self.lengths[:, None] * self.outward

    @cached_property
    def arms(self) -> Complex:
        """Return the vector x + i z (N,) [m] from each link's inner pin to its outer pin, in the link's frame.

        The vector of the last link ends at the tool.
        """
        return np.append(self.lengths[:-1], self.tool)

    @cached_property
    def sum_outward(self) -> Array:
        """Return the matrix (N, N) from generalised forces to joint torques: tau_j = sum_{k>=j} Q_k.

        Q_k is the generalised force of the absolute angle q_k (mechanics/README.md, section 3).
        """
        return np.triu(np.ones((self.size, self.size)))

    def pose(self, theta: ArrayLike) -> Pose:
        """Return the pose at joint angles theta (..., N) [rad]."""
        return pose(self.lengths, theta)

    def geometry(self, theta: ArrayLike) -> Geometry:
        """Return lengths, levers and transmissions of all cylinders at joint angles theta (..., N) [rad].

        NaN where a linkage cannot be closed.
        """
        return Geometry(*self._linkages.stretch(self.pose(theta)))

    @cached_property
    def _linkages(self) -> Linkages:
        """Return the linkages of all cylinders, to be evaluated together."""
        return Linkages(tuple(cylinder.linkage for cylinder in self.cylinders))

    def tool_point(self, theta: ArrayLike) -> Point:
        """Return the place (...,) [m] of the tooth line and its derivatives (..., N) [m/rad] by the joint angles.

        Both are x + i z in chassis axes, the place from the first pin.

        theta: joint angles (..., N) [rad]
        """
        return point(self.pose(theta), self.size, self.tool)

    @cached_property
    def spans(self) -> tuple[tuple[int, ...], ...]:
        """Return for each cylinder the numbers of the joints (from 0) on which it acts."""
        bodies = [[body for body, _ in cylinder.linkage.pins] for cylinder in self.cylinders]
        return tuple(tuple(range(min(b), max(b))) for b in bodies)

    @cached_property
    def four_bars(self) -> dict[str, FourBar]:
        """Return the four-bar linkages, by name of the cylinder that drives each."""
        return {c.name: c.linkage for c in self.cylinders if isinstance(c.linkage, FourBar)}

    @cached_property
    def carried(self) -> tuple[Cylinder, ...]:
        """Return the cylinders whose foot is on a link, not on the chassis."""
        return tuple(c for c in self.cylinders if c.linkage.pins[0][0] > 0)

    @cached_property
    def forces_measured(self) -> tuple[bool, ...]:
        """Return for each cylinder whether its force is measured.

        The force is measured by a force pin, or by the head-side pressure with or without the rod-side pressure.
        """
        measured = {s.index for s in self.signals if s.kind in (Kind.HEAD_PRESSURE, Kind.FORCE_PIN)}
        return tuple(c in measured for c in range(len(self.cylinders)))

    @cached_property
    def rows(self) -> tuple[int, ...]:
        """Return the joints (from 0) whose torque is measured.

        At least one cylinder acts on such a joint, and the force of every cylinder that acts on it is measured.
        """
        acting = [[c for c, span in enumerate(self.spans) if j in span] for j in range(self.size)]
        return tuple(j for j, cs in enumerate(acting) if cs and all(self.forces_measured[c] for c in cs))

    @cached_property
    def tables(self) -> tuple[tuple[Array, Array] | None, ...]:
        """Return a table of length and angle for each cylinder that acts on one joint, None for the others.

        A table is (lengths in ascending order [m], joint angles [rad]); it gives the first guess of `joint_angle`.
        """
        return tuple(self._table(c) for c in range(len(self.cylinders)))

    def _table(self, c: int) -> tuple[Array, Array] | None:
        """Return the table (lengths [m], joint angles [rad]) of cylinder c, None where it acts on several joints.

        The angles cover the joint's range evenly; the lengths ascend.
        """
        if len(self.spans[c]) != 1:
            return None
        (j,) = self.spans[c]
        theta = np.zeros((TABLE, self.size))
        theta[:, j] = np.linspace(self.links[j].angle_low, self.links[j].angle_high, TABLE)
        length = self.cylinders[c].linkage.stretch(self.pose(theta)).length
        order = slice(None) if length[-1] > length[0] else slice(None, None, -1)
        return length[order], theta[order, j]

    def joint_angle(self, c: int, length: ArrayLike) -> Array:
        """Return the joint angle (...,) [rad] at which cylinder c has a length (...,) [m]; NaN outside the joint's
        range.

        The cylinder must act on one joint. A table gives the first guess, Newton steps refine it: the error is below
        1e-12 rad away from dead points. Raises ValueError for a cylinder that acts on several joints.
        """
        table = self.tables[c]
        if table is None:
            raise ValueError(f"cylinder {self.cylinders[c].name} acts on several joints: its length gives no one angle")
        (j,) = self.spans[c]
        wanted = np.asarray(length, dtype=np.float64)
        if wanted.ndim == 0:
            return np.asarray(self._one_joint_angle(c, j, float(wanted), table))
        theta = np.zeros((*wanted.shape, self.size))
        theta[..., j] = np.interp(wanted, *table, left=np.nan, right=np.nan)
        for _ in range(NEWTON_STEPS):
            stretch = self.cylinders[c].linkage.stretch(self.pose(theta))
            theta[..., j] -= (stretch.length - wanted) / stretch.gradient[..., j]
        return theta[..., j]

    def _one_joint_angle(self, c: int, j: int, length: float, table: tuple[Array, Array]) -> float:
        """Return `joint_angle` [rad] of one length [m]: arrays of one element take ten times as long as plain numbers.

        Pins are placed in the frame of the body before the joint, so that the other joints' angles have no influence.
        NaN outside the joint's range.

        c: number of the cylinder
        j: number of the joint on which it acts
        table: lengths [m] and joint angles [rad] for the first guess, see `tables`
        """
        linkage, joint = self.cylinders[c].linkage, complex(self.lengths[j - 1]) if j else 0j
        angle = float(np.interp(length, *table, left=np.nan, right=np.nan))
        for _ in range(NEWTON_STEPS):
            reached, slope = linkage.over_one_joint(joint, angle)
            angle -= (reached - length) / slope
        return angle

    def cylinder_force(self, c: int, head: Array | float, rod: Array | float) -> Array | float:
        """Return the force F = p_head A_head - p_rod A_rod (...,) [N] of cylinder c, positive when it pushes.

        head, rod: pressures of both sides (...,) [Pa] (mechanics/README.md, section 2)
        """
        cylinder = self.cylinders[c]
        return head * cylinder.area_head - rod * cylinder.area_rod


TABLE = 1025  # points of each of `Machine.tables`; chosen: fine enough for the Newton steps below
NEWTON_STEPS = 3  # reach rounding error from that table's first guess


def base_parameters(links: tuple[Link, ...]) -> Array:
    """Return Phi (3N,) = (J, X, Z) of each link from its data sheet (mechanics/README.md, section 3).

    With mu_j the mass beyond link j:
    J = I + m (cx^2 + cz^2) + mu l^2 [kg m^2], X = m cx + mu l, Z = m cz [kg m].
    """
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
    """Return the machine with such centres of gravity and inertias that its `base_parameters` are phi (3N,).

    The masses stay as they were.

    phi: (3N,) J [kg m^2], X, Z [kg m] of each link
    """
    links = []
    for j, (link, (inertia, x, z)) in enumerate(zip(machine.links, phi.reshape(-1, 3).tolist(), strict=True)):
        mu = sum(other.mass for other in machine.links[j + 1 :])
        cx, cz = (x - mu * link.length) / link.mass, z / link.mass
        about_centre = inertia - link.mass * (cx**2 + cz**2) - mu * link.length**2
        links.append(replace(link, cx=cx, cz=cz, inertia=about_centre))
    return replace(machine, links=tuple(links))


def base_parameter_covariance(links: tuple[Link, ...]) -> Array:
    """Return the covariance (3N, 3N) of `base_parameters`, (J, X, Z) of each link [kg m^2, kg m, kg m].

    First-order propagation of the standard errors of masses, centres of gravity and inertias in the data sheet, taken
    as independent. The errors of lengths are not contained.
    """
    spread = base_parameter_spread(links)
    return np.asarray(spread @ spread.T)


def base_parameter_spread(links: tuple[Link, ...]) -> Array:
    """Return the change (3N, 4N) of `base_parameters` by one standard error of each mass, centre and inertia.

    The rows are (J, X, Z) [kg m^2, kg m, kg m] link by link. The columns, link by link too, are mass, centre x,
    centre z and inertia of the data sheet. The errors of lengths have no column.
    """
    scale = [(k.mass_error, k.centre_error, k.centre_error, k.inertia_error) for k in links]
    gradient = np.concatenate([_mass_gradient(links, j) for j in range(len(links))], axis=1)
    return np.asarray(gradient * np.array(scale).reshape(-1))


def _mass_gradient(links: tuple[Link, ...], j: int) -> Array:
    """Return the derivatives (3N, 4) of all base parameters by mass [kg], cx, cz [m] and inertia [kg m^2] of link j.

    The mass of a link is also in J and X of the links before it.
    """
    k, gradient = links[j], np.zeros((3 * len(links), 4))
    for i in range(j):
        gradient[3 * i : 3 * i + 2, 0] = (links[i].length ** 2, links[i].length)
    gradient[3 * j : 3 * j + 3, 0] = (k.cx**2 + k.cz**2, k.cx, k.cz)
    gradient[3 * j : 3 * j + 3, 1] = (2 * k.mass * k.cx, k.mass, 0.0)
    gradient[3 * j : 3 * j + 3, 2] = (2 * k.mass * k.cz, 0.0, k.mass)
    gradient[3 * j, 3] = 1.0
    return gradient
