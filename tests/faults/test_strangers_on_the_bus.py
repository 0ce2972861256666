"""The daemon with sensors on a bus, attacked by a stranger: nothing wrong is shown as right, and the bus is told."""

import asyncio
import struct
import time

import pytest

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.canopen.devices import sensor_node
from cylforce.canopen.heartbeat import PRE_OPERATIONAL
from cylforce.canopen.network import Network
from cylforce.programs.common.readings import make_core
from cylforce.programs.run import Daemon
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Reason
from cylforce.signals.events import ERROR, Frame
from scenarios import EXCAVATOR
from sdo_bench import Bench

MACHINE = load(EXCAVATOR)
SERVICE = MACHINE.service
OWN, SENSOR = SERVICE.node_id, SERVICE.nodes[0]
PDO = SENSOR.pdos[0]
PRODUCERS, SILENT, RECOVERED, OVERRUN = 0x8150, 0x8130, 0x8140, 0x8110


class Stage:
    """A daemon, sensors that measure a posture at rest, and a stranger, on a bus inside this process."""

    def __init__(self, name):
        self.daemon = Daemon(MACHINE, make_core(MACHINE, None), open_bus(name), None, NOTHING_KEPT)
        self.sensor_bus, self.stranger = open_bus(name), open_bus(name)
        self.network = Network(self.send)
        self.mute = set()  # identifiers that do not reach the bus
        middle = {f"{link.name}_angle": (link.angle_low + link.angle_high) / 2 for link in SERVICE.machine.links}
        self.sensors = {}
        for described in SERVICE.nodes:
            node = self.sensors[described.node_id] = sensor_node(described)
            node.associate_network(self.network)
            for pdo in described.pdos:
                node.store(
                    pdo.number, encode(pdo, {f.signal: middle.get(f.signal, 0.0) for f in pdo.fields if f.signal})
                )
        self.codes, self.requests = [], []

    def send(self, can_id, data):
        return can_id in self.mute or self.sensor_bus.send(can_id, data)

    def heard(self, frame: Frame):
        if frame.can_id == 0x80 + OWN:
            self.codes.append(struct.unpack_from("<H", frame.data)[0])
        if frame.can_id == 0x600 + SENSOR.node_id:
            self.requests.append(frame.data)

    async def beats(self):
        while True:
            self.network.poll(now_us())
            await asyncio.sleep(0.02)

    @property
    def reason(self):
        return self.daemon.weighing.estimate.gross.reason

    def measures(self):
        return self.daemon.weighing.pipeline.state is not None


def played(scenario, name):
    """The scenario once everything measures."""

    async def main():
        stage, loop = Stage(f"virtual:{name}"), asyncio.get_running_loop()
        stage.sensor_bus.attach(loop, stage.network.on_frame)
        stage.stranger.attach(loop, stage.heard)
        stage.daemon.start(loop)
        for node in stage.sensors.values():
            node.boot()
        clock = asyncio.create_task(stage.beats())
        try:
            await until(stage.measures, 20.0)
            await scenario(stage)
        finally:
            clock.cancel()
            await stage.daemon.stop(loop)
            stage.sensor_bus.close()
            stage.stranger.close()
        return stage

    return asyncio.run(main())


async def until(condition, seconds=10.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        await asyncio.sleep(0.01)


def test_a_second_producer_of_a_sensors_identifier():
    async def scenario(stage):
        begun = time.monotonic()
        while PRODUCERS not in stage.codes:
            assert time.monotonic() - begun < 5.0
            stage.stranger.send(PDO.can_id, bytes(PDO.length))
            await asyncio.sleep(0.05)
        await until(lambda: stage.reason is Reason.TWO_PRODUCERS, 1.0)
        await until(lambda: stage.codes[-1] == 0 and stage.measures(), 15.0)

    played(scenario, "producer")


def test_our_own_identifier_from_a_stranger():
    async def scenario(stage):
        stage.stranger.send(0x180 + OWN, bytes(8))
        await until(lambda: PRODUCERS in stage.codes)
        assert stage.measures()  # publishing goes on

    played(scenario, "spoofed")


def test_a_heartbeat_lost_while_its_pdos_go_on():
    async def scenario(stage):
        stage.mute.add(0x700 + SENSOR.node_id)
        await until(lambda: SILENT in stage.codes)
        await until(lambda: stage.reason is Reason.NOT_OPERATIONAL)
        assert not stage.measures()
        stage.mute.clear()
        await until(stage.measures, 20.0)

    played(scenario, "heartbeat")


def test_a_sensor_that_says_pre_operational_to_please_a_stranger_is_started_again():
    async def scenario(stage):
        stage.sensor_bus.send(0, bytes([128, SENSOR.node_id]))
        stage.network.on_frame(Frame(now_us(), 0, bytes([128, SENSOR.node_id])))
        assert stage.sensors[SENSOR.node_id].state == PRE_OPERATIONAL
        await until(lambda: stage.sensors[SENSOR.node_id].operational, 20.0)
        await until(stage.measures, 20.0)

    played(scenario, "stopped")


def test_a_sensors_pdo_that_is_disabled_while_its_heartbeat_goes_on_is_set_up_again():
    async def scenario(stage):
        node = stage.sensors[SENSOR.node_id]
        await until(lambda: SENSOR.node_id in stage.daemon.outcomes)
        await asyncio.sleep(0.3)
        node.set_value(0x1800, 1, PDO.can_id | 1 << 31)
        await until(lambda: not stage.measures())
        await until(stage.measures, 20.0)
        assert node.raw(0x1800, 1) & ~(1 << 30) == PDO.can_id

    played(scenario, "disabled")


@pytest.mark.parametrize(
    ("can_id", "bits", "code"),
    [(ERROR | 0x100, 0, RECOVERED), (ERROR | 0x4, 0x01, OVERRUN), (ERROR | 0x4, 0x10, 0x8120)],
)
def test_what_the_controller_says_of_the_bus(can_id, bits, code):
    async def scenario(stage):
        stage.stranger.send(can_id, bytes([0, bits, 0, 0, 0, 0, 0, 0]))
        await until(lambda: code in stage.codes)
        stage.stranger.send(ERROR | 0x4, bytes([0, 0x40, 0, 0, 0, 0, 0, 0]))
        await until(lambda: stage.codes[-1] == 0)
        assert stage.measures()

    played(scenario, f"error{code}{bits}")


def test_a_stranger_cannot_turn_supervision_off_nor_take_a_sensors_identifier():
    """As in the field: heartbeat consumer off, our PDO on a sensor's identifier; the bus has both aborts."""
    bench = Bench(None)
    before = {index: dict(bench.station.node.data_store[index]) for index in (0x1016, 0x1800)}
    assert bench.write((0x1016, 1, "<I"), 0) != 0
    assert bench.write((0x1800, 1, "<I"), PDO.can_id) != 0
    bench.nmt(128)
    assert bench.write((0x1800, 1, "<I"), PDO.can_id) != 0
    assert {index: dict(bench.station.node.data_store[index]) for index in before} == before


def test_foreign_frames_are_not_even_logged():
    """Ten thousand of them, beside the identifiers that are wanted."""

    async def scenario(stage):
        before = stage.daemon.bus.counters.received
        for k in range(10_000):
            stage.stranger.send(0x123, bytes(8))
            if k % 500 == 0:
                await asyncio.sleep(0.01)
        await asyncio.sleep(0.2)
        assert stage.daemon.bus.counters.received - before < 2000
        assert stage.measures()

    played(scenario, "foreign")
