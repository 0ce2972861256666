"""Forty machine files with one error each, as people make them: wrong units and signs, swapped pins and sides, counts,
ranges, misspelt, missing and double keys, files that are none. Each is refused or brings a warning that names the right
key and its line; none passes without a word."""

import re
from typing import NamedTuple

import pytest

from cylforce.programs.common.machine_file import load_machine
from cylforce.settings.machine_file import SettingsError, load
from reference_machine.machinefile import machine_file, two_link_file
from scenarios import CONFIG, EXCAVATOR

SHIPPED = EXCAVATOR.read_text()
REFUSED, WARNED = "refused", "warned"
LINKAGE = "[cylinders.linkage]"  # a fault of the geometry is at its linkage, the pins stand below


class Case(NamedTuple):
    """Edits (old, new) of the shipped file, the outcome, the key that must be named, and what its line holds."""

    edits: tuple[tuple[str, str], ...]
    outcome: str
    key: str
    line: str


def one(old, new, outcome, key, line=None):
    return Case(((old, new),), outcome, key, new if line is None else line)


def table(header):
    """A table of the shipped file, from its header to the next table of an array."""
    start = SHIPPED.index(header)
    return SHIPPED[start : SHIPPED.index("\n[[", start) + 1]


BOOM_FOOT = 'foot = { body = "chassis", at_m = [0.55, -0.62] }'
BOOM_EYE = 'eye = { body = "boom", at_m = [2.40, 0.70] }'
STICK_FOOT = 'foot = { body = "boom", at_m = [2.75, 1.00] }'
BUCKET_FOOT = 'foot = { body = "stick", at_m = [0.20, 0.70] }'
HEAD_KIND, ROD_KIND = 'kind = "head_pressure"\nat = "boom"', 'kind = "rod_pressure"\nat = "boom"'

CASES = {
    # units
    "mm for m": one("length_m = 5.7", "length_m = 5700", REFUSED, "links.boom.length_m"),
    "tool in mm": one("point_m = [1.5, 0.0]", "point_m = [1130, 0.0]", REFUSED, "tool.point_m"),
    "pin in mm": one("at_m = [2.40, 0.70]", "at_m = [2400, 700]", REFUSED, "cylinders.boom.linkage.eye.at_m"),
    "t for kg": one("mass_kg = 1700", "mass_kg = 1.7", REFUSED, "links.boom.mass_kg"),
    "half a kilogram": one("mass_kg = 1700", "mass_kg = 0.52", REFUSED, "links.boom.mass_kg"),
    "payload in t": one("rated_payload_kg = 1500", "rated_payload_kg = 1.5", REFUSED, "machine.rated_payload_kg"),
    "m for mm": one("bore_mm = 120", "bore_mm = 0.120", REFUSED, "cylinders.boom.bore_mm"),
    "radians": one(
        "angle_range_deg = [-40, 58]", "angle_range_deg = [-0.698, 1.012]", REFUSED, "links.boom.angle_range_deg"
    ),
    "bar as Pa": Case(
        (
            ("scale_bar = 0.02", "scale_pa = 0.02"),
            ("range_bar = [-5, 400]", "range_pa = [-5, 400]"),
            ("standard_error_bar = 0.1", "standard_error_pa = 0.1"),
        ),
        REFUSED,
        "sensors.boom_head_pressure.range_pa",
        "range_pa",
    ),
    "sensor in radians": Case(
        (("offset_deg = -180\nrange_deg = [-45, 63]", "offset_deg = -180\nrange_deg = [-0.785, 1.1]"),),
        REFUSED,
        "sensors.boom_angle.range_deg",
        "range_deg = [-0.785, 1.1]",
    ),
    "inertia about the pin": one("inertia_kg_m2 = 5200", "inertia_kg_m2 = 17940", WARNED, "links.boom.inertia_kg_m2"),
    "radii for diameters": one("rod_mm = 85", "rod_mm = 42.5", WARNED, "cylinders.boom.rod_mm"),
    # signs, pins, sides
    "flipped foot": one(BOOM_FOOT, BOOM_FOOT.replace("-0.62", "0.62"), REFUSED, "cylinders.boom.linkage", LINKAGE),
    "flipped eye": one(BOOM_EYE, BOOM_EYE.replace("2.40", "-2.40"), REFUSED, "cylinders.boom.linkage", LINKAGE),
    "flipped foot above": one(
        STICK_FOOT, STICK_FOOT.replace("1.00", "-1.00"), WARNED, "cylinders.stick.linkage", LINKAGE
    ),
    "x and z exchanged": one(
        BUCKET_FOOT, BUCKET_FOOT.replace("0.20, 0.70", "0.70, 0.20"), REFUSED, "cylinders.bucket.linkage", LINKAGE
    ),
    "pins exchanged": Case(
        (("[0.55, -0.62]", "[X]"), ("[2.40, 0.70]", "[0.55, -0.62]"), ("[X]", "[2.40, 0.70]")),
        WARNED,
        "cylinders.boom.linkage",
        LINKAGE,
    ),
    "other side": one('side = "left"', 'side = "right"', REFUSED, "cylinders.bucket.linkage", LINKAGE),
    "centre behind its pin": one("centre_m = [2.7, 0.45]", "centre_m = [-2.7, 0.45]", WARNED, "links.boom.centre_m"),
    "angles of the other sign": one(
        "angle_range_deg = [-150, -35]",
        "angle_range_deg = [35, 150]",
        REFUSED,
        "sensors.stick_angle.range_deg",
        "range_deg = [-155, -30]",
    ),
    "head and rod exchanged": Case(
        ((HEAD_KIND, "[X]"), (ROD_KIND, HEAD_KIND), ("[X]", ROD_KIND)),
        WARNED,
        "sensors.boom_head_pressure.kind",
        'kind = "rod_pressure"',
    ),
    "bore and rod exchanged": Case(
        (("bore_mm = 120\nrod_mm = 85", "bore_mm = 85\nrod_mm = 120"),),
        REFUSED,
        "cylinders.boom.rod_mm",
        "rod_mm = 120",
    ),
    "sensors of two cylinders exchanged": Case(
        (
            ('at = "boom"\nnode = "boom_angle"', '[X]\nnode = "boom_angle"'),
            ('at = "stick"\nnode = "stick_angle"', 'at = "boom"\nnode = "stick_angle"'),
            ("[X]", 'at = "stick"'),
        ),
        REFUSED,
        "sensors.boom_angle.range_deg",
        "range_deg = [-45, 63]",
    ),
    # counts, ranges
    "one boom cylinder of two": one("count = 2\n", "", WARNED, "cylinders.boom", "[[cylinders]]"),
    "no cylinder": one("count = 2", "count = 0", REFUSED, "cylinders.boom.count"),
    "other cylinder's stroke": one(
        "length_range_m = [1.75, 3.07]", "length_range_m = [2.35, 3.82]", REFUSED, "cylinders.boom.linkage", LINKAGE
    ),
    "stroke as length": one(
        "length_range_m = [1.75, 3.07]", "length_range_m = [0.0, 1.32]", REFUSED, "cylinders.boom.length_range_m"
    ),
    "angles out of reach": one(
        "angle_range_deg = [-138, 24]", "angle_range_deg = [-170, 60]", REFUSED, "cylinders.bucket.linkage", LINKAGE
    ),
    "falling range": one(
        "angle_range_deg = [-40, 58]", "angle_range_deg = [58, -40]", REFUSED, "links.boom.angle_range_deg"
    ),
    "no length": one("length_m = 5.7", "length_m = 0", REFUSED, "links.boom.length_m"),
    "negative mass": one("mass_kg = 900", "mass_kg = -900", REFUSED, "links.stick.mass_kg"),
    "tolerance of 1000 %": one(
        "mass_percent = 10", "mass_percent = 1000", REFUSED, "links.boom.tolerance.mass_percent"
    ),
    "rate 0": one("rate_hz = 100", "rate_hz = 0", REFUSED, "filter.rate_hz"),
    # keys and values
    "unknown key": one("mass_kg = 1700", "mass_kg = 1700\ncolour = 3", REFUSED, "links.boom.colour", "colour = 3"),
    "missing key": one("mass_kg = 1700\n", "", REFUSED, "links.boom", "[[links]]"),
    "misspelt key": one("mass_kg = 1700", "mas_kg = 1700", REFUSED, "links.boom.mas_kg"),
    "NaN": one("bore_mm = 120", "bore_mm = nan", REFUSED, "cylinders.boom.bore_mm"),
    "infinite": one("[1.05, 0.15]", "[1.05, inf]", REFUSED, "links.stick.centre_m"),
    "text for a number": one("mass_kg = 900", 'mass_kg = "900 kg"', REFUSED, "links.stick.mass_kg"),
    # bus
    "node-ID twice": one("node_id = 34", "node_id = 33", REFUSED, "nodes.stick_pressure.node_id"),
    "PDO too long": Case(
        (
            (
                'object = "6020h"\ntype = "i16"',
                'object = "6020h"\ntype = "f32"\nskip_after = [{ object = "6021h", type = "u32" }]',
            ),
        ),
        REFUSED,
        "sensors.roll.pdo",
        "[[sensors]]",
    ),
    "unknown place": one(
        'at = "boom"\nnode = "boom_pressure"',
        'at = "boum"\nnode = "boom_pressure"',
        REFUSED,
        "sensors.boom_head_pressure.at",
        'at = "boum"',
    ),
    "two sensors on one place": one('kind = "roll"', 'kind = "pitch"', REFUSED, "sensors.roll", "[[sensors]]"),
    "name twice": one(
        '[[cylinders]]\nname = "stick"', '[[cylinders]]\nname = "boom"', REFUSED, "cylinders.boom.name", 'name = "boom"'
    ),
}


def sentences(path):
    """Outcome and sentences of a file."""
    try:
        return WARNED, load(path).warnings
    except SettingsError as error:
        lines = str(error).splitlines()
        return REFUSED, lines[1:] or lines


@pytest.mark.parametrize("name", CASES)
def test_names_key_and_line(tmp_path, name):
    case, text = CASES[name], SHIPPED
    for old, new in case.edits:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "machine.toml"
    path.write_text(text)
    outcome, said = sentences(path)
    assert outcome == case.outcome, said
    own = [s for s in said if re.match(rf"{re.escape(str(path))}:\d+: {re.escape(case.key)} ", s)]
    assert own, said
    line = int(own[0].removeprefix(f"{path}:").split(":")[0])
    assert case.line in text.splitlines()[line - 1]


NO_FILES = {
    "empty": (b"", "is empty"),
    "binary": (bytes(range(256)), "is not UTF-8 text at byte 128"),
    "zeros": (bytes(64), "is not TOML"),
    "not UTF-8": (SHIPPED.replace("20 t", "20 t Löffel").encode("latin-1"), "is not UTF-8 text at byte"),
    "truncated": (SHIPPED[:300].encode() + b"\n[[links", "is not TOML"),
    "another TOML file": (b'[project]\nname = "x"\n', ": project is not a key of a machine file"),
}


@pytest.mark.parametrize("name", NO_FILES)
def test_what_is_no_machine_file(tmp_path, name):
    content, said = NO_FILES[name]
    path = tmp_path / "machine.toml"
    path.write_bytes(content)
    with pytest.raises(SettingsError) as error:
        load(path)
    assert str(path) in str(error.value)
    assert said in str(error.value)


def test_a_folder_is_no_machine_file(tmp_path):
    with pytest.raises(SettingsError, match=r"cannot be read .Is a directory.: give the path of a machine file"):
        load(tmp_path)


@pytest.mark.parametrize(
    ("edit", "line"),
    [
        (("mass_kg = 1700", "mass_kg = 1700\nmass_kg = 1"), "mass_kg = 1"),
        (("[tool]", "[machine]\nx = 1\n[tool]"), "[machine]"),
    ],
)
def test_a_double_key_is_named_with_its_line(tmp_path, edit, line):
    path, text = tmp_path / "machine.toml", SHIPPED.replace(*edit, 1)
    path.write_text(text)
    with pytest.raises(SettingsError) as error:
        load(path)
    number = int(re.search(r"machine\.toml:(\d+): ", str(error.value))[1])
    assert text.splitlines()[number - 1] == line
    assert f"{line!r} is not TOML" in str(error.value)
    assert "is there twice: remove one" in str(error.value)


def test_one_run_lists_every_error(tmp_path):
    """Errors of keys, values, names and bus in different sections; the arm is checked though the bus is wrong."""
    text = SHIPPED
    for old, new in (
        ("rated_payload_kg", "rated_payload"),
        ("node_id = 34", "node_id = 33"),
        ("node_id = 35\n", "node_id = 35\ncolour = 1\n"),
        ('kind = "roll"', 'kind = "pitch"'),
        ("rate_hz = 100", "rate_hz = 0"),
        ("channel_hz = 5", "chanel_hz = 5"),
        ('effects = ["coulomb", "viscous"', 'effects = ["coulomb", "magic"'),
    ):
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "machine.toml"
    path.write_text(text)
    _, said = sentences(path)
    assert [re.sub(r"^.*?:\d+: (\S+) .*", r"\1", s) for s in said] == [
        "machine.rated_payload",
        "nodes.stick_pressure.node_id",
        "nodes.bucket_pressure.colour",
        "sensors.roll",
        "filter.rate_hz",
        "filter.chanel_hz",
        "friction.effects",
    ]


def test_the_arm_is_checked_though_the_bus_is_wrong_and_the_other_way_round(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(SHIPPED.replace('side = "left"', 'side = "right"', 1).replace("node_id = 34", "node_id = 33", 1))
    _, said = sentences(path)
    assert any("cylinders.bucket.linkage has a lever that changes its sign" in s for s in said)
    assert any("nodes.stick_pressure.node_id is 33" in s for s in said)
    path.write_text(
        SHIPPED.replace("mass_kg = 900", "mass_kg = 0", 1).replace('object = "6020h"', 'object = "6010h"', 1)
    )
    _, said = sentences(path)
    assert any("links.stick.mass_kg must be greater than 1" in s for s in said)
    assert any("sensors.roll.object is mapped twice from this node" in s for s in said)


def test_a_stroke_that_does_not_reach_is_said_in_mm(tmp_path):
    """The stick's cylinder is 3807.1 mm long at -150 deg: 7 mm beyond an end stop at 3.8 m pass, 57 mm are said."""
    path = tmp_path / "machine.toml"
    path.write_text(SHIPPED.replace("[2.35, 3.82]", "[2.35, 3.8]", 1))
    assert load(path).warnings == ()
    path.write_text(SHIPPED.replace("[2.35, 3.82]", "[2.35, 3.75]", 1))
    (said,) = load(path).warnings
    assert "cylinders.stick.linkage makes the cylinder 57 mm longer than extended at -150.0 deg" in said


@pytest.mark.parametrize(
    ("lengths", "outcome", "said"),
    [
        ("[1.9, 3.7]", WARNED, None),
        ("[2.0, 3.3]", WARNED, "fits its cylinder only with stick between"),
        ("[1.75, 2.86]", REFUSED, "fits its cylinder only with stick between -150 and -135 deg, 15% of its"),
        ("[5.0, 6.0]", REFUSED, "fits its cylinder, length_range_m = [5, 6], in no posture of its joints"),
    ],
)
def test_a_cylinder_over_two_joints_must_fit_in_their_postures(tmp_path, lengths, outcome, said):
    """Its foot stands on the boom, its rocker on the stick."""
    path, foot = tmp_path / "machine.toml", 'foot = { body = "boom", at_m = [4.5, 1.2] }'
    path.write_text(SHIPPED.replace(BUCKET_FOOT, foot, 1).replace("[1.75, 2.86]", lengths, 1))
    got, found = sentences(path)
    assert got == outcome
    assert found == () if said is None else any(f"cylinders.bucket.linkage {said}" in one for one in found)


def test_the_pressure_that_holds_the_payload_at_full_reach(tmp_path):
    """By hand, for one boom cylinder: moments about the boom pin 1700 kg x 2.7 m + 900 x (5.7 + 1.05) + 800 x (5.7 +
    2.9 + 0.65) + 1500 x (5.7 + 2.9 + 1.2) = 32765 kg m, times 9.80665 m/s^2 = 321.3 kN m; the largest lever is the
    foot's distance from the boom pin, sqrt(0.55^2 + 0.62^2) = 0.829 m; pi / 4 x (0.12 m)^2 = 0.01131 m^2: 343 bar."""
    path = tmp_path / "machine.toml"
    path.write_text(SHIPPED.replace("count = 2\n", "", 1))
    assert any("cylinders.boom needs at least 343 bar to carry" in said for said in load(path).warnings)


def test_files_in_order_bring_no_warning(shared):
    machines = sorted((shared / "data/foreign_machines").glob("*/machine.toml"))
    assert len(machines) == 10
    for path in (*CONFIG.glob("*.toml"), *machines):
        assert load(path).warnings == (), path


@pytest.mark.parametrize("made", [machine_file, two_link_file])
def test_the_reference_machines_file_brings_no_warning(tmp_path, made):
    (tmp_path / "machine.toml").write_text(made("reference"))
    assert load(tmp_path / "machine.toml").warnings == ()


def test_programs_print_warnings_once(tmp_path, capsys):
    path = tmp_path / "machine.toml"
    path.write_text(SHIPPED.replace("count = 2\n", "", 1))
    load_machine(path)
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("\n") == 1
    assert said.err.startswith(f"cylforce: warning: {path}:43: cylinders.boom needs at least 343 bar")
