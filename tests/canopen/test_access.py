"""Who may write over SDO: by state, by lock, and identifiers that are never ours."""

import struct
from random import Random

import pytest

from cylforce.canopen.access import BLOCKED_US, OPEN_US, TRIES, LockState
from cylforce.canopen.dictionary.object_dictionary import CODE, PROTECTION, SECONDS_LEFT, own_objects
from cylforce.files.candump import Sent
from cylforce.programs.live.station import without_code
from cylforce.service.publication import publication
from cylforce.signals.events import Frame
from sdo_bench import OWN, SECRET, SERVICE, Bench, aborted

STATE, WRONG, INCOMPATIBLE, TOO_HIGH = 0x08000022, 0x06090030, 0x06040043, 0x06090031
SENSOR = SERVICE.nodes[0]
HEARTBEAT, CONSUMER, OURS = (0x1017, 0, "<H"), (0x1016, 1, "<I"), (0x1800, 1, "<I")
DISABLED = 1 << 31


@pytest.fixture
def bench():
    return Bench()


@pytest.mark.parametrize("address", [HEARTBEAT, CONSUMER, OURS])
@pytest.mark.parametrize("code", [None, SECRET])
def test_supervision_and_communication_are_closed_while_operational(address, code):
    bench = Bench(code)
    before = bench.read(*address[:2])
    assert bench.write(address, before) == STATE
    assert bench.read(*address[:2]) == before
    assert any("refused: locked" in words for words in bench.said)


@pytest.mark.parametrize(("address", "value"), [(HEARTBEAT, 250), (CONSUMER, 13 << 16 | 100), (OURS, DISABLED | 0x1C0)])
def test_they_are_open_while_pre_operational_or_unlocked(bench, address, value):
    bench.nmt(128)
    assert bench.write(address, value) == 0
    bench.nmt(1)
    assert bench.write(address, value) == STATE
    assert bench.unlock() == 0
    assert bench.write(address, value) == 0
    assert bench.read(*address[:2]) == value


@pytest.mark.parametrize("state", ["pre-operational", "unlocked"])
@pytest.mark.parametrize("flags", [0, DISABLED, 1 << 30])
def test_an_identifier_of_a_sensor_or_of_another_pdo_of_ours_is_refused_always(bench, state, flags):
    bench.nmt(128) if state == "pre-operational" else bench.unlock()
    assert bench.write(OURS, DISABLED | 0x1C0) == 0
    foreign = [pdo.can_id for node in SERVICE.nodes for pdo in node.pdos]
    for can_id in (*foreign, *(pdo.can_id for pdo in SERVICE.publication[1:])):
        assert bench.write(OURS, flags | can_id) == INCOMPATIBLE, hex(can_id)
    assert bench.read(0x1800, 1) == DISABLED | 0x1C0
    for can_id in (0, 0x80, 0x580 + OWN, 0x600 + OWN, 0x700 + SENSOR.node_id):
        assert bench.write(OURS, flags | can_id) != 0
    assert bench.write(OURS, 0x1C0) == 0


def test_the_lock_tells_its_state_and_closes_by_itself(bench):
    assert bench.lock is LockState.LOCKED
    assert bench.unlock() == 0
    assert bench.lock is LockState.UNLOCKED
    assert bench.read(PROTECTION, SECONDS_LEFT) == OPEN_US // 1_000_000
    bench.t_us += OPEN_US - 1
    assert bench.write(HEARTBEAT, 250) == 0  # a protected write keeps it open
    bench.t_us += OPEN_US - 1
    assert bench.lock is LockState.UNLOCKED
    bench.t_us += 1
    assert bench.lock is LockState.LOCKED
    assert bench.write(HEARTBEAT, 500) == STATE


@pytest.mark.parametrize("how", ["zero", "reset"])
def test_the_lock_is_closed_on_purpose(bench, how):
    bench.unlock()
    assert bench.unlock(0) == 0 if how == "zero" else bench.nmt(129) is None
    assert bench.lock is LockState.LOCKED


def test_codes_cannot_be_tried_in_a_row(bench):
    for k in range(TRIES):
        assert bench.unlock(k + 1) == WRONG
    assert bench.lock is LockState.BLOCKED
    assert bench.unlock() == STATE  # the right one is not looked at either
    bench.t_us += BLOCKED_US - 1
    assert bench.unlock() == STATE
    bench.t_us += 1
    assert bench.unlock() == 0
    assert sum("wrong code" in words for words in bench.said) == TRIES


def test_without_a_code_nothing_is_unlocked():
    bench = Bench(None)
    assert bench.lock is LockState.NO_CODE
    for code in (1, SECRET, 0xFFFFFFFF):
        assert bench.unlock(code) == STATE
    assert bench.unlock(0) == 0
    assert bench.lock is LockState.NO_CODE


def test_a_code_is_neither_readable_nor_in_the_log(bench):
    bench.unlock()
    answer = bench.ask(struct.pack("<BHB4x", 0x40, PROTECTION, CODE))
    assert aborted(answer) == 0x06010001
    segmented = struct.pack("<BHBI", 0x21, PROTECTION, CODE, 4)
    assert aborted(bench.ask(segmented)) == 0x08000020
    secret = SECRET.to_bytes(4, "little")
    assert not any(secret in event.data for event in bench.log.events if isinstance(event, Frame | Sent))
    logged = [e for e in bench.log.events if isinstance(e, Frame) and e.data[:4] == b"\x23\xa0\x21\x01"]
    assert logged[0].data[4:] == bytes(4)


def test_only_the_code_is_blanked():
    for can_id, data in (
        (0x600 + OWN, b"\x23\xa0\x21\x02abcd"),
        (0x601 + OWN, b"\x23\xa0\x21\x01abcd"),
        (0x1A1, b"ab"),
    ):
        frame = Frame(0, can_id, data)
        assert without_code(frame, OWN) is frame


@pytest.mark.parametrize(
    ("address", "values"),
    [
        (HEARTBEAT, {1: WRONG, 9: WRONG, 10: 0, 10_000: 0, 10_001: TOO_HIGH, 0xFFFF: TOO_HIGH, 0: 0}),
        (CONSUMER, {0: 0, 0x7F << 16 | 0xFFFF: 0, 0x80 << 16: TOO_HIGH, 0xFFFFFFFF: TOO_HIGH}),
        (OURS, {0x180: 0x06090032, 0x57F: 0, 0xFFFFFFFF: TOO_HIGH, 0xC00006E0: TOO_HIGH, DISABLED | 0x580: WRONG}),
    ],
)
def test_limits_hold_when_unlocked(bench, address, values):
    bench.unlock()
    if address == OURS:
        assert bench.write(OURS, DISABLED | 0x1C0) == 0
    for value, code in values.items():
        assert bench.write(address, value) == code, hex(value)
        if not code and address == OURS:
            assert bench.write(OURS, DISABLED | value) == 0


def test_every_object_that_can_be_written_has_limits():
    """But 1003h:0, whose only value and abort code are CiA 301's."""
    for made in own_objects(publication(OWN, 0.1, 1500.0, 300e3)):
        for entry in made.entries:
            if entry.access in ("rw", "wo") and made.index != 0x1003:
                assert entry.low is not None, (hex(made.index), entry)
                assert entry.high is not None, (hex(made.index), entry)


def test_a_change_is_told_with_both_values_and_a_repetition_is_not(bench):
    bench.unlock()
    before = len(bench.said)
    for _ in range(3):
        assert bench.write(HEARTBEAT, 250) == 0
    assert bench.said[before:] == ["1017h:0 from 01f4h to 00fah"]


def test_operators_need_no_code(bench):
    """The service decides on zero and tare, see service/commands.py; here there is no service."""
    assert bench.write((0x6125, 1, "<I"), int.from_bytes(b"zero", "little")) == 0
    assert bench.lock is LockState.LOCKED


def test_random_writes_while_operational_change_no_parameter(bench):
    rng = Random(7)
    before = {index: dict(subs) for index, subs in bench.station.node.data_store.items()}
    for _ in range(20_000):
        index = rng.choice([0x1016, 0x1017, 0x1800, 0x1801, 0x1A00, PROTECTION, 0x1003, rng.randrange(0x10000)])
        data = struct.pack("<BHB", rng.choice([0x22, 0x23, 0x2B, 0x2F, 0x21]), index, rng.randrange(6)) + rng.randbytes(
            4
        )
        bench.ask(data)
    assert {index: dict(subs) for index, subs in bench.station.node.data_store.items()} == before
