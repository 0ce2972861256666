"""Gravity at a location on the earth.

It is 0.5 % less at the equator than at a pole, and 0.03 % less for every 1000 m of height.
"""

from math import sin, sqrt

# World Geodetic System 1984 (NIMA TR8350.2, third edition, tables 3.1, 3.3 and 3.4)
AXIS = 6378137.0  # m, semi-major
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)
EQUATOR = 9.7803253359  # m/s^2
K = 0.00193185265241
M = 0.00344978650684  # omega^2 a^2 b / GM


def normal_gravity(latitude: float, height: float = 0.0) -> float:
    """Return gravity [m/s^2] by Somigliana's formula and its series in the height.

    g0 = g_e (1 + k s) / sqrt(1 - e^2 s), g = g0 (1 - 2 (1 + f + m - 2 f s) h/a + 3 (h/a)^2), s = sin(latitude)^2
    (TR8350.2, equations 4-1 and 4-3).

    latitude: [rad]
    height: above the ellipsoid [m]
    """
    s, up = sin(latitude) ** 2, height / AXIS
    ground = EQUATOR * (1.0 + K * s) / sqrt(1.0 - ECCENTRICITY_2 * s)
    return ground * (1.0 - 2.0 * (1.0 + FLATTENING + M - 2.0 * FLATTENING * s) * up + 3.0 * up * up)
