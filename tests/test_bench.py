"""The benchmark runs, its parts add up, and a step costs what it should against fixed work on the same core.

A step was 3.3 to 3.4 yardsticks while its arithmetic was done in arrays; it is 0.30 with the compiled kernel, 0.41
beside many other programs, and 2.1 with the interpreted one. Against filterpy's update a step is 4.9 to 5.6 beside
other programs, its kernel's residual, recursion, weight and forces take 4.2 to 5.1 us; decoding a frame is 0.08 of
canopen's, interpreted 0.59. The limits are a third above, that of the step above its least: what is done to the step in
Python varies by a tenth between processors, and more beside other programs.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from cylforce.estimation.kernel.choice import INTERPRETED, chosen
from speed import takes_at_most

ROOT = Path(__file__).resolve().parents[1]
LIMIT = {True: 0.55, False: 2.7}  # yardsticks, compiled and interpreted
DECODE = {True: 0.11, False: 0.78}  # of a frame by python-can and canopen
TIMES = {True: 40.0, False: 5.0}  # real time, where numpy is imported in 0.1 s; 98 and 11 beside other programs
FILTERPY_US = 18.2  # median, as in the table of the kernel's chapter


def test_a_step_costs_little_against_fixed_work(tmp_path):
    output = tmp_path / "bench.json"
    command = [
        sys.executable,
        "-m",
        "bench",
        ROOT / "config/excavator_20t.toml",
        "--rounds",
        "3",
        "--json",
        output,
    ]
    done = subprocess.run(command, cwd=ROOT / "tools", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (found,) = json.loads(output.read_text()).values()
    assert set(found["parts_us"]) == {"decode", "sample", "regressor", "recursion", "force", "encode", "rest"}
    assert all(us > 0.0 for us in found["parts_us"].values())
    assert sum(found["parts_us"].values()) == pytest.approx(found["step_us"])
    assert found["rate_hz"] == 100.0
    assert found["share_of_core"] == pytest.approx(found["step_us"] * 1e-4)
    assert found["yardsticks"] < LIMIT[chosen() is not INTERPRETED]


def test_a_step_beside_others(tmp_path):
    """`--against` tells ratios and times; the compiled kernel's are within their limits, a third above what is
    measured. The limits in microseconds are of the machine on which an update of filterpy took FILTERPY_US: another
    one, or one that is busy with something else, is as much slower at both."""
    output = tmp_path / "against.json"
    command = [sys.executable, "-m", "bench", "--against", "--rounds", "1", "--json", output]
    done = subprocess.run(command, cwd=ROOT / "tools", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "whole step" in done.stdout
    found = json.loads(output.read_text())
    assert set(found) == {"step_over_filterpy", "rows_us", "solve_us", "decode_over_canopen", "filterpy_us"}
    assert 0.0 < found["decode_over_canopen"] < DECODE[chosen() is not INTERPRETED]
    if chosen() is not INTERPRETED:
        slower = found["filterpy_us"] / FILTERPY_US
        assert 0.0 < found["rows_us"] < 5.0 * slower
        assert 0.0 < found["solve_us"] < 5.9 * slower
        assert 0.0 < found["step_over_filterpy"] < 6.5


def test_where_the_time_goes(tmp_path):
    """The whole step is in `step`, and its parts are in it. A round is looked at some 20 times, and what `step` does
    itself is a tenth of it: in ten rounds some look meets it."""
    output = tmp_path / "functions.json"
    command = [sys.executable, "-m", "bench", "--functions", "--rounds", "10", "--json", output]
    done = subprocess.run(command, cwd=ROOT / "tools", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(output.read_text())
    whole, tick = found["step.step"], found["step._tick"]
    assert whole["whole_us"] > tick["whole_us"] > tick["own_us"]
    assert "step._tick" in done.stdout


def test_a_replay_is_timed(tmp_path):
    """A minute and a longer one: the same bytes, the same memory."""
    output = tmp_path / "replay.json"
    command = [sys.executable, "-m", "bench", "--replay", "--minutes", "2", "--rounds", "1", "--json", output]

    def took_s():
        done = subprocess.run(command, cwd=ROOT / "tools", capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        minute, longer = json.loads(output.read_text())
        assert (minute["compared"], longer["compared"]) == (13_200, 26_400)
        assert minute["different"] == longer["different"] == 0
        assert longer["memory"] < 1.05 * minute["memory"]
        assert longer["times"] == pytest.approx(longer["recorded_s"] / longer["took_s"])
        assert longer["memory"] < 80e6
        return longer["took_s"]

    assert takes_at_most(120.0 / TIMES[chosen() is not INTERPRETED], took_s)
