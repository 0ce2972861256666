"""Pressures that are all wrong by one factor: named when the data sheet's masses exclude them, contained in the
reported error when they do not; a known weight settles it."""

from array import array
from functools import cache

import numpy as np
import pytest
import tomlkit

from cylforce.commissioning.common_scale import CommonScale, common_scale, rescaled
from cylforce.commissioning.emptiness import HEAVY
from cylforce.commissioning.explained import row_noise
from cylforce.commissioning.identification import identify
from cylforce.estimation.blocks import chosen
from cylforce.estimation.observation import observed_factors
from cylforce.estimation.regressor import Rows
from cylforce.estimation.residual import residual
from cylforce.programs.common.readings import model_of
from cylforce.programs.identify import without_known_weight
from cylforce.service.weighing import LoadConstants, LoadEstimator
from cylforce.settings.identified import identified_warnings, read_identified, seal_again, write_identified
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Reason, Status
from known_lift import KNOWN_KG, lifted
from scenarios import SMALL, moved

LOADED = load(SMALL)
MODEL = model_of(LOADED)


@cache
def recording():
    return moved(LOADED)


def measured(factor):
    """The recording with all pressures `factor` times as large."""
    return rescaled(MODEL, recording(), 1.0 / factor)


@cache
def healthy():
    return identify(MODEL, [recording()])


@cache
def estimated(factor):
    whole = observed_factors(MODEL, [measured(factor)])
    data = chosen(whole, list(range(len(MODEL.parameters))))
    return common_scale(MODEL, data, row_noise(data, MODEL.prior))


@pytest.mark.parametrize("factor", [0.01, 0.0689, 0.1, 0.5, 0.667, 0.8, 0.875, 0.95, 1.14, 1.5, 2.0, 14.504])
def test_the_estimate_follows_the_factor(factor):
    """Nothing but the prior of friction has a scale of its own, so that the factor is found to some per cent."""
    assert estimated(factor).factor == pytest.approx(factor * estimated(1.0).factor, rel=0.03)


@pytest.mark.parametrize("factor", [0.5, 0.667, 0.8, 0.875, 0.95, 1.0, 1.14, 1.5, 2.0])
def test_the_reported_error_contains_the_factor(factor):
    """A weight that reads `factor` times the true one is wrong by 1/factor - 1 of what it reads."""
    assert abs(1.0 / factor - 1.0) < 2.0 * estimated(factor).error


def test_a_healthy_machine_has_the_error_of_its_data_sheet_and_not_less():
    """Masses 10 % off, each in its own direction, are within the tolerances of 10 %."""
    found = estimated(1.0)
    assert not found.is_wrong
    assert found.standard_error <= found.error < found.standard_error + abs(1.0 - found.factor)
    assert abs(found.factor - 1.0) < 0.1 + found.standard_error


def test_masses_at_the_limit_of_all_their_tolerances_are_not_excluded():
    """In either direction: farther than HEAVY standard errors of tolerances that are drawn independently."""
    links = MODEL.machine.links
    found = estimated(1.0)
    share = max(np.sqrt(3.0) * k.mass_error / k.mass for k in links)
    assert found.limit > max(share, HEAVY * found.standard_error * 0.999)


@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        (0.1, "one decimal digit"),
        (0.667, ""),
        pytest.param(2.0, "", marks=pytest.mark.long),
        (14.504, "psi for bar"),
    ],
)
def test_pressures_that_the_data_sheet_excludes_are_refused_by_name(factor, cause):
    with pytest.raises(ValueError, match="all pressures") as refused:
        identify(MODEL, [measured(factor)])
    sentence = str(refused.value)
    assert "unit (bar, psi, MPa), range and decimal digits" in sentence
    assert cause in sentence
    assert "bucket is not empty" not in sentence


def test_whoever_wants_it_anyway_gets_a_warning_and_the_error():
    found = identify(MODEL, [measured(0.1)], refuse=False)
    assert "(one decimal digit" in found.warnings[0]
    assert found.tares.reported_scale_error > 8.0


def test_the_estimate_of_an_error():
    """Masses of 0.8 +- 0.04: the true weight is 1.25 +- 0.05 times the reported one."""
    found = CommonScale(0.8, 0.04, 0.15)
    assert found.is_wrong
    assert found.error == pytest.approx(np.hypot(0.25, 0.05))
    assert not CommonScale(0.9, 0.04, 0.15).is_wrong


@pytest.mark.parametrize("known", [False, True])
def test_a_heavy_load_is_shown_as_degraded_until_the_scale_is_known(known):
    """1000 kg of 1500 kg rated, of which 1 % is the limit; the scale of the data sheet's masses leaves several %."""
    model, tares = healthy().model, healthy().tares
    assert tares.common_error == healthy().by_masses.error
    better = tares._replace(common_error=0.0, scale_error=0.001) if known else tares
    constants, moving = LoadConstants(model, better), model.channels.run(lifted(LOADED))
    estimator = LoadEstimator.start(constants)
    rows, usable = model.filtered.run(moving.motion), array("d", [1.0] * len(model.machine.rows))
    for k in range(model.settle_steps, 1000):
        left = residual(model, tares, Rows(rows.columns[k], rows.torque[k]), np.zeros(len(usable)))
        load = estimator.load(estimator.update(constants.residual_of_arrays(left), usable))
    assert load.mass.value == pytest.approx(KNOWN_KG, rel=0.01)
    if known:
        assert (load.mass.status, load.mass.reason) == (Status.OK, Reason.NONE)
    else:
        assert (load.mass.status, load.mass.reason) == (Status.DEGRADED, Reason.UNCERTAIN)
        assert load.mass.standard_error > KNOWN_KG * tares.common_error


def test_the_error_is_kept_in_the_file_and_files_without_it_are_read(tmp_path):
    path = tmp_path / "identified.toml"
    write_identified(path, healthy(), LOADED, [("moves.log", "0" * 64)])
    assert read_identified(path, LOADED).common_error == healthy().tares.common_error
    assert identified_warnings(path) == ()


def test_a_file_from_before_is_read_with_a_warning(tmp_path):
    path = tmp_path / "identified.toml"
    write_identified(path, healthy(), LOADED, [("moves.log", "0" * 64)])
    said = tomlkit.parse(path.read_text())
    del said["common_scale_error"], said["seal"]["keys"]["common_scale_error"]
    path.write_text(tomlkit.dumps(said))
    seal_again(path, LOADED, "as it was written before")
    assert read_identified(path, LOADED).common_error == 0.0
    assert "common_scale_error" not in path.read_text()
    assert identified_warnings(path)[0].startswith("the scale of the pressures is not known")


def test_what_identify_prints_says_how_well_and_what_to_do():
    found = healthy()
    text = without_known_weight(found.tares, found.by_masses)
    assert f"+- {100.0 * found.tares.reported_scale_error:.1f} % only: lift a known weight" in text
