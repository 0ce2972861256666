"""The simulated sensors as nodes: commissioned over the bus they send at SYNC or by timer what the truth file says."""

import asyncio
from itertools import count

import numpy as np
import pytest

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.files.truth import TruthWriter, read_truth
from cylforce.programs.common.play import prepare
from cylforce.programs.live.sim_bus import STILL_S, MovingStage, SensorNodes, play_until
from cylforce.settings.machine_file import load
from cylforce.signals.codec import decode
from cylforce.signals.events import Frame
from waiting import until

EXCAVATOR = "config/excavator_20t.toml"
CHANNELS = count()


@pytest.fixture
def play(request):
    """One cycle of the excavator, whose sensors come with their mapping made."""
    loaded = load(request.config.rootpath / EXCAVATOR)
    nodes = tuple(node._replace(writable_mapping=False) for node in loaded.service.nodes)
    return prepare(loaded._replace(service=loaded.service._replace(nodes=nodes)), "cycles", 5, 0.1, amount=1)


class Rig:
    """The nodes without a bus: frames go in, what they send is kept."""

    def __init__(self, play, path, nodes=None):
        if nodes:
            service = play.service._replace(nodes=nodes)
            play = play._replace(loaded=play.loaded._replace(service=service))
        self.sent, self.play = [], play
        stage = MovingStage(play.service.machine, play.records)
        self.writer = TruthWriter(path, play.header, stage.names)
        self.nodes = SensorNodes(play, self.send, self.writer, stage)
        self.layouts = {pdo.can_id: pdo for node in play.service.nodes for pdo in node.pdos}

    def send(self, can_id, data):
        self.sent.append((can_id, data))
        return True

    def close(self):
        """The truth is complete."""
        self.nodes.stage.close()
        with self.writer:
            pass

    def values(self):
        """What the PDOs sent since the last call say."""
        found = {}
        for can_id, data in self.sent:
            if can_id in self.layouts:
                found |= decode(self.layouts[can_id], data)
        self.sent.clear()
        return found


def test_nothing_is_measured_before_the_start_command(play, tmp_path):
    rig = Rig(play, tmp_path / "truth.csv")
    rig.nodes.boot()
    assert rig.sent == [(0x700 + node.node_id, b"\x00") for node in play.service.nodes]
    rig.nodes.on_frame(Frame(0, 0x80, b""))
    rig.nodes.poll(5_000)
    assert rig.values() == {}
    rig.close()


def test_answers_to_sync_are_the_truth_of_that_moment(play, tmp_path):
    """SYNC comes whenever it comes: the motion runs on the clock, not on the count."""
    rig = Rig(play, tmp_path / "truth.csv")
    rig.nodes.boot()
    rig.nodes.on_frame(Frame(0, 0, b"\x01\x00"))
    rng, t_us, seen, times = np.random.default_rng(0), 0, [], []
    while not rig.nodes.done(t_us):
        t_us += int(rng.uniform(9_000, 11_000))
        rig.sent.clear()
        rig.nodes.on_frame(Frame(t_us, 0x80, b""))
        seen.append(rig.values())
        times.append(t_us)
    rig.close()
    truth = read_truth(tmp_path / "truth.csv")
    np.testing.assert_array_equal(truth.t_us, times)
    angle = np.array([values["stick_angle"] for values in seen])
    np.testing.assert_allclose(angle, truth.columns["theta.stick"], atol=0.006)
    still = truth.t_us < 1e6 * STILL_S
    assert np.ptp(truth.columns["theta.stick"][still]) == 0
    assert set(truth.columns["phase"]) == {0, 1, 2, 3, 4, 5}
    assert 300 <= truth.columns["mass"].max() <= 1500


def test_event_timers_send_without_sync(play, tmp_path):
    nodes = tuple(
        node._replace(pdos=tuple(pdo._replace(synchronous=False, period_s=0.02) for pdo in node.pdos))
        for node in play.service.nodes
    )
    rig = Rig(play, tmp_path / "truth.csv", nodes)
    rig.nodes.boot()
    rig.nodes.on_frame(Frame(0, 0, b"\x01\x00"))
    rig.sent.clear()
    for t_us in range(1000, 1_000_000, 1000):
        rig.nodes.poll(t_us)
    boom = [can_id for can_id, _ in rig.sent if can_id == nodes[0].pdos[0].can_id]
    assert abs(len(boom) - 50) <= 2
    rig.close()
    assert abs(len(read_truth(tmp_path / "truth.csv").t_us) - 100) <= 2


def test_on_a_real_clock_and_bus(play, tmp_path):
    """Nodes on one end of a virtual bus, SYNC and NMT from the other; every SYNC is answered by every node."""
    name, path = f"virtual:sim{next(CHANNELS)}", tmp_path / "truth.csv"
    received, firsts = [], {node.pdos[0].can_id for node in play.service.nodes}

    def answers():
        return sum(frame.can_id in firsts for frame in received)

    async def scenario():
        ours, theirs, stop = open_bus(name), open_bus(name), asyncio.Event()
        ours.attach(asyncio.get_running_loop(), received.append)
        task = asyncio.create_task(play_until(play, theirs, path, stop))
        nodes = play.service.nodes
        await until(lambda: len(received) == len(nodes))  # their boot-up messages
        ours.send(0x000, b"\x01\x00")
        for k in range(30):
            ours.send(0x080, b"")
            await until(lambda k=k: answers() == (k + 1) * len(nodes))
        stop.set()
        await task
        ours.close()
        theirs.close()

    before = now_us()
    asyncio.run(scenario())
    boots = [frame.can_id for frame in received if frame.data == b"\x00" and frame.can_id > 0x700]
    assert boots == [0x700 + node.node_id for node in play.service.nodes]
    for node in play.service.nodes:
        assert sum(frame.can_id == node.pdos[0].can_id for frame in received) == 30
    truth = read_truth(path)
    assert len(truth.t_us) == 30
    assert before < truth.t_us[0] < truth.t_us[-1] < now_us()
