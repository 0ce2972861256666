"""Machine files: what they become, and what is refused; each error is a sentence that names line, key and cure."""

import hashlib
import re
from math import pi
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cylforce.files.tables import ColumnMap
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.linkages import FourBar
from cylforce.settings.machine_file import SettingsError, default_filters, load
from cylforce.signals.codec import decode, encode
from cylforce.signals.kinds import Kind
from cylforce.signals.units import DEGREE

CONFIG = Path(__file__).resolve().parents[2] / "config"
SHIPPED = (CONFIG / "excavator_20t.toml").read_text()
PINS = 'foot = { body = "stick", at_m = [0.20, 0.70] }'

OVER_TWO_JOINTS = (PINS, 'foot = { body = "boom", at_m = [4.5, 1.2] }'), ("[1.75, 2.86]", "[1.9, 3.7]")


@pytest.fixture
def edited(tmp_path):
    """Loads the shipped file with replacements: (old, new), first occurrence each."""

    def write(*edits):
        text = SHIPPED
        for old, new in edits:
            assert old in text, old
            text = text.replace(old, new, 1)
        path = tmp_path / "machine.toml"
        path.write_text(text)
        return load(path)

    return write


@pytest.fixture
def refused(edited):
    """The text with which an edited file is refused: one sentence, or a line with their number and one on each line."""

    def sentence(*edits):
        with pytest.raises(SettingsError) as error:
            edited(*edits)
        said = str(error.value)
        assert_sentences(said, "machine.toml")
        return said

    return sentence


def assert_sentences(said, name):
    """One sentence with the file's line, or a line with the number of errors and a sentence for each."""
    first, *more = said.splitlines()
    if more:
        assert first.endswith(f"{name}: {len(more)} errors")
    for line in more or [first]:
        assert re.search(rf"{name}:(\d+:)? ", line)


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_files_load_and_leave_the_bus_half_free(path):
    loaded = load(path)
    assert loaded.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert loaded.columns is None
    service = loaded.service
    assert service.filters == default_filters() == Filters(100.0, 5.0, 2.0, 2.0, 0.002)
    assert service.machine.rows == tuple(range(service.machine.size))
    assert bits_per_second(service) < 0.5 * 500_000


def bits_per_second(service):
    """At most: 47 bits of frame and pause, the data, a stuff bit for every 4 bits after the first of 34 + data."""

    def bits(size):
        return 47 + 8 * size + (34 + 8 * size - 1) // 4

    pdos = [*service.publication, *(pdo for node in service.nodes for pdo in node.pdos)]
    hearts = [service.heartbeat_s, *(node.heartbeat_s for node in service.nodes)]
    sync = bits(0) * service.filters.rate_hz
    return sync + sum(bits(pdo.length) / pdo.period_s for pdo in pdos) + sum(bits(1) / s for s in hearts)


def test_units_become_si():
    service = load(CONFIG / "excavator_20t.toml").service
    signals = {signal.name: signal for signal in service.machine.signals}
    head, angle = signals["boom_head_pressure"], signals["stick_angle"]
    assert (head.kind, head.index, head.unit) == (Kind.HEAD_PRESSURE, 0, "Pa")
    assert (head.low, head.high, head.standard_error) == pytest.approx((-5e5, 4e7, 1e4))
    assert (angle.kind, angle.index) == (Kind.JOINT_ANGLE, 1)
    assert (angle.low, angle.high) == pytest.approx((-155 * DEGREE, -30 * DEGREE))
    assert head.period_s == pytest.approx(0.01)
    boom = service.machine.cylinders[0]
    assert boom.area_head == pytest.approx(2 * pi / 4 * 0.120**2)
    assert boom.area_rod == pytest.approx(2 * pi / 4 * (0.120**2 - 0.085**2))
    link = service.machine.links[0]
    assert link.mass_error == pytest.approx(0.1 * 1700 / 3**0.5)
    assert (link.angle_low, link.angle_high) == pytest.approx((-40 * DEGREE, 58 * DEGREE))
    assert service.machine.links[-1].length == pytest.approx(1.5)


def test_pdos_hold_their_sensors_in_the_order_of_the_file():
    service = load(CONFIG / "excavator_20t.toml").service
    node = next(node for node in service.nodes if node.name == "boom_pressure")
    (pdo,) = node.pdos
    assert (pdo.can_id, pdo.node_id, pdo.number, pdo.synchronous, pdo.sync) == (0x1A1, 33, 1, True, 1)
    assert [field.signal for field in pdo.fields] == ["boom_head_pressure", "boom_rod_pressure"]
    assert [(field.index, field.sub, field.code) for field in pdo.fields] == [(0x7130, 1, "h"), (0x7130, 2, "h")]
    assert node.identity == (None, None, None, 1033)
    values = {"boom_head_pressure": 123.44e5, "boom_rod_pressure": -1e5}
    assert decode(pdo, encode(pdo, values)) == pytest.approx(values)
    angle = next(pdo for node in service.nodes for pdo in node.pdos if pdo.fields[0].signal == "stick_angle")
    assert encode(angle, {"stick_angle": -90 * DEGREE}) == (9000).to_bytes(4, "little")


def test_event_timer_gaps_and_a_pdo_of_its_own(edited):
    node = edited(
        (
            "node_id = 33\n",
            'node_id = 33\npdos = [{ number = 2, cob_id = 0x305, transmission = "event_timer", period_ms = 500 }]\n',
        ),
        ("[filter]", OIL + "[filter]"),
    ).service.nodes[0]
    first, second = node.pdos
    assert (first.can_id, first.synchronous, first.period_s) == (0x1A1, True, 0.01)
    assert (second.can_id, second.synchronous, second.sync, second.period_s) == (0x305, False, 0, 0.5)
    assert [(f.signal, f.code) for f in second.fields] == [(None, "B"), ("oil_temperature", "h"), (None, "I")]
    assert second.length == 7
    assert decode(second, b"\x00\x0a\x00\x00\x00\x00\x00") == pytest.approx({"oil_temperature": 274.15})


OIL = """
[[sensors]]
name = "oil_temperature"
kind = "oil_temperature"
node = "boom_pressure"
pdo = 2
object = "2100h:3"
type = "i16"
scale_degc = 0.1
range_degc = [-40, 120]
skip_before = [{ object = "2100h:1", type = "u8" }]
skip_after = [{ object = "2100h:4", type = "u32" }]

"""


def test_foreign_sync_and_every_second_one(edited):
    loaded = edited(
        ("sync_producer = true", "sync_producer = false"),
        ("node_id = 33\n", "node_id = 33\nsync_every = 2\nperiod_ms = 40\n"),
    )
    (pdo,) = loaded.service.nodes[0].pdos
    assert (pdo.synchronous, pdo.sync, pdo.period_s) == (True, 2, 0.04)
    assert not loaded.service.sync_producer


def test_a_linkage_over_two_joints_can_be_described(edited):
    """A loader's tilt cylinder: its foot on another body than the rocker's. The angle then needs a sensor of its
    own."""
    loaded = edited(*OVER_TWO_JOINTS)
    machine = loaded.service.machine
    assert loaded.warnings == ()
    assert machine.spans == ((0,), (1,), (1, 2))
    assert isinstance(machine.cylinders[2].linkage, FourBar)
    assert machine.rows == (0, 1, 2)


def test_eye_aside_of_the_rockers_end_and_the_other_side(edited):
    linkage = edited(("rocker_m = 0.68", "rocker_m = 0.68\neye_m = [0.34, 0.068]")).service.machine.cylinders[2].linkage
    assert linkage.eye == pytest.approx(0.5 + 0.1j)
    assert linkage.side == 1


def test_a_dogbone_is_a_four_bar_with_its_eye_at_the_common_pin(edited):
    dogbone = edited(
        ('kind = "four_bar" # the', 'kind = "dogbone" # the'),
        ("rocker_pin =", "inner_pin ="),
        ("link_pin =", "outer_pin ="),
        ("rocker_m", "inner_m"),
        ("link_m", "outer_m"),
    )
    assert dogbone.service.machine.cylinders == load(CONFIG / "excavator_20t.toml").service.machine.cylinders


def test_a_cylinder_without_sensors_is_a_torque_less(edited):
    keep = SHIPPED.index("[[sensors]]"), SHIPPED.index('[[sensors]]\nname = "stick_head_pressure"')
    node = SHIPPED[SHIPPED.index("[[nodes]]") : SHIPPED.index('[[nodes]]\nname = "stick_pressure"')]
    assert edited((SHIPPED[slice(*keep)], ""), (node, "")).service.machine.rows == (1, 2)


def test_return_pressure_where_no_sensor_is(edited):
    start = SHIPPED.index('[[sensors]]\nname = "stick_rod_pressure"')
    rod = SHIPPED[start : SHIPPED.index("[[sensors]]", start + 1)]
    loaded = edited((rod, ""), ("bore_mm = 135", "bore_mm = 135\nrod_pressure_bar = 7.5"))
    assert loaded.service.machine.cylinders[1].rod_pressure == pytest.approx(7.5e5)
    assert loaded.service.machine.rows == (0, 1, 2)


def test_columns_of_a_recording(edited):
    table = """
[table]
time = { column = "Time", scale_ms = 1 }
[table.signals]
boom_angle = { column = "q1", scale_deg = 1, offset_deg = 5 }
stick_head_pressure = { column = "pA" }
"""
    columns = edited(("[filter]", table + "\n[filter]")).columns
    assert (columns.time_column, columns.time_scale_s) == ("Time", 0.001)
    assert columns.columns == (
        ColumnMap("boom_angle", "q1", DEGREE, 5 * DEGREE),
        ColumnMap("stick_head_pressure", "pA", 1.0, 0.0),
    )


TABLE = ("[filter]", "[table.signals]\n{}\n[filter]")
REFUSED = {
    # of the file as TOML, and of its keys
    "misspelt key": (
        ("mass_kg = 1700", "mas_kg = 1700"),
        "links.boom.mas_kg is not a key of this table: did you mean mass_kg, which is missing?",
    ),
    "missing key": (("mass_kg = 1700\n", ""), "links.boom lacks the key mass_kg: add it"),
    "unknown key": (("mass_kg = 1700", "mass_kg = 1700\ncolour = 3"), "links.boom.colour is not a key"),
    "a guess": (
        ("rated_payload_kg = 1500", "rated_payload_kg = 1500\npayload_reach = 1"),
        "did you mean payload_reach_m",
    ),
    "duplicate key": (("mass_kg = 1700", "mass_kg = 1700\nmass_kg = 1"), "is not TOML"),
    "broken": (("[[links]]", "[[links]"), "is not TOML"),
    "no section": (("[tool]\npoint_m = [1.5, 0.0]", ""), "the file lacks the key tool: add it"),
    "not a number": (("bore_mm = 120", "bore_mm = nan"), "cylinders.boom.bore_mm must be a finite number, not nan"),
    "infinite": (("mass_kg = 900", "mass_kg = inf"), "links.stick.mass_kg must be a finite number, not inf"),
    "infinite sensor": (
        ("scale_bar = 0.02", "scale_bar = inf"),
        "sensors.boom_head_pressure.scale_bar is inf: it must be a finite number",
    ),
    "negative": (("mass_kg = 900", "mass_kg = -900"), "links.stick.mass_kg must be greater than 1, not -900"),
    "text": (("mass_kg = 900", 'mass_kg = "900"'), "links.stick.mass_kg must be a number, not '900'"),
    "truth value": (("mass_kg = 900", "mass_kg = true"), "links.stick.mass_kg must be a number, not True"),
    "text in a sensor": (
        ("scale_bar = 0.02", 'scale_bar = "0.02"'),
        "sensors.boom_head_pressure.scale_bar is '0.02': it must be a finite number",
    ),
    "no unit": (
        ("scale_bar = 0.02", "scale = 0.02"),
        "sensors.boom_head_pressure.scale has no unit: write scale_bar or scale_mpa",
    ),
    "wrong unit": (
        ("scale_bar = 0.02", "scale_deg = 0.02"),
        "sensors.boom_head_pressure.scale_deg has the unit of another quantity: write scale_bar or",
    ),
    "two units": (("scale_bar = 0.02", "scale_kpa = 2"), "mixes the units bar and kpa: use one"),
    "no scale": (
        ("scale_bar = 0.02", "scale_bar = 0"),
        "sensors.boom_head_pressure.scale_bar is 0: give the size of one digit",
    ),
    "no range": (
        ("range_bar = [-5, 400]\n", ""),
        "sensors.boom_head_pressure lacks the range of values that can be true: add range_bar or range_mpa",
    ),
    "falling range": (("range_bar = [-5, 400]", "range_bar = [400, -5]"), "the first number must be the smaller one"),
    "range of three": (
        ("range_bar = [-5, 400]", "range_bar = [0, 1, 2]"),
        "sensors.boom_head_pressure.range_bar must have at most 2 entries, not [0, 1, 2]",
    ),
    "kind": (('kind = "pitch"', 'kind = "pich"'), "sensors.pitch.kind must be 'head_pressure'"),
    "object": (('"7130h:1"', '"7130:x"'), "sensors.boom_head_pressure.object is '7130:x': write index (hex)"),
    "low object": (('"7130h:1"', '"130h:1"'), "the index must be 1000h-FFFFh"),
    "type": (('type = "i16"', 'type = "i24"'), "sensors.boom_head_pressure.type must be 'i8', 'u8'"),
    "linkage": (
        ('kind = "triangle"', 'kind = "circle"'),
        "cylinders.boom.linkage.kind is 'circle': write one of triangle, four_bar, dogbone",
    ),
    "linkage without kind": (('kind = "triangle"\n', ""), "cylinders.boom.linkage lacks the key kind: write one of"),
    "half a place": (("at_m = [0.55, -0.62]", "at_m = [0.55]"), "linkage.foot.at_m must have at least 2 entries"),
    "place without brackets": (("[2.7, 0.45]", "2.7"), "links.boom.centre_m must be a list, not 2.7"),
    "pin without keys": (
        ('{ body = "chassis", at_m = [0.55, -0.62] }', "[0.55, -0.62]"),
        "foot must be a table of keys",
    ),
    "half a cylinder": (("count = 2", "count = 1.5"), "cylinders.boom.count must be a whole number, not 1.5"),
    "capitals": (
        ("[machine]", "[Machine]"),
        "Machine is not a key of a machine file: did you mean machine, which is missing?",
    ),
    "name": (('name = "boom_angle"\nkind', 'name = "boom angle"\nkind'), "sensors.boom angle.name"),
    # names, places, and what belongs together
    "same link": (('name = "stick"', 'name = "boom"'), "links.boom.name is 'boom', which is taken: choose another"),
    "chassis": (('name = "bucket"', 'name = "chassis"'), "links.chassis.name is 'chassis', which is taken"),
    "same sensor": (('name = "roll"', 'name = "pitch"'), "sensors.pitch.name is 'pitch', which is taken"),
    "time": (('name = "roll"', 'name = "t_s"'), "sensors.t_s.name is 't_s', which is taken"),
    "same quantity": (('kind = "roll"', 'kind = "pitch"'), "sensors.roll measures the same as pitch"),
    "same node id": (
        ("node_id = 34", "node_id = 33"),
        "nodes.stick_pressure.node_id is 33, which is also that of boom_pressure",
    ),
    "own node id": (
        ("node_id = 33", "node_id = 64"),
        "nodes.boom_pressure.node_id is 64, which is also that of cylforce's own node",
    ),
    "unknown cylinder": (
        ('at = "boom"\nnode = "boom_pressure"', 'at = "bom"\nnode = "boom_pressure"'),
        "is 'bom', which is no cylinder: write one of boom, stick, bucket",
    ),
    "no place": (
        ('at = "boom"\nnode = "boom_pressure"', 'node = "boom_pressure"'),
        "sensors.boom_head_pressure lacks the key at: write one of boom",
    ),
    "unknown link": (
        ('at = "stick"\nnode = "stick_angle"', 'at = "arm"\nnode = "stick_angle"'),
        "sensors.stick_angle.at is 'arm', which is no link",
    ),
    "place of the chassis": (
        ('node = "slew_gyro"', 'node = "slew_gyro"\nat = "boom"'),
        "belongs to the chassis: remove it",
    ),
    "unknown node": (('node = "slew_gyro"', 'node = "gyro"'), "sensors.slew_rate.node is 'gyro', which is no node"),
    "idle node": (
        ('[[sensors]]\nname = "slew_rate"', '[[nodes]]\nname = "x"\nnode_id = 5\n[[sensors]]\nname = "slew_rate"'),
        "nodes.x has no sensor",
    ),
    "unknown body": (
        ('body = "chassis"', 'body = "house"'),
        "cylinders.boom.linkage.foot.body is 'house', which is no link",
    ),
    "one body": (('body = "chassis"', 'body = "boom"'), "cylinders.boom.linkage has all its pins on one body"),
    "open linkage": (("rocker_m = 0.68", "rocker_m = 0.2"), "cylinders.bucket.linkage cannot be closed at"),
    "other cylinder": (("length_range_m = [1.75, 3.07]", "length_range_m = [4, 5]"), "all outside length_range_m"),
    "thick rod": (("rod_mm = 85", "rod_mm = 120"), "cylinders.boom.rod_mm is 120, not smaller than bore_mm = 120"),
    "no length": (("length_m = 2.9\n", ""), "links.stick lacks the key length_m"),
    "whole turn": (
        ("angle_range_deg = [-40, 58]", "angle_range_deg = [-310, 58]"),
        "links.boom.angle_range_deg is [-310, 58] and spans more than a turn",
    ),
    # measurements that are not enough
    "no angle": (
        ('kind = "joint_angle"\nat = "stick"', 'kind = "slew_angle"'),
        "links.stick has no source of its angle, and all absolute angles beyond it are lost: add a sensor",
    ),
    "unit of another": (
        ('kind = "head_pressure"\nat = "stick"', 'kind = "force_pin"\nat = "stick"'),
        "sensors.stick_head_pressure.scale_bar has the unit of another quantity: write scale_kn or scale_n",
    ),
    "pressure twice": (
        ('kind = "head_pressure"', 'kind = "rod_pressure"'),
        "sensors.boom_rod_pressure measures the same",
    ),
    "rod pressure known": (
        ("bore_mm = 135", "bore_mm = 135\nrod_pressure_bar = 5"),
        "is measured by a sensor: remove this key",
    ),
    # bus
    "nine bytes": (
        (
            'object = "6020h"\ntype = "i16"',
            'object = "6020h"\ntype = "i32"\nskip_after = [{ object = "6021h", type = "i32" }]',
        ),
        "sensors.roll.pdo would hold 10 bytes, 8 at most",
    ),
    "same object": (('object = "6020h"', 'object = "6010h"'), "sensors.roll.object is mapped twice from this node"),
    "same COB-ID": (
        ("node_id = 34\n", "node_id = 34\npdos = [{ number = 1, cob_id = 0x1A1 }]\n"),
        "cannot be identified: TPDO 1 has the COB-ID 1A1h of boom_pressure",
    ),
    "our COB-ID": (
        ("node_id = 34\n", "node_id = 34\npdos = [{ number = 1, cob_id = 0x2C0 }]\n"),
        "the COB-ID 2C0h of cylforce's own publication",
    ),
    "COB-ID of others": (
        ("node_id = 34\n", "node_id = 34\npdos = [{ number = 1, cob_id = 0x601 }]\n"),
        "cob_id must be less than or equal to 1407",
    ),
    "idle PDO": (
        ("node_id = 34\n", "node_id = 34\npdos = [{ number = 3 }]\n"),
        "nodes.stick_pressure.pdos describe TPDO 3, which no sensor uses",
    ),
    "fifth PDO": (('node = "slew_gyro"\n', 'node = "slew_gyro"\npdo = 5\n'), "has TPDO 5, which has no default COB-ID"),
    "no timer": (
        ("node_id = 34\n", 'node_id = 34\ntransmission = "event_timer"\n'),
        "sends by its event timer: add period_ms",
    ),
    "other period": (
        ("node_id = 34\n", "node_id = 34\nperiod_ms = 20\n"),
        "follows the SYNC of cylforce every 10 ms, not every 20 ms",
    ),
    "no type": (('object = "6020h"\ntype = "i16"\n', 'object = "6020h"\n'), "sensors.roll lacks the key type"),
    "too fine": (
        ("scale_bar = 0.02", "scale_bar = 0.01"),
        "sensors.boom_head_pressure.range_bar exceeds what INTEGER16 with this scale can express",
    ),
    "unsigned": (("offset_deg = -180\n", ""), "sensors.boom_angle.range_deg exceeds what UNSIGNED32"),
    "float without error": (
        (
            'type = "i16"\nscale_deg_s = 0.01\nrange_deg_s = [-150, 150]\nstandard_error_deg_s = 0.05',
            'type = "f32"\nscale_deg_s = 1\nrange_deg_s = [-150, 150]',
        ),
        "sensors.slew_rate lacks standard_error",
    ),
    "node id 0": (("node_id = 33", "node_id = 0"), "nodes.boom_pressure.node_id must be greater than or equal to 1"),
    "profile": (("profile = 410", "profile = 411"), "nodes.chassis_tilt.profile"),
    "large force": (
        ("rated_force_n = 300_000", "rated_force_n = 400_000"),
        "publication.rated_force_n is too large for force_x (INTEGER16)",
    ),
    "fast publication": (
        ("period_ms = 50", "period_ms = 5"),
        "publication.period_ms is 5, shorter than a step of filter.rate_hz (10 ms)",
    ),
    # estimator
    "Nyquist": (
        ("channel_hz = 5", "channel_hz = 50"),
        "filter.channel_hz is not below half of rate_hz (50 Hz, Nyquist): lower it",
    ),
    "slow": (("rate_hz = 100", "rate_hz = 1"), "filter.rate_hz must be greater than or equal to 10"),
    "friction": (
        ('effects = ["coulomb", "viscous"', 'effects = ["coulomb", "magic"'),
        "friction.effects name 'magic': choose among coulomb",
    ),
    # recordings
    "column of nobody": (
        (TABLE[0], TABLE[1].format('boom = { column = "x" }')),
        "table.signals.boom is no sensor: write one of boom_head_pressure",
    ),
    "no column": (
        (TABLE[0], TABLE[1].format("pitch = { scale_deg = 1 }")),
        "table.signals.pitch lacks the key column: add it",
    ),
    "column's unit": (
        (TABLE[0], TABLE[1].format('pitch = { column = "x", scale_bar = 1 }')),
        "table.signals.pitch.scale_bar has the unit of another quantity: write scale_deg or scale_rad",
    ),
    "column's NaN": (
        (TABLE[0], TABLE[1].format('pitch = { column = "x", scale_deg = nan }')),
        "table.signals.pitch.scale_deg is nan: it must be a finite number",
    ),
    "column's 0": (
        (TABLE[0], TABLE[1].format('pitch = { column = "x", scale_deg = 0 }')),
        "table.signals.pitch.scale_deg is 0",
    ),
    "time's unit": (
        (TABLE[0], '[table]\ntime = { column = "t", scale_deg = 1 }\n[filter]'),
        "table.time.scale_deg has the unit of another quantity: write scale_s or scale_ms or scale_us",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_with_key_and_cure(refused, case):
    edit, said = REFUSED[case]
    assert said in refused(edit)


def section(header):
    """A table of the shipped file, from its header to the next."""
    start = SHIPPED.index(header)
    return SHIPPED[start : SHIPPED.index("\n[[", start) + 1]


STICK_HEAD = section('[[sensors]]\nname = "stick_head_pressure"')
FORCE_PIN = """[[sensors]]
name = "pin"
kind = "force_pin"
at = "stick"
node = "slew_gyro"
object = "9130h:3"
type = "i32"
scale_n = 1
range_kn = [-500, 500]
"""


def test_rod_pressure_alone_says_nothing(refused):
    assert (
        "sensors.stick_rod_pressure gives no force without the head side: add a head_pressure sensor at stick"
        in refused((STICK_HEAD, ""))
    )


def test_one_unit_for_all_keys_of_a_sensor(refused):
    assert "sensors.pin mixes the units kn and n: use one" in refused((STICK_HEAD, STICK_HEAD + FORCE_PIN))


def test_a_force_is_measured_one_way(refused):
    pin = FORCE_PIN.replace("_kn", "_n")
    assert "cylinders.stick has a force pin and pressure sensors" in refused((STICK_HEAD, STICK_HEAD + pin))


def test_no_torque_at_all(refused):
    pressures = [section(f'[[sensors]]\nname = "{c}_{side}_pressure"') for c in ARM for side in ("head", "rod")]
    nodes = [section(f'[[nodes]]\nname = "{c}_pressure"') for c in ARM]
    # the last node's table is followed by a comment, the last sensor's by another sensor: only whole tables go
    assert "sensors measure no torque: add head_pressure" in refused(*((text, "") for text in pressures + nodes))


ARM = ("boom", "stick", "bucket")


def test_length_of_a_cylinder_over_two_joints_is_no_angle(refused):
    length = """[[sensors]]
name = "length"
kind = "cylinder_length"
at = "bucket"
node = "slew_gyro"
object = "9130h:3"
type = "u32"
scale_mm = 0.1
range_mm = [1800, 3800]
"""
    said = refused(*OVER_TWO_JOINTS, (STICK_HEAD, length + STICK_HEAD))
    assert "sensors.length is of no use: the length of bucket depends on several joints" in said


def test_length_across_a_dead_point_is_no_angle(refused):
    length = """[[sensors]]
name = "length"
kind = "cylinder_length"
at = "stick"
node = "slew_gyro"
object = "9130h:3"
type = "u32"
scale_mm = 0.1
range_mm = [1700, 4000]
"""
    wide = ("angle_range_deg = [-150, -35]", "angle_range_deg = [-250, -35]")
    assert "sensors.length gives no unique angle: stick has a dead point" in refused(
        wide, (STICK_HEAD, length + STICK_HEAD)
    )


@pytest.mark.parametrize(
    ("edit", "marker"),
    [
        (("bore_mm = 135", "bore_mm = -135"), "bore_mm = -135"),
        (("rod_mm = 95", "rod_mm = 195"), "rod_mm = 195"),
        (('object = "6020h"', 'object = "6010h"'), None),
        (("channel_hz = 5", "channel_hz = 60"), "channel_hz = 60"),
        (('foot = { body = "boom"', 'foot = { body = "bom"'), 'foot = { body = "bom"'),
        (("node_id = 49", "node_id = 48"), "node_id = 48"),
        (("centre_m = [0.65, 0.28]", "centre_m = [0.65, inf]"), "centre_m = [0.65, inf]"),
        (("profile = 410\n", "profile = 410\nidentity = { serial = -1 }\n"), None),
    ],
)
def test_the_line_is_that_of_the_key(refused, edit, marker):
    """A duplicate is told at its second place, a key of an inline table at its line."""
    said = refused(edit)
    if "TOML" in said:
        return
    line = int(re.search(r"machine\.toml:(\d+):", said)[1])
    text = SHIPPED.replace(*edit, 1).splitlines()
    if marker is None:
        marker = edit[1]
        assert marker in text[line - 1]
    else:
        assert marker in text[line - 1]
        if marker == "node_id = 48":
            assert 'name = "slew_gyro"' in text[line - 2]


@pytest.mark.parametrize(
    "content", [b"\xff\xfe", b"", b"\0", b"[machine", b"a = 1", b"links = 3", b"[[machine]]\nname = 1"]
)
def test_no_machine_file_at_all(tmp_path, content):
    path = tmp_path / "m.toml"
    path.write_bytes(content)
    with pytest.raises(SettingsError, match=r"m\.toml:"):
        load(path)


def test_absent_file(tmp_path):
    with pytest.raises(SettingsError, match=r"none\.toml: cannot be read"):
        load(tmp_path / "none.toml")


LINES = SHIPPED.splitlines()


@settings(deadline=None, max_examples=150)
@given(st.data())
def test_a_damaged_file_is_loaded_or_refused_with_a_sentence(tmp_path_factory, data):
    """One line removed, doubled, or its value replaced: never another exception."""
    at = data.draw(st.integers(0, len(LINES) - 1))
    head, equals, _ = LINES[at].partition(" = ")
    values = [
        "0",
        "-1",
        "1e308",
        "nan",
        '""',
        "[]",
        "[1]",
        "{}",
        "true",
        "1979-05-27",
        '"boom"',
        "[{}]",
        "9" * 400,
        "9" * 5000,
        "[" * 3000,
    ]
    changed = [[], [LINES[at], LINES[at]]] + ([[f"{head} = {v}"] for v in values] if equals else [])
    new = data.draw(st.sampled_from(changed))
    path = tmp_path_factory.mktemp("damaged") / "m.toml"
    path.write_text("\n".join([*LINES[:at], *new, *LINES[at + 1 :]]))
    said = outcome(path)
    if said is not None:
        assert_sentences(said, "m.toml")


def outcome(path):
    try:
        load(path)
    except SettingsError as error:
        return str(error)
    return None


def test_entries_that_are_all_wrong_are_not_missing(tmp_path):
    text = (CONFIG / "excavator_20t.toml").read_text()
    path = tmp_path / "pins_mm.toml"
    path.write_text(text.replace("[[cylinders]]\n", "[[cylinders]]\ntolerance = { pins_mm = 2 }\n"))
    with pytest.raises(SettingsError) as found:
        load(path)
    first, *others = str(found.value).splitlines()
    assert first.endswith(": 3 errors")
    assert all("pins_mm is not a key of this table: did you mean pins_m?" in line for line in others)
