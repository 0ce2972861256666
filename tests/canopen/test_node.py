"""The CANopen node, frame by frame: NMT, SDO, PDO, SYNC, heartbeat, emergencies, and what strangers may send it."""

import asyncio
import struct
import time
import tracemalloc
from random import Random

import pytest

from cylforce.canopen.devices import Derived, sensor_node
from cylforce.canopen.dictionary.object_dictionary import own_objects, sensor_objects
from cylforce.canopen.dictionary.object_table import Entry, Object, dictionary, group, variable
from cylforce.canopen.network import Network
from cylforce.canopen.node import Node
from cylforce.canopen.objects import Commands
from cylforce.canopen.sdo_client import AbortedError, Client, NoAnswerError
from cylforce.mechanics.installation import SensorNode
from cylforce.service.publication import publication
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.events import ERROR, EXTENDED, REMOTE, Frame
from cylforce.signals.layout import Field, Pdo
from sdo_bench import aborted

OURS = 64
PUBLICATION = publication(OURS, 0.1, 1500.0, 300e3)
WEIGHT = {"payload_gross": 1234.5, "payload_net": 1000.0}


class Bench:
    """A network with nodes on it, seen from the bus: `sent` is what they sent."""

    def __init__(self):
        self.sent = []
        self.network = Network(self.send)

    def send(self, can_id, data):
        self.sent.append((can_id, bytes(data)))
        return True

    def add(self, node):
        node.associate_network(self.network)
        node.boot()
        return node

    def frame(self, can_id, data=b"", t_us=None):
        """What the nodes answer to a frame."""
        self.sent.clear()
        self.network.on_frame(Frame(self.network.t_us if t_us is None else t_us, can_id, data))
        return list(self.sent)

    def poll(self, t_us):
        self.sent.clear()
        self.network.poll(t_us)
        return list(self.sent)

    def sdo(self, request, node_id=OURS):
        """The answer to an SDO request."""
        ((can_id, data),) = self.frame(0x600 + node_id, request)
        assert (can_id, len(data)) == (0x580 + node_id, 8)
        return data

    def read(self, index, sub, node_id=OURS):
        answer = self.sdo(struct.pack("<BHB4x", 0x40, index, sub), node_id)
        assert answer[0] & 0xE3 == 0x43, aborted(answer)
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def write(self, index, sub, size, value, node_id=OURS):
        """0, or the abort code."""
        data = struct.pack("<BHBI", 0x23 | (4 - size) << 2, index, sub, value)
        answer = self.sdo(data, node_id)
        assert answer[1:4] == data[1:4]
        return 0 if answer[0] == 0x60 else aborted(answer)


@pytest.fixture
def bench():
    return Bench()


@pytest.fixture
def verdicts():
    return []


@pytest.fixture
def ours(bench, verdicts):
    objects = own_objects(PUBLICATION, 500, 10_000, [12 << 16 | 300])
    commands = Commands(frozenset({(0x6125, 1), (0x6139, 1)}), lambda: verdicts.pop(0))
    node = Node(OURS, dictionary(objects, OURS), PUBLICATION, commands=commands, autostart=True)
    node.add_read_callback(Derived(node, PUBLICATION).read)
    bench.add(node)
    assert bench.sent == [(0x740, b"\0")]
    bench.sent.clear()
    return node


FIELDS = (
    Field("boom_head", 0x7130, 1, "h", 1e4, 0.0, "Pa", 0.0, 4e7),
    Field("boom_rod", 0x7130, 2, "h", 1e4, 0.0, "Pa", 0.0, 4e7),
)
PRESSURE = SensorNode("boom", 12, 404, (1, 2, 3, 4), 0.1, (Pdo(0x18C, 12, 1, True, 1, 0.01, FIELDS),), True)


@pytest.fixture
def sensor(bench):
    node = bench.add(sensor_node(PRESSURE))
    bench.sent.clear()
    return node


class TestNmt:
    def test_states_gate_pdo_and_sdo(self, bench, ours):
        data = encode(PUBLICATION[0], WEIGHT)
        for command, pdo, sdo in ((128, False, True), (1, True, True), (2, False, False), (1, True, True)):
            assert bench.frame(0, bytes([command, OURS])) == []
            assert ours.publish(1, data) is pdo
            assert bench.sent == [(0x1C0, data)] * pdo
            assert bool(bench.frame(0x640, bytes.fromhex("4000100000000000"))) is sdo

    def test_commands_to_others_and_malformed_ones_do_nothing(self, bench, ours):
        for data in (b"", b"\x02", b"\x02\x05", b"\x02\x40\x00", b"\x07\x40", bytes(8)):
            assert bench.frame(0, data) == []
            assert ours.operational

    def test_reset_gives_default_values_and_boots(self, bench, ours):
        assert bench.write(0x1017, 0, 2, 100) == 0
        ours.publish(1, encode(PUBLICATION[0], WEIGHT))
        assert bench.frame(0, bytes([130, OURS])) == [(0x740, b"\0")]
        assert (bench.read(0x1017, 0), bench.read(0x9130, 1)) == (500, 12345)
        assert bench.frame(0, bytes([129, 0])) == [(0x740, b"\0")]
        assert bench.read(0x9130, 1) == 0x80000000
        assert ours.operational

    def test_heartbeat_tells_the_state_at_absolute_times(self, bench, ours):
        assert bench.poll(499_999) == []
        assert bench.poll(500_100) == [(0x740, b"\x05")]
        bench.frame(0, bytes([128, OURS]))
        assert bench.poll(999_999) == []
        assert bench.poll(1_000_000) == [(0x740, b"\x7f")]
        assert bench.poll(5_700_000) == [(0x740, b"\x7f")]  # what was missed is skipped
        assert bench.poll(5_999_000) == []
        assert bench.write(0x1017, 0, 2, 0) == 0
        assert bench.poll(99_000_000) == []

    def test_a_sensor_waits_for_its_start(self, bench, sensor):
        assert sensor.state == 127
        bench.frame(0, b"\x01\x00")
        assert sensor.operational


class TestSdo:
    def test_what_is_published_is_read(self, bench, ours):
        ours.publish(1, encode(PUBLICATION[0], WEIGHT))
        assert bench.read(0x9130, 1) == 12345
        assert bench.read(0x9140, 1) == 10000
        assert bench.read(0x9138, 1) == 2345
        assert bench.read(0x7130, 1) == 12345
        assert (bench.read(0x6131, 1), bench.read(0x6132, 1)) == (0x00020000, 1)

    def test_what_does_not_fit_the_other_type_saturates_and_no_value_stays_none(self, bench, ours):
        ours.publish(1, struct.pack("<ii", 1_000_000, -(1 << 31)))
        assert (bench.read(0x7130, 1), bench.read(0x9138, 1)) == (32767, 0x80000000)
        ours.publish(1, encode(PUBLICATION[0], {}))
        assert (bench.read(0x9130, 1), bench.read(0x7130, 1)) == (0x80000000, 0x8000)

    def test_status_says_whether_a_channel_is_valid(self, bench, ours):
        assert [bench.read(0x6150, channel) for channel in range(1, 6)] == [1] * 5
        ours.publish(1, encode(PUBLICATION[0], WEIGHT))
        ours.publish(2, struct.pack("<hhhh", 30000, -30000, 0, 0))
        fine = {"payload_quality": 0.0, "force_quality": 0.0}
        ours.publish(4, encode(PUBLICATION[3], fine))
        ours.publish(6, bytes(8))
        assert [bench.read(0x6150, channel) for channel in range(1, 6)] == [0, 2, 4, 0, 0]
        quality = float(Status.INVALID + 4 * Reason.TILT)
        ours.publish(4, encode(PUBLICATION[3], fine | {"payload_quality": quality}))
        assert [bench.read(0x6150, channel) for channel in range(1, 6)] == [1, 2, 4, 0, 0]

    def test_long_objects_go_in_segments(self, bench, ours):
        answer = bench.sdo(bytes.fromhex("4008100000000000"))
        assert (answer[0], answer[4]) == (0x41, 8)
        first, last = bench.sdo(b"\x60" + bytes(7)), bench.sdo(b"\x70" + bytes(7))
        assert first[1:8] + last[1 : 8 - (last[0] >> 1 & 7)] == b"cylforce"
        assert last[0] & 1

    @pytest.mark.parametrize(
        ("index", "sub", "size", "code"),
        [
            (0x1234, 0, 4, 0x06020000),  # no such object
            (0x1018, 9, 4, 0x06090011),  # no such sub-index
            (0x1000, 1, 4, 0x06090011),
            (0x1000, 0, 4, 0x06010002),  # read only
            (0x9130, 1, 4, 0x06010002),
            (0x1017, 0, 4, 0x06070010),  # length
            (0x1017, 0, 1, 0x06070010),
            (0x1003, 0, 1, 0x06090030),  # only 0 may be written
        ],
    )
    def test_what_cannot_be_written(self, bench, ours, index, sub, size, code):
        assert bench.write(index, sub, size, 0x01010101) == code

    def test_a_command_cannot_be_read(self, bench, ours):
        assert aborted(bench.sdo(bytes.fromhex("4025610100000000"))) == 0x06010001

    @pytest.mark.parametrize("command", [0x6125, 0x6139])
    def test_commands_are_answered_by_the_verdict_of_the_core(self, bench, ours, verdicts, command):
        verdicts += [None, 0x08000022, 0]
        assert [bench.write(command, 1, 4, 0x6F72657A) for _ in range(3)] == [0, 0x08000022, 0]
        assert bench.write(command, 1, 2, 0x7A) == 0x06070010

    def test_a_segmented_command_is_refused_before_its_data(self, bench, ours):
        assert aborted(bench.sdo(bytes.fromhex("2125610104000000"))) == 0x08000020
        assert aborted(bench.sdo(b"\x09zero\0\0\0")) == 0x05040001

    def test_limits_and_what_is_no_number(self, bench):
        entries = [Entry(1, "Limited", "h", "rw", 0, low=-5, high=5), Entry(2, "Float", "f", "rw", 0.0)]
        objects = [group(0x2000, "Test", 9, entries), variable(0x1017, "Producer heartbeat time", "H", "rw", 0)]
        bench.add(Node(5, dictionary(objects, 5)))
        assert [bench.write(0x2000, 1, 2, v & 0xFFFF, 5) for v in (5, -5, 6, -6)] == [0, 0, 0x06090031, 0x06090032]
        assert bench.read(0x2000, 1, 5) == 0xFFFB
        for text in ("0000c07f", "0000807f", "000080ff"):
            value = int.from_bytes(bytes.fromhex(text), "little")
            assert bench.write(0x2000, 2, 4, value, 5) == 0x06090030
        assert bench.read(0x2000, 2, 5) == 0

    @pytest.mark.parametrize("first", [b"", b"\x23", bytes(7), b"\x60" + bytes(7), b"\xff" * 8, b"\xc0" + bytes(7)])
    def test_a_malformed_first_request_is_answered_with_an_abort(self, bench, ours, first):
        assert aborted(bench.sdo(first)) == 0x05040001
        assert bench.read(0x1000, 0) == 0x00020194

    def test_an_abort_is_not_answered(self, bench, ours):
        assert bench.frame(0x640, b"\x80" + bytes(7)) == []

    def test_toggle_timeout_size_and_memory(self, bench, ours):
        begin = bytes.fromhex("2117100002000000")
        assert bench.sdo(begin)[0] == 0x60
        assert aborted(bench.sdo(b"\x1b\x64\x00" + bytes(5))) == 0x05030000
        bench.sdo(begin)
        bench.poll(2_000_000)
        assert aborted(bench.sdo(b"\x0b\x64\x00" + bytes(5))) == 0x05040000
        bench.sdo(begin)
        assert aborted(bench.sdo(b"\x09\x64\x00\x00" + bytes(4))) == 0x06070010
        bench.sdo(begin)
        assert bench.sdo(b"\x0b\x64\x00" + bytes(5))[0] == 0x20
        assert bench.read(0x1017, 0) == 100
        assert aborted(bench.sdo(bytes.fromhex("21171000ffffffff"))) == 0x05040005
        bench.sdo(bytes.fromhex("2017100000000000"))  # of unknown size, without end
        answers = [bench.sdo(bytes([0x10 * (k % 2)]) + bytes(7))[0] for k in range(147)]
        assert answers[-1] == 0x80
        assert set(answers[:-1]) == {0x20, 0x30}


class TestPdo:
    def test_foreign_remote_and_error_frames_are_ignored(self, bench, ours):
        for can_id in (0x1C0 | REMOTE, 0x640 | REMOTE, 0x640 | EXTENDED, 0x0 | ERROR, 0x80 | EXTENDED, 0x240, 0x7E5):
            assert bench.frame(can_id, bytes(8)) == []
        assert ours.operational

    def test_a_sensor_answers_every_nth_sync(self, bench, sensor):
        bench.frame(0, b"\x01\x0c")
        assert bench.write(0x1800, 2, 1, 3, 12) == 0
        assert [len(bench.frame(0x80)) for _ in range(7)] == [0, 0, 1, 0, 0, 1, 0]

    def test_acyclic_synchronous_only_after_a_change(self, bench, sensor):
        bench.frame(0, b"\x01\x0c")
        bench.write(0x1800, 2, 1, 0, 12)
        sensor.set_value(0x7130, 1, 7)
        assert [bench.frame(0x80) for _ in range(2)] == [[(0x18C, b"\x07\0")], []]
        sensor.set_value(0x7130, 1, 8)
        assert bench.frame(0x80) == [(0x18C, b"\x08\0")]

    def test_the_event_timer(self, bench, sensor):
        bench.write(0x1800, 5, 2, 20, 12)
        bench.frame(0, b"\x01\x0c")
        counts = [len(bench.poll(t_us)) for t_us in range(0, 101_000, 10_000)]
        assert counts == [0, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1]
        bench.frame(0, b"\x80\x0c")
        assert bench.poll(120_000) == []

    def test_mapping_is_written_the_canopen_way(self, bench, sensor):
        write = lambda index, sub, size, value: bench.write(index, sub, size, value, 12)  # noqa: E731
        device_state, not_mappable, too_long = 0x08000022, 0x06040041, 0x06040042
        assert write(0x1A00, 0, 1, 0) == device_state  # enabled
        assert write(0x1800, 1, 4, 0x300 | 12) == device_state  # another identifier while enabled
        assert write(0x1800, 1, 4, 0x8000018C) == 0
        assert write(0x1A00, 1, 4, 0x71300210) == device_state  # in use
        assert write(0x1A00, 0, 1, 0) == 0
        assert write(0x1A00, 1, 4, 0x71300220) == not_mappable  # of another length
        assert write(0x1A00, 1, 4, 0x12340010) == not_mappable
        assert write(0x1A00, 1, 4, 0x10170010) == not_mappable
        for sub in range(1, 6):
            assert write(0x1A00, sub, 4, 0x71300210) == 0
        assert write(0x1A00, 0, 1, 9) == too_long
        assert write(0x1A00, 0, 1, 5) == too_long  # 10 bytes
        assert write(0x1A00, 2, 4, 0x71300110) == 0
        assert write(0x1A00, 0, 1, 2) == 0
        assert write(0x1800, 1, 4, 0x80) == 0x06090030  # that of SYNC
        assert write(0x1800, 2, 1, 250) == 0x06090030
        assert write(0x1800, 2, 1, 1) == 0
        assert write(0x1800, 1, 4, 0x30D) == 0
        sensor.store(1, struct.pack("<hh", 1, 2))
        bench.frame(0, b"\x01\x0c")
        assert bench.frame(0x80) == [(0x30D, struct.pack("<hh", 2, 1))]

    def test_our_own_mapping_is_fixed_but_may_be_disabled(self, bench, ours):
        assert bench.write(0x1A00, 0, 1, 0) == 0x06010002
        assert bench.write(0x1800, 1, 4, 0x800001C0) == 0
        assert not ours.publish(1, encode(PUBLICATION[0], WEIGHT))
        assert bench.read(0x9130, 1) == 12345
        assert bench.write(0x1800, 1, 4, 0x1C0) == 0
        assert ours.publish(1, bytes(8))

    def test_we_produce_sync_and_a_sensor_does_not(self, bench, ours, sensor):
        ours.produce_sync()
        sensor.produce_sync()
        assert bench.sent == [(0x80, b"")]
        bench.frame(0, bytes([2, OURS]))
        bench.sent.clear()
        ours.produce_sync()
        assert bench.sent == []


class TestOthers:
    def test_heartbeats_of_others(self, bench):
        heard = []
        node = Node(
            OURS,
            dictionary(own_objects(PUBLICATION, 500, 0, [12 << 16 | 300]), OURS),
            PUBLICATION,
            autostart=True,
            on_peer=lambda *what: heard.append(what),
        )
        bench.add(node)
        for t_us, state in ((0, b"\x00"), (100_000, b"\x7f"), (200_000, b"\x05"), (300_000, b"\x05")):
            bench.frame(0x70C, state, t_us)
        assert bench.frame(0x70C, b"", 300_000) == bench.frame(0x70C, b"\0\0", 300_000) == []
        assert heard == [(12, 0), (12, 127), (12, 5)]
        assert node.heartbeats.state(12) == 5
        assert bench.poll(600_000)[-1:] != [(0xC0, bytes.fromhex("308111 0c00000000"))]
        assert (0xC0, bytes.fromhex("308111 0c00000000")) in bench.poll(600_001)
        assert (heard[-1], node.heartbeats.state(12)) == ((12, None), None)
        assert bench.poll(900_000)[-1:] != [(0xC0, bytes.fromhex("3081110c00000000"))]
        assert bench.frame(0x70C, b"\x05", 900_000) == [(0xC0, bytes(8))]
        assert heard[-1] == (12, 5)

    def test_who_is_watched_can_be_written(self, bench, ours):
        assert bench.write(0x1016, 2, 4, 13 << 16 | 100) == 0
        bench.frame(0x70D, b"\x05", 0)
        assert ours.heartbeats.state(13) == 5

    def test_emergencies_are_told_once_and_remembered(self, bench, ours):
        assert ours.emergencies.occur(0xFF20, 0x80, b"\x01\x02\x03\x04\x05")
        assert not ours.emergencies.occur(0xFF20, 0x80)
        assert bench.sent == [(0xC0, bytes.fromhex("20ff81 0102030405"))]
        ours.emergencies.occur(0x8130, 0x10)
        assert (bench.read(0x1001, 0), bench.read(0x1003, 0)) == (0x91, 2)
        assert (bench.read(0x1003, 1), bench.read(0x1003, 2)) == (0x8130, 0x0201FF20)
        bench.sent.clear()
        assert ours.emergencies.repair(0xFF20)
        assert not ours.emergencies.repair(0xFF20)
        assert bench.sent == [(0xC0, bytes.fromhex("000011 0000000000"))]
        assert bench.write(0x1003, 0, 1, 0) == 0
        assert (bench.read(0x1003, 0), bench.read(0x1003, 1), bench.read(0x1001, 0)) == (0, 0, 0x11)

    def test_a_storm_of_emergencies_takes_no_memory(self, bench, ours):
        for code in range(0xFF00, 0xFF00 + 200):
            ours.emergencies.occur(code & 0xFFFF)
        assert bench.read(0x1003, 0) == 8
        assert len(bench.sent) <= 64


def test_no_frame_upsets_a_node(bench, ours, verdicts):
    """200 000 arbitrary frames, most of them to identifiers of ours: no exception, memory stays, an SDO still works."""
    verdicts += [None] * 200_000
    random = Random(1)
    heads = [
        struct.pack("<BHB", c, i, s) for c in (0x20, 0x21, 0x23, 0x2F, 0x40) for i in ours.data_store for s in (0, 1)
    ]
    ids = [0, 0x80, 0x640, 0x640, 0x640, 0x640, 0x70C, 0x1C0, 0x240]

    def burst(count):
        for k in range(count):
            data = random.randbytes(random.choice((0, 1, 2, 4, 7, 8, 8, 8, 8, 8)))
            if random.random() < 0.5:
                data = (random.choice(heads) + data)[:8]
            can_id = random.choice(ids) if random.random() < 0.9 else random.getrandbits(32)
            if can_id == 0 and random.random() < 0.9:
                data = bytes([1, OURS])
            bench.network.on_frame(Frame(k, can_id, data))
            bench.sent.clear()

    burst(50_000)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    burst(50_000)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    burst(100_000)
    assert grown < 100_000
    bench.frame(0, bytes([129, OURS]))
    assert bench.read(0x1000, 0) == 0x00020194
    assert ours.publish(1, bytes(8))


class Wire:
    """Two networks joined: a client's and a node's; frames arrive in the loop's next turn, answers `turns` later."""

    def __init__(self):
        self.client, self.server = Network(self.to_server), Network(self.to_client)
        self.lost = self.turns = 0

    def to_server(self, can_id, data):
        asyncio.get_running_loop().call_soon(self.server.on_frame, Frame(0, can_id, data))
        return True

    def to_client(self, can_id, data):
        if self.lost:
            self.lost -= 1
        else:
            self.later(self.turns, Frame(0, can_id, data))
        return True

    def later(self, turns, frame):
        again = (self.later, turns - 1, frame) if turns else (self.client.on_frame, frame)
        asyncio.get_running_loop().call_soon(*again)


def with_client(scenario, objects=None):
    """Run `scenario(client, wire, node)` against a node that has `objects`."""

    async def main():
        wire = Wire()
        node = Node(OURS, dictionary(objects or own_objects(PUBLICATION), OURS), PUBLICATION, autostart=True)
        node.associate_network(wire.server)
        node.boot()
        client = Client(wire.client, OURS, 0.1)
        await scenario(client, wire, node)
        client.close()
        assert not wire.client.subscribers.get(0x580 + OURS)

    asyncio.run(main())


class TestClient:
    def test_expedited_and_segmented_both_ways(self):
        long = [
            *own_objects(PUBLICATION),
            Object(0x2000, "Long", 7, (Entry(0, "Long", "s", "rw", "x"),)),
        ]

        async def scenario(client, wire, node):
            assert await client.read(0x1000, 0, "I") == 0x00020194
            assert await client.upload(0x1008, 0) == b"cylforce"
            await client.write(0x1017, 0, "H", 250)
            assert await client.read(0x1017, 0, "H") == 250
            for text in (b"", b"a", b"1234", b"12345", b"1234567", b"12345678", bytes(range(32, 127)) * 10):
                await client.download(0x2000, 0, text)
                assert bytes(node.data_store[0x2000][0]) == text
                if text:
                    assert await client.upload(0x2000, 0) == text

        with_client(scenario, long)

    def test_an_abort_is_a_sentence(self):
        async def scenario(client, wire, node):
            with pytest.raises(AbortedError, match=r"object 1000h:0 of node 64: .*read only.* \(SDO abort 06010002h\)"):
                await client.write(0x1000, 0, "I", 1)

        with_client(scenario)

    def test_silence_ends_in_time_and_the_next_transfer_works(self):
        async def scenario(client, wire, node):
            wire.lost = 1
            with pytest.raises(NoAnswerError, match="object 1000h:0 of node 64: no answer"):
                await client.upload(0x1000, 0)
            assert await client.read(0x1000, 0, "I") == 0x00020194

        with_client(scenario)

    @pytest.mark.parametrize("turns", [0, 1, 5])
    def test_an_answer_that_waits_while_this_program_cannot_run_is_found(self, turns):
        """Whether it is read in the first turn of the loop afterwards or later."""

        async def scenario(client, wire, node):
            asked = asyncio.create_task(client.read(0x1000, 0, "I"))
            wire.turns = turns
            await asyncio.sleep(0.0)
            time.sleep(0.15)  # noqa: ASYNC251  # longer than the time limit
            assert await asked == 0x00020194

        with_client(scenario)

    def test_answers_to_other_questions_are_passed_over(self):
        async def scenario(client, wire, node):
            asked = asyncio.ensure_future(client.read(0x1000, 0, "I"))
            await asyncio.sleep(0)
            for stray in (
                bytes.fromhex("4301100007000000"),
                b"",
                bytes.fromhex("6000100000000000"),
                b"\x80" + bytes(7),
            ):
                wire.client.on_frame(Frame(0, 0x5C0, stray))
            assert await asked == 0x00020194

        with_client(scenario)

    def test_tasks_take_turns(self):
        async def scenario(client, wire, node):
            found = await asyncio.gather(*(client.upload(0x1008, 0) for _ in range(5)), client.upload(0x1001, 0))
            assert found == [b"cylforce"] * 5 + [b"\0"]

        with_client(scenario)


@pytest.mark.parametrize(("profile", "device"), [(404, 0x00020194), (406, 406), (410, 410), (0, 0)])
def test_a_sensor_says_what_it_is(bench, profile, device):
    fields = (Field("angle", 0x6010, 0, "h", 0.0001745, 0.0, "rad", -3.0, 3.0),)
    pdo = Pdo(0x185, 5, 1, False, 0, 0.01, fields)
    described = SensorNode("tilt", 5, profile, (None, 7, None, 9), 0.5, (pdo,), False)
    bench.add(sensor_node(described))
    assert bench.read(0x1000, 0, 5) == device
    assert [bench.read(0x1018, sub, 5) for sub in range(1, 5)] == [0, 7, 0, 9]
    assert (bench.read(0x1A00, 1, 5), bench.read(0x1800, 5, 5)) == (0x60100010, 10)
    assert bench.read(0x6010, 0, 5) == 0x8000
    assert len({made.index for made in sensor_objects(described)}) == len(sensor_objects(described))
