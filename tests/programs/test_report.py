"""The report of an identification: every section, for both shipped machines; one file that loads nothing; refusals
as `cylforce identify` makes them, with nothing half-written."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cylforce.commissioning.identification import identify
from cylforce.estimation.model import Model
from cylforce.files.atomic import RecordingError
from cylforce.files.logfile import file_sha256
from cylforce.files.tables import Table, read_table, write_table
from cylforce.programs.cli import app
from cylforce.programs.common.progress import progress_bar, watched
from cylforce.programs.common.readings import model_of, named_segments
from cylforce.programs.identify import run_identify
from cylforce.programs.reports import evidence as evidences
from cylforce.programs.reports import report
from cylforce.programs.reports.evidence import evidence, friction, push
from cylforce.programs.reports.findings import findings
from cylforce.programs.sim import run_sim
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.trajectory import JointCourse
from pages import Page, check_one_file
from scenarios import EXCAVATOR, truth_of
from scenarios import moved as empty_moves

CONFIG = Path(__file__).resolve().parents[2] / "config"
MACHINES = sorted(CONFIG.glob("excavator*.toml"))
SECTIONS = ("next", "torques", "residuals", "coverage", "weighing", "parameters", "laws", "undetermined", "provenance")
FIGURES = ("torques", "residuals", "coverage", "weighing", "parameters", "laws")


def moved(folder, machine):
    """A recording of empty moves."""
    path = folder / f"{machine.stem}.csv"
    run_sim(machine, scenario="moves", duration=40.0, seed=3, table=path)
    return path


def moved_without_the_boom(path, loaded):
    """A recording of empty moves of all joints but the first."""
    service = loaded.service
    every = moves(service.machine, np.random.default_rng(3), 80.0)
    scene = every._replace(joints=(JointCourse(every.joints[0].begin), *every.joints[1:]))
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng(4)
    (record,) = run(service.machine, truth_of(loaded), made, [scene], dt=1.0 / service.filters.rate_hz, rng=rng)
    write_table(path, Table(record.t, record.values, tuple(s.name for s in service.machine.signals)))
    return path


@pytest.fixture(scope="module", params=MACHINES, ids=lambda path: path.stem)
def made(request, tmp_path_factory):
    """(machine file, recording, identified.toml, report) as the command line makes them."""
    folder = tmp_path_factory.mktemp("report")
    recording, identified, html = moved(folder, request.param), folder / "identified.toml", folder / "report.html"
    command = ["identify", request.param, recording, "-o", identified, "--report", html, "--no-statistics"]
    done = CliRunner().invoke(app, list(map(str, command)))
    assert done.exit_code == 0, done.output
    return request.param, recording, identified, html


def test_every_section_is_there_with_its_figure(made):
    page = Page(made[-1].read_text(encoding="utf-8"))
    assert tuple(page.sections) == SECTIONS
    assert page.figures == set(FIGURES)
    assert all(page.text[name].strip() for name in SECTIONS)


def test_it_is_one_file_that_loads_nothing(made):
    check_one_file(made[-1].read_text(encoding="utf-8"))


def test_it_says_where_it_comes_from(made):
    machine, recording, identified, html = made
    said = Page(html.read_text(encoding="utf-8")).text["provenance"]
    assert load(machine).service.machine.name in said
    assert recording.name in said
    for path in (machine, recording, identified):
        assert file_sha256(path) in said


def test_it_says_what_was_found(made, tmp_path):
    """The same numbers as the identification's: parameters, rows, what is not told, with its cure."""
    machine, recording, _, html = made
    loaded = load(machine)
    found = run_identify(loaded, [recording], tmp_path / "identified.toml")
    text = Page(html.read_text(encoding="utf-8")).text
    for name, value in zip(found.tares.names, found.tares.values, strict=True):
        assert name in text["parameters"]
        assert f"{value:.5g}" in text["parameters"]
    for error in found.tares.row_error:
        assert f"{error:.0f} N m" in text["torques"]
    for name in found.not_identified:
        assert name in text["undetermined"]
    for law in found.held_out:
        assert law.replace("_", " ") in text["laws"]


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """(loaded, identification, evidence) of an excavator whose boom never moved."""
    folder, machine = tmp_path_factory.mktemp("still"), CONFIG / "excavator_20t.toml"
    loaded = load(machine)
    recording = moved_without_the_boom(folder / "still.csv", loaded)
    found = run_identify(loaded, [recording], folder / "identified.toml")
    return loaded, found, evidence(found.model, found.tares, named_segments(loaded, [recording]))


def test_a_joint_that_never_moved_is_named_with_its_cure(still):
    _, found, shown = still
    told = findings(found, shown)
    lost = {u.name: u for u in told.undetermined}
    assert {"boom.X", "boom.coulomb"} <= lost.keys()
    assert lost["boom.coulomb"].cure == "move the boom cylinder slowly, both ways"
    assert told.undetermined[0].name == "boom.coulomb"  # the costliest first
    assert any("boom.coulomb" in line for step in told.steps for line in step.details)
    assert any(gap.startswith("boom from") and "extending (0.0 of 6.0 s)" in gap for gap in told.gaps)
    assert not told.cards[0].good
    assert next(row for row in told.rows if row.joint == "boom").largest == 0.0
    assert np.all(shown.seconds[0] == 0.0)


def test_evidence_is_what_the_model_predicts(still):
    """Thinned points: residuals as large as the fit says, rows at rest left out, friction on the law."""
    _, found, shown = still
    left = shown.points.measured - shown.points.predicted
    assert np.all(np.isnan(left[:, 0]))
    np.testing.assert_allclose(np.sqrt(np.nanmean(left[:, 1:] ** 2, axis=0)), found.tares.row_error[1:], rtol=0.2)
    assert 0 < len(left) <= evidences.MOST_POINTS
    force = push(found.model, shown.points, 1, 1)
    good = np.isfinite(force)
    np.testing.assert_allclose((force * shown.points.lever[:, 1])[good], left[good, 1])
    k = found.tares.names.index("stick.coulomb")
    dry = Model(found.model.machine, found.model.filters, ("coulomb",))
    law, error = friction(dry, found.tares, 1, np.array([-0.1, 0.0, 0.1]), np.zeros(3))
    np.testing.assert_allclose(law, found.tares.values[k] * np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose(error[[0, 2]], np.sqrt(found.tares.covariance[k, k]))


def test_long_recordings_are_thinned_evenly(made):
    machine, recording, *_ = made
    loaded = load(machine)
    model = model_of(loaded)
    names = [signal.name for signal in loaded.service.machine.signals]
    values = read_table(recording, names).values
    many = evidences.MOST_POINTS // len(values) + 2
    shown = evidence(model, model.data_sheet, [("once", values), *[("again", values)] * (many - 1)])
    assert evidences.MOST_POINTS / 2 <= len(shown.points.speed) <= evidences.MOST_POINTS
    alone = evidence(model, model.data_sheet, [("once", values)])
    np.testing.assert_allclose(shown.seconds, many * alone.seconds)
    assert shown.stretch.recording == "once"


def refused(machine, recording, folder):
    command = ["identify", machine, recording, "-o", folder / "i.toml", "--report", folder / "r.html"]
    done = CliRunner().invoke(app, list(map(str, command)))
    assert done.exit_code != 0
    assert sorted(path.name for path in folder.iterdir()) == []
    return str(done.exception)


def test_it_refuses_as_identify_does(tmp_path, made):
    """Too short a recording, a machine that stands still: the sentence of identify, and no file."""
    machine, recording, *_ = made
    names = [signal.name for signal in load(machine).service.machine.signals]
    table = read_table(recording, names)
    short, rest, folder = tmp_path / "short.csv", tmp_path / "rest.csv", tmp_path / "out"
    folder.mkdir()
    write_table(short, table._replace(t_s=table.t_s[:1500], values=table.values[:1500]))
    write_table(rest, table._replace(values=np.tile(table.values[0], (len(table.t_s), 1))))
    assert "move the empty machine for at least 20 s" in refused(machine, short, folder)
    assert "no cylinder moves" in refused(machine, rest, folder)


def test_without_the_extra_it_says_which_to_install(monkeypatch, tmp_path, made):
    monkeypatch.setattr(report, "find_spec", lambda name: None)
    folder = tmp_path / "out"
    folder.mkdir()
    assert "pip install 'cylforce[report]'" in refused(*made[:2], folder)
    with pytest.raises(RecordingError, match="matplotlib and jinja2"):
        report.check_extra()


def test_the_bar_knows_how_far_a_text_has_been_read(tmp_path):
    log, table, told = tmp_path / "a.log", tmp_path / "a.csv", []
    log.write_text(("x" * 63 + "\n") * 12_000)
    table.write_text("1\n")
    assert len(list(watched(log, range(12_000), lambda doing, share: told.append((doing, share))))) == 12_000
    assert told == [("reading a.log", k * 5000 / 12_000) for k in range(3)]
    assert list(watched(table, [1], lambda doing, share: told.append(share))) == [1]
    assert told[-1] is None
    with progress_bar() as watch:  # no terminal: nothing is drawn
        watch("reading", 0.5)
        watch("fitting", None)


def test_a_scale_is_called_known_only_after_a_lift():
    loaded = load(EXCAVATOR)
    found = identify(model_of(loaded), [empty_moves(loaded)])
    assert not found.scale_measured
    assert found._replace(tares=found.tares._replace(scale_error=0.001)).scale_measured
