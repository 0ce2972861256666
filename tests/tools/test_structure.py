"""tools/structure: each rule is noticed when it is broken, on a source tree made for it; sizes are reported."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from structure import broken, circles, duplicates, effect_tests, modules, sizes, structure

TOOLS = Path(__file__).resolve().parents[2] / "tools"
GOOD = {
    "house/__init__.py": "",
    "house/low/__init__.py": "",
    "house/low/stone.py": "class Stone:\n    def weight(self):\n        return 1.0\n",
    "house/high/roof.py": "from house.low.stone import Stone\n\n\nclass Roof:\n    stone: Stone\n",
    "house/effects/rain/drop.py": "class Drop:\n    pass\n",
}


def written(folder, files):
    for name, text in (GOOD | files).items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    return modules(folder)


def test_a_good_tree_breaks_nothing(tmp_path):
    found = structure(written(tmp_path, {}))
    assert list(broken(found)) == []
    assert found.folders["house/low"] == (1, "stone.py", 3)


@pytest.mark.parametrize(
    "back",
    [
        "import house.high.roof\n",
        "from house.high.roof import Roof\n",
        "from house.high import roof\n",
        "from ..high import roof\n",
        "from ..high.roof import Roof\n",
        "def late():\n    from house.high import roof\n    return roof\n",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.high.roof import Roof\n",
    ],
)
def test_a_circle_of_files(tmp_path, back):
    found = written(tmp_path, {"house/low/stone.py": back + "class Stone:\n    pass\n"})
    assert circles(found) == [["house.high.roof", "house.low.stone"]]
    assert list(broken(structure(found))) == ["these files import each other: house.high.roof, house.low.stone"]


def test_a_class_name_that_stands_twice(tmp_path):
    found = written(tmp_path, {"house/high/wall.py": "class Stone:\n    pass\n"})
    assert duplicates(found) == {"Stone": ["house/high/wall.py", "house/low/stone.py"]}
    assert len(list(broken(structure(found)))) == 1


@pytest.mark.parametrize(
    "test",
    [
        "isinstance(x, Drop)",
        "isinstance(x, int | drop.Drop)",
        "issubclass(x, (int, Drop))",
        "[1 for y in x if isinstance(y, Drop)]",
    ],
)
def test_a_room_that_tests_for_a_single_effect(tmp_path, test):
    found = written(tmp_path, {"house/high/wet.py": f"def f(x):\n    return {test}\n"})
    assert effect_tests(found) == {"low": 0, "high": 1}
    assert len(list(broken(structure(found)))) == 1


def test_a_pattern_for_a_single_effect(tmp_path):
    text = "def f(x):\n    match x:\n        case Drop():\n            return 1\n    return isinstance(x, int)\n"
    assert effect_tests(written(tmp_path, {"house/high/wet.py": text})) == {"low": 0, "high": 1}


def test_nested_functions_and_methods_count_and_their_lines_too(tmp_path):
    text = (
        "class Wall:\n    def f(self):\n        async def g():\n            pass\n            pass\n        return g\n"
    )
    found = sizes(written(tmp_path, {"house/low/brick.py": text}))
    assert found.functions == 3  # with Stone.weight
    assert (found.longest, found.lines) == ("house/low/brick.py:2 f", 4)


def test_the_command_says_what_is_broken_and_ends_with_1(tmp_path):
    written(tmp_path, {"house/high/wall.py": "class Stone:\n    pass\n"})
    command = [sys.executable, "-m", "structure", tmp_path]
    done = subprocess.run(command, cwd=TOOLS, env=os.environ, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "structure: class Stone is defined 2 times: house/high/wall.py, house/low/stone.py\n"
    assert "class names defined more than once: 1" in done.stdout
