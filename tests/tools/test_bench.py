"""The benchmark runs, its parts add up, and a replay gives the same bytes in the same memory.

How long a step takes is printed by `tools/bench`, with ratios to fixed work on the same core and to other programs. It
is no test: a busy machine, or one whose neighbours take its caches, is two or three times as slow.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def test_the_parts_of_a_step_add_up(tmp_path):
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
    assert found["yardsticks"] > 0.0


def test_a_step_beside_others(tmp_path):
    """`--against` prints ratios and times."""
    output = tmp_path / "against.json"
    command = [sys.executable, "-m", "bench", "--against", "--rounds", "1", "--json", output]
    done = subprocess.run(command, cwd=ROOT / "tools", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "whole step" in done.stdout
    found = json.loads(output.read_text())
    assert set(found) == {"step_over_filterpy", "rows_us", "solve_us", "decode_over_canopen", "filterpy_us"}
    assert all(value > 0.0 for value in found.values())


def test_where_the_time_goes(tmp_path):
    """The whole step is in `on_tick`, and its parts are in it. A round is looked at some 20 times, and a fifth of a
    step is the force: in ten rounds some look meets it, and what it calls."""
    output = tmp_path / "functions.json"
    command = [sys.executable, "-m", "bench", "--functions", "--rounds", "10", "--json", output]
    done = subprocess.run(command, cwd=ROOT / "tools", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(output.read_text())
    whole, force = found["service.WeighingService.on_tick"], found["interaction.ForceEstimator.update"]
    assert whole["whole_us"] > force["whole_us"] > force["own_us"]
    assert "interaction.ForceEstimator.update" in done.stdout


def test_a_replay_is_timed(tmp_path):
    """A minute and a longer one: the same bytes, the same memory."""
    output = tmp_path / "replay.json"
    command = [sys.executable, "-m", "bench", "--replay", "--minutes", "2", "--rounds", "1", "--json", output]

    done = subprocess.run(command, cwd=ROOT / "tools", capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    minute, longer = json.loads(output.read_text())
    assert (minute["compared"], longer["compared"]) == (13_200, 26_400)
    assert minute["different"] == longer["different"] == 0
    assert longer["memory"] < 1.05 * minute["memory"]
    assert longer["times"] == pytest.approx(longer["recorded_s"] / longer["took_s"])
    assert longer["memory"] < 80e6
