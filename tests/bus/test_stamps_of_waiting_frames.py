"""Frames that wait while the loop is busy keep the times at which they came."""

import asyncio
import struct
import time

import pytest

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.can.socketcan import waited_us

STAMP = 35  # SO_TIMESTAMPNS
LEVEL = 1  # SOL_SOCKET
READING_US = 5000  # between the readings of two clocks, a quarter of the frames' distance


@pytest.mark.parametrize(("age_ns", "waited"), [(0, 0), (5_000_000, 5000), (-1000, 0), (2_000_000_000, 0)])
def test_a_stamp_tells_how_long_a_frame_waited(age_ns, waited):
    """One of the future, or more than a second old, is of a clock that was set."""
    wall = 1_700_000_000_000_000_000
    stamp = struct.pack("@ll", *divmod(wall - age_ns, 10**9))
    assert waited_us([(LEVEL, STAMP, stamp)], wall) == waited


def test_without_a_stamp_a_frame_has_just_come():
    assert waited_us([], time.time_ns()) == 0


def test_frames_of_one_burst_have_their_own_times():
    sender, receiver = open_bus("socketcan:vcan0"), open_bus("socketcan:vcan0")
    got, done = [], asyncio.Event()

    async def main():
        receiver.attach(asyncio.get_running_loop(), lambda frame: got.append(frame) or len(got) < 3 or done.set())
        sent = []
        for k in range(3):
            before = now_us()
            assert sender.send(0x181, bytes([k]))
            sent.append((before, now_us()))
            time.sleep(0.02)  # noqa: ASYNC251  # the loop is busy
        await done.wait()
        return sent

    try:
        sent = asyncio.run(asyncio.wait_for(main(), 10.0))
    finally:
        sender.close()
        receiver.close()
    for frame, (before, after) in zip(got, sent, strict=True):  # however long the machine took to send it
        assert before - READING_US <= frame.t_us <= after + READING_US
