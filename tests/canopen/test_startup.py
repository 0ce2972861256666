"""Sensors are made to send what the machine file says, each by a task of its own; what is not ours is refused."""

import asyncio
import struct
from itertools import pairwise

import pytest

from cylforce.canopen.devices import sensor_node
from cylforce.canopen.heartbeat import Heartbeats
from cylforce.canopen.network import Network
from cylforce.canopen.sdo_client import TIMEOUT_S
from cylforce.canopen.startup import FIRST_DELAY_S, LAST_DELAY_S, Commissioner, Stage
from cylforce.mechanics.installation import SensorNode
from cylforce.signals.events import Frame
from cylforce.signals.layout import Field, Pdo
from waiting import run_virtually, until


def pressures(node_id, *, synchronous=True, can_id=None, number=1):
    fields = tuple(Field(f"p{node_id}_{sub}", 0x7130, sub, "h", 1e4, 0.0, "Pa", 0.0, 4e7) for sub in (1, 2))
    can_id = can_id or 0x100 * number + 0x80 + node_id
    pdo = Pdo(can_id, node_id, number, synchronous, int(synchronous), 0.01, fields)
    return SensorNode(f"pressures{node_id}", node_id, 404, (1, 2, None, node_id), 0.05, (pdo,), True)


def now():
    """Return the time of the test's virtual clock [us]."""
    return round(asyncio.get_running_loop().time() * 1e6)


class World:
    """A daemon's network and sensors on one wire; frames arrive in the loop's next turn. `dead` nodes hear nothing."""

    def __init__(self, wanted, built=None):
        self.wanted = wanted
        self.client, self.server = Network(self.to_server), Network(self.to_client)
        self.outcomes, self.frames, self.dead = [], [], set()
        self.heartbeats = Heartbeats(self.on_peer)
        self.heartbeats.watch((node.node_id, 200_000) for node in wanted)
        self.sensors = {node.node_id: sensor_node(node) for node in (built or wanted)}
        for node_id, sensor in self.sensors.items():
            sensor.associate_network(self.server)
            self.client.subscribe(0x700 + node_id, self.on_heartbeat)
        self.commissioner = Commissioner(wanted, self.client, self.heartbeats.state, self.outcomes.append)

    def to_server(self, can_id, data):
        self.frames.append((can_id, bytes(data)))
        if can_id == 0 or can_id & 0x7F not in self.dead:
            asyncio.get_running_loop().call_soon(self.server.on_frame, Frame(now(), can_id, data))
        return True

    def to_client(self, can_id, data):
        if can_id & 0x7F not in self.dead:
            asyncio.get_running_loop().call_soon(self.client.on_frame, Frame(now(), can_id, data))
        return True

    def on_heartbeat(self, can_id, data, timestamp):
        self.heartbeats.on_heartbeat(can_id, data, self.client.t_us)

    def on_peer(self, node_id, state):
        self.commissioner.on_peer(node_id, state)

    async def clock(self):
        while True:
            t_us = now()
            self.server.poll(t_us)
            self.client.poll(t_us)
            self.heartbeats.poll(t_us)
            await asyncio.sleep(0.01)

    def stages(self):
        return {outcome.node.node_id: outcome.stage for outcome in self.outcomes}

    def written(self, node_id):
        """Objects that were written."""
        downloads = [data for can_id, data in self.frames if can_id == 0x600 + node_id and data[0] & 0xE0 == 0x20]
        return [struct.unpack_from("<HB", data, 1) for data in downloads]


def play(world, scenario):
    async def main():
        clock = asyncio.create_task(world.clock())
        for sensor in world.sensors.values():
            sensor.boot()
        world.commissioner.start()
        await scenario(world)
        await world.commissioner.close()
        clock.cancel()

    run_virtually(main())


def test_all_send_what_is_wanted():
    nodes = [pressures(11), pressures(12, synchronous=False), pressures(13, can_id=0x1F0)]
    world = World(nodes)

    async def scenario(world):
        await until(lambda: set(world.stages().values()) == {Stage.OPERATIONAL} and len(world.stages()) == 3)
        world.sensors[11].store(1, struct.pack("<hh", 7, 8))

    play(world, scenario)
    for node in nodes:
        sensor, pdo = world.sensors[node.node_id], node.pdos[0]
        assert sensor.operational
        assert sensor.raw(0x1017, 0) == 50
        assert sensor.raw(0x1800, 1) == pdo.can_id
        assert (sensor.raw(0x1A00, 0), sensor.raw(0x1A00, 1), sensor.raw(0x1A00, 2)) == (2, 0x71300110, 0x71300210)
        assert (sensor.raw(0x1800, 2), sensor.raw(0x1800, 5)) == ((1, 0) if pdo.synchronous else (255, 10))


def test_mapping_is_written_with_the_pdo_disabled():
    world = World([pressures(11)])
    play(world, lambda world: until(world.stages))
    written = world.written(11)
    disabled, enabled = (k for k, at in enumerate(written) if at == (0x1800, 1))
    mapping = [k for k, (index, _) in enumerate(written) if index == 0x1A00]
    assert disabled < mapping[0] < mapping[-1] < enabled
    assert written[mapping[0]] == written[mapping[-1]] == (0x1A00, 0)


def test_a_second_time_nothing_is_written():
    """A daemon that starts anew does not disturb sensors that send already."""
    world = World([pressures(11)])

    async def scenario(world):
        await until(world.stages)
        world.frames.clear()
        world.outcomes.clear()
        again = Commissioner(world.wanted, world.client, world.heartbeats.state, world.outcomes.append)
        again.start()
        await until(world.stages)
        await again.close()

    play(world, scenario)
    assert world.written(11) == []
    assert world.stages() == {11: Stage.OPERATIONAL}


def test_a_dead_node_holds_nobody_up_and_is_taken_when_it_comes():
    world = World([pressures(11), pressures(12)])
    world.dead.add(11)

    async def scenario(world):
        await until(lambda: world.stages() == {11: Stage.SILENT, 12: Stage.OPERATIONAL})
        world.dead.clear()
        await until(lambda: world.stages() == {11: Stage.OPERATIONAL, 12: Stage.OPERATIONAL})

    play(world, scenario)
    (reason,) = (outcome.reason for outcome in world.outcomes if outcome.stage is Stage.SILENT)
    assert reason == "pressures11: object 1000h:0 of node 11: no answer"


@pytest.mark.parametrize(
    ("identity", "what"),
    [((9, 2, 0, 11), "vendor 0x9, not 0x1"), ((1, 2, 0, 12), "serial number 0xc, not 0xb")],
)
def test_another_device_is_refused_and_kept_quiet(identity, what):
    wanted = pressures(11)
    world = World([wanted], [wanted._replace(identity=identity)])

    async def scenario(world):
        world.sensors[11].change_state(5)
        await until(lambda: world.stages() == {11: Stage.REFUSED})
        await asyncio.sleep(0.1)

    play(world, scenario)
    assert [outcome.stage for outcome in world.outcomes] == [Stage.REFUSED]
    assert f"node 11 has {what}: it is another device" in world.outcomes[0].reason
    assert world.sensors[11].state == 127
    assert world.written(11) == []


def test_a_fixed_mapping_is_only_checked():
    wanted = pressures(11)._replace(writable_mapping=False)
    world = World([wanted])
    play(world, lambda world: until(world.stages))
    assert world.stages() == {11: Stage.OPERATIONAL}
    assert world.written(11) == [(0x1017, 0)]


def test_a_fixed_mapping_that_differs_is_refused():
    wanted = pressures(11)._replace(writable_mapping=False)
    swapped = wanted.pdos[0]._replace(fields=wanted.pdos[0].fields[::-1])
    world = World([wanted], [wanted._replace(pdos=(swapped,))])
    play(world, lambda world: until(world.stages))
    assert (
        "TPDO 1 of node 11 maps 7130h:2, 7130h:1 and cannot be changed to 7130h:1, 7130h:2" in world.outcomes[0].reason
    )


def test_an_object_that_cannot_be_mapped_is_told_and_tried_again():
    wanted = pressures(11)
    built = pressures(11)._replace(pdos=(wanted.pdos[0]._replace(fields=wanted.pdos[0].fields[:1]),))
    world = World([wanted], [built])

    async def scenario(world):
        await until(lambda: world.written(11).count((0x1A00, 2)) >= 2)

    play(world, scenario)
    assert [outcome.stage for outcome in world.outcomes] == [Stage.FAILED]
    assert "object 1A00h:2 of node 11: Object cannot be mapped to the PDO" in world.outcomes[0].reason


def test_a_node_that_boots_again_is_done_again():
    world = World([pressures(11)])

    async def scenario(world):
        await until(world.stages)
        world.sensors[11].reset()
        assert world.sensors[11].raw(0x1017, 0) == 0
        await until(lambda: len(world.outcomes) == 2 and world.sensors[11].operational)

    play(world, scenario)
    assert [outcome.stage for outcome in world.outcomes] == [Stage.OPERATIONAL] * 2
    assert world.sensors[11].raw(0x1017, 0) == 50


def test_a_node_whose_boot_up_was_missed_is_done_again():
    """It was silent, and came back with its default values."""
    world = World([pressures(11)])

    async def scenario(world):
        await until(world.stages)
        await until(lambda: world.heartbeats.state(11) == 5)
        world.dead.add(11)
        await until(lambda: world.heartbeats.state(11) is None)
        world.sensors[11].reset()
        world.sensors[11].set_value(0x1017, 0, 20)
        await asyncio.sleep(0.05)
        world.dead.clear()
        await until(lambda: world.sensors[11].raw(0x1017, 0) == 50 and world.sensors[11].operational)

    play(world, scenario)
    assert world.sensors[11].raw(0x1017, 0) == 50
    assert world.sensors[11].operational


def test_a_node_that_is_sent_back_to_pre_operational_is_started_again():
    world = World([pressures(11)])

    async def scenario(world):
        await until(lambda: world.heartbeats.state(11) == 5)
        world.server.on_frame(Frame(now(), 0, bytes([128, 11])))
        await until(lambda: world.heartbeats.state(11) == 127)
        await until(lambda: world.heartbeats.state(11) == 5)

    play(world, scenario)
    assert world.sensors[11].operational


def test_a_node_that_does_not_start_is_told():
    world = World([pressures(11)])
    change = world.sensors[11].change_state
    world.sensors[11].change_state = lambda state: change(127)

    async def scenario(world):
        await until(lambda: world.stages() == {11: Stage.FAILED})

    play(world, scenario)
    assert world.outcomes[0].reason == "pressures11: node 11 does not start: its heartbeat does not show operational"
    assert [data for can_id, data in world.frames if can_id == 0][:3] == [b"\x01\x0b"] * 3


def test_attempts_become_rarer():
    world = World([pressures(11)])
    world.dead.add(11)
    times = []
    to_server = world.to_server

    def timed(can_id, data):
        if data[0] == 0x40:
            times.append(asyncio.get_running_loop().time())
        return to_server(can_id, data)

    world.client.send = timed
    play(world, lambda world: until(lambda: len(times) == 8))
    gaps = [b - a for a, b in pairwise(times)]
    assert gaps[0] < TIMEOUT_S + FIRST_DELAY_S + 0.1
    assert gaps[-1] > TIMEOUT_S + LAST_DELAY_S - 0.1
    assert max(gaps) < TIMEOUT_S + LAST_DELAY_S + 0.1


def test_an_old_encoder_has_its_timer_elsewhere():
    """CiA 406: 6200h, where 1800h has no event timer."""
    wanted = pressures(11, synchronous=False)
    world = World([wanted])
    sensor = world.sensors[11]
    del sensor.object_dictionary[0x1800].subindices[5]
    timer = sensor.object_dictionary[0x1017]
    sensor.object_dictionary.indices[0x6200] = type(timer)("Cyclic timer", 0x6200)
    sensor.object_dictionary.indices[0x6200].data_type = timer.data_type
    sensor.data_store[0x6200] = {0: b"\0\0"}
    play(world, lambda world: until(world.stages))
    assert world.stages() == {11: Stage.OPERATIONAL}
    assert sensor.raw(0x6200, 0) == 10
