"""The timer keeps absolute deadlines; the clock does not jump."""

import asyncio
import itertools
import os
import time

import pytest

from cylforce.can.clock import Timer, now_us


@pytest.fixture
def timer():
    made = Timer(0.01)
    yield made
    made.close()


def test_now_is_the_wall_clock_in_microseconds():
    assert abs(now_us() - time.time() * 1e6) < 1e6


def test_now_rises_with_monotonic_time(monkeypatch):
    first = now_us()
    monkeypatch.setattr(time, "time_ns", lambda: 0)
    monkeypatch.setattr(time, "time", lambda: 0.0)
    assert 0 <= now_us() - first < 1_000_000


def test_missed_expirations_are_counted_not_repeated(timer):
    assert timer.read() == 0
    time.sleep(0.055)
    missed = timer.read()
    assert missed >= 5
    assert timer.read() == 0


def test_deadlines_are_multiples_of_the_period_after_the_first(timer):
    os.set_blocking(timer.fileno(), True)
    deadlines, counts = [], []
    for _ in range(5):
        counts.append(timer.read())
        deadlines.append(timer.deadline_us)
        assert deadlines[-1] <= now_us()
        time.sleep(0.003)  # a late reader does not move the next deadline
    steps = [b - a for a, b in itertools.pairwise(deadlines)]
    assert [round(step / 10_000) for step in steps] == counts[1:]
    assert all(abs(step % 10_000 - 10_000 * (step % 10_000 > 5000)) <= 1 for step in steps)


def test_the_loop_is_woken(timer):
    async def main():
        loop, done = asyncio.get_running_loop(), asyncio.Event()
        loop.add_reader(timer.fileno(), lambda: timer.read() and done.set())
        await asyncio.wait_for(done.wait(), 5.0)
        loop.remove_reader(timer.fileno())
        return done.is_set()

    assert asyncio.run(main())


@pytest.mark.parametrize("period_s", [0.0, -1.0, float("inf"), float("nan")])
def test_a_period_that_is_none_is_refused(period_s):
    with pytest.raises(ValueError, match="period must be positive"):
        Timer(period_s)
