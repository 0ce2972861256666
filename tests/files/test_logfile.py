"""A log is read back as it was written; what is broken says where; foreign recordings become events."""

import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import can
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cylforce.files.atomic import RecordingError
from cylforce.files.candump import Sent, event_line, own_event, parsed, parts, parts_of
from cylforce.files.logfile import Header, LogWriter, file_sha256, running_versions
from cylforce.files.logreader import mismatches, read_events, with_ticks
from cylforce.signals.events import ERROR, EXTENDED, REMOTE, Frame, Tick

T0 = 1_700_000_000_123_456
PERIOD_US = 10_000
HEADER = Header(
    versions=running_versions(),
    machine="config/excavator 20 t (Größe 2).toml",
    machine_sha256="ab" * 32,
    identified_sha256=None,
    state={"zero": 0.1 + 0.2, "tare": -1e-300, "list": [1, None, "x"]},
    bus="socketcan:can0",
    node_id=10,
)


def silent(sentence):
    raise AssertionError(f"nothing was to be told, but: {sentence}")


def read(path, period_us=PERIOD_US, **options):
    options.setdefault("report", silent)
    header, events = read_events(path, period_us, **options)
    return header, list(events)


def written(path, events, channel="can0", **options):
    with LogWriter(path, HEADER, T0, channel, **options) as log:
        for event in events:
            log.log(event)
    return log


TIMES = st.integers(0, 4_102_444_800_000_000)  # until the year 2100, to the microsecond
DATA = st.binary(max_size=8)
IDS = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x1FFFFFFF).map(lambda i: i | EXTENDED),
    st.integers(0, 0x1FFFFFFF).map(lambda i: i | ERROR),
)
FRAMES = st.builds(Frame, TIMES, IDS, DATA)
REMOTES = st.builds(
    lambda t, i, n: Frame(t, i | REMOTE, bytes(n)),
    TIMES,
    IDS.filter(lambda i: not i & ERROR),
    st.integers(0, 8),
)
EVENTS = st.one_of(FRAMES, REMOTES, st.builds(Tick, TIMES), st.builds(Sent, TIMES, IDS, DATA))


@settings(max_examples=300)
@given(EVENTS)
def test_one_event_as_a_line_and_back(event):
    said = parsed(event_line(event, "vcan0"))
    assert own_event(said) == event
    assert type(own_event(said)) is type(event)


@settings(max_examples=30, deadline=None)
@given(st.lists(EVENTS, max_size=60))
def test_any_sequence_of_events_is_read_back_identical(tmp_path_factory, events):
    path = tmp_path_factory.mktemp("log") / "run.log"
    log = written(path, events)
    header, back = read(path)
    assert header == HEADER
    assert back == events
    assert [type(e) for e in back] == [type(e) for e in events]
    assert log.lost == 0


def test_the_text_is_candump_s(tmp_path):
    path = tmp_path / "run.log"
    written(path, [Tick(1_000_001), Frame(1_000_002, 0x185, b"\x01\xaf"), Sent(1_000_003, 0x18A, b"")])
    assert path.read_text().splitlines()[-3:] == [
        "(0000000001.000001) tick 080#",
        "(0000000001.000002) can0 185#01AF",
        "(0000000001.000003) sent 18A#",
    ]


@pytest.mark.parametrize("channel", ["tick", "sent", "cylforce", "ws://127.0.0.1:5/", "a b", "x" * 16, ""])
def test_a_bus_whose_name_is_no_channel_is_can0(tmp_path, channel):
    events = [Frame(T0, 0x185, b"\x01"), Tick(T0 + 1)]
    written(tmp_path / "run.log", events, channel=channel)
    assert read(tmp_path / "run.log")[1] == events
    assert " can0 185#01\n" in (tmp_path / "run.log").read_text()


def test_the_log_grows_while_it_is_written_and_is_kept_when_killed(tmp_path):
    path = tmp_path / "run.log"
    script = f"""
import os, signal, time
from pathlib import Path
from cylforce.files.logfile import Header, LogWriter
from cylforce.signals.events import Tick
log = LogWriter(Path({str(path)!r}), Header.model_validate({HEADER.model_dump()!r}), {T0}, "can0")
for k in range(300):
    log.log(Tick({T0} + k * 10_000))
while log.backlog:
    time.sleep(0.01)
os.kill(os.getpid(), signal.SIGKILL)
"""
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == -9
    ticks = read(path)[1]
    assert ticks == [Tick(T0 + k * 10_000) for k in range(len(ticks))]
    assert 300 - len(ticks) <= 51  # no more than half a second


def test_a_full_disk_ends_the_log_not_the_caller():
    told = []
    log = written(Path("/dev/full"), [Tick(T0 + k * 10_000) for k in range(500)], report=told.append)
    assert log.lost == 500
    assert told == ["/dev/full: logging stopped: No space left on device; all else goes on"]


def test_a_stalled_disk_ends_the_log_before_memory_does(tmp_path):
    """The disk is a pipe that is full and that nobody reads."""
    told, path = [], tmp_path / "run.log"
    os.mkfifo(path)
    disk = os.open(path, os.O_RDWR | os.O_NONBLOCK)
    with suppress(BlockingIOError):
        while os.write(disk, bytes(4096)):
            pass
    log = LogWriter(path, HEADER, T0, "can0", report=told.append, backlog_bytes=10_000, close_s=0.05)
    for k in range(2000):
        log.log(Tick(T0 + k * 10_000))
    log.close()
    os.close(disk)
    assert log.lost == 2000
    assert told == [f"{path}: logging stopped: the disk does not keep up; all else goes on"]


def test_an_older_log_is_set_aside(tmp_path):
    for k in range(3):
        written(tmp_path / "run.log", [Tick(T0 + k)])
    assert [read(tmp_path / name)[1] for name in ("run.1.log", "run.2.log", "run.log")] == [
        [Tick(T0)],
        [Tick(T0 + 1)],
        [Tick(T0 + 2)],
    ]


def test_a_log_that_cannot_be_opened_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"absent/run.log: cannot be written: No such file"):
        LogWriter(tmp_path / "absent" / "run.log", HEADER, T0, "can0")


def test_mismatches_are_sentences(tmp_path):
    path = tmp_path / "run.log"
    assert mismatches(path, HEADER, HEADER) == ()
    machine = tmp_path / "other.toml"
    machine.write_text("x")
    other = HEADER.model_copy(
        update={
            "machine": "other.toml",
            "machine_sha256": file_sha256(machine),
            "identified_sha256": "cd" * 32,
            "node_id": 11,
            "versions": HEADER.versions | {"numpy": "9.9"},
        }
    )
    text = "\n".join(mismatches(path, HEADER, other))
    for part in ("another machine file", "no identified file, this is", "node 10, not", "numpy 9.9"):
        assert part in text
    assert len(text.splitlines()) == 4


def broken_header(path, old, new):
    written(path, [])
    lines = path.read_text().splitlines(keepends=True)
    data = bytes.fromhex("".join(line.split("#")[1].strip() for line in lines)).replace(old, new)
    data += b" " * (-len(data) % 8)
    head = lines[0].split("#")[0]
    path.write_text("".join(f"{head}#{data[k : k + 8].hex()}\n" for k in range(0, len(data), 8)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b'"format": 1', b'"format": 2', "is a log of format 2, this cylforce reads format 1 only"),
        (b'"format": 1', b'"formal": 1', "the log's header is broken"),
        (b'"node_id": 10', b'"node_id": "x"', "the log's header is broken"),
        (b'"node_id"', b"node_id", "the log's header is broken"),
        (b"{", b"[", "the log's header is broken"),
    ],
)
def test_a_header_that_cannot_be_used_is_refused(tmp_path, old, new, message):
    broken_header(tmp_path / "run.log", old, new)
    with pytest.raises(RecordingError, match=message):
        read_events(tmp_path / "run.log", PERIOD_US)


@pytest.mark.parametrize("keep", [1, 20, 44])
def test_a_cut_last_line_is_left_out_and_told(tmp_path, keep):
    path, told = tmp_path / "run.log", []
    written(path, [Tick(T0), Frame(T0 + 1, 0x185, bytes(8))])
    text = path.read_text()
    start = text.rindex("(")
    path.write_text(text[: start + keep])
    assert read(path, report=told.append)[1] == [Tick(T0)]
    assert len(told) == 1
    assert f"line {text.count(chr(10))}, the last, is cut off" in told[0]


FOREIGN = """\
# a comment, as can-utils allows
(1700000000.000000) can0 185#0102

(1700000000.004) can0 12345678#01 R
(1700000000.010000000) can0 081#R T
(1700000000.010001) can0 185#R8
(1700000000.020000) can0 20000004#0000000000000000
(1700000000.020001) can0 185##1AABB
(1700000000.020001) can0 45123#81:00:12345678#11223344 R
(1700000000.020002) can0 18A#00
"""
S = 1_700_000_000_000_000
FOREIGN_EVENTS = [
    Frame(S, 0x185, b"\x01\x02"),
    Frame(S + 4_000, 0x12345678 | EXTENDED, b"\x01"),
    Frame(S + 10_000, 0x81 | REMOTE, b""),
    Tick(S + 10_000),
    Frame(S + 10_001, 0x185 | REMOTE, bytes(8)),
    Frame(S + 20_000, 4 | ERROR, bytes(8)),
    Tick(S + 20_000),
    Sent(S + 20_002, 0x18A, b"\x00"),
    Tick(S + 30_000),
]


def test_a_foreign_log_gets_ticks_and_our_own_frames_are_told_apart(tmp_path):
    path, told = tmp_path / "candump.log", []
    path.write_text(FOREIGN)
    assert read(path, own_ids=frozenset({0x18A}), report=told.append) == (None, FOREIGN_EVENTS)
    assert told == [f"{path}: 2 CAN FD or XL frames were skipped"]


def test_a_last_line_without_its_end_is_taken_if_it_is_whole(tmp_path):
    path = tmp_path / "candump.log"
    path.write_text("(1.000000) can0 185#01")
    assert read(path)[1] == [Frame(1_000_000, 0x185, b"\x01"), Tick(1_010_000)]


@pytest.mark.parametrize(
    "line",
    [
        "nonsense",
        "(1.0) can0",
        "(1.0) can0 185",
        "(1.0) can0 185#123",
        "(1.0) can0 185#" + "00" * 9,
        "(1.0) can0 1850#00",
        "(1.0) can0 FFFFFFFF#00",
        "(-1.0) can0 185#00",
        "(1.0) can0 185#0G",
        "(1.0) can0 185#00 X",
        "\0" * 40,
    ],
)
def test_a_broken_line_names_file_and_line(tmp_path, line):
    path = tmp_path / "broken.log"
    path.write_text(f"(1.000000) can0 185#01\n{line}\n(1.000000) can0 185#01\n")
    with pytest.raises(RecordingError, match=r"broken.log, line 2: is no frame of candump text"):
        read(path)


def test_two_buses_are_not_merged(tmp_path):
    path = tmp_path / "two.log"
    path.write_text("(1.000000) can0 185#01\n(1.000000) can1 186#02\n")
    with pytest.raises(RecordingError, match=r"holds several buses \(can0, can1, \.\.\.\): choose one"):
        read(path)
    assert read(path, channel="can1")[1][0] == Frame(1_000_000, 0x186, b"\x02")
    with pytest.raises(RecordingError, match=r"holds no frame of can2, only of can0, can1"):
        read(path, channel="can2")


def test_what_is_no_recording_is_refused(tmp_path):
    (tmp_path / "empty.log").touch()
    with pytest.raises(RecordingError, match=r"empty\.log: holds no frame"):
        read(tmp_path / "empty.log")
    with pytest.raises(RecordingError, match=r"absent\.log: does not exist"):
        read(tmp_path / "absent.log")
    with pytest.raises(RecordingError, match=r"x\.trc: is none of the recordings that can be read"):
        read(tmp_path / "x.trc")
    for suffix in (".blf", ".asc"):
        with pytest.raises(RecordingError, match=f"absent{suffix}: cannot be read: No such file"):
            read(tmp_path / f"absent{suffix}")


@settings(max_examples=200)
@given(st.lists(st.integers(0, 3_000_000), min_size=1, max_size=50).map(sorted), st.integers(1_000, 50_000))
def test_ticks_stand_at_the_period_s_boundaries(times, period):
    events = list(with_ticks((Frame(t, 1, b"") for t in times), period, silent))
    ticks = [e.t_us for e in events if isinstance(e, Tick)]
    assert [e.t_us for e in events if isinstance(e, Frame)] == times
    assert ticks == [times[0] + k * period for k in range(1, len(ticks) + 1)]
    assert times[-1] <= ticks[-1] < times[-1] + period + (times[-1] == times[0])
    assert [e.t_us for e in events] == sorted(e.t_us for e in events)


@pytest.mark.parametrize("jump", [10**15, -(10**15) // 2])
def test_a_clock_that_is_set_makes_no_ticks_in_between(jump):
    told, t = [], 10**15
    frames = [
        Frame(t, 1, b""),
        Frame(t + 1, 1, b""),
        Frame(t + jump, 1, b""),
        Frame(t + jump + 10_000, 1, b""),
    ]
    events = list(with_ticks(iter(frames), PERIOD_US, told.append))
    assert [e.t_us for e in events if isinstance(e, Tick)] == [t + jump + 10_000]
    assert len(told) == 1


MESSAGES = [
    can.Message(timestamp=1_700_000_000.0, arbitration_id=0x185, is_extended_id=False, data=b"\x01\x02", channel=0),
    can.Message(timestamp=1_700_000_000.004, arbitration_id=0x12345678, data=b"\x01", channel=0, is_rx=False),
    can.Message(
        timestamp=1_700_000_000.01,
        arbitration_id=0x81,
        is_extended_id=False,
        is_remote_frame=True,
        dlc=2,
        channel=0,
    ),
    can.Message(timestamp=1_700_000_000.010001, arbitration_id=0x18A, is_extended_id=False, data=b"\x00", channel=0),
]
CLASSIC = [
    (0, Frame(0, 0x185, b"\x01\x02")),
    (4_000, Frame(0, 0x12345678 | EXTENDED, b"\x01")),
    (10_000, Frame(0, 0x81 | REMOTE, bytes(2))),
    (10_000, Tick(0)),
    (10_001, Sent(0, 0x18A, b"\x00")),
    (20_000, Tick(0)),
]


def record(path, messages):
    with can.Logger(str(path)) as logger:
        for message in messages:
            logger(message)


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc", ".ASC"])
def test_python_can_s_recordings(tmp_path, suffix):
    path = tmp_path / f"python-can{suffix}"
    record(path, MESSAGES)
    header, events = read(path, own_ids=frozenset({0x18A}))
    start = events[0].t_us
    assert header is None
    assert start == (0 if suffix.lower() == ".asc" else S)
    expected = [e._replace(t_us=start + t) for t, e in CLASSIC]
    if suffix == ".log":  # python-can leaves a remote frame's length out there
        expected[2] = expected[2]._replace(data=b"")
    assert events == expected


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_fd_frames_are_passed_over_and_error_frames_marked(tmp_path, suffix):
    path, told = tmp_path / f"mixed{suffix}", []
    fd = can.Message(timestamp=1.7e9, arbitration_id=0x185, is_fd=True, data=bytes(12), channel=0)
    error = can.Message(timestamp=1.7e9 + 1e-3, is_error_frame=True, channel=0)
    record(path, [MESSAGES[0], fd, error])
    frames = [e for e in read(path, report=told.append)[1] if isinstance(e, Frame)]
    assert len(frames) == 2
    assert frames[1].can_id & ERROR
    assert told == [f"{path}: 1 CAN FD frames were skipped"]


def test_a_cut_blf_is_read_as_far_as_it_goes(tmp_path):
    path, told = tmp_path / "cut.blf", []
    many = [
        can.Message(timestamp=1.7e9 + k * 1e-3, arbitration_id=0x185, is_extended_id=False, data=bytes([k & 255] * 8))
        for k in range(20_000)
    ]
    record(path, many)
    path.write_bytes(path.read_bytes()[:-3_000])
    frames = [e for e in read(path, report=told.append)[1] if isinstance(e, Frame)]
    assert 0 < len(frames) < 20_000
    assert len(told) == 1
    assert "was not closed by its writer" in told[0]


def test_a_blf_with_fewer_objects_than_its_header_says_is_reported(tmp_path):
    """A copy that lost whole containers, with a header that fits its size; objects of other kinds count."""
    whole, path, told = tmp_path / "whole.blf", tmp_path / "copy.blf", []
    with can.BLFWriter(str(whole)) as log:
        log.max_container_size = 2048
        for k in range(400):
            message = can.Message(timestamp=1.7e9 + 0.01 * k, arbitration_id=0x185, is_extended_id=False, data=b"\1")
            message.channel = 0
            log.on_message_received(message)
        log.log_event("a marker", 1.7e9 + 5.0)
    assert sum(isinstance(e, Frame) for e in read(whole)[1]) == 400
    content = bytearray(whole.read_bytes()[: whole.stat().st_size // 2])
    content[16:24] = len(content).to_bytes(8, "little")
    path.write_bytes(content)
    frames = [e for e in read(path, report=told.append)[1] if isinstance(e, Frame)]
    assert 50 < len(frames) < 400
    assert len(told) == 1
    assert f"copy.blf: holds {len(frames)} objects, its header says 401: frames are missing" in told[0]


@pytest.mark.parametrize("last", ["(1.020000) can0 185#01020", "(1.020000) can0 18", "(1.0200"])
def test_a_last_line_that_is_cut_off_is_left_out(tmp_path, last):
    path, told = tmp_path / "cut.log", []
    path.write_text(f"(1.000000) can0 185#010203\n(1.010000) can0 185#010203\n{last}")
    frames = [e for e in read(path, report=told.append)[1] if isinstance(e, Frame)]
    assert [frame.data for frame in frames] == [b"\1\2\3"] * 2
    assert told == [f"{path}: line 3, the last, is cut off and was left out"]


@pytest.mark.parametrize("content", [b"", b"LOGG", b"no recording at all" * 100])
def test_what_is_no_blf_is_refused(tmp_path, content):
    path = tmp_path / "no.blf"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"no\.blf: is broken after frame 0: "):
        read(path)


def test_a_broken_blf_names_the_frame(tmp_path):
    path = tmp_path / "broken.blf"
    record(path, MESSAGES * 10_000)
    content = bytearray(path.read_bytes())
    middle = content.index(b"LOBJ", 200)
    content[middle : middle + 4] = b"XXXX"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"broken\.blf: is broken after frame [1-9]"):
        read(path, report=[].append)  # the messages' stamps repeat


ASC = """date Tue Nov 14 22:13:20.000 2023
base hex  timestamps {kind}
no internal events logged
// version 9.0.0
   0.000000 1  185             Rx   d 2 01 02
   0.001000 1  185             Rx   d 2 01 {byte}
"""


def test_asc_by_hand(tmp_path):
    path = tmp_path / "hand.asc"
    path.write_text(ASC.format(kind="absolute", byte="0A"))
    assert read(path)[1][1] == Frame(1_000, 0x185, b"\x01\x0a")
    path.write_text(ASC.format(kind="absolute", byte="ZZ"))
    with pytest.raises(RecordingError, match=r"hand\.asc, line 6: is no frame"):
        read(path)
    path.write_text(ASC.format(kind="relative", byte="0A"))
    with pytest.raises(RecordingError, match="its times are relative; save it with absolute times"):
        read(path)


def test_our_log_through_python_can(tmp_path):
    """Others read our log too: python-can takes header, ticks and sent frames for channels of their own."""
    path = tmp_path / "run.log"
    written(path, [Tick(T0), Frame(T0 + 1, 0x185, b"\x01"), Sent(T0 + 2, 0x18A, b"\x02")])
    with can.LogReader(str(path)) as reader:
        found = [(m.channel, m.arbitration_id, bytes(m.data)) for m in reader if m.channel != "cylforce"]
    assert found == [("tick", 0x80, b""), ("can0", 0x185, b"\x01"), ("sent", 0x18A, b"\x02")]


def test_an_interrupted_reader_leaves_no_open_file(tmp_path):
    path = tmp_path / "run.log"
    written(path, [Tick(T0 + k) for k in range(1000)])
    _, events = read_events(path, PERIOD_US)
    assert next(events) == Tick(T0)
    del events
    shutil.rmtree(tmp_path)


@settings(max_examples=200)
@given(st.lists(EVENTS, max_size=8), st.integers(0, 10**6), st.sampled_from("()#. 0129AFRTabx\t\r\n_-\xb2"))
def test_a_block_is_read_as_its_lines(events, at, letter):
    """All of it at once, or not at all; with one letter changed, too."""
    whole = "".join(event_line(event, "can0") for event in events)
    changed = whole[: at % len(whole)] + letter + whole[at % len(whole) + 1 :] if whole else letter
    for text in (whole, changed):
        found = parts_of(text)
        if found is not None:
            assert found == [parts(line) for line in text.removesuffix("\n").split("\n") if text]
    ours = [e for e in events if isinstance(e, Tick) or e.can_id <= 0x7FF]
    assert parts_of("".join(event_line(e, "can0") for e in ours)) is not None or not ours
