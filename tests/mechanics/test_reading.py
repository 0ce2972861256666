"""What follows a course with a time constant."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cylforce.mechanics.reading import followed


@given(st.floats(0.005, 1.0), st.floats(-1e6, 1e6))
def test_what_stays_is_followed_exactly(constant, level):
    t = np.arange(50) / 100.0
    assert followed(np.full(50, level), t, constant) == pytest.approx(np.full(50, level), abs=1e-9 * abs(level) + 1e-12)


@given(st.floats(0.02, 0.5))
def test_a_step_is_followed_by_all_but_one_in_e_after_the_time_constant(constant):
    t = np.arange(4000) / 1000.0
    seen = followed(np.where(t < 0.5, -1.0, 1.0), t, constant)
    assert np.interp(0.499 + constant, t, seen) == pytest.approx(1.0 - 2.0 / np.e, abs=1e-3)
    assert np.all(np.diff(seen) >= 0.0)
