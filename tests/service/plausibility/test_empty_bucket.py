"""What seems to hang in an empty bucket, and whether it can be in it."""

import numpy as np
import pytest

from cylforce.service.plausibility.detectors.empty_bucket import distance

REACH = 2.0


@pytest.mark.parametrize("moments", [(0.0, 0.0, 0.0), (10.0, 19.9, 0.0), (10.0, -14.0, 14.0)])
def test_a_mass_within_reach_is_possible(moments):
    assert distance(np.array(moments), np.eye(3), REACH) == 0.0


def test_moments_without_a_mass_are_as_far_as_the_cone_of_all_masses():
    """The nearest mass to a moment alone lies on the edge |p| = R m: at a right angle to it."""
    for direction in np.linspace(0.0, 6.0, 13):
        moments = np.array([0.0, 30.0 * np.cos(direction), 30.0 * np.sin(direction)])
        assert distance(moments, np.eye(3), REACH) == pytest.approx(30.0 / np.sqrt(1.0 + REACH**2), rel=0.01)


def test_less_than_nothing_is_as_far_as_it_is_below():
    assert distance(np.array([-12.0, 0.0, 0.0]), np.diag([16.0, 1e-4, 1e-4]), REACH) == pytest.approx(3.0)


def test_what_is_not_known_decides_nothing():
    """A moment whose error goes along with a mass's, as that of a bucket held level, is no less possible than it."""
    along = np.array([1.0, REACH, 0.0])
    covariance = 1e-2 * np.eye(3) + 400.0 * np.outer(along, along)
    assert distance(-20.0 * along, covariance, REACH) < 1.01
    assert distance(np.array([0.0, 0.0, 40.0]), covariance, REACH) > 10.0


def test_a_finer_grid_of_directions_says_the_same():
    rng = np.random.default_rng(3)
    for _ in range(50):
        root = rng.normal(size=(3, 3))
        covariance, moments = root @ root.T + 0.1 * np.eye(3), rng.normal(size=3) * [5.0, 30.0, 30.0]
        found = distance(moments, covariance, REACH)
        angles = np.linspace(0.0, 2.0 * np.pi, 3600)
        edges = np.stack([np.ones_like(angles), REACH * np.cos(angles), REACH * np.sin(angles)])
        masses = np.linspace(0.0, 200.0, 2001)
        known, best = np.linalg.inv(covariance), np.inf
        for edge in edges.T[::10]:
            each = moments[:, None] - edge[:, None] * masses
            best = min(best, float((each * (known @ each)).sum(axis=0).min()))
        if np.hypot(*moments[1:]) > REACH * moments[0]:
            assert found == pytest.approx(np.sqrt(best), rel=0.03, abs=0.05)
