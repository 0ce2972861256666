"""A recommended motion as a table: what is written is played; what cannot be played is refused by its line."""

import numpy as np
import pytest

from cylforce.files.atomic import RecordingError
from cylforce.files.motion_table import read_motion, write_motion
from cylforce.files.tables import read_table
from cylforce.mechanics.workspace import driven
from cylforce.programs.experiments.catalogue import catalogue, checkup
from cylforce.programs.experiments.motions import read_scene, table_of
from cylforce.programs.sim import run_sim
from cylforce.settings.machine_file import load
from cylforce.simulation.trajectory import follow
from scenarios import CONFIG

MACHINE_FILE = CONFIG / "excavator_20t.toml"
MACHINE = load(MACHINE_FILE).service.machine
NAMES = [link.name for link in MACHINE.links]


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "motion.csv"
    write_motion(path, table_of(checkup(MACHINE)[1]), NAMES)
    return path


def test_every_motion_of_the_catalogue_is_played_as_it_was_written(tmp_path):
    path, t = tmp_path / "motion.csv", np.arange(0.0, 59.9, 0.03)
    for motion in catalogue(MACHINE, driven(MACHINE)[:1]):
        write_motion(path, table_of(motion), NAMES)
        wanted, played = follow(motion.scene, t), follow(read_scene(path, MACHINE, motion.load_kg), t)
        assert np.max(np.abs(wanted.theta - played.theta)) < 1e-3, motion.words
        assert np.max(np.abs(wanted.thetad - played.thetad)) < 2e-2, motion.words
        assert np.max(np.abs(wanted.turn - played.turn)) < 1e-3


def test_the_conditions_of_a_motion_stand_above_its_table(tmp_path):
    path = tmp_path / "motion.csv"
    motion = next(m for m in catalogue(MACHINE, ()) if m.load_kg)
    write_motion(path, table_of(motion), NAMES)
    comments = [line for line in path.read_text().splitlines() if line.startswith("#")]
    assert motion.words in comments[0]
    assert any(f"{motion.load_kg:.0f} kg" in line for line in comments)
    assert any("level ground" in line for line in comments)
    assert any("temperature" in line for line in comments)


def test_the_columns_may_be_in_any_order(written):
    """The first column was taken as the time, whatever its name."""
    table = read_motion(written, NAMES)
    lines = written.read_text().splitlines()
    turned = [line if line.startswith("#") else ",".join(reversed(line.split(","))) for line in lines]
    written.write_text("\n".join(turned))
    again = read_motion(written, NAMES)
    for one, other in ((table.t_s, again.t_s), (table.angles, again.angles), (table.slew, again.slew)):
        np.testing.assert_array_equal(one, other)


def test_the_simulated_machine_plays_a_table(written, tmp_path):
    table = tmp_path / "played.csv"
    run_sim(MACHINE_FILE, motion=written, seed=1, table=table)
    read = read_table(table, [s.name for s in MACHINE.signals if s.name.endswith("_angle")])
    course = follow(checkup(MACHINE)[1].scene, read.t_s)
    assert read.t_s[-1] == pytest.approx(150.0, abs=0.1)
    assert np.max(np.abs(read.values[:, 1] - course.theta[:, 1])) < 0.02


def spoilt(path, change):
    lines = path.read_text().splitlines()
    header = next(k for k, line in enumerate(lines) if line.startswith("t_s"))
    change(lines, header)
    path.write_text("\n".join(lines))
    return path


def replaced(lines, k, column, text):
    cells = lines[k].split(",")
    cells[column] = text
    lines[k] = ",".join(cells)


@pytest.mark.parametrize(
    ("change", "row", "words"),
    [
        (lambda lines, h: replaced(lines, h + 10, 0, "0.1"), 10, "time must increase"),
        (lambda lines, h: replaced(lines, h, 1, "jib_rad"), 0, "'jib_rad' is no joint of this machine"),
        (lambda lines, h: replaced(lines, h + 10, 2, "3.3"), 10, "stick at 3.300 rad is outside of its range"),
        (lambda lines, h: replaced(lines, h + 10, 0, "0.4501"), 10, "faster than 1 m/s: give the motion more time"),
        (lambda lines, h: replaced(lines, h + 10, 2, "far"), 10, "'far' in column 'stick_rad' is no number"),
        (lambda lines, h: replaced(lines, h + 10, 2, "1,2"), 10, "has 6 cells, the header 5"),
    ],
)
def test_a_table_that_cannot_be_played_is_refused_with_line_and_cure(written, change, row, words):
    if "more time" in words:  # only where something moves
        lines = written.read_text().splitlines()
        header = next(k for k, line in enumerate(lines) if line.startswith("t_s"))
        angles = np.array([[float(x) for x in line.split(",")] for line in lines[header + 1 :]])
        row = int(np.argmax(np.max(np.abs(np.diff(angles[:, 1:4], axis=0)), axis=1))) + 2
        before = angles[row - 2, 0]
        change = lambda lines, h: replaced(lines, h + row, 0, f"{before + 1e-4:.5f}")  # noqa: E731
    path = spoilt(written, change)
    line = next(k for k, text in enumerate(path.read_text().splitlines(), 1) if text.startswith("t_s")) + row
    with pytest.raises(RecordingError, match=f"{path}:{line}: .*{words}"):
        read_scene(path, MACHINE)


def test_a_motion_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"nothing\.csv: cannot be read"):
        read_scene(tmp_path / "nothing.csv", MACHINE)
