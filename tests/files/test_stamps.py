"""Stamps of another program's log: a clock that was set cuts the recording, a frame with a wrong stamp is left out,
both are reported with file and time; a healthy log passes as it is."""

import numpy as np
import pytest

from cylforce.files.logreader import read_events
from cylforce.files.stamps import NAMED
from cylforce.signals.events import Frame, Tick

T0 = 1_700_000_000_000_000
PERIOD_US = 10_000
IDS = (0x181, 0x281, 0x182, 0x282, 0x183)
STRANGER = 0x7FE


def bus(seconds, begin_us=T0):
    """(time [us], identifier) of frames of five messages each 10 ms, 230 us apart as on a bus."""
    count = round(seconds * 1e6 / PERIOD_US)
    return [(begin_us + k * PERIOD_US + 230 * i, can_id) for k in range(count) for i, can_id in enumerate(IDS)]


def events_of(path, frames):
    """The events of a candump log of these frames, and what was reported."""
    path.write_text("".join(f"({t // 10**6}.{t % 10**6:06d}) can0 {can_id:03X}#01\n" for t, can_id in frames))
    told = []
    return list(read_events(path, PERIOD_US, report=told.append)[1]), told


def frames_of(events):
    return [(e.t_us, e.can_id) for e in events if isinstance(e, Frame)]


def ticks_of(events):
    return np.array([e.t_us for e in events if isinstance(e, Tick)])


@pytest.mark.parametrize("step_s", [0.02, 0.1, 0.5, 0.8, 3.0, 30.0, 59.0, 61.0, 86_400.0])
def test_a_clock_that_steps_back_cuts_the_recording_there(tmp_path, step_s):
    before = bus(70.0)[: 5 * 6500 + 3]  # in the middle of a period
    step = round(step_s * 1e6)
    after = [(t - step, can_id) for t, can_id in bus(70.0)[len(before) :]]
    events, told = events_of(tmp_path / "back.log", before + after)
    assert frames_of(events) == before + after
    steps = np.diff(ticks_of(events))
    assert np.sum(steps != PERIOD_US) == 1, "ticks begin anew once"
    assert abs(np.min(steps) + step) <= 2 * PERIOD_US
    assert len(told) == 1
    assert "back.log: the clock of the recording steps back by" in told[0]
    assert f"to {after[0][0] / 1e6:.6f} s: the recording is cut there" in told[0]


def test_each_of_several_steps_is_reported(tmp_path):
    whole, back = bus(8.0), {2: 800_000, 4: 2_000_000, 6: 300_000}
    frames = [(t - sum(by for at, by in back.items() if t >= T0 + at * 10**6), i) for t, i in whole]
    events, told = events_of(tmp_path / "steps.log", frames)
    assert frames_of(events) == frames
    assert len(told) == 3
    assert np.sum(np.diff(ticks_of(events)) != PERIOD_US) == 3


def test_a_clock_that_is_set_all_the_time_is_reported_briefly(tmp_path):
    frames = [(t - k // 100 * 2 * 200_000, i) for k, (t, i) in enumerate(bus(10.0))]
    _, told = events_of(tmp_path / "often.log", frames)
    assert len(told) == NAMED + 1
    assert told[-1].endswith("the clock of the recording was set 49 times: it is cut at each")


@pytest.mark.parametrize("off_s", [-3600.0, -6.0, -0.05, 0.05, 5.0, 6.0, 59.0, 3600.0])
@pytest.mark.parametrize("can_id", [STRANGER, IDS[2]])
def test_a_frame_with_a_wrong_stamp_is_left_out(tmp_path, off_s, can_id):
    """Ticks and all other frames are as without it."""
    healthy, at = bus(2.0), 503
    stray = (healthy[at - 1][0] + round(off_s * 1e6), can_id)
    events, told = events_of(tmp_path / "stray.log", [*healthy[:at], stray, *healthy[at:]])
    assert events == events_of(tmp_path / "healthy.log", healthy)[0]
    way = "ahead of" if off_s > 0 else "behind"
    assert len(told) == 1
    assert f"stray.log: frames stamped {abs(off_s):g} s {way} the frames beside them" in told[0]
    assert f"the first at {stray[0] / 1e6:.6f} s, were left out: 1;" in told[0]


def test_many_frames_with_wrong_stamps_are_counted(tmp_path):
    frames = [(t + 5_000_000 * (k % 97 == 50), i) for k, (t, i) in enumerate(bus(5.0))]
    events, told = events_of(tmp_path / "stray.log", frames)
    assert frames_of(events) == [f for k, f in enumerate(frames) if k % 97 != 50]
    assert len(told) == 1
    assert "were left out: 26;" in told[0]


def test_a_second_interface_on_another_clock_is_left_out(tmp_path):
    """Two interfaces under one name, the clock of one 50 ms late: each frame stands twice."""
    frames = [stamped for t, i in bus(5.0) for stamped in ((t, i), (t - 50_000, i))]
    events, told = events_of(tmp_path / "both.log", frames)
    assert frames_of(events) == bus(5.0)
    assert f"were left out: {len(bus(5.0))};" in told[0]


def silences():
    """Healthy logs: with a pause, sparse, in slight disorder, with a start and an end of single frames."""
    rng = np.random.default_rng(1)
    late = bus(3.0, begin_us=T0 + 12_000_000)
    yield bus(5.0) + late
    yield [*bus(1.0), (T0 + 3_000_000, 0x700), (T0 + 5_000_000, 0x700), *late]
    yield [(T0 + k * 1_000_000 + 300_000 * (k % 3), 0x700 + k % 4) for k in range(40)]
    yield [(t + int(rng.integers(-4000, 4000)), i) for t, i in bus(5.0)]
    yield [(T0 - 9_000_000, 0x701), *bus(1.0), (T0 + 7_000_000, 0x701)]
    yield [f for k, f in enumerate(bus(5.0)) if not 400 < k < 420]


@pytest.mark.parametrize("frames", list(silences()))
def test_a_healthy_log_passes_as_it_is(tmp_path, frames):
    events, told = events_of(tmp_path / "healthy.log", frames)
    assert frames_of(events) == frames
    assert set(np.diff(ticks_of(events)).tolist()) == {PERIOD_US}
    assert told == []
