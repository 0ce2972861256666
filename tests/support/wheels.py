"""The wheel of this source, built once for all tests that install it."""

import fcntl
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PIP = (sys.executable, "-m", "pip", "--no-input", "--disable-pip-version-check")
NO_INDEX = re.compile("No matching distribution|Could not find a version|connection|Retrying|timed out", re.IGNORECASE)


def pip(*words):
    """Run pip without this repository's sources on its path. Where it fails, the test fails with pip's message."""
    outside = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([*PIP, *map(str, words)], capture_output=True, text=True, env=outside, timeout=600)
    if done.returncode != 0 and NO_INDEX.search(done.stderr):
        pytest.fail(f"pip reaches no index with the run-time dependencies, so no wheel can be tried:\n{done.stderr}")
    assert done.returncode == 0, done.stderr


def built_wheel(base):
    """Return the wheel in the folder `base`, built by the locked hatchling if it is not there yet.

    Processes that share `base` wait for the one that builds it.
    """
    folder = base / "wheel"
    with (base / "wheel.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not list(folder.glob("*.whl")):
            pip("wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, ROOT)
    [path] = folder.glob("*.whl")
    return path
