"""Prior of the centrifugal terms of a link from its data sheet (mechanics/README.md, section 4).

D - J = -2 (m cz^2 + f I) and E = m cx cz + t I: f is the share of the inertia I about the centre that the link's depth
has, t the angle between its long axis and the line of its pins. No data sheet has f and t."""

from math import sqrt
from typing import NamedTuple

from cylforce.mechanics.machine import Link

# Largest f; f is uniform from 0 to it. A box h deep and l long has f = h^2 / (h^2 + l^2). Arms are at most a third as
# deep as long; a tool may be of any shape.
ARM, TOOL = 0.1, 1.0
TILT = 0.05  # rad, standard error of t: the straight line of the pins and the bent box around it; chosen: 3 degrees


class Slewing(NamedTuple):
    """Centrifugal terms of a link.

    excess:        D - J [kg m^2]
    excess_error:  its standard error
    product:       E [kg m^2]
    product_error: its standard error
    """

    excess: float
    excess_error: float
    product: float
    product_error: float


def slewing(link: Link, *, tool: bool) -> Slewing:
    """Return the centrifugal terms from the data sheet's figures and tolerances, errors propagated to first order."""
    m, x, z, inertia = link.mass, link.cx, link.cz, link.inertia
    share = (TOOL if tool else ARM) / 2.0
    excess = -2.0 * (m * z**2 + share * inertia)
    spread = share / sqrt(3.0) * inertia, share * link.inertia_error
    deep = 2.0 * _root(z**2 * link.mass_error, 2.0 * m * z * link.centre_error, *spread)
    parts = x * z * link.mass_error, m * x * link.centre_error, m * z * link.centre_error, TILT * inertia
    return Slewing(excess, deep + 1.0, m * x * z, _root(*parts) + 1.0)


def _root(*parts: float) -> float:
    return sqrt(sum(part**2 for part in parts))
