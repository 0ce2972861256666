"""Service and simulated excavator as processes of their own on vcan0: commissioned, published, zeroed, stopped,
replayed, and read by an independent protocol analyser."""

import asyncio
import re
import shutil
import struct
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.can.opening import open_bus
from cylforce.commissioning.identification import identify
from cylforce.files.candump import Sent
from cylforce.files.logreader import read_events
from cylforce.programs.common.readings import model_of
from cylforce.programs.replay import run_replay
from cylforce.settings.identified import write_identified
from cylforce.settings.machine_file import load
from cylforce.signals.codec import decode
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.events import Frame, Tick
from scenarios import EXCAVATOR, moved

BUS = "socketcan:vcan0"
COMMAND = (sys.executable, "-m", "cylforce")
SECONDS = 10.0  # after the sensors' first PDO
OURS = 64
ZERO, TARE = (struct.pack("<BHB", 0x23, index, 1) for index in (0x6125, 0x6139))
DONE, NOT_NOW, RANGE = b"\x60", 0x08000022, 0x06090030
PAYLOAD, QUALITY = 0x180 + OURS, 0x480 + OURS


class Operator:
    """Sits on the bus: keeps every frame, tries to zero too early, then with a wrong word, then rightly."""

    def __init__(self, machine):
        self.layouts = {pdo.can_id: pdo for pdo in machine.service.publication}
        self.sensors = {pdo.can_id for node in machine.service.nodes for pdo in node.pdos}
        self.bus = open_bus(BUS)
        self.frames, self.answers, self.gross = [], [], np.nan
        self.requests = [ZERO + b"zero", TARE + b"tare", ZERO + b"ZERO", ZERO + b"zero"]
        self.first, self.zeroed = asyncio.Event(), asyncio.Event()

    def on_frame(self, frame):
        self.frames.append(frame)
        if frame.can_id in self.sensors:
            self.first.set()
        elif frame.can_id == PAYLOAD:
            self.gross = decode(self.layouts[PAYLOAD], frame.data)["payload_gross"]
        elif frame.can_id == QUALITY:
            self.act(int(decode(self.layouts[QUALITY], frame.data)["payload_quality"]))
        elif frame.can_id == 0x580 + OURS:
            self.answers.append(frame.data)
            if len(self.answers) == 4:
                self.zeroed.set()

    def act(self, quality):
        """The first two requests at once, the others when an empty bucket is weighed."""
        empty = Status(quality & 3) is Status.OK and abs(self.gross) < 25.0
        if self.requests and (empty or len(self.requests) > 2) and len(self.answers) + len(self.requests) == 4:
            self.bus.send(0x600 + OURS, self.requests.pop(0))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Some seconds of both programs; everything that they left."""
    folder = tmp_path_factory.mktemp("daemon")
    path, tares, log = folder / "machine.toml", folder / "identified.toml", folder / "run.log"
    path.write_text(EXCAVATOR.read_text().replace("\nperiod_ms = 50\n", "\nperiod_ms = 10\n"))
    machine = load(path)
    write_identified(tares, identify(model_of(machine), [moved(machine)]), machine, [])
    operator = None

    async def main():
        nonlocal operator
        operator = Operator(machine)
        operator.bus.attach(asyncio.get_running_loop(), operator.on_frame)
        pipe = {"stderr": asyncio.subprocess.PIPE, "stdout": asyncio.subprocess.PIPE}
        words = ("run", path, "--bus", BUS, "--identified", tares, "--log", log)
        daemon = await asyncio.create_subprocess_exec(*COMMAND, *map(str, words), **pipe)
        words = ("sim", path, "--bus", BUS, "--cycles", "1", "--seed", "3", "--truth", folder / "truth.csv")
        sim = await asyncio.create_subprocess_exec(*COMMAND, *map(str, words), **pipe)
        try:
            await asyncio.wait_for(operator.first.wait(), 60.0)
            await asyncio.wait_for(operator.zeroed.wait(), 60.0)
            await asyncio.sleep(SECONDS)
        finally:
            daemon.terminate()
            said = await asyncio.wait_for(daemon.communicate(), 20.0)
            sim.terminate()
            await asyncio.wait_for(sim.communicate(), 20.0)
            operator.bus.close()
        return daemon.returncode, sim.returncode, said

    code, sim_code, (out, err) = asyncio.run(main())
    events = list(read_events(log, 10_000)[1])
    return SimpleNamespace(
        machine=machine,
        tares=tares,
        log=log,
        events=events,
        operator=operator,
        code=code,
        sim_code=sim_code,
        out=out.decode(),
        told=err.decode(),
    )


def sent(ran, can_id):
    return [e for e in ran.events if isinstance(e, Sent) and e.can_id == can_id]


def test_both_stop_cleanly_on_sigterm(ran):
    """Exit code 0; nothing but JSON lines on standard error, the last of which says that it stopped; no traceback."""
    assert (ran.code, ran.sim_code) == (0, 0)
    lines = ran.told.splitlines()
    assert all(line.startswith("{") for line in lines), ran.told
    assert '"stopped"' in lines[-1]
    assert '"level": "error"' not in ran.told
    assert ran.out == ""


def test_the_sensors_are_commissioned(ran):
    """Each sensor answered SDO, was started, is told, and measured."""
    for node in ran.machine.service.nodes:
        told = [line for line in ran.told.splitlines() if f'"name": "{node.name}"' in line]
        assert any('"operational"' in line.lower() for line in told), told
        assert any(e.can_id == 0x580 + node.node_id for e in ran.events if isinstance(e, Frame))
        assert any(e.can_id == 0 and e.data == bytes([1, node.node_id]) for e in ran.events if isinstance(e, Sent))
        assert sum(e.can_id == node.pdos[0].can_id for e in ran.events if isinstance(e, Frame)) > 50 * SECONDS


def test_estimates_are_published_every_step(ran):
    """Four TPDOs a tick, 10 ms apart; weight and force become OK."""
    ticks = [e for e in ran.events if isinstance(e, Tick)]
    for pdo in ran.machine.service.publication:
        assert len(sent(ran, pdo.can_id)) == len(ticks)
    times = [f.t_us for f in ran.operator.frames if f.can_id == PAYLOAD]
    assert abs(np.median(np.diff(times)) - 10_000) < 1_500
    layout = ran.operator.layouts[QUALITY]
    said = [decode(layout, e.data) for e in sent(ran, QUALITY)]
    for what in ("payload_quality", "force_quality"):
        assert sum(int(values[what]) & 3 == Status.OK for values in said) > 20
    assert Reason(int(said[0]["payload_quality"]) >> 2) in (Reason.SIGNAL_MISSING, Reason.NOT_OPERATIONAL)


def test_the_log_holds_what_was_on_the_bus(ran):
    """Every frame that others saw of us is in the log, in order, and every frame of others."""
    seen = [(f.can_id, f.data) for f in ran.operator.frames]
    ours = {pdo.can_id for pdo in ran.machine.service.publication} | {0x580 + OURS, 0x700 + OURS, 0x080 + OURS}
    logged = [(e.can_id, e.data) for e in ran.events if isinstance(e, Sent) and e.can_id in ours]
    assert logged == [frame for frame in seen if frame[0] in ours]
    sensors = [frame for frame in seen if frame[0] in ran.operator.sensors]
    theirs = [(e.can_id, e.data) for e in ran.events if isinstance(e, Frame) and e.can_id in ran.operator.sensors]
    assert theirs == sensors[: len(theirs)]
    assert len(sensors) - len(theirs) < 100  # what came after the daemon's end


def test_zero_by_sdo(ran):
    """Refused before anything is measured (0800 0022h), refused with a wrong word (0609 0030h), then done: the weight
    that was shown is taken off."""
    early, also_early, wrong, done = ran.operator.answers[:4]
    assert [aborted(answer) for answer in (early, also_early, wrong)] == [NOT_NOW, NOT_NOW, RANGE]
    assert done[:4] == DONE + ZERO[1:4]
    told = [line for line in ran.told.splitlines() if "command" in line]
    assert len(told) == 4
    assert "zero refused: the weight must be OK, and it is invalid (" in told[0]
    assert "tare refused: the weight must be OK, and it is invalid (" in told[1]
    assert "zero refused: the four bytes written must be the word zero, not b'ZERO'" in told[2]
    assert float(re.search(r"zero set to (-?[\d.]+) kg", told[-1])[1]) != 0.0


def aborted(answer):
    assert answer[0] == 0x80
    return int.from_bytes(answer[4:8], "little")


def test_the_log_replays_to_the_last_bit(ran):
    """Frames sent live, zeroing included, come out of the replay."""
    told = []
    found = run_replay(ran.machine, ran.log, ran.tares, told.append)
    assert (found.different, told) == (0, [])
    assert found.compared == sum(len(sent(ran, pdo.can_id)) for pdo in ran.machine.service.publication)
    assert found.service.scale.zero != 0.0


def test_tshark_finds_no_malformed_frame(ran):
    """Debian's protocol analyser decodes the log as CANopen: NMT, SDO, SYNC, PDOs, heartbeats."""
    program = shutil.which("tshark")
    assert program, "tshark is missing: apt-get install tshark"
    command = (program, "-n", "-r", str(ran.log), "-d", "can.subdissector,canopen")
    wanted = "_ws.malformed || _ws.expert.severity >= error"
    assert subprocess.run((*command, "-Y", wanted), capture_output=True, text=True, check=True).stdout == ""
    decoded = subprocess.run((*command, "-Y", "canopen"), capture_output=True, text=True, check=True).stdout
    assert len(decoded.splitlines()) == len(ran.log.read_text().splitlines())
    for word in ("SYNC", "PDO1 (tx)", "PDO4 (tx)", "NMT", "SDO", "Boot-up", "Operational"):
        assert word in decoded, word
