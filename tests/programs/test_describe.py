"""`cylforce describe`: its numbers against numbers computed by hand, its drawing with every pin in three postures."""

import re
from math import atan2, cos, hypot, pi, radians, sin, sqrt
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from command_line import cylforce_
from cylforce.canopen.bus_load import longest_frame, traffic
from cylforce.mechanics.outline import hull, outline, pin_list
from cylforce.programs.description.arm import cylinder_numbers, extent, postures, set_ranges
from cylforce.programs.description.drawing import drawing
from cylforce.service.publication import FAST
from cylforce.service.published_values import TABLE
from cylforce.settings.machine_file import load
from scenarios import CONFIG, EXCAVATOR

MACHINES = sorted(CONFIG.glob("*.toml"))
LOADER = CONFIG / "wheel_loader.toml"
SVG = "{http://www.w3.org/2000/svg}"


def described(capsys, path, *words):
    assert cylforce_("describe", path, *words) == 0
    return capsys.readouterr().out


def row(out, *cells):
    """The cells of the line that begins with these."""
    return next(line.split() for line in out.splitlines() if line.split()[: len(cells)] == list(cells))


def by_hand(angle):
    """Boom cylinder of the 20 t machine at a boom angle [rad], by the law of cosines: foot (0.55, -0.62) m, eye (2.40,
    0.70) m from the boom's pin: length, and lever = foot distance * eye distance * sin(enclosed) / length [m]."""
    foot, eye = hypot(0.55, 0.62), hypot(2.40, 0.70)
    enclosed = angle + atan2(0.70, 2.40) - atan2(-0.62, 0.55)
    length = sqrt(foot**2 + eye**2 - 2 * foot * eye * cos(enclosed))
    return length, foot * eye * sin(enclosed) / length


def test_boom_length_lever_and_torque_at_300_bar_are_those_computed_by_hand(capsys):
    """Two cylinders of 120 mm bore and 85 mm rod: 2 * pi/4 * 0.12^2 = 0.02262 m^2 push with 678.6 kN, 0.01127 m^2 pull
    with 338.1 kN."""
    out = described(capsys, EXCAVATOR)
    push, pull = (2 * pi / 4 * area * 300e5 for area in (0.12**2, 0.12**2 - 0.085**2))
    assert (push, pull) == pytest.approx((678.6e3, 338.1e3), rel=1e-3)
    lines = out[out.index("Levers") :].splitlines()[2:5]
    for line, angle in zip(lines, (-40.0, 9.0, 58.0), strict=True):
        given, lever, pushing, pulling = (float(t) for t in line.split()[-4:])
        assert given == angle
        assert lever == pytest.approx(by_hand(radians(angle))[1], abs=5.1e-4)
        assert pushing == pytest.approx(push * by_hand(radians(angle))[1] / 1e3, abs=0.06)
        assert pulling == pytest.approx(-pull * by_hand(radians(angle))[1] / 1e3, abs=0.06)
    low, high = (1e3 * by_hand(radians(a))[0] for a in (-40.0, 58.0))
    stroke = row(out, "boom", "1750", "3070")
    assert [float(t) for t in stroke[3:]] == pytest.approx([-40.0, low, 58.0, high, low - 1750, 3070 - high], abs=0.51)


def test_a_missing_stroke_is_a_warning_in_millimetres(capsys, tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(EXCAVATOR.read_text().replace("length_range_m = [1.75, 3.07]", "length_range_m = [1.75, 3.02]"))
    missing = round(1e3 * (by_hand(radians(58.0))[0] - 3.02))
    out = described(capsys, path)
    assert f"warning: boom: {missing} mm of stroke are missing when open: correct its longest length" in out
    assert row(out, "boom", "1750", "3020")[-1] == f"-{missing}"
    path.write_text(EXCAVATOR.read_text().replace("length_range_m = [1.75, 3.07]", "length_range_m = [1.75, 2.98]"))
    assert cylforce_("describe", path) == 0
    said = capsys.readouterr()
    assert "mm longer than extended" in said.err  # the file's own check
    assert "mm of stroke are missing" not in said.out
    assert "warning" not in described(capsys, EXCAVATOR)


def test_a_linkage_over_two_joints_that_does_not_close_is_a_warning(capsys, tmp_path):
    path = tmp_path / "open.toml"
    path.write_text(LOADER.read_text().replace("link_m = 0.675", "link_m = 0.40"))
    out = described(capsys, path, "--svg", tmp_path / "a.svg")
    assert "warning: tilt: its linkage cannot be closed all over the bucket's angle_range_deg" in out
    assert "nan" not in (tmp_path / "a.svg").read_text()


def test_a_loaders_bucket_angles_count_from_the_chassis():
    machine = load(LOADER).service.machine
    assert np.degrees(set_ranges(machine)) == pytest.approx(np.array([[-42, 47], [-46, 48]]))
    tilt = cylinder_numbers(machine)[1]
    assert tilt.reaches_over == (0,)
    assert min(tilt.left) > 0.0
    curled = machine.tool_point(postures(machine)[2]).place - machine.pose(postures(machine)[2]).origin[-1]
    assert np.degrees(np.angle(curled)) == pytest.approx(48.0)


def test_reach_of_the_stretched_arm():
    """Boom 5.7, stick 2.9, tool 1.5 m: nowhere farther than their sum; downwards as far as the boom at -40 degrees with
    stick and tool hanging."""
    far = extent(load(EXCAVATOR).service.machine)
    assert 8.5 < far.forward < 10.1
    assert far.down == pytest.approx(5.7 * sin(radians(40.0)) + 2.9 + 1.5, abs=0.03)


@pytest.mark.parametrize(("count", "bits"), [(0, 55), (1, 65), (2, 75), (4, 95), (8, 135)])
def test_longest_frames_are_those_of_the_literature(count, bits):
    assert longest_frame(count) == bits


@pytest.mark.parametrize("count", range(9))
def test_no_pattern_needs_more_stuff_bits_than_the_worst(count):
    """11111 0000 1111 0000 ...: a stuff bit after the first five equal bits, then, with it, after every four."""
    bits = [1] * 5 + [k // 4 % 2 for k in range(34 + 8 * count - 5)]
    sent, run = [], 0
    for bit in bits:
        run = run + 1 if sent and bit == sent[-1] else 1
        sent.append(bit)
        if run == 5:
            sent.append(1 - bit)
            run = 1
    assert longest_frame(count) == len(sent) + 13


def test_bus_load_is_the_sum_computed_by_hand(capsys):
    """100 SYNC of 55 bits, 100 times 7 PDOs of 4 bytes (95 bits) and one of 2 bytes (75), 9 heartbeats of 1 byte (65)
    twice a second: 5500 + 66500 + 7500 + 1170 bit/s; and our PDOs of 8 bytes (135), those of the forces 50 and the
    others 20 times a second."""
    forces, others = len(FAST), len(TABLE) - len(FAST)
    total = 5500 + 66500 + 7500 + 1170 + 135 * (50 * forces + 20 * others)
    assert sum(each.bits_per_second for each in traffic(load(EXCAVATOR).service)) == pytest.approx(total)
    out = described(capsys, EXCAVATOR)
    assert f"in all {total} bit/s with the most stuff bits" in out
    shares = [f"{total / (10 * rate):.0f} % of {rate} kbit/s" for rate in (125, 250, 500, 1000)]
    assert ", ".join(shares) in out


def test_nodes_and_pdos_as_the_bus_has_them(capsys):
    out = described(capsys, EXCAVATOR)
    assert row(out, "boom_pressure", "33")[2:] == ["404", "500", "boom_head_pressure,", "boom_rod_pressure"]
    assert row(out, "boom_pressure", "1") == [
        *("boom_pressure", "1", "1A1h", "every", "SYNC", "0", "7130h:1", "INTEGER16", "boom_head_pressure")
    ]
    assert ["2", "7130h:2", "INTEGER16", "boom_rod_pressure"] in [line.split() for line in out.splitlines()]


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_every_pin_is_drawn_and_named(path):
    machine = load(path).service.machine
    names = [pin.name for pin in pin_list(machine)]
    for cylinder in machine.cylinders:
        assert f"{cylinder.name} cylinder foot" in names
        assert any(name.startswith(cylinder.name) and "cylinder eye" in name for name in names)
    for link in machine.links:
        assert f"{link.name} pin" in names
    root = ET.fromstring(drawing(machine))
    texts = ["".join(text.itertext()) for text in root.iter(f"{SVG}text")]
    for number, name in enumerate(names, 1):
        assert sum(text == str(number) for text in texts) == 3  # once in each posture
        assert any(text.startswith(f"{number} {name} ") for text in texts)
    assert len(list(root.iter(f"{SVG}circle"))) == 3 * len(names)
    assert {"lowest angles", "middle", "highest angles"} <= set(texts)


def test_the_drawing_is_to_scale():
    """From the boom's pin to the stick's in each posture: 5.7 m, by the scale bar."""
    machine = load(EXCAVATOR).service.machine
    root = ET.fromstring(drawing(machine))
    circles = [complex(float(c.get("cx")), float(c.get("cy"))) for c in root.iter(f"{SVG}circle")]
    count = len(pin_list(machine))
    label = next(
        "".join(t.itertext()) for t in root.iter(f"{SVG}text") if re.fullmatch(r"[\d.]+ m", "".join(t.itertext()))
    )
    bar = max(
        (line for line in root.iter(f"{SVG}line") if line.get("y1") == line.get("y2")),
        key=lambda line: float(line.get("y1")),
    )
    scale = (float(bar.get("x2")) - float(bar.get("x1"))) / float(label.split()[0])
    for posture in range(3):
        first, second = circles[posture * count], circles[posture * count + 1]
        assert abs(second - first) / scale == pytest.approx(5.7, rel=5e-3)


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_drawn_cylinders_rockers_and_links_are_as_long_as_they_are(path):
    machine = load(path).service.machine
    for theta in postures(machine):
        seen, length = outline(machine, theta), machine.geometry(theta).length
        assert [abs(b - a) for a, b in seen.cylinders] == pytest.approx(length.tolist())
        four = [c.linkage for c in machine.cylinders if len(c.linkage.pins) == 3]
        assert [abs(b - a) for a, b in seen.bars] == pytest.approx([linkage.link_length for linkage in four])
        assert [abs(corners[1] - corners[0]) for corners in seen.rockers] == pytest.approx(
            [linkage.rocker_length for linkage in four]
        )


def test_a_hull_has_the_outer_corners_anticlockwise():
    assert hull([0j, 2 + 0j, 2 + 2j, 2j, 1 + 1j, 1 + 0j]) == (0j, 2 + 0j, 2 + 2j, 2j)


def test_a_page_holds_drawing_and_tables_and_loads_nothing(capsys, tmp_path):
    described(capsys, LOADER, "--html", tmp_path / "a.html", "--svg", tmp_path / "a.svg")
    text = (tmp_path / "a.html").read_text()
    for part in ("<svg", "Wheel loader 15 t", "tilt rocker pin", "Bus load", "lift_head_pressure"):
        assert part in text
    addresses = re.findall(r"https?://[^\"' ]*", text)
    assert set(addresses) == {"http://www.w3.org/2000/svg"}
    assert not re.search(r"(src|href)=", text)


def test_names_in_a_page_are_escaped(capsys, tmp_path):
    path = tmp_path / "m.toml"
    path.write_text(LOADER.read_text().replace('"Wheel loader 15 t"', '"<script>alert(1)</script>"'))
    described(capsys, path, "--html", tmp_path / "a.html", "--svg", tmp_path / "a.svg")
    assert "<script>" not in (tmp_path / "a.html").read_text()
    assert "<script>" not in (tmp_path / "a.svg").read_text()
