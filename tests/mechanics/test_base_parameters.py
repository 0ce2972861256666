"""What the data sheet's tolerances make of the base parameters, by hand: J = I + m (x^2 + z^2) + mu l^2,
X = m x + mu l, Z = m z, with mu the mass beyond."""

import numpy as np
import pytest

from cylforce.mechanics.machine import Link, base_parameter_covariance, base_parameters

SURE = Link("", 0.0, 800.0, 0.7, 0.3, 300.0, -3.0, 3.0, 0.0, 0.0, 0.0)


def test_base_parameters_are_those_of_the_data_sheet():
    """J = 300 + 800 * 0.58, X = 560, Z = 240; before it 5 m without a mass, with 800 kg at their end."""
    inner = Link("", 5.0, 0.0, 0.0, 0.0, 0.0, -3.0, 3.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(base_parameters((inner, SURE)), [20_000.0, 4000.0, 0.0, 764.0, 560.0, 240.0])


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        # centre known to 0.1 m in x and in z: dJ = 2 m x 0.1 = 112 and 2 m z 0.1 = 48, dX = dZ = 80
        ((0.0, 0.1, 0.0), [[112.0**2 + 48.0**2, 112.0 * 80.0, 48.0 * 80.0], [0, 80.0**2, 0], [0, 0, 80.0**2]]),
        # mass known to 50 kg: dJ = 0.58 * 50 = 29, dX = 35, dZ = 15
        ((50.0, 0.0, 0.0), [[29.0**2, 29.0 * 35.0, 29.0 * 15.0], [0, 35.0**2, 35.0 * 15.0], [0, 0, 15.0**2]]),
        # inertia known to 90 kg m^2
        ((0.0, 0.0, 90.0), [[8100.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]),
    ],
    ids=["centre", "mass", "inertia"],
)
def test_tolerances_of_a_link_become_those_of_its_base_parameters(errors, expected):
    mass, centre, inertia = errors
    link = Link("", 0.0, 800.0, 0.7, 0.3, 300.0, -3.0, 3.0, mass, centre, inertia)
    np.testing.assert_allclose(np.triu(base_parameter_covariance((link,))), expected, atol=1e-9)


def test_a_mass_that_is_not_sure_is_not_sure_at_the_links_before():
    """50 kg at the end of 5 m: dJ = 1250 kg m^2, dX = 250 kg m, and both rise with the outer link's own."""
    inner = Link("", 5.0, 900.0, 2.0, 0.1, 1000.0, -3.0, 3.0, 0.0, 0.0, 0.0)
    outer = Link("", 0.0, 800.0, 0.7, 0.3, 300.0, -3.0, 3.0, 50.0, 0.0, 0.0)
    by_mass = np.array([1250.0, 250.0, 0.0, 29.0, 35.0, 15.0])
    np.testing.assert_allclose(base_parameter_covariance((inner, outer)), np.outer(by_mass, by_mass), atol=1e-9)
