"""`cylforce new`: a machine file from a data sheet passes, is commented, simulates, and says what is still a guess."""

import re
import shlex
import tomllib

import numpy as np
import pytest

from command_line import cylforce_
from cylforce.estimation.model import Model
from cylforce.mechanics.fitting import fitted, range_postures
from cylforce.mechanics.workspace import working_range
from cylforce.programs.new import GivenFigures, run_new, wanted
from cylforce.settings.error import SettingsError
from cylforce.settings.machine_file import load
from cylforce.settings.proposal.envelope import highest
from cylforce.settings.proposal.types import TYPES
from cylforce.simulation.scenario import cycles, moves
from cylforce.simulation.trajectory import follow

SIZES = (1.5, 8.0, 15.0, 50.0)
# An 8 t excavator with a single boom cylinder; strokes and closed lengths as on its parts list.
MIDI = {
    "name": "Midi 8 t",
    "boom.length_m": "3.62",
    "stick.length_m": "1.75",
    "bucket.length_m": "1.05",
    "boom.count": "1",
    "boom.bore_mm": "115",
    "boom.rod_mm": "65",
    "boom.stroke_mm": "885",
    "boom.closed_mm": "1340",
    "stick.bore_mm": "95",
    "stick.rod_mm": "60",
    "stick.stroke_mm": "900",
    "stick.closed_mm": "1330",
    "bucket.bore_mm": "85",
    "bucket.rod_mm": "55",
    "bucket.stroke_mm": "730",
    "bucket.closed_mm": "1130",
    "dig_depth_m": "4.1",
    "cut_height_m": "6.6",
    "pin_height_m": "1.25",
    "boom_pressure.node_id": "20",
}
LOADER = {
    "arm.length_m": "2.7",
    "lift.stroke_mm": "760",
    "lift.closed_mm": "1180",
    "tilt.stroke_mm": "680",
    "tilt.closed_mm": "1150",
    "hinge_height_m": "4.1",
    "pin_height_m": "2.05",
}

# A 12.5 t wheel loader whose tilt cylinder cannot cover the typical -46:48 deg of the bucket.
TIGHT = {
    "arm.length_m": "2.35",
    "hinge_height_m": "3.75",
    "lift.stroke_mm": "720",
    "tilt.bore_mm": "130",
    "tilt.rod_mm": "75",
    "tilt.stroke_mm": "540",
}


def made(folder, kind, tonnes, values=None):
    path = folder / f"{kind}{tonnes:g}.toml"
    run_new(GivenFigures(kind, str(tonnes), [f"{k}={v}" for k, v in (values or {}).items()], True), path)
    return path


@pytest.fixture(scope="module")
def midi(tmp_path_factory):
    return made(tmp_path_factory.mktemp("new"), "excavator", 8.0, MIDI)


@pytest.mark.parametrize("tonnes", SIZES)
@pytest.mark.parametrize("kind", TYPES)
def test_typical_machines_pass_and_can_be_moved(tmp_path, capsys, kind, tonnes):
    """Every posture of simulated cycles and moves is within all strokes, away from dead points."""
    path = made(tmp_path, kind, tonnes)
    machine = load(path).service.machine
    assert f"{tonnes:g} t" in machine.name
    rng = np.random.default_rng(1)
    for scene in [*cycles(machine, rng, 1, swing=False), moves(machine, rng, 40.0)]:
        at = machine.geometry(follow(scene, np.arange(0.0, scene.duration, 0.1)).theta)
        for c, cylinder in enumerate(machine.cylinders):
            assert cylinder.length_low < at.length[:, c].min() < at.length[:, c].max() < cylinder.length_high
            assert at.transmission[:, c].min() > 0.25
    ranges = working_range(machine)
    assert np.all(ranges[:, 1] - ranges[:, 0] > np.radians(50.0))
    out = capsys.readouterr().out
    assert "Next: cylforce describe" in out
    assert "warning" not in out
    assert load(path).warnings == ()


def test_what_is_given_stands_in_the_file_and_what_is_not_is_marked(midi):
    text = midi.read_text()
    raw = tomllib.loads(text)
    boom = raw["cylinders"][0]
    assert (boom["count"], boom["bore_mm"], boom["rod_mm"], boom["length_range_m"]) == (1, 115, 65, [1.34, 2.225])
    assert [link.get("length_m") for link in raw["links"]] == [3.62, 1.75, None]
    assert raw["tool"]["point_m"][0] == 1.05
    assert raw["nodes"][0]["node_id"] == 20
    assert all(
        "identity" not in node for node in raw["nodes"]
    )  # a serial number that the sensor has not stops the start
    lines = text.splitlines()
    assert next(line for line in lines if line.startswith("bore_mm = 115")).endswith("# data sheet")
    pins = [line for line in lines if "at_m = " in line]
    assert len(pins) == 7
    assert all(line.endswith("# MEASURE THIS") for line in pins)
    assert all("typical" in line for line in lines if line.startswith("mass_kg"))


def test_a_guess_has_a_larger_tolerance_than_a_figure(midi):
    raw = tomllib.loads(midi.read_text())
    boom = raw["cylinders"][0]["tolerance"]
    assert boom == {"bore_mm": 0.1, "pins_m": 0.0147}  # 20 mm times the cube root of 8/20
    assert raw["links"][0]["tolerance"]["mass_percent"] == 30
    guessed = tomllib.loads(made(midi.parent, "excavator", 20.0).read_text())
    assert guessed["cylinders"][0]["tolerance"] == {"bore_mm": 6, "pins_m": 0.02}


def test_unmeasured_pins_leave_the_scale_too_uncertain_to_book(midi):
    """Both pins 14.7 mm (half-width), lever about 0.5 m: sqrt(2) * 14.7 / sqrt(3) / 500 = 2.4 %, above the 1 % that a
    booked weight may have."""
    service = load(midi).service
    error = Model(service.machine, service.filters, service.effects).scale_error
    assert error == pytest.approx(0.024, rel=0.1)


@pytest.mark.parametrize(("kind", "tonnes", "values"), [("excavator", 8.0, MIDI), ("wheel_loader", 18.0, LOADER)])
def test_each_cylinder_has_the_stroke_of_the_data_sheet_and_it_covers_the_angle_range(tmp_path, kind, tonnes, values):
    machine = load(made(tmp_path, kind, tonnes, values)).service.machine
    for c, cylinder in enumerate(machine.cylinders):
        closed, stroke = (float(values[f"{cylinder.name}.{key}_mm"]) / 1e3 for key in ("closed", "stroke"))
        assert (cylinder.length_low, cylinder.length_high) == pytest.approx((closed, closed + stroke))
        length = machine.geometry(range_postures(machine, c)).length[:, c]
        assert length.min() - closed == pytest.approx(0.01 * stroke, abs=0.002)
        assert closed + stroke - length.max() == pytest.approx(0.01 * stroke, abs=0.003)


def test_the_boom_range_follows_from_the_working_envelope(midi):
    """Stick and teeth straight down: depth = l sin(angle) + 1.75 + 1.05 - 1.25."""
    machine = load(midi).service.machine
    boom, stick, bucket = machine.links
    assert 3.62 * np.sin(-boom.angle_low) + 1.75 + 1.05 - 1.25 == pytest.approx(4.1, abs=0.01)
    best = max(
        1.75 * np.sin(boom.angle_high + a) + 1.05 * np.sin(boom.angle_high + a + b)
        for a in np.linspace(stick.angle_low, stick.angle_high, 50)
        for b in np.linspace(bucket.angle_low, bucket.angle_high, 50)
    )
    assert 1.25 + 3.62 * np.sin(boom.angle_high) + best == pytest.approx(6.6, abs=0.01)


def test_highest_is_the_sum_of_links_pointing_up():
    assert highest(90.0, [2.0, 1.0], [(0.0, 1.0), (-90.0, 0.0)]) == pytest.approx(3.0)
    assert highest(0.0, [2.0, 1.0], [(0.0, 1.0), (-90.0, 30.0)]) == pytest.approx(0.5, abs=1e-3)


def test_a_loaders_arm_range_follows_from_its_hinge_height(tmp_path):
    machine = load(made(tmp_path, "wheel_loader", 18.0, LOADER)).service.machine
    assert 2.05 + 2.7 * np.sin(machine.links[0].angle_high) == pytest.approx(4.1, abs=0.01)


def test_a_typical_range_that_a_cylinder_cannot_cover_is_narrowed_and_a_given_one_refused(tmp_path, capsys):
    path = made(tmp_path, "wheel_loader", 12.5, TIGHT)
    said = capsys.readouterr().out
    low, high = (float(t) for t in re.search(r"bucket.angle_range_deg: .* narrowed to (\S+):(\S+):", said).groups())
    assert -46.0 < low < -36.0
    assert 38.0 < high <= 48.0
    arm, bucket = (link["angle_range_deg"] for link in tomllib.loads(path.read_text())["links"])
    assert bucket == pytest.approx([low - arm[1], high - arm[0]])  # the cylinder stands on the chassis
    assert "narrowed to what its cylinder can cover; MEASURE THIS" in path.read_text()
    path.unlink()
    refused = r"bucket.angle_range_deg is -46:48, .* near a dead point .* widest range that fits is about (\S+)$"
    with pytest.raises(ValueError, match=refused) as error:
        made(tmp_path, "wheel_loader", 12.5, TIGHT | {"bucket.angle_range_deg": "-46:48"})
    fits = re.search(refused, str(error.value)).group(1)
    made(tmp_path, "wheel_loader", 12.5, TIGHT | {"bucket.angle_range_deg": fits})
    assert "narrowed" not in capsys.readouterr().out


def test_heights_of_a_loaders_hinge_give_the_arms_range_or_agree_with_it(tmp_path, capsys):
    """asin((0.35 - 1.85) / 2.5) = -36.9 deg, asin((3.85 - 1.85) / 2.5) = 53.1 deg."""
    heights = {"arm.length_m": "2.5", "hinge_low_m": "0.35", "hinge_height_m": "3.85"}
    raw = tomllib.loads(made(tmp_path, "wheel_loader", 13.0, heights | {"pin_height_m": "1.85"}).read_text())
    assert raw["links"][0]["angle_range_deg"] == [-36.9, 53.1]
    assert cylforce_("describe", tmp_path / "wheel_loader13.toml") == 0
    assert "the bucket's pin comes from -1.50 m to 2.00 m, counted upwards" in capsys.readouterr().out
    given = heights | {"arm.angle_range_deg": "-36.9:53.1"}
    raw = tomllib.loads(made(tmp_path, "wheel_loader", 13.1, given).read_text())
    assert raw["links"][0]["angle_range_deg"] == [-36.9, 53.1]
    with pytest.raises(ValueError, match=r"hinge_height_m is 3.6, but the arm's end is at 3.85 m"):
        made(tmp_path, "wheel_loader", 13.2, given | {"hinge_height_m": "3.6"})
    with pytest.raises(ValueError, match=r"hinge_low_m is 0.35, but the arm's end is at 0.60 m .* its pin at 2.10 m"):
        made(tmp_path, "wheel_loader", 13.3, given | {"pin_height_m": "2.1"})
    with pytest.raises(ValueError, match=r"hinge_height_m is 6, an arm of 2.5 m with its pin at 1.85 m reaches -0.61 "):
        made(tmp_path, "wheel_loader", 13.4, heights | {"pin_height_m": "1.85", "hinge_height_m": "6"})


def test_fitted_numbers_are_the_nearest():
    """Of all (x, y, z) with x + y = 3 and z = 1, (1, 2, 1) is nearest to (0, 1, 0); where y moves half as easily, the
    step is as 1 to 1/4."""
    near = fitted(np.array([0.0, 1.0, 0.0]), np.ones(3), lambda x: (x[0] + x[1], x[2]), (3.0, 1.0))
    assert near == pytest.approx([1.0, 2.0, 1.0], abs=1e-4)
    eased = fitted(np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.5, 1.0]), lambda x: (x[0] + x[1], x[2]), (3.0, 1.0))
    assert eased == pytest.approx([1.6, 1.4, 1.0], abs=1e-4)
    with pytest.raises(ValueError, match="no pins near"):
        fitted(np.zeros(2), np.ones(2), lambda x: (float(np.sin(x[0])), x[1]), (2.0, 1.0))


def answers(*given):
    """Someone who answers questions in turn; afterwards only presses Enter."""
    left = list(given)
    asked = []

    def ask(question):
        asked.append(question)
        return left.pop(0) if left else ""

    return ask, asked


def test_it_asks_for_what_is_not_given(tmp_path, capsys):
    ask, asked = answers("tractor", "wheel_loader", "12", "My loader", "4000 kg", "4000")
    path = tmp_path / "m.toml"
    run_new(GivenFigures(None, None, ["arm.length_m=2.5"], False), path, ask)
    raw = tomllib.loads(path.read_text())
    assert raw["machine"]["name"] == "My loader"
    assert raw["machine"]["rated_payload_kg"] == 4000
    assert raw["links"][0]["length_m"] == 2.5
    assert not any("arm: length" in question for question in asked)
    assert "rated payload [kg] [3600]: " in asked
    out = capsys.readouterr().out
    assert "'tractor' is none of them" in out
    assert "rated_payload_kg is '4000 kg': write a number" in out
    assert "3 figures from the data sheet" in out


def test_enter_is_an_excavator_and_node_ids_are_asked_for_when_wanted(tmp_path):
    ask, asked = answers("", "8")
    run_new(GivenFigures(None, None, [], False), tmp_path / "a.toml", ask)
    assert [len(tomllib.loads((tmp_path / "a.toml").read_text())[part]) for part in ("links", "cylinders")] == [3, 3]
    assert asked[-1].startswith("ask for ")
    assert not any("node id [" in question for question in asked)
    ask, asked = answers("", "8", *[""] * (len(asked) - 3), "yes", "21")
    run_new(GivenFigures(None, None, [], False), tmp_path / "b.toml", ask)
    assert "node id [" in asked[-1]
    assert tomllib.loads((tmp_path / "b.toml").read_text())["nodes"][0]["node_id"] == 21


def test_refused_answers_come_back_as_one_command(tmp_path, capsys):
    ask, _ = answers("big", "8000", "8", "Midi 8 t", *[""] * 5, "-200:20")
    path = tmp_path / "m.toml"
    with pytest.raises(ValueError, match=r"stick.angle_range_deg is -200:20, .* levers"):
        run_new(GivenFigures("excavator", None, ["boom.length_m=3.62"], False), path, ask)
    assert not path.exists()
    out = capsys.readouterr().out
    assert "--tonnes is 'big': write the operating mass in tonnes" in out
    assert "--tonnes is 8000, it must be 0.8 to 100" in out
    again = shlex.split(out.splitlines()[-1])
    assert again[:2] == ["cylforce", "new"]
    assert "name=Midi 8 t" in again
    right = [word.replace("-200:20", "-150:-35") for word in again[2:]]
    assert right != again[2:]
    assert cylforce_("new", *right) == 0
    assert tomllib.loads(path.read_text())["links"][0]["length_m"] == 3.62


def test_when_the_input_ends_it_says_so_and_writes_nothing(tmp_path):
    def ask(question):
        raise EOFError

    with pytest.raises(SettingsError, match=r"--set name was asked for and the input ended: .* --yes"):
        run_new(GivenFigures("excavator", "8", [], False), tmp_path / "m.toml", ask)
    assert list(tmp_path.iterdir()) == []


REFUSED = [
    ("--type tractor --tonnes 8", "--type is 'tractor', which is no type of machine: write one of excavator, "),
    ("--tonnes 8", "--type is missing: write one of"),
    ("--type excavator", "--tonnes is missing: give the operating mass"),
    ("--type excavator --tonnes eight", "--tonnes is 'eight': write the operating mass in tonnes, a number"),
    ("--type excavator --tonnes 8000", "--tonnes is 8000, it must be 0.8 to 100: give"),
    ("--type excavator --tonnes nan", "--tonnes is nan, it"),
    (
        "--set boom.lenght_m=3.6",
        "--set boom.lenght_m: is no figure of this type of machine: did you mean boom.length_m",
    ),
    ("--type excavator --tonnes 1_2", "--tonnes is '1_2': write the operating mass in tonnes, a number"),
    ("--set =3", "--set =3: has no key: write KEY=VALUE"),
    ("--set boom.bore_mm=1_15", "boom.bore_mm is '1_15': write a number"),
    ("--set boom.length_m", "--set boom.length_m: has no value: write KEY=VALUE"),
    (
        "--set boom.length_m=3620",
        "boom.length_m is 3620, machines of this type and size have 1.68 to 10.5: check the unit",
    ),
    ("--set boom.length_m=nan", "boom.length_m is nan"),
    ("--set boom.count=two", "boom.count is 'two': write a whole number"),
    ("--set boom.count=1 --set boom.count=2", "--set boom.count: is given twice"),
    ("--set stick.angle_range_deg=-35:-150", "stick.angle_range_deg is -35:-150, it must rise"),
    ("--set stick.angle_range_deg=-35", "stick.angle_range_deg is '-35': write a range LOW:HIGH"),
    ("--set boom.rod_mm=120", "boom.rod_mm is 120, its bore 90: a rod is thinner; exchange or correct them"),
    ("--set boom.stroke_mm=1500 --set boom.closed_mm=1400", "boom.closed_mm is 1400, its stroke 1500: .* correct one"),
    (
        "--set bucket.stroke_mm=1900 --set bucket.closed_mm=3000",
        "bucket.stroke_mm and bucket.closed_mm require lengths of",
    ),
    ("--set stick.angle_range_deg=-200:20", "stick.angle_range_deg is -200:20, and the stick cylinder"),
    ("--set dig_depth_m=12", "dig_depth_m is 12, which links of these lengths do not reach"),
    ("--set cut_height_m=25", "cut_height_m is 25, links of these lengths and ranges reach"),
    ("--set boom_pressure.node_id=34", "stick_pressure.node_id is 34, which is also boom_pressure.node_id"),
    ("--set boom_pressure.node_id=64", "also that of cylforce's own node"),
    ("--set boom_pressure.node_id=0", "boom_pressure.node_id is 0"),
]


@pytest.mark.parametrize(("words", "said"), REFUSED, ids=[words for words, _ in REFUSED])
def test_refusals_name_option_value_limit_and_cure(tmp_path, capsys, words, said):
    base = [] if "--type" in words or words.startswith("--tonnes") else ["--type", "excavator", "--tonnes", "8"]
    assert cylforce_("new", "-o", tmp_path / "m.toml", "--yes", *base, *words.split()) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert re.search(said.replace("(", r"\("), error), error
    assert list(tmp_path.iterdir()) == []


def test_a_name_is_one_line(tmp_path):
    with pytest.raises(ValueError, match=r"name is 'two.nlines': write one line"):
        made(tmp_path, "excavator", 8.0, {"name": "two\nlines"})


def test_a_file_is_never_replaced(tmp_path, capsys):
    path = tmp_path / "m.toml"
    path.write_text("mine")
    assert cylforce_("new", "-o", path, "--yes", "--type", "excavator", "--tonnes", "8") == 2
    assert "m.toml: exists and is not replaced: choose another file with -o" in capsys.readouterr().err
    assert path.read_text() == "mine"
    assert cylforce_("new", "-o", tmp_path / "m.txt", "--yes", "--type", "excavator", "--tonnes", "8") == 2
    assert "must end in .toml" in capsys.readouterr().err
    assert cylforce_("new", "-o", tmp_path / "absent" / "m.toml", "--yes", "--type", "excavator", "--tonnes", "8") == 2
    assert "cannot be written" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [path]


def test_the_list_has_every_figure_with_its_limits(tmp_path, capsys):
    assert cylforce_("new", "--list", "--type", "wheel_loader", "--tonnes", "18") == 0
    out = capsys.readouterr().out
    for key in wanted("wheel_loader", 18.0):
        assert key in out
    assert cylforce_("new", "--list") == 2
    assert "--list needs --type" in capsys.readouterr().err


@pytest.mark.parametrize(("kind", "tonnes", "values"), [("excavator", 8.0, MIDI), ("wheel_loader", 18.0, LOADER)])
def test_a_proposed_machine_weighs_once_its_pins_are_measured(tmp_path, capsys, kind, tonnes, values):
    """From the data sheet to booked weights: the commands of an integrator's first hour, on the simulated machine."""
    path = made(tmp_path, kind, tonnes, _measured(kind, tonnes) | values | {"pins_mm": "2"})
    log, run, truth, tares = (tmp_path / name for name in ("moves.log", "run.log", "truth.csv", "identified.toml"))
    assert cylforce_("sim", path, "--scenario", "moves", "--seed", 5, "--log", log) == 0
    assert cylforce_("identify", path, log, "-o", tares, "--no-statistics") == 0
    assert cylforce_("sim", path, "--cycles", 3, "--seed", 5, "--log", run, "--truth", truth) == 0
    capsys.readouterr()
    assert cylforce_("replay", path, run, "--identified", tares) == 0
    booked = [float(line.split()[3]) for line in capsys.readouterr().out.splitlines() if " booked " in line]
    rows = [line.split(",") for line in truth.read_text().splitlines()[1:]]
    cycle, mass = (np.array([float(row[rows[0].index(name)]) for row in rows[1:]]) for name in ("cycle", "mass"))
    true = [mass[cycle == k].max() for k in (1, 2, 3)]
    assert booked == pytest.approx(true, rel=0.02)


def _measured(kind, tonnes):
    """All bores as given figures, so that only what is measured remains uncertain."""
    return {k: f"{f.typical:g}" for k, f in wanted(kind, tonnes).items() if k.endswith(("bore_mm", "rod_mm"))}
