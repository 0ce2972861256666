"""A CANopen stack that is not ours (npm canopen) reads our EDS, takes the weight by PDO and SDO, zeroes it."""

import asyncio
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.canopen.devices import Derived
from cylforce.canopen.dictionary.eds import eds
from cylforce.canopen.dictionary.object_dictionary import own_objects
from cylforce.canopen.dictionary.object_table import dictionary
from cylforce.canopen.network import Network
from cylforce.canopen.node import Node
from cylforce.canopen.objects import Commands
from cylforce.service import commands
from cylforce.service.commands import Scale
from cylforce.service.publication import publication
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Quantity, Reason, Status

PEER = Path(__file__).parent / "peer"
WAIT_S = 300.0  # for what is certain to come, on a slow machine too
OURS, THEIRS, RATED = 64, 5, 1500.0
PUBLICATION = publication(OURS, 0.1, RATED, 300e3)
ZERO = 0x6F72657A  # "zero"
FINE = {"payload_quality": 0.0, "force_quality": 0.0}


class Scales:
    """Our node with a weight on it; zero and tare are obeyed as the core does."""

    def __init__(self, bus):
        self.bus, self.network = bus, Network(bus.send)
        self.mass, self.scale, self.verdict = Quantity(12.3, 0.5, Status.OK, Reason.NONE), Scale(), None
        objects = dictionary(own_objects(PUBLICATION, 100), OURS)
        known = Commands(frozenset({(commands.ZERO, 1), (commands.TARE, 1)}), lambda: self.verdict)
        self.node = Node(OURS, objects, PUBLICATION, commands=known, autostart=True)
        self.node.add_read_callback(Derived(self.node, PUBLICATION).read)
        self.network.add_node(self.node)

    def on_frame(self, frame):
        command = commands.read(frame, OURS)
        if command is not None:
            self.scale, answer = commands.obey(command, self.scale, self.mass, RATED)
            self.verdict = answer.verdict
            self.publish()
        self.network.on_frame(frame)

    def publish(self):
        gross = self.mass.value - self.scale.zero
        values = FINE | {"payload_gross": gross, "payload_net": gross - self.scale.tare, "force_x": -1230.0}
        for pdo in PUBLICATION:
            self.node.publish(pdo.number, encode(pdo, values))

    async def run(self):
        self.bus.attach(asyncio.get_running_loop(), self.on_frame)
        self.network.poll(now_us())
        self.node.boot()
        while True:
            self.network.poll(now_us())
            self.publish()
            await asyncio.sleep(0.02)


class Peer:
    """The other stack in its own process, on the bus by a socket of this one."""

    def __init__(self, bus):
        self.bus, self.told, self.frames, self.answers, self.asked = bus, [], [], {}, 0

    async def begin(self, file):
        command = ("node", str(PEER / "peer.js"), str(file), str(OURS), str(THEIRS))
        pipe = asyncio.subprocess.PIPE
        self.process = await asyncio.create_subprocess_exec(*command, stdin=pipe, stdout=pipe)
        self.reader = asyncio.create_task(self.read())
        self.bus.attach(asyncio.get_running_loop(), self.on_frame)
        await self.heard("ready")

    def on_frame(self, frame):
        self.frames.append(frame.can_id)
        self.write({"id": frame.can_id, "data": frame.data.hex()})

    def write(self, line):
        self.process.stdin.write(json.dumps(line).encode() + b"\n")

    async def read(self):
        async for text in self.process.stdout:
            line = json.loads(text)
            if "id" in line:
                self.bus.send(line["id"], bytes.fromhex(line["data"]))
            elif "answer" in line:
                self.answers.pop(line["answer"]).set_result(line)
            else:
                self.told.append(line)

    async def ask(self, **what):
        self.asked += 1
        self.answers[self.asked] = asyncio.get_running_loop().create_future()
        self.write({"ask": self.asked, **what})
        async with asyncio.timeout(WAIT_S):
            return await self.answers[self.asked]

    async def upload(self, *what):
        return (await self.ask(upload=what))["value"]

    async def heard(self, key, accept=lambda line: True):
        """The newest line with `key` that is accepted, waiting for one if need be."""
        async with asyncio.timeout(WAIT_S):
            while True:
                found = [line for line in self.told if key in line and accept(line)]
                if found:
                    return found[-1]
                await asyncio.sleep(0.01)

    async def end(self):
        self.bus.close()
        self.process.stdin.close()
        await self.process.wait()
        await self.reader


@pytest.fixture
def resolved(tmp_path):
    """Our EDS with the node id filled in, which that stack leaves to its user."""
    assert shutil.which("node"), "there is no node: apt-get install nodejs npm (tools/test does)"
    modules = PEER / "node_modules/canopen"
    assert modules.is_dir(), f"the peer is not installed: npm ci --ignore-scripts --prefix {PEER} (tools/test does)"
    path = tmp_path / "cylforce.eds"
    text = re.sub(r"\$NODEID\+(0x[0-9A-F]+)", lambda found: hex(int(found[1], 16) + OURS), eds(PUBLICATION, 100))
    path.write_text(text)
    return path


async def meet(file, scenarios):
    """Plays `scenario(scales, peer)` after each other with both on the bus; to start that stack takes seconds."""
    scales, peer = Scales(open_bus("socketcan:vcan0")), Peer(open_bus("socketcan:vcan0"))
    await peer.begin(file)
    task = asyncio.create_task(scales.run())
    try:
        for scenario in scenarios:
            await scenario(scales, peer)
    finally:
        task.cancel()
        scales.bus.close()
        await peer.end()


async def weight_by_pdo_and_sdo(scales, peer):
    pdo = await peer.heard("pdo", lambda line: line["pdo"] == PUBLICATION[0].can_id)
    assert list(pdo["values"].values()) == [123, 123]
    assert await peer.upload(0x9130, 1, "INTEGER32") == 123
    digits, unit = await peer.upload(0x6132, 1, "UNSIGNED8"), await peer.upload(0x6131, 1, "UNSIGNED32")
    assert (digits, unit) == (1, 0x00020000)
    assert await peer.upload(0x7130, 2, "INTEGER16") == -123


async def commands_that_are_refused(scales, peer):
    was = scales.mass
    wrong = await peer.ask(download=(0x6125, 1, "UNSIGNED32", 1))
    scales.mass = replace(was, value=500.0)
    far = await peer.ask(download=(0x6125, 1, "UNSIGNED32", ZERO))
    scales.mass = replace(was, status=Status.INVALID)
    moving = await peer.ask(download=(0x6125, 1, "UNSIGNED32", ZERO))
    nothing = await peer.ask(upload=(0x5000, 0, "UNSIGNED32"))
    scales.mass = was
    errors = [answer["error"] for answer in (wrong, far, moving, nothing)]
    assert "Invalid value for download parameter" in errors[0]
    assert "Invalid value for download parameter" in errors[1]
    assert "because of present device state" in errors[2]
    assert "Object does not exist" in errors[3]
    assert scales.scale == Scale()


async def zero_by_sdo(scales, peer):
    assert await peer.ask(download=(0x6125, 1, "UNSIGNED32", ZERO)) == {"answer": peer.asked, "value": None}
    assert await peer.upload(0x9130, 1, "INTEGER32") == 0
    await peer.heard("pdo", lambda line: list(line["values"].values()) == [0, 0])


async def nmt_heartbeat_emergency_and_segments(scales, peer):
    assert (await peer.heard("heartbeat", lambda line: line["state"] == 5))["heartbeat"] == OURS
    assert await peer.upload(0x1008, 0, "VISIBLE_STRING") == "cylforce"
    scales.node.emergencies.occur(0x8130, 0x10, bytes([12]))
    assert (await peer.heard("emergency"))["emergency"] == 0x8130
    await peer.ask(command="preoperational")
    await peer.heard("heartbeat", lambda line: line["state"] == 127)
    peer.frames.clear()
    await asyncio.sleep(0.3)
    assert set(peer.frames) == {0x700 + OURS}
    await peer.ask(command="start")
    await peer.heard("heartbeat", lambda line: line["state"] == 5)


def test_a_stack_that_is_not_ours_understands_us(resolved):
    nmt = nmt_heartbeat_emergency_and_segments
    asyncio.run(meet(resolved, [nmt, weight_by_pdo_and_sdo, commands_that_are_refused, zero_by_sdo]))
