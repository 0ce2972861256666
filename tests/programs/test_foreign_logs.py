"""Logs of another program with a fault of the logger: every command reports it with the file, no diagnosis is made of
it, and no weight is lost without a sentence."""

import re

import pytest
import structlog

from cylforce.files.atomic import RecordingError
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.recorded import chosen
from cylforce.programs.fleet.task import FAILED, OK, Job, summarised
from cylforce.programs.gap import diagnose
from cylforce.programs.identify import run_identify
from cylforce.programs.replay import Totals, stream_replay
from cylforce.programs.sim import run_sim
from cylforce.settings.machine_file import load
from scenarios import CONFIG

SEED = 1
MACHINE = CONFIG / "excavator_20t.toml"
LOADED = load(MACHINE)
TWICE = "mostly TWO_PRODUCERS: two nodes send a sensor's message; or the logger stored each frame twice"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("foreign")


def read(path):
    """(stamp [us], rest of the line) of a log."""
    lines = (re.match(r"\((\d+)\.(\d{6})\) (.*)", line) for line in path.read_text().splitlines())
    return [(int(m[1] + m[2]), m[3]) for m in lines if m]


def written(path, frames):
    path.write_text("".join(f"({t // 10**6}.{t % 10**6:06d}) {rest}\n" for t, rest in frames))
    return path


@pytest.fixture(scope="module")
def moves(folder):
    """The frames of a minute of moves as another program's candump stores them."""
    run_sim(MACHINE, scenario="moves", duration=60.0, seed=SEED, log=folder / "own.log")
    return [(t, rest) for t, rest in read(folder / "own.log") if rest.startswith("can0 ")]


@pytest.fixture(scope="module")
def work(folder):
    """The frames of three digging cycles."""
    run_sim(MACHINE, cycles=3, seed=SEED, log=folder / "own_work.log")
    return [(t, rest) for t, rest in read(folder / "own_work.log") if rest.startswith("can0 ")]


@pytest.fixture(scope="module")
def tares(folder, moves):
    """The identified file of the healthy log."""
    run_identify(LOADED, [written(folder / "moves.log", moves)], folder / "identified.toml")
    return folder / "identified.toml"


def doubled(frames, after_us):
    return sorted([*frames, *((t + after_us, rest) for t, rest in frames)])


def set_back(frames, step_us, share=0.5):
    middle = int(share * len(frames))
    return [*frames[:middle], *((t - step_us, rest) for t, rest in frames[middle:])]


@pytest.mark.parametrize("after_us", [150, 1000])
def test_frames_that_stand_twice_are_named_with_the_cure(folder, moves, after_us):
    echo = written(folder / "echo.log", doubled(moves[: len(moves) // 2], after_us))
    with pytest.raises(RecordingError, match=rf"no gapless stretch .*; .*echo\.log: .* s are not usable, {TWICE}"):
        run_identify(LOADED, [echo], folder / "none.toml")
    answer = diagnose(LOADED, Question((echo,))).answer
    assert answer["effects"] == []
    assert answer["reason"].startswith("no gapless stretch of 20 s in echo.log; of echo.log ")
    assert f" s are not usable, {TWICE}" in answer["reason"]
    outcome = summarised(Job(str(echo), str(MACHINE), MACHINE.read_text()))
    assert outcome.facts["state"] == FAILED
    assert TWICE in outcome.facts["reason"]


def test_frames_that_stand_twice_for_a_while_are_named(folder, moves):
    """What is not doubled is examined."""
    many = len(moves)
    part = written(folder / "part.log", [*doubled(moves[: many // 3], 150), *moves[many // 3 :]])
    told = []
    found = chosen(LOADED, [part], {}, tell=told.append)
    assert len(found.stretches) == 1
    assert 35.0 < found.looked_at[0].seconds < 40.0
    assert len(told) == 1
    assert TWICE in told[0]


def test_a_clock_that_was_set_back_changes_no_identification(folder, moves, tares):
    back = written(folder / "back.log", set_back(moves, 800_000))
    with structlog.testing.capture_logs() as said:
        found = run_identify(LOADED, [back], folder / "back.toml")
    assert all(share > 0.99 for share in found.explained)
    assert [s["event"] for s in said if "back.log: the clock of the recording steps back by" in s["event"]]


def test_a_clock_that_was_set_back_is_in_the_answers(folder, moves):
    back = written(folder / "back.log", set_back(moves, 800_000))
    told = []
    assert len(chosen(LOADED, [back], {}, tell=told.append).stretches) == 2
    facts = summarised(Job(str(back), str(MACHINE), MACHINE.read_text())).facts
    assert facts["state"] == OK
    assert [s for s in facts["warnings"] if "the clock of the recording steps back" in s] == told
    short = written(folder / "short.log", set_back(moves[: len(moves) // 2], 800_000))
    answer = diagnose(LOADED, Question((short,))).answer
    assert "short.log: the clock of the recording steps back" in answer["warnings"][0]


def weighed(folder, frames, tares):
    """The bookings [kg] of a replay, and what was reported."""
    told, tally = [], Totals(LOADED.service.machine.rated_payload)
    found = stream_replay(LOADED, written(folder / "work.log", frames), tares, tally.take, told.append)
    return [round(b.mass) for b in found.bookings], told


def test_no_booking_is_lost_by_a_clock_that_steps_back_between_two_lifts(folder, work, tares):
    """In the middle of three cycles the bucket is empty. (A load that hangs while the clock is set may be lost: how
    long it hung is not known.)"""
    healthy, told = weighed(folder, work, tares)
    assert len(healthy) == 3
    assert told == []
    for step_us in (100_000, 3_000_000, 59_000_000):
        kilograms, told = weighed(folder, set_back(work, step_us), tares)
        assert kilograms == pytest.approx(healthy, rel=0.02)
        assert len(told) == 1
        assert "work.log: the clock of the recording steps back by" in told[0]


def test_no_booking_is_lost_by_a_frame_stamped_ahead(folder, work, tares):
    healthy, _ = weighed(folder, work, tares)
    middle = len(work) // 2
    stray = (work[middle - 1][0] + 6_000_000, "can0 0C4065A7#AF00000058020000")
    kilograms, told = weighed(folder, [*work[:middle], stray, *work[middle:]], tares)
    assert kilograms == healthy
    assert len(told) == 1
    assert "work.log: frames stamped 6 s ahead of the frames beside them" in told[0]
