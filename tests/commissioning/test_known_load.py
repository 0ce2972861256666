"""A lift of a known weight tells the scale, where areas and levers of the machine file are not the machine's."""

from dataclasses import replace

import pytest

from cylforce.commissioning.identification import identify
from cylforce.commissioning.known_load import with_known_load
from cylforce.estimation.model import Model
from cylforce.programs.common.readings import model_of
from cylforce.service.hanging import hanging
from cylforce.settings.machine_file import load
from known_lift import KNOWN_KG, lifted
from scenarios import EXCAVATOR, moved


def test_a_known_weight_tells_how_much_too_large_the_areas_are():
    """With areas 4 % too large in the file all forces read 4 % too high, and what is left must be divided by 1.04.
    Within half of the 1 % that nobody knows before, and within three of its standard errors."""
    loaded, wrong = load(EXCAVATOR), 1.04
    model = model_of(loaded)
    cylinders = [
        replace(c, area_head=wrong * c.area_head, area_rod=wrong * c.area_rod) for c in model.machine.cylinders
    ]
    model = Model(replace(model.machine, cylinders=tuple(cylinders)), model.filters, model.friction)
    identified = with_known_load(identify(model, [moved(loaded)]), [lifted(loaded)], KNOWN_KG, hanging)
    found = identified.tares
    assert found.scale == pytest.approx(1.0 / wrong, abs=0.005)
    assert abs(found.scale - 1.0 / wrong) < 3.0 * found.scale_error
    assert found.common_error == 0.0
    assert identified.scale_measured
    assert identified.warnings[0].startswith("the known weight reads 10")
    assert "+- 0." in identified.warnings[0]


def test_a_known_weight_that_agrees_with_the_data_sheet_is_not_questioned():
    loaded = load(EXCAVATOR)
    found = with_known_load(identify(model_of(loaded), [moved(loaded)]), [lifted(loaded)], KNOWN_KG, hanging)
    assert found.warnings == ()
    assert found.scale_measured
