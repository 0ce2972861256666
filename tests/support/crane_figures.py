"""Figures of the tools that examine the recordings of a real crane."""

import json
import subprocess
import sys
from pathlib import Path

TOOLS = Path(__file__).resolve().parents[2] / "tools"


def measure(module, folder, output, *options):
    """Return the finished process of a tool that writes its figures to a file."""
    command = [sys.executable, "-m", module, folder, *options, "--json", output]
    return subprocess.run(command, cwd=TOOLS, capture_output=True, text=True, check=False)


def figures_of(module, shared, work, *options):
    """Return the figures of a tool for the crane's recordings."""
    output = work / "figures.json"
    done = measure(module, shared / "data" / "hmf_crane", output, *options)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return json.loads(output.read_text())
