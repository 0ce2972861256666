"""README's first command prints what README shows."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
PADDED = re.compile(r" *-?\d+(?:\.\d+)?")  # with the spaces that align it: -0.1 is wider than 0.1
AGREES, SMALL = 1e-3, 0.3  # processors round sums in other orders: by this share of a figure, and small ones by so much
COUNTS = 100  # whole numbers below it are counts (buckets, overruns, the seed): a count is equal or wrong


@pytest.fixture(scope="module")
def shown():
    """The block in README, without the command."""
    return re.search(r"\$ tools/demo --seed 6\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)[1].splitlines()


@pytest.fixture(scope="module")
def printed(tmp_path_factory):
    """What the demo prints on a clock on which computing costs no time, and the figures that it writes."""
    figures = tmp_path_factory.mktemp("demo") / "out.json"
    options = ("--bus", "socketcan:vcan0", "--seed", "6", "--json", figures)
    command = [sys.executable, "-m", "cylforce", "demo", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return [line.rstrip() for line in done.stdout.splitlines()], json.loads(figures.read_text())


def agree(printed: str, shown: str) -> bool:
    """Whether two figures can be one: each was rounded to its last place, so they may stand one place apart."""
    a, b = float(printed), float(shown)
    if "." not in shown and b < COUNTS:
        return a == b
    return abs(a - b) <= max(AGREES * abs(b), SMALL) + 10.0 ** -len(shown.partition(".")[2])


def test_readme_shows_what_the_demo_prints(shown, printed):
    lines, _ = printed
    assert [PADDED.sub(" 0", line) for line in lines] == [PADDED.sub(" 0", line) for line in shown]
    for line, as_shown in zip(lines, shown, strict=True):
        numbers = zip(NUMBER.findall(line), NUMBER.findall(as_shown), strict=True)
        assert all(agree(a, b) for a, b in numbers), (line, as_shown)


def test_the_demo_books_every_bucket_within_its_error(printed):
    cycles = printed[1]["cycles"]
    assert len(cycles) == 3
    for cycle in cycles:
        assert abs(cycle["estimated_kg"] - cycle["true_kg"]) < 3.0 * cycle["standard_error_kg"]
