"""One contract for every bus, subclassed per backend, and what only a kernel bus can do: go down, vanish, be full."""

import asyncio
import fcntl
import itertools
import os
import pty
import select
import struct
import subprocess
import termios
import time

import pytest

from cylforce.can.bus import BusError
from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.can.python_can import Relay
from cylforce.signals.events import ERROR, EXACTLY, EXTENDED, REMOTE
from waiting import until

numbers = itertools.count()


def run(coroutine):
    return asyncio.run(coroutine)


class Contract:
    """What holds of every bus; a subclass has a fixture `name` that makes a bus and tells its name."""

    @pytest.fixture
    def pair(self, name):
        buses = open_bus(name), open_bus(name)
        yield buses
        for bus in buses:
            bus.close()

    def exchange(self, pair, frames):
        """What the second bus got when the first one sent `frames`."""
        sender, receiver = pair
        got = []

        async def main():
            receiver.attach(asyncio.get_running_loop(), got.append)
            sender.attach(asyncio.get_running_loop(), lambda frame: pytest.fail(f"own frame came back: {frame}"))
            for can_id, data in frames:
                assert sender.send(can_id, data)
            await until(lambda: len(got) >= len(frames))

        run(main())
        return got

    def test_frames_arrive_in_order_with_their_time(self, pair):
        before = now_us()
        frames = [(0x180 + k % 100, bytes([k % 256] * (k % 9))) for k in range(300)]
        got = self.exchange(pair, frames)
        assert [(f.can_id, f.data) for f in got] == frames
        times = [f.t_us for f in got]
        assert times == sorted(times)
        assert before <= times[0] <= times[-1] <= now_us()
        assert (pair[0].counters.sent, pair[1].counters.received) == (300, 300)
        assert pair[1].overflow() == 0

    def test_flags_make_foreign_frames_recognisable(self, pair):
        frames = [
            (0x181, b"12"),
            (0x181 | EXTENDED, b"12"),
            (0x181 | REMOTE, b""),
            (0x1FFFFFFF | EXTENDED, b""),
        ]
        got = self.exchange(pair, frames)
        assert [(f.can_id, f.data) for f in got] == frames

    def test_only_frames_that_are_wanted_come_in_and_error_frames(self, pair):
        sender, receiver = pair
        receiver.accept([(0x181, EXACTLY), (EXTENDED | 0xEA0000, EXTENDED | REMOTE | 0x3FF0000)])
        got = []
        foreign = [0x182, 0x581, 0x181 | EXTENDED, 0x181 | REMOTE, 0x18EB40FE | EXTENDED, 0x7FF]
        wanted = [0x181, 0x18EA40FE | EXTENDED, 0x181]

        async def main():
            receiver.attach(asyncio.get_running_loop(), got.append)
            for can_id in (*foreign, *wanted[:2], *foreign, wanted[2]):
                assert sender.send(can_id, b"")
            await until(lambda: len(got) >= len(wanted))

        run(main())
        assert [frame.can_id for frame in got] == wanted
        assert receiver.counters.received == len(wanted)

    def test_a_burst_does_not_starve_the_loop(self, pair):
        turns = 0

        async def main():
            sender, receiver = pair
            loop = asyncio.get_running_loop()

            def turn():
                nonlocal turns
                turns += 1
                loop.call_soon(turn)

            for k in range(2000):
                sender.send(0x123, k.to_bytes(2, "little"))
            receiver.attach(loop, lambda frame: None)
            turn()
            await until(lambda: receiver.counters.received == 2000)

        run(main())
        assert turns >= 2000 // 256

    def test_closing_inside_the_callback(self, pair):
        got = []

        async def main():
            sender, receiver = pair

            def close(frame):
                got.append(frame)
                receiver.close()

            receiver.attach(asyncio.get_running_loop(), close)
            sender.send(0x123, b"1")
            sender.send(0x123, b"2")
            await until(lambda: got)
            await asyncio.sleep(0.05)

        run(main())
        assert len(got) == 1

    def test_a_closed_bus_drops_and_counts(self, pair):
        bus = pair[0]
        bus.close()
        bus.close()
        assert not bus.send(0x123, b"")
        assert (bus.counters.dropped, bus.counters.errors) == (1, 0)


class TestVirtual(Contract):
    @pytest.fixture
    def name(self):
        return f"virtual:test{next(numbers)}"

    def test_frames_come_from_another_thread(self, pair):
        got = []

        async def main():
            pair[1].attach(asyncio.get_running_loop(), got.append)
            await asyncio.to_thread(pair[0].send, 0x123, b"thread")
            await until(lambda: got)

        run(main())
        assert got[0].data == b"thread"

    def test_nobody_fetches(self, pair):
        for _ in range(5100):
            assert pair[0].send(0x123, b"")
        assert pair[1].overflow() == 100


class TestRemote(Contract):
    @pytest.fixture
    def name(self):
        with Relay() as relay:
            yield relay.name

    # A thread of the relay's library may still send to a client that is gone, and dies of it.
    @pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
    def test_the_relay_goes_and_comes_back(self):
        got = []

        async def main():
            with Relay() as relay:
                port = int(relay.name.rpartition(":")[2])
                bus = open_bus(relay.name)
                bus.attach(asyncio.get_running_loop(), got.append)
            await until(lambda: not bus.send(0x1, b""))
            with Relay(port) as relay:
                await until(lambda: bus.counters.reopened)
                other = open_bus(relay.name)
                await asyncio.sleep(0.05)
                other.send(0x123, b"back")
                await until(lambda: got)
                other.close()
                bus.close()

        run(main())
        assert got[0].data == b"back"


def ip(*arguments):
    subprocess.run(["ip", *arguments], check=True, timeout=10)


@pytest.fixture
def link():
    """An interface of this test's own."""
    name = f"vtest{next(numbers)}"
    ip("link", "add", name, "type", "vcan")
    ip("link", "set", name, "up")
    yield name
    subprocess.run(["ip", "link", "delete", name], check=False, capture_output=True, timeout=10)


class TestSocketCan(Contract):
    @pytest.fixture
    def name(self, link):
        return f"socketcan:{link}"

    def survives(self, link, pair, break_it, mend_it):
        """Frames come again after mending. Return the share of a processor that the broken bus took meanwhile."""
        sender = pair[0]
        got = []

        async def main():
            loop = asyncio.get_running_loop()
            for bus in pair:
                bus.attach(loop, got.append)
            break_it()
            started, began = time.process_time(), time.monotonic()
            for _ in range(50):
                assert not sender.send(0x123, b"")
                await asyncio.sleep(0.01)
            cpu = (time.process_time() - started) / (time.monotonic() - began)
            mend_it()
            await until(lambda: sender.send(0x123, b"back") and got)
            return cpu

        cpu = run(main())
        assert sender.counters.errors >= 1
        assert sender.counters.reopened >= 1
        assert got[-1].data == b"back"
        return cpu

    def test_the_link_goes_down_and_up(self, link, pair):
        cpu = self.survives(link, pair, lambda: ip("link", "set", link, "down"), lambda: ip("link", "set", link, "up"))
        assert cpu < 0.5

    def test_the_link_vanishes_and_comes_back(self, link, pair):
        def mend():
            ip("link", "add", link, "type", "vcan")
            ip("link", "set", link, "up")

        assert self.survives(link, pair, lambda: ip("link", "delete", link), mend) < 0.5

    def test_error_frames_are_told(self, pair):
        pair[1].accept([(0x181, EXACTLY)])
        got = self.exchange(pair, [(ERROR | 0x4, bytes(8))])
        assert got[0].can_id == ERROR | 0x4

    def test_filters_are_those_of_the_socket_that_follows(self, link, pair):
        for bus in pair:
            bus.accept([(0x123, EXACTLY)])
        got = []

        async def main():
            loop = asyncio.get_running_loop()
            pair[0].attach(loop, got.append)
            pair[1].attach(loop, lambda frame: None)
            ip("link", "set", link, "down")
            await until(lambda: pair[0].counters.errors)
            ip("link", "set", link, "up")
            await until(lambda: pair[0].counters.reopened and pair[1].send(0x124, b"") and pair[1].send(0x123, b""))
            await until(lambda: got)

        run(main())
        assert {frame.can_id for frame in got} == {0x123}

    def test_more_filters_than_the_kernel_takes_are_refused(self, pair):
        with pytest.raises(BusError, match="takes no 513 filters"):
            pair[0].accept([(k, EXACTLY) for k in range(513)])

    def test_what_the_kernel_had_to_throw_away_is_counted(self, pair):
        sender, receiver = pair
        sent = 15000
        for _ in range(sent):
            sender.send(0x123, bytes(8))
        lost = receiver.overflow()
        assert 0 < lost < sent
        got = []

        async def main():
            receiver.attach(asyncio.get_running_loop(), got.append)
            await until(lambda: len(got) == sent - lost)

        run(main())
        assert receiver.overflow() == lost


def slcan():
    """A CAN controller under the test's control: the line discipline slcan (17) on a pseudo-terminal. Returns the
    terminal's master and slave and the interface's name."""
    master, slave = pty.openpty()
    settings = termios.tcgetattr(slave)
    settings[0:4] = [0, 0, termios.CS8 | termios.CREAD, 0]
    termios.tcsetattr(slave, termios.TCSANOW, settings)
    fcntl.ioctl(slave, termios.TIOCSETD, struct.pack("i", 17))
    name = fcntl.ioctl(slave, 0x8910, bytes(16)).rstrip(b"\0").decode()  # SIOCGIFNAME
    ip("link", "set", name, "type", "can", "bitrate", "250000")
    with subprocess.Popen(["ip", "link", "set", name, "up"]) as up:
        while up.poll() is None:  # the driver waits until its commands have been taken
            if select.select([master], [], [], 0.05)[0]:
                os.read(master, 4096)
    assert up.returncode == 0
    return master, slave, name


def test_a_full_queue_drops_and_counts_and_goes_on():
    """An adapter that takes no frames: ENOBUFS is no reason to wait, to raise or to open again."""
    master, slave, name = slcan()
    try:
        bus = open_bus(f"socketcan:{name}")
        sent = [bus.send(0x123, bytes(8)) for _ in range(1000)]
        assert sent[0]
        assert not sent[-1]
        assert bus.counters.dropped == sent.count(False)
        assert bus.counters.errors == 0
        while not bus.send(0x321, b""):
            os.read(master, 65536)
        bus.close()
    finally:
        os.close(slave)
        os.close(master)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("socketcan:absent", "socketcan:absent: there is no such interface"),
        ("vcan0", "has no channel: write INTERFACE:CHANNEL"),
        ("kvaser:0", "there is no interface 'kvaser'"),
        ("udp_multicast:239.0.0.1", "would send frames out of this machine"),
        ("remote:192.168.1.2:54701", "frames stay on this machine"),
        ("remote:localhost:54701", "frames stay on this machine"),
        ("remote:127.0.0.1:http", "'http' is no port number"),
        ("remote:127.0.0.1:1", "no relay answers there"),
    ],
)
def test_what_cannot_be_opened_is_refused_with_a_sentence(name, sentence):
    with pytest.raises(BusError, match=sentence):
        open_bus(name)
