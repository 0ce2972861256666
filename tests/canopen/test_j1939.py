"""The values on J1939: what a truck's display reads, and whose the address is."""

import math
from dataclasses import replace

import cantools
import pytest

from cylforce.canopen.dictionary.dbc import dbc
from cylforce.canopen.j1939 import (
    CLAIMED,
    J1939,
    SETTLE_US,
    Claim,
    error_and_force,
    identifier,
    name_of,
    totals,
    vehicle_weight,
)
from cylforce.service.publication import publication
from cylforce.signals.estimate import Quantity, Reason, Status, no_estimate
from cylforce.signals.events import EXTENDED, Frame

ADDRESS, NAME = 0x27, name_of(64)
DBC = cantools.database.load_string(dbc(publication(64, 0.05, 1500.0, 300e3, 0.02, None), 64, j1939=ADDRESS), "dbc")


def estimate(net=812.0, error=4.0, force=84_000.0, turn=-1.0, t_us=10_000_000):
    nothing = no_estimate(t_us, Reason.STARTING, None)
    soil = replace(
        nothing.soil,
        magnitude=Quantity(force, 100.0, Status.OK, Reason.NONE),
        direction=Quantity(turn, 0.1, Status.OK, Reason.NONE),
    )
    return replace(nothing, net=Quantity(net, error, Status.DEGRADED, Reason.AT_REST), soil=soil)


def test_identifiers_are_those_of_the_standard():
    assert identifier(0xFEEA, ADDRESS) == EXTENDED | 0x18FEEA27
    assert identifier(CLAIMED, ADDRESS) == EXTENDED | 0x18EEFF27


def test_a_display_with_the_dbc_reads_them():
    found = DBC.decode_message(0x18FEEA27, vehicle_weight(estimate()))
    assert found == {"cargo_weight": 812.0}
    found = DBC.decode_message(0x18FF0027, error_and_force(estimate()))
    assert found["payload_standard_error"] == pytest.approx(4.0)
    assert found["soil_magnitude"] == 84_000.0
    assert found["soil_direction"] == pytest.approx(math.degrees(-1.0), abs=0.005)
    assert (str(found["payload_status"]), str(found["payload_reason"])) == ("degraded", "at_rest")
    assert (str(found["soil_magnitude_status"]), str(found["soil_magnitude_reason"])) == ("ok", "none")


def test_the_bytes_of_vehicle_weight():
    """J1939-71: axle location, axle weight and trailer weight not available, cargo weight in bytes 6 and 7."""
    assert vehicle_weight(estimate()) == bytes.fromhex("ff ffff ffff 9601 ff")


@pytest.mark.parametrize(("net", "raw"), [(-3.0, 0), (float("nan"), 0xFFFF), (200_000.0, 0xFFFF)])
def test_what_cannot_be_said(net, raw):
    assert int.from_bytes(vehicle_weight(estimate(net))[5:7], "little") == raw


def test_the_bytes_of_a_total():
    """ISO 11783-10: command 3 (value) of element 0; DDI 431, then 1 234 567 kg, the low byte first."""
    found = totals(3210.4, 1_234_567.0)
    assert found[3] == bytes.fromhex("0300 af01 87d61200")
    assert identifier(0xCB00, ADDRESS) == EXTENDED | 0x18CBFF27
    read = [DBC.decode_message(0x18CBFF27, data) for data in found]
    names = ["loaded_total_mass", "unloaded_total_mass", "lifetime_loaded_total_mass", "lifetime_unloaded_total_mass"]
    assert [str(x["total_of"]) for x in read] == names
    assert [x["total"] for x in read] == [3210, 3210, 1_234_567, 1_234_567]
    assert [str(read[0][name]) for name in ("process_data_command", "process_data_element")] == ["value", "0"]


@pytest.mark.parametrize(("kg", "raw"), [(-5.0, 0), (3e9, 0x7FFFFFFF)])
def test_what_a_total_cannot_say(kg, raw):
    assert [int.from_bytes(data[4:], "little") for data in totals(kg, None)] == [raw, raw]


def test_no_value_is_not_available():
    nothing = no_estimate(0, Reason.STARTING, None)
    assert error_and_force(nothing)[:6] == b"\xff" * 6


class TestAddress:
    @pytest.fixture
    def sent(self):
        return []

    @pytest.fixture
    def said(self):
        return []

    @pytest.fixture
    def node(self, sent, said):
        made = J1939(lambda can_id, data: sent.append((can_id, data)) or True, Claim(ADDRESS, NAME), said.append)
        made.claim(0)
        return made

    def claimed(self, name, address=ADDRESS):
        return Frame(1, identifier(CLAIMED, address), name.to_bytes(8, "little"))

    def test_it_is_claimed_before_anything_is_sent(self, node, sent):
        node.publish(estimate(t_us=SETTLE_US - 1))
        assert sent == [(EXTENDED | 0x18EEFF27, NAME.to_bytes(8, "little"))]
        node.publish(estimate(t_us=SETTLE_US))
        assert [can_id & 0x1FFFFFFF for can_id, _ in sent[1:]] == [0x18FEEA27, 0x18FF0027]
        node.publish_totals(SETTLE_US - 1, 1.0, 2.0)
        assert len(sent) == 3
        node.publish_totals(SETTLE_US, 1.0, 2.0)
        assert [can_id & 0x1FFFFFFF for can_id, _ in sent[3:]] == [0x18CBFF27] * 4

    def test_a_request_is_answered(self, node, sent):
        for peer in (0xFF, ADDRESS):
            node.on_frame(Frame(1, EXTENDED | 0x18EA0003 | peer << 8, bytes.fromhex("00ee00")))
        node.on_frame(Frame(1, EXTENDED | 0x18EA5003, bytes.fromhex("00ee00")))  # another node is asked
        assert len(sent) == 3

    def test_the_lower_name_keeps_it(self, node, sent, said):
        node.on_frame(self.claimed(NAME + 1))
        assert (sent[-1][0], said) == (EXTENDED | 0x18EEFF27, [])
        node.on_frame(self.claimed(NAME - 1, ADDRESS + 1))
        assert len(sent) == 2
        node.on_frame(self.claimed(NAME - 1))
        assert sent[-1][0] == EXTENDED | 0x18EEFFFE  # cannot claim
        assert said == ["J1939 address 39 belongs to another node: choose another j1939_address"]
        node.publish(estimate())
        assert len(sent) == 3
