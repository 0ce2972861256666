"""A joint whose torque stays unexplained: identification refuses or warns, and names the correction that makes the
recording fit; the identified file keeps the warning, its users repeat it, the report shows it in red."""

import re
from dataclasses import replace
from functools import cache
from io import StringIO
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from rich.console import Console

from cylforce.commissioning import suspicion
from cylforce.commissioning.explained import FAR, LITTLE, explained, quality
from cylforce.commissioning.identification import Identification, identify
from cylforce.commissioning.repairs import DECISIVE, Case, Repair, repairs
from cylforce.commissioning.wiring import Suspicion
from cylforce.estimation.blocks import chosen
from cylforce.estimation.observation import observe, observed_factors
from cylforce.files.tables import Table, write_table
from cylforce.programs.common.readings import make_core, model_of
from cylforce.programs.identify import How, run_identify, show
from cylforce.programs.replay import run_replay
from cylforce.programs.reports.report import write_report
from cylforce.settings.identified import identified_warnings
from cylforce.settings.machine_file import Loaded, load
from scenarios import EXCAVATOR, SMALL
from spoilt import exchanged, samples, with_bore
from studies.unexplained import reference

LOADED = load(EXCAVATOR)
MODEL = model_of(LOADED)
FEW = load(SMALL)  # for laws of any machine: with two cylinders there are a quarter of the corrections to try
FEW_MODEL = model_of(FEW)
SIGNALS = [s.name for s in MODEL.machine.signals]
FEW_SIGNALS = [s.name for s in FEW_MODEL.machine.signals]
UP_SIDE_DOWN = "the recording fits with the sign of z in foot at_m of the {} cylinder changed"


@cache
def recording(loaded=LOADED, seconds=60.0):
    """Moves of a machine in order."""
    return samples(loaded, 60, seconds=seconds)


def flipped(loaded):
    """The machine file with the foot of its first cylinder on the other side of the pin."""
    machine = loaded.service.machine
    first, *others = machine.cylinders
    body, at = first.linkage.foot
    first = replace(first, linkage=replace(first.linkage, foot=(body, at.conjugate())))
    return loaded._replace(service=loaded.service._replace(machine=replace(machine, cylinders=(first, *others))))


class Written(NamedTuple):
    """The machine, its recording, the identified file, and the identification."""

    loaded: Loaded
    table: Path
    output: Path
    found: Identification


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """What is written of a machine file with a flipped pin."""
    folder = tmp_path_factory.mktemp("flipped")
    table, output = folder / "moves.parquet", folder / "identified.toml"
    values, wrong = recording(FEW), flipped(FEW)
    write_table(table, Table(np.arange(len(values)) * 0.01, values, tuple(FEW_SIGNALS)))
    return Written(wrong, table, output, run_identify(wrong, [table], output, How(refuse=False)))


@pytest.fixture(scope="module")
def in_order():
    """What is found of a machine in order."""
    return identify(MODEL, [recording()])


def test_a_machine_in_order_is_explained(in_order):
    assert np.all(in_order.explained > 0.999)
    assert in_order.warnings == ()


def test_the_share_explained_is_one_less_the_part_of_the_variance_that_is_left(in_order):
    """The same by hand, from the rows themselves."""
    found = in_order
    model, seen = found.model, observe(found.model, recording())
    torque = np.where(seen.certain, seen.torque, np.nan)
    left = torque - seen.columns @ found.tares.values
    by_hand = 1.0 - np.nanmean(left**2, axis=0) / np.nanvar(torque, axis=0)
    fitted = chosen(observed_factors(model, [recording()]), list(range(len(model.parameters))))
    assert explained(model, fitted, found.tares.values) == pytest.approx(by_hand, abs=1e-6)
    nothing = explained(model, fitted, np.zeros_like(found.tares.values))
    assert nothing == pytest.approx(1.0 - np.nanmean(torque**2, axis=0) / np.nanvar(torque, axis=0), abs=1e-4)


def test_a_flipped_pin_is_refused_by_name_and_nothing_is_written(tmp_path):
    table, output = tmp_path / "moves.parquet", tmp_path / "identified.toml"
    write_table(table, Table(np.arange(len(recording())) * 0.01, recording(), tuple(SIGNALS)))
    with pytest.raises(ValueError, match=f"the measured torque of boom does not fit .*{UP_SIDE_DOWN.format('boom')}"):
        run_identify(flipped(LOADED), [table], output)
    assert not output.exists()


def test_a_pin_that_leaves_no_usable_posture_is_refused_by_name():
    machine = MODEL.machine
    boom, *others = machine.cylinders
    body, at = boom.linkage.foot
    boom = replace(boom, linkage=replace(boom.linkage, foot=(body, -at.conjugate())))
    wrong = replace(MODEL, machine=replace(machine, cylinders=(boom, *others)))
    with pytest.raises(ValueError, match=r"boom moved, but .*the sign of x in foot at_m of the boom cylinder"):
        identify(wrong, [recording()])


def test_written_all_the_same_the_warning_goes_with_the_parameters(written):
    found, output = written.found, written.output
    assert UP_SIDE_DOWN.format("stick") in found.warnings[0]
    assert identified_warnings(output) == found.warnings
    heard = []
    make_core(written.loaded, output, heard.append)
    assert heard == [f"{output}: {sentence}" for sentence in found.warnings]
    run_replay(written.loaded, written.table, output, heard.append)
    assert UP_SIDE_DOWN.format("stick") in heard[len(found.warnings)]


def test_the_terminal_shows_share_and_warning(written):
    out = StringIO()
    show(written.found, Console(file=out, width=1000))
    assert f"stick {100.0 * written.found.explained[0]:.2f} %" in out.getvalue()
    assert f"warning: {written.found.warnings[0]}" in out.getvalue()


def test_the_report_shows_the_joint_in_red(written, tmp_path):
    page = tmp_path / "report.html"
    write_report(page, written.found, [("moves", recording(FEW))], written.output)
    text = page.read_text()
    assert '<tr class="bad"><td>stick</td>' in text
    assert "<tr><td>bucket</td>" in text
    assert '<div class="card bad">' in text
    assert UP_SIDE_DOWN.format("stick") in text


def test_a_pressure_on_another_cylinder_is_named():
    first, second = "stick_head_pressure", "bucket_head_pressure"
    values = exchanged(recording(), [SIGNALS.index(first)], [SIGNALS.index(second)])
    found = identify(MODEL, [values], refuse=False)
    assert f"the recording fits with {first} exchanged with {second}" in found.warnings[0]


def test_a_wrong_bore_is_named():
    found = identify(with_bore(FEW_MODEL, 0, 1.2), [recording(FEW)], refuse=False)
    assert found.explained[0] < LITTLE
    assert "the recording fits with bore_mm of stick 1" in found.warnings[0]  # 17 % smaller
    assert "smaller" in found.warnings[0]


def test_an_angle_that_is_explained_by_impossible_masses_is_seen():
    """Half of a wrong zero is explained by other masses, which lie far from the data sheet."""
    values = recording().copy()
    values[:, SIGNALS.index("stick_angle")] += np.radians(20.0)
    fitted = chosen(observed_factors(MODEL, [values]), list(range(len(MODEL.parameters))))
    found = identify(MODEL, [values], refuse=False)
    best = chosen(fitted, [k for k, p in enumerate(MODEL.parameters) if p.name in found.tares.names])
    judged = quality(found.model, best, found.tares.values, found.tares.covariance)
    assert judged.distance > FAR
    assert any("far from the data sheet" in sentence for sentence in found.warnings)


def turned(loaded, name, factor, offset):
    values, model = recording(loaded).copy(), model_of(loaded)
    k = [s.name for s in model.machine.signals].index(name)
    values[:, k] = offset + factor * values[:, k]
    return model, values


def longer_stick():
    stick, *others = FEW_MODEL.machine.links
    links = (replace(stick, length=1.2 * stick.length), *others)
    return replace(FEW_MODEL, machine=replace(FEW_MODEL.machine, links=links)), recording(FEW)


def crossed():
    first, second = (SIGNALS.index(f"{name}_head_pressure") for name in ("boom", "bucket"))
    return MODEL, exchanged(recording(), [first], [second])


def other_sign():
    bucket = FEW_MODEL.machine.links[-1]
    return turned(FEW, "bucket_angle", -1.0, bucket.angle_low + bucket.angle_high)


def moved_zero():
    return turned(LOADED, "boom_angle", 1.0, np.radians(20.0))


FOUND_ELSEWHERE = (  # other tests find corrections of this kind, too
    (moved_zero, r"the zero of boom_angle moved by -(19|20|21) deg"),
    (crossed, "boom_head_pressure exchanged with bucket_head_pressure"),
)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (other_sign, "the other sign of bucket_angle"),
        (longer_stick, r"length_m of stick 1[67] % smaller"),
        *(pytest.param(*each, marks=pytest.mark.long) for each in FOUND_ELSEWHERE),
    ],
    ids=("sign of an angle", "length", "zero of an angle", "pressures of two cylinders"),
)
def test_what_looks_like_a_load_or_an_area_is_refused_by_its_own_name(wrong, words):
    """Each of them was once refused as a load in the bucket, as a wrong bore or as exchanged cylinders."""
    model, values = wrong()
    with pytest.raises(ValueError, match=f"(^|: )the recording fits with {words}[:;] check that first"):
        identify(model, [values])


def test_a_zero_of_an_angle_that_nearly_fits_is_noticed():
    """On a machine that shares no code with the estimator 98.6 % of the bucket's torque is explained all the same."""
    good = reference(0, seconds=60.0)
    values = [part.copy() for part in good.segments]
    for part in values:
        part[:, SIGNALS.index("bucket_angle")] += np.radians(20.0)
    warnings = identify(good.model, values).warnings
    assert "too little of the measured torque is explained: bucket 98" in warnings[0]
    assert "the recording fits with the zero of bucket_angle moved by -" in warnings[0]


def rival(score):
    return Repair("an angle", "another angle", score, Case(MODEL, recording()))


@pytest.mark.parametrize(
    ("better_by", "said"),
    [
        (2.0 * DECISIVE, "^the recording fits with another angle: check that first$"),
        (0.5 * DECISIVE, "^a bore; or the recording fits with another angle$"),
        (-0.5 * DECISIVE, "^a bore; or the recording fits with another angle$"),
        (-2.0 * DECISIVE, "^a bore$"),
    ],
)
def test_the_better_explanation_is_said_and_both_when_they_explain_alike(better_by, said):
    suspected, others = Suspicion("bore_mm of boom", "a bore"), (rival(-better_by),)
    assert re.search(said, suspicion.better_sentence(suspected, 0.0, others))


def test_what_is_in_order_needs_no_repair():
    assert repairs(Case(FEW_MODEL, recording(FEW)[-4000:]), (0,)) == ()
