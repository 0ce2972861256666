"""Intervals of shares in the tables of the tools."""

import pytest

from layers.intervals import wilson


def test_intervals_are_wilsons():
    assert wilson(8, 10) == pytest.approx((0.490, 0.943), abs=1e-3)
    assert wilson(0, 0) == (0.0, 1.0)
