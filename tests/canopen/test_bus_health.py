"""What happens to the bus itself, as emergencies: error frames, lost frames, a bus that was away."""

import itertools
import struct

import pytest

from cylforce.canopen.bus_health import CLEAN_US, COLLISION, OVERRUN, PASSIVE, RECOVERED, REOPENED, BusHealth, Tally
from cylforce.canopen.emergency import Emergencies
from cylforce.canopen.startup import Outcome, Stage
from cylforce.programs.live.edge import LONGEST_US, SILENT_US, Edge
from cylforce.programs.live.wanted import wanted
from cylforce.settings.machine_file import load
from cylforce.signals.events import ERROR, EXACTLY, EXTENDED, Frame
from scenarios import EXCAVATOR

SERVICE = load(EXCAVATOR).service
CONTROLLER, BUS_OFF, RESTARTED = ERROR | 0x4, ERROR | 0x40, ERROR | 0x100


class Seen:
    """A bus that takes EMCY messages while `takes`: the codes that it got, 0 for a repaired one."""

    def __init__(self):
        self.codes, self.takes, self.told = [], True, []
        self.emergencies = Emergencies(self.send, lambda *a: None)
        self.health = BusHealth(self.emergencies, self.told.append)

    def send(self, data):
        if self.takes:
            self.codes.append(struct.unpack_from("<H", data)[0])
        return self.takes


@pytest.fixture
def seen():
    return Seen()


def flags(byte, kind=CONTROLLER, t_us=0):
    return Frame(t_us, kind, bytes([0, byte, 0, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize(
    ("frame", "code"),
    [
        (flags(0x01), OVERRUN),
        (flags(0x02), OVERRUN),
        (flags(0x10), PASSIVE),
        (flags(0x20), PASSIVE),
        (flags(0x00, RESTARTED), RECOVERED),
    ],
)
def test_an_error_frame_is_an_emergency_once_and_over_after_a_second(seen, frame, code):
    for _ in range(3):
        seen.health.on_frame(frame)
    assert seen.codes == [code]
    assert len(seen.told) == 1
    seen.health.on_frame(flags(0x40))
    seen.health.update(Tally(), CLEAN_US - 1)
    assert seen.codes == [code]
    seen.health.update(Tally(), CLEAN_US)
    assert seen.codes == [code, 0]


def test_error_passive_lasts_until_the_controller_is_active_again(seen):
    seen.health.on_frame(flags(0x10))
    for t in range(0, 10 * CLEAN_US, CLEAN_US // 2):
        seen.health.update(Tally(), t)
    assert seen.codes == [PASSIVE]
    seen.health.on_frame(flags(0x40, t_us=10 * CLEAN_US))
    seen.health.update(Tally(), 12 * CLEAN_US)
    assert seen.codes == [PASSIVE, 0]


@pytest.mark.parametrize("frame", [flags(0x00), flags(0x04), Frame(0, BUS_OFF, bytes(8)), Frame(0, CONTROLLER, b"")])
def test_what_says_nothing_wrong_is_none(seen, frame):
    seen.health.on_frame(frame)
    assert seen.codes == []


def test_no_bytes_of_an_error_frame_raise(seen):
    for kind in range(0x200):
        for length in (0, 1, 2, 8):
            seen.health.on_frame(Frame(0, ERROR | kind, b"\xff" * length))
    assert set(seen.codes) == {OVERRUN, PASSIVE, RECOVERED}


def test_an_ordinary_frame_with_the_same_low_bits_is_none(seen):
    for can_id in (0x4, 0x100, EXTENDED | 0x104):
        seen.health.on_frame(Frame(0, can_id, b"\xff" * 8))
    assert seen.codes == []


@pytest.mark.parametrize(
    ("tally", "code"), [(Tally(lost=1), OVERRUN), (Tally(dropped=1), OVERRUN), (Tally(reopened=1), REOPENED)]
)
def test_what_is_counted_is_an_emergency_when_it_grows(seen, tally, code):
    seen.health.update(Tally(), 0)
    seen.health.update(tally, 1)
    seen.health.update(tally, CLEAN_US)
    assert seen.codes == [code]
    seen.health.update(tally, CLEAN_US + 1)
    assert seen.codes == [code, 0]


def test_an_emergency_that_the_bus_could_not_take_is_sent_when_it_can(seen):
    """Bus-off, or a full queue: it is about just that."""
    seen.takes = False
    seen.health.update(Tally(dropped=1), 0)
    seen.health.on_frame(flags(0x00, RESTARTED))
    seen.emergencies.flush()
    assert seen.codes == []
    seen.takes = True
    seen.emergencies.flush()
    assert seen.codes == [OVERRUN, RECOVERED]


def test_a_long_time_without_bus_keeps_the_last_emergencies_only(seen):
    seen.takes = False
    for k in range(1000):
        seen.emergencies.occur(0xFF00, 0, bytes([k % 256]))
        seen.emergencies.repair(0xFF00)
    seen.takes = True
    seen.emergencies.flush()
    assert len(seen.codes) == 64
    assert seen.codes[-1] == 0


def test_a_collision_names_the_node(seen):
    seen.health.doubled(17, 0)
    assert seen.codes == [COLLISION]


def test_what_is_wanted_is_what_the_service_reads_and_its_own(seen):
    exact = {can_id for can_id, mask in wanted(SERVICE) if mask == EXACTLY}
    own = SERVICE.node_id
    for node in SERVICE.nodes:
        assert {pdo.can_id for pdo in node.pdos} | {0x700 + node.node_id, 0x580 + node.node_id} <= exact
    assert {0, 0x80, 0x600 + own, 0x180 + own, 0x700 + own} <= exact
    assert not exact & {0x123, 0x600 + SERVICE.nodes[0].node_id, 0x77F}
    assert {can_id for can_id, _ in wanted(SERVICE, {0x77F})} - exact == {0x77F}
    assert len(wanted(SERVICE._replace(j1939_address=0x21))) == len(exact) + 2


class FakeBus:
    def __init__(self):
        self.accepted = []

    def accept(self, filters):
        self.accepted.append(filters)


class FakeNode:
    emergencies = None


@pytest.fixture
def edge():
    begun = []
    made = Edge(SERVICE, FakeBus(), FakeNode(), begun.append, lambda words: None)
    return made, begun


def test_a_node_that_is_operational_and_sends_nothing_is_set_up_again_ever_more_rarely(edge):
    made, begun = edge
    node = SERVICE.nodes[0]
    outcomes = {node.node_id: Outcome(node, Stage.OPERATIONAL, "")}
    times = []
    for t in range(10 * SILENT_US, 200 * SILENT_US, SILENT_US):
        made.wake(outcomes, t)
        if len(begun) > len(times):
            times.append(t)
    assert set(begun) == {node.node_id}
    waits = [b - a for a, b in itertools.pairwise(times)]
    assert waits[:4] == [k * SILENT_US for k in (1, 2, 4, 8)]
    assert max(waits) == LONGEST_US


@pytest.mark.parametrize("stage", [Stage.SILENT, Stage.REFUSED, Stage.FAILED])
def test_a_node_that_is_not_operational_is_the_commissioners(edge, stage):
    made, begun = edge
    node = SERVICE.nodes[0]
    for t in range(10 * SILENT_US, 60 * SILENT_US, SILENT_US):
        made.wake({node.node_id: Outcome(node, stage, "")}, t)
    assert begun == []


def test_a_node_that_sends_is_left_alone(edge):
    made, begun = edge
    node = SERVICE.nodes[0]
    for t in range(10 * SILENT_US, 60 * SILENT_US, SILENT_US):
        for pdo in node.pdos:
            made.on_frame(Frame(t, pdo.can_id, b""))
        made.wake({node.node_id: Outcome(node, Stage.OPERATIONAL, "")}, t)
    assert begun == []


def test_the_bus_is_asked_once_for_the_same_and_again_for_more():
    bus = FakeBus()
    made = Edge(SERVICE, bus, FakeNode(), [].append, lambda words: None)
    for subscribed in ({0x740}, {0x740}, {0x740, 0x77F}):
        made.filter(frozenset(subscribed))
    assert len(bus.accepted) == 2
