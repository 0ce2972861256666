"""An independent protocol analyser decodes our log as CANopen and finds no malformed frame."""

import shutil
import struct
import subprocess

import pytest

from cylforce.files.candump import Sent
from cylforce.files.logfile import Header, LogWriter, running_versions
from cylforce.service.publication import publication
from cylforce.signals.codec import encode
from cylforce.signals.events import ERROR, EXTENDED, REMOTE, Frame, Tick

NODE, SENSOR, T0 = 10, 5, 1_700_000_000_000_000


def tshark(path, *arguments):
    """Lines that tshark prints about a log."""
    program = shutil.which("tshark")
    assert program, "tshark is missing: apt-get install tshark"
    command = [program, "-n", "-r", str(path), "-d", "can.subdissector,canopen", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "damaged" not in done.stderr, done.stderr
    return done.stdout.splitlines()


def commissioning():
    """What passes before a sensor's first PDO, in both directions: (sent by us, identifier, data)."""
    upload = struct.pack("<BHBI", 0x40, 0x1018, 1, 0)
    answer = struct.pack("<BHBI", 0x43, 0x1018, 1, 0x1234)
    download = struct.pack("<BHBI", 0x23, 0x1800, 1, 0x185)
    return [
        (False, 0x700 + SENSOR, b"\0"),
        (True, 0x600 + SENSOR, upload),
        (False, 0x580 + SENSOR, answer),
        (True, 0x600 + SENSOR, download),
        (False, 0x580 + SENSOR, struct.pack("<BHBI", 0x60, 0x1800, 1, 0)),
        (False, 0x580 + SENSOR, struct.pack("<BHBI", 0x80, 0x1800, 1, 0x06090030)),
        (True, 0x000, bytes((1, SENSOR))),
        (True, 0x700 + NODE, b"\x05"),
        (False, 0x700 + SENSOR, b"\x05"),
        (True, 0x080 + NODE, struct.pack("<HB5x", 0x8130, 0x11)),
    ]


def cycle(t_us):
    """One period: SYNC, a sensor's PDO, the tick, what we publish."""
    yield Sent(t_us, 0x080, b"")
    yield Frame(t_us + 300, 0x180 + SENSOR, struct.pack("<hh", -120, 3000))
    yield Tick(t_us + 1_000)
    for pdo in publication(NODE, 0.01, 1500.0, 1e5):
        yield Sent(t_us + 1_200, pdo.can_id, encode(pdo, {}))


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "run.log"
    header = Header(
        versions=running_versions(),
        machine="config/excavator_20t.toml",
        machine_sha256="ab" * 32,
        identified_sha256="cd" * 32,
        state={"zero": 0.0, "tare": 12.5},
        bus="socketcan:vcan0",
        node_id=NODE,
    )
    with LogWriter(path, header, T0, "vcan0") as writer:
        for k, (ours, can_id, data) in enumerate(commissioning()):
            writer.log((Sent if ours else Frame)(T0 + k, can_id, data))
        for k in range(200):
            for event in cycle(T0 + 10_000 * (k + 1)):
                writer.log(event)
        for can_id in (0x18FEEE00 | EXTENDED, 0x185 | REMOTE, 0x004 | ERROR):
            writer.log(Frame(T0 + 3_000_000, can_id, bytes(8)))
    return path


def test_our_log_holds_no_malformed_frame(log):
    frames = len(log.read_text().splitlines())
    assert len(tshark(log)) == frames
    assert tshark(log, "-Y", "_ws.malformed") == []
    assert tshark(log, "-Y", "_ws.expert.severity >= error") == []
    assert len(tshark(log, "-Y", "canopen")) == frames - 3  # extended, remote and error frames are no CANopen


def test_every_service_is_recognised(log):
    text = "\n".join(tshark(log))
    for word in ("SYNC", "PDO1 (tx)", "PDO4 (tx)", "NMT", "EMCY", "SDO", "Boot-up", "Operational"):
        assert word in text, word
    ticks, ours = 200, 200
    assert sum("SYNC" in line for line in text.splitlines()) == ticks + ours


def test_times_are_exact_to_the_microsecond(log):
    times = tshark(log, "-T", "fields", "-e", "frame.time_epoch")
    assert "1700000000.010000000" in times
    assert "1700000000.010300000" in times
    assert "1700000000.011000000" in times
