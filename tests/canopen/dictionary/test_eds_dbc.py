"""EDS and DBC: one table, read back by independent programs, equal to the files shipped."""

import math
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cantools
import pytest
from dcf.device import Device

from cylforce.canopen.dictionary.dbc import dbc
from cylforce.canopen.dictionary.eds import eds
from cylforce.canopen.dictionary.object_dictionary import own_objects, unit_and_digits
from cylforce.canopen.dictionary.object_table import dictionary
from cylforce.canopen.dictionary.vendor_eds import default_mapping, mapped_code, profile, read
from cylforce.service.publication import FAST, publication
from cylforce.settings.machine_file import default_filters, load
from cylforce.signals.codec import decode, encode
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.layout import CODES, Field, not_available

ROOT = Path(__file__).resolve().parents[3]
NODE_ID = 64
PUBLICATION = publication(NODE_ID, 0.1, 1500.0, 300e3, 0.02, default_filters())
EXCAVATOR = publication(NODE_ID, 0.05, 1500.0, 300e3, 0.02, default_filters())  # of the file in config
SERVICE = load(ROOT / "config" / "excavator_20t.toml").service
WHOLE = dbc(SERVICE.publication, SERVICE.node_id, SERVICE.nodes, 500)
SHIPPED = {"cylforce.eds": eds(PUBLICATION, 500, 10_000), "cylforce.dbc": WHOLE}


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_file_is_what_the_table_makes(name):
    path = ROOT / "config" / name
    assert path.read_text(encoding="ascii") == SHIPPED[name], (
        "write it anew: python tests/canopen/dictionary/test_eds_dbc.py"
    )


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "cylforce.eds"
    path.write_text(SHIPPED["cylforce.eds"], encoding="ascii")
    return path


def test_dcfchk_has_nothing_to_say(file):
    checker = Path(sys.executable).parent / "dcfchk"
    done = subprocess.run([checker, "-n", str(NODE_ID), file], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_dcf_tools_see_our_pdos(file):
    device = Device.from_dcf(str(file), {"NODEID": NODE_ID})
    assert device.device_type & 0xFFFF == 404
    for pdo in PUBLICATION:
        theirs = device.tpdo[pdo.number]
        assert (theirs.cob_id, theirs.transmission_type, theirs.event_timer) == (
            pdo.can_id,
            255,
            20 if pdo.number in FAST else 100,
        )
        assert [(o.index, o.sub_index) for o in theirs.mapping.values()] == [(f.index, f.sub) for f in pdo.fields]


def test_a_stranger_reads_the_same_dictionary(file):
    """As a vendor's EDS, through the canopen library."""
    read_back, made = read(file), dictionary(own_objects(PUBLICATION, 500, 10_000), NODE_ID)
    assert profile(read_back) == 404
    assert list(read_back.dictionary) == list(made)
    for index in made:
        members = [made[index]] if not hasattr(made[index], "values") else list(made[index].values())
        for member in members:
            other = read_back.dictionary.get_variable(index, member.subindex)
            same = ("name", "data_type", "access_type", "min", "max", "pdo_mappable")
            assert [getattr(other, key) for key in same] == [getattr(member, key) for key in same]
            if not other.relative and member.default not in (None, ""):
                assert other.default == member.default


def test_every_published_value_is_mapped_and_described(file):
    read_back = read(file)
    for pdo in PUBLICATION:
        assert default_mapping(read_back, pdo.number) == tuple((f.index, f.sub, 8 * CODES[f.code]) for f in pdo.fields)
        assert [mapped_code(read_back, f.index, f.sub) for f in pdo.fields] == [f.code for f in pdo.fields]


def test_a_published_object_without_a_name_is_refused():
    """A name of an object is written for its readers: no text is made up where none is given."""
    *others, last = PUBLICATION
    nameless = last._replace(fields=(replace(last.fields[0], index=0x2199), *last.fields[1:]))
    with pytest.raises(ValueError, match=r"object 2199h of the published value event_age has no name: add its index"):
        own_objects((*others, nameless))


def test_units_and_digits_give_back_the_resolution():
    by_name = {f.signal: f for pdo in PUBLICATION for f in pdo.fields}
    assert unit_and_digits(by_name["payload_gross"]) == (0x00020000, 1)
    assert unit_and_digits(by_name["force_x"]) == (0x03210000, 2)  # kN
    assert unit_and_digits(by_name["force_direction"]) == (0x00410000, 2)


@pytest.fixture(scope="module")
def database():
    return cantools.database.load_string(dbc(EXCAVATOR, NODE_ID), "dbc")


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_the_dbc_decodes_what_we_encode(database, sign):
    values = {
        f.signal: (f.low if sign < 0 else f.high) * 0.9 if f.unit != "1" else min(3.0, 0.9 * f.high) * (sign > 0)
        for pdo in PUBLICATION
        for f in pdo.fields
    }
    for pdo in PUBLICATION:
        data = encode(pdo, values)
        ours, theirs = decode(pdo, data), database.decode_message(pdo.can_id, data, decode_choices=False)
        for field in pdo.fields:
            if field.signal in theirs:
                size = math.pi / 180.0 if field.unit == "rad" else 1.0
                assert theirs[field.signal] * size == pytest.approx(ours[field.signal], rel=1e-9, abs=1e-9)


def test_the_dbc_names_status_and_reason(database):
    quality = Status.HOLD + 4 * Reason.FROZEN
    data = encode(PUBLICATION[3], {"payload_quality": float(quality), "booked_count": 7.0})
    found = database.decode_message(PUBLICATION[3].can_id, data)
    assert (str(found["payload_status"]), str(found["payload_reason"])) == ("hold", "frozen")
    assert (found["booked_count"], str(found["booked_payload"])) == (7, "no_value")


def test_every_comment_of_the_dbc_is_about_a_signal_of_its_message():
    signals = {(m.frame_id, s.name) for m in cantools.database.load_string(WHOLE, "dbc").messages for s in m.signals}
    commented = {(int(can_id), name) for can_id, name in re.findall(r"CM_ SG_ (\d+) (\w+) ", WHOLE)}
    assert commented
    assert commented <= signals


def test_every_frame_of_ours_is_in_the_dbc(database):
    expected = {pdo.can_id for pdo in PUBLICATION} | {0x700 + NODE_ID, 0x80 + NODE_ID}
    assert {message.frame_id for message in database.messages} == expected
    assert database.decode_message(0x740, b"\x05") == {"nmt_state": "operational"}
    emergency = database.decode_message(0xC0, bytes.fromhex("3081110700000000"))
    assert (emergency["error_code"], emergency["error_register"]) == (0x8130, 0x11)


def test_no_value_is_told_as_such(database):
    data = encode(PUBLICATION[1], {})
    assert {str(value) for value in database.decode_message(PUBLICATION[1].can_id, data).values()} == {"no_value"}


def test_real32_and_gaps():
    fields = (
        Field(None, 0x2000, 1, "H", 1.0, 0.0, "1", 0.0, 0.0),
        Field("temperature", 0x6130, 1, "f", 1.0, 273.15, "K", 200.0, 400.0),
    )
    pdo = PUBLICATION[0]._replace(fields=fields)
    made = cantools.database.load_string(dbc([pdo], NODE_ID), "dbc")
    data = encode(pdo, {"temperature": 300.0})
    assert made.decode_message(pdo.can_id, data)["temperature"] == pytest.approx(300.0, rel=1e-6)
    assert "DefaultValue=0x7FC00000" in eds([pdo, PUBLICATION[1]])
    assert math.isnan(not_available("f"))


@pytest.fixture(scope="module")
def whole():
    return cantools.database.load_string(WHOLE, "dbc")


class TestWholeBus:
    """The DBC of `describe --dbc`: the sensors' frames too, as cantools reads them."""

    def test_every_frame_of_every_node_is_there(self, whole):
        sent = {pdo.can_id: node.name for node in SERVICE.nodes for pdo in node.pdos}
        sent |= {pdo.can_id: "cylforce" for pdo in SERVICE.publication}
        found = {m.frame_id: m.senders[0] for m in whole.messages if "_tpdo" in m.name}
        assert found == sent

    def test_what_a_sensor_sends_is_decoded(self, whole):
        for node in SERVICE.nodes:
            for pdo in node.pdos:
                values = {f.signal: (f.low + 2.0 * f.high) / 3.0 for f in pdo.fields if f.signal}
                data = encode(pdo, values)
                seen = whole.decode_message(pdo.can_id, data)
                for field in pdo.fields:
                    if field.signal:
                        size = math.pi / 180.0 if field.unit == "rad" else 1.0
                        assert seen[field.signal] * size == pytest.approx(decode(pdo, data)[field.signal], abs=1e-9)

    def test_how_often_it_comes_what_it_is_and_its_range(self, whole):
        payload = whole.get_message_by_name("cylforce_tpdo1")
        assert (payload.cycle_time, payload.comment) == (50, "TPDO 1 of node 64, by a timer")
        gross = payload.get_signal_by_name("payload_gross")
        assert (gross.minimum, gross.maximum, gross.unit) == (-750.0, 3000.0, "kg")
        assert all(m.cycle_time for m in whole.messages if "_tpdo" in m.name)
        assert whole.get_message_by_name("cylforce_heartbeat").cycle_time == 500


if __name__ == "__main__":
    for shipped, text in SHIPPED.items():
        (ROOT / "config" / shipped).write_text(text, encoding="ascii")
