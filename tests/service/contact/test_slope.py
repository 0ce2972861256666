"""A change of the ground's slope, from paths of the teeth that are made by hand."""

from math import cos, radians, sin

import pytest

from cylforce.service.contact.slope import NO_COURSE, kink


def found(places):
    """(path so far [m], confidence) of every change along places 1 cm apart."""
    course, said = NO_COURSE, []
    for k, place in enumerate(places):
        course, sure = kink(course, place)
        if sure is not None:
            said.append((0.01 * k, sure))
    return said


def bent(degrees, length=1.0):
    """Straight to the house for `length`, then as far along a slope."""
    before = [complex(-0.01 * k, 0.0) for k in range(round(100 * length))]
    way = complex(-cos(radians(degrees)), sin(radians(degrees)))
    return before + [before[-1] + 0.01 * k * way for k in range(1, round(100 * length))]


@pytest.mark.parametrize("degrees", [-20.0, -10.0, 10.0, 20.0])
def test_a_bend_is_found_once_and_soon(degrees):
    (at, sure), *others = found(bent(degrees))
    assert others == []
    assert 1.0 < at < 1.4
    assert 0.7 < sure <= 1.0


@pytest.mark.parametrize("degrees", [0.0, 2.0, -3.0])
def test_a_straight_path_has_none(degrees):
    assert found(bent(degrees)) == []


def test_an_arc_has_none():
    """A bucket that turns about a pin 3 m away."""
    assert found([3j - 3j * complex(cos(0.01 * k / 3.0), sin(0.01 * k / 3.0)) for k in range(300)]) == []
