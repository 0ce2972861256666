"""The benchmark runs, its parts add up, and a step stays well under five percent of a core."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


def test_a_step_costs_less_than_five_percent_of_a_core(tmp_path):
    output = tmp_path / "bench.json"
    command = [
        sys.executable,
        ROOT / "tools/bench.py",
        ROOT / "config/excavator_20t.toml",
        "--rounds",
        "3",
        "--json",
        output,
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (found,) = json.loads(output.read_text()).values()
    assert set(found["parts_us"]) == {"decode", "sample", "regressor", "recursion", "force", "encode", "rest"}
    assert all(us > 0.0 for us in found["parts_us"].values())
    assert sum(found["parts_us"].values()) == pytest.approx(found["step_us"])
    assert found["rate_hz"] == 100.0
    assert found["share_of_core"] == pytest.approx(found["step_us"] * 1e-4)
    assert found["share_of_core"] < 0.05
