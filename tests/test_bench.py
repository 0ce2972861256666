"""The benchmark runs, its parts add up, and a step costs what it should against fixed work on the same core.

A step was 2.5 yardsticks, and is 3.3 to 3.4 since it weighs the bars and cylinders of the linkages (0.5), compares the
sensors with each other, watches who sends, and notices a base that rocks (0.3). On the core on which 2.85 yardsticks
are five percent at 100 Hz, the limit of 3.7 is six and a half.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


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
    assert found["yardsticks"] < 3.7
