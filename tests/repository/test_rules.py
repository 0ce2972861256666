"""The rules that the house stands on: sizes, annotations, top level, lock, skips, systemd units."""

import configparser
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from structure import broken, functions, modules, structure

ROOT = Path(__file__).resolve().parents[2]
TOP_LEVEL = {
    *("pyproject.toml", "src", "config", "docs", "systemd", "tests", "tools", "README.md"),
    *("requirements.lock", "CHANGELOG.md", "SECURITY.md", "LICENSE", ".gitignore", ".ci"),
    "hatch_build.py",
}


@cache
def parsed():
    return modules()


def test_circles_and_names_keep_to_the_rules():
    """The rules are those of tools/structure."""
    assert list(broken(structure(parsed()))) == []


def unannotated(function):
    arguments = function.args
    given = [
        *arguments.posonlyargs,
        *arguments.args,
        *arguments.kwonlyargs,
        arguments.vararg,
        arguments.kwarg,
    ]
    missing = [a.arg for a in given if a is not None and a.annotation is None and a.arg not in ("self", "cls")]
    return missing + ["return"] * (function.returns is None)


def test_every_function_is_annotated():
    assert not {name: missing for name, node in functions(parsed()) if (missing := unannotated(node))}


def test_the_top_level_is_complete_and_no_more():
    generated = {line.strip("/\n") for line in (ROOT / ".gitignore").read_text().splitlines()} | {".git"}
    assert {path.name for path in ROOT.iterdir()} - generated == TOP_LEVEL


def test_the_tools_chapter_names_every_command_and_study():
    text = (ROOT / "tools/README.md").read_text()
    commands = {path.name for path in (ROOT / "tools").iterdir() if path.is_file() and os.access(path, os.X_OK)}
    studies = {path.stem for path in (ROOT / "tools/studies").glob("[a-z]*.py")}
    assert {"accuracy", "structure", "test"} <= commands
    assert [name for name in commands if f"`tools/{name}" not in text] == []
    assert [name for name in studies if f"`tools/accuracy {name}" not in text] == []


def test_the_lock_is_exact_and_names_no_place():
    lines = [line for line in (ROOT / "requirements.lock").read_text().splitlines() if not line.startswith("#")]
    assert lines
    assert [line for line in lines if not re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", line)] == []


def test_no_contract_of_the_floors_has_an_exception():
    assert "ignore_imports" not in (ROOT / "pyproject.toml").read_text()


def run_with_our_conftest(folder, *bodies):
    """Exit status and output of pytest over test files, with the shared folder absent."""
    shutil.copy(ROOT / "tests/conftest.py", folder)
    for k, body in enumerate(bodies):
        (folder / f"test_{k}.py").write_text("import pytest\n" + body)
    command = [sys.executable, "-m", "pytest", "-q", "--shared", str(folder / "absent"), folder]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=60)
    return done.returncode, done.stdout


def test_absent_shared_data_is_told_and_counted(tmp_path):
    status, output = run_with_our_conftest(tmp_path, "def test(shared): pass\ndef test_other(shared): pass\n")
    assert status == 0
    assert f"2 tests skipped: no ../shared/data ({tmp_path / 'absent/data'} is absent)" in output


@pytest.mark.parametrize(
    "bodies",
    [
        [
            "def test(): pass\ndef test_other(): pytest.skip('not today')",
            "@pytest.mark.skipif(True, reason='not here')\ndef test(): pass",
        ],
        ["pytest.importorskip('no_such_module')"],
    ],
    ids=["in a test and by a mark", "of all there is"],
)
def test_any_other_skip_fails_the_run_and_is_listed(tmp_path, bodies):
    status, output = run_with_our_conftest(tmp_path, *bodies)
    assert status == 1
    listed = output.partition("FORBIDDEN SKIPS")[2]
    assert [f"test_{k}.py" in listed for k in range(len(bodies))] == [True] * len(bodies)


def test_systemd_accepts_the_unit(tmp_path):
    """systemd-analyze verify, with a program that exists in the place of the installed one."""
    text = (ROOT / "systemd/cylforce.service").read_text()
    unit = tmp_path / "cylforce.service"
    unit.write_text(re.sub(r"^ExecStart=\S+", "ExecStart=/bin/true", text, flags=re.MULTILINE))
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", unit], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


@pytest.mark.parametrize(("file", "program"), [("80-can0.network", "networkd"), ("80-can0.link", "udevd")])
def test_systemd_knows_every_key_of_the_network_files(file, program):
    """A misspelt key is only a warning in the journal: each must stand in the program's own table of keys."""
    keys = configparser.ConfigParser(strict=False)
    keys.optionxform = str
    keys.read(ROOT / "systemd" / file)
    known = (ROOT / "/lib/systemd" / f"systemd-{program}").read_bytes()
    unknown = [f"{s}.{key}" for s in keys.sections() for key in keys[s] if f"{s}.{key}\0".encode() not in known]
    assert keys.sections()
    assert unknown == []


def test_a_bus_that_is_off_restarts():
    """systemd leaves RestartSec off: the bus would stay off for ever."""
    keys = configparser.ConfigParser()
    keys.read(ROOT / "systemd/80-can0.network")
    assert keys["Match"]["Name"] == "can0"
    assert keys["CAN"]["BitRate"] == "250K"
    assert keys["CAN"]["RestartSec"] == "100ms"
