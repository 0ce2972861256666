"""Prior of the centrifugal terms of a link from its data sheet (mechanics/README.md, section 4).

D - J = -2 (m cz^2 + f I) and E = m cx cz + t I: f is the share of the inertia I about the centre that the link's depth
has, t the angle between its long axis and the line of its pins. No data sheet has f and t."""

from math import sqrt
from typing import NamedTuple

from cylforce.mechanics.machine import Link

# Largest f; f is uniform from 0 to it. A box h deep and l long has f = h^2 / (h^2 + l^2). Arms are at most a third as
# deep as long; a tool may be of any shape.
ARM, TOOL = 0.1, 1.0
FLOOR = 1.0  # kg m^2, added to both standard errors, so that neither is zero; chosen
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
    """Return the prior of a link's two centrifugal terms while the house slews, from the data sheet.

    They are second moments about the inner pin: the excess D - J = -2 int z^2 dm = -2 (m cz^2 + f I), and the product
    E = int x z dm = m cx cz + t I. The share f of the inertia I that lies in the link's depth is uniform from 0 to its
    largest value, half of it in the mean. The tilt t of the long axis is 0 in the mean. The standard errors are
    propagated to first order; the tolerances of the data sheet are standard errors.

    link: mass [kg], centre of mass cx, cz [m], inertia about it [kg m^2], and the tolerance of each
    tool: whether it is a tool, which may be of any shape; else an arm
    """
    m, x, z, inertia = link.mass, link.cx, link.cz, link.inertia
    largest_share = TOOL if tool else ARM
    share, share_error = largest_share / 2.0, largest_share / 2.0 / sqrt(3.0)
    excess_error = 2.0 * _root_sum_of_squares(
        z**2 * link.mass_error, 2.0 * m * z * link.centre_error, share_error * inertia, share * link.inertia_error
    )
    product_error = _root_sum_of_squares(
        x * z * link.mass_error, m * x * link.centre_error, m * z * link.centre_error, TILT * inertia
    )
    return Slewing(
        excess=-2.0 * (m * z**2 + share * inertia),
        excess_error=excess_error + FLOOR,
        product=m * x * z,
        product_error=product_error + FLOOR,
    )


def _root_sum_of_squares(*parts: float) -> float:
    return sqrt(sum(part**2 for part in parts))
