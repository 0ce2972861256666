"""Continuous shape parameters: every effect declares fields it has, with ranges that hold its starting values."""

from dataclasses import fields

import numpy as np
import pytest

from cylforce.effects.fault import ShapeRange, shaped, shapes
from cylforce.effects.library import LIBRARY

PROFILED = [group for group in LIBRARY if shapes(group)]


@pytest.mark.parametrize("group", PROFILED, ids=lambda group: repr(group[0]))
def test_starting_values_lie_within_their_ranges(group):
    floats = {f.name for f in fields(group[0]) if type(getattr(group[0], f.name)) is float}
    for shape in shapes(group):
        assert shape.field in floats
        value = getattr(group[0], shape.field)
        assert shape.low <= value <= shape.high
        assert shape.value(shape.position(value)) == pytest.approx(value, rel=1e-12, abs=1e-12)


def test_effects_with_a_width_or_a_time_constant_are_profiled():
    names = {group[0].about.name for group in PROFILED}
    assert {"stribeck", "friction_temperature_drift", "pressure_drift", "ringing_compliance", "mud"} <= names
    assert not {"coulomb_friction", "asymmetric_friction", "linkage_geometry"} & names


@pytest.mark.parametrize(
    ("shape", "middle"),
    [
        (ShapeRange("right", 0.0, 1.0), 0.5),
        (ShapeRange("settling", 25.0, 400.0, log=True), 100.0),
        (ShapeRange("fading", 0.0, 0.03, log=True, shift=0.01), 0.01),  # 0.01 * 2^(0, 1, 2) less 0.01
    ],
)
def test_a_position_halfway_is_the_mean_in_equal_steps(shape, middle):
    assert shape.value(0.5) == pytest.approx(middle)
    assert shape.position(middle) == pytest.approx(0.5)
    np.testing.assert_allclose([shape.value(x) for x in (-1.0, 0.0, 1.0, 2.0)], np.repeat([shape.low, shape.high], 2))


def test_a_shape_is_set_in_all_effects_that_share_it():
    group = next(g for g in LIBRARY if g[0].about.name == "return_line_loss")
    found = shaped(group, {"power": 1.2})
    assert [(effect.way, effect.power) for effect in found] == [(1, 1.2), (-1, 1.2)]
    with pytest.raises(ValueError, match="no parameter 'force' of its shape: way, power"):
        shaped(group, {"force": 1.2})
