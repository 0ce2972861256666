"""What a data sheet tells of the centrifugal terms holds for boxes of any plausible depth."""

import numpy as np
import pytest

from cylforce.estimation.priors.depth import slewing
from cylforce.mechanics.machine import Link


def box(length, depth, mass=1000.0, at=(1.0, 0.2), turned=0.0):
    """A link that is a box, and its true (D - J, E) about the inner pin: -2 int z^2 dm, int x z dm."""
    along, across = mass * length**2 / 12.0, mass * depth**2 / 12.0
    c, s = np.cos(turned), np.sin(turned)
    zz, xz = along * s**2 + across * c**2 + mass * at[1] ** 2, (along - across) * s * c + mass * at[0] * at[1]
    return Link("box", length, mass, *at, along + across, -1.0, 1.0, 0.0, 0.0, 0.0), np.array([-2.0 * zz, xz])


@pytest.mark.parametrize(("tool", "deepest"), [(False, 1.0 / 3.0), (True, 2.0)])
def test_the_truth_of_boxes_lies_within_its_intervals(tool, deepest):
    """Of 300 boxes 95 % within two standard errors, and not all within a half of one."""
    rng, off = np.random.default_rng(1), []
    for _ in range(300):
        link, truth = box(3.0, 3.0 * rng.uniform(0.0, deepest), turned=rng.normal(0.0, 0.05))
        told = slewing(link, tool=tool)
        off.append((truth - [told.excess, told.product]) / [told.excess_error, told.product_error])
    inside = np.mean(np.abs(off) < 2.0, axis=0)
    assert np.all(inside > 0.94)
    assert np.all(np.std(off, axis=0) > 0.4)


def test_a_thin_link_has_its_centres_distance_alone():
    """1000 kg, 0.2 m beside the line of its pins: -80, and 200 kg m^2, within a standard error."""
    link, truth = box(3.0, 0.0)
    assert truth == pytest.approx([-80.0, 200.0])
    told = slewing(link, tool=False)
    assert np.all(np.abs(truth - [told.excess, told.product]) < 2.0 * np.array([told.excess_error, told.product_error]))


def test_tolerances_count():
    link, _ = box(3.0, 0.5)
    loose = Link("box", 3.0, 1000.0, 1.0, 0.2, link.inertia, -1.0, 1.0, 100.0, 0.1, 100.0)
    sharp, dull = slewing(link, tool=False), slewing(loose, tool=False)
    by_hand = np.hypot(sharp.product_error - 1.0, np.sqrt(20.0**2 + 100.0**2 + 20.0**2)) + 1.0
    assert dull.product_error == pytest.approx(by_hand)
    assert dull.excess_error > sharp.excess_error
