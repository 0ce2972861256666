"""The wheel, installed into a virtual environment of its own with the run-time dependencies and nothing else, used
from an empty folder: the commands work, and what the repository ships is in it.

Of Python 3.11 to 3.13, which the metadata name, this is the one that runs the tests."""

import json
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from email.parser import Parser
from pathlib import Path
from types import SimpleNamespace

import pytest

import cylforce
from wheels import pip

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = [ROOT / name for name in ("config", "systemd")]
SHIPPED = {p.name: p for folder in FOLDERS for p in folder.iterdir() if p.suffix not in (".md", ".svg")}


@pytest.fixture(scope="module")
def installed(tmp_path_factory, wheel):
    """An environment with the wheel, an empty folder to be in, and how to call the program there."""
    folder = tmp_path_factory.mktemp("installed")
    venv, here = folder / "venv", folder / "empty"
    here.mkdir()
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    pip("--python", venv / "bin/python", "install", "-q", "--no-compile", "-c", ROOT / "requirements.lock", wheel)

    def call(*words):
        command = [venv / "bin/cylforce", *map(str, words)]
        clean = {"PATH": "/usr/bin:/bin", "HOME": str(here), "OPENBLAS_NUM_THREADS": "1"}
        return subprocess.run(command, capture_output=True, text=True, cwd=here, env=clean, timeout=300)

    return SimpleNamespace(venv=venv, here=here, call=call)


def done(call, *words):
    """What a command printed; it must end well."""
    found = call(*words)
    assert found.returncode == 0, found.stderr
    return found.stdout


def test_the_wheel_holds_the_package_and_what_is_shipped(wheel):
    """Every file of src/cylforce at its place, and those of config/ and systemd/, byte by byte; besides them the
    compiled kernel, which makes the wheel one for this processor; nothing else."""
    sources = ROOT / "src/cylforce"
    wanted = {
        f"cylforce/{path.relative_to(sources)}": path
        for path in sources.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".so"
    }
    wanted |= {f"cylforce/shipped/{path.parent.name}/{path.name}": path for path in SHIPPED.values()}
    with zipfile.ZipFile(wheel) as file:
        found = {name for name in file.namelist() if ".dist-info/" not in name}
        assert found - wanted.keys() == {f"cylforce/estimation/kernel/compiled{sysconfig.get_config_var('EXT_SUFFIX')}"}
        assert wanted.keys() <= found
        assert wheel.stem.endswith(f"-{sysconfig.get_platform().replace('-', '_')}")
        for name, path in wanted.items():
            assert file.read(name) == path.read_bytes(), name


def test_the_metadata_are_complete(wheel):
    with zipfile.ZipFile(wheel) as file:
        [name] = [name for name in file.namelist() if name.endswith(".dist-info/METADATA")]
        found = Parser().parsestr(file.read(name).decode())
    assert (found["Name"], found["Version"]) == ("cylforce", cylforce.__version__)
    assert found["License-Expression"] == "Apache-2.0"
    assert found["Author"] == "The cylforce developers"
    assert found["Requires-Python"] == ">=3.11"
    assert found["Keywords"]
    assert found.get_payload().startswith("# cylforce")
    said = found.get_all("Classifier")
    for version in ("3.11", "3.12", "3.13"):
        assert f"Programming Language :: Python :: {version}" in said
    assert any(line.startswith("Development Status :: ") for line in said)


def test_it_runs_outside_the_repository(installed):
    assert done(installed.call, "--version") == f"cylforce {cylforce.__version__}\n"
    assert "commission" in done(installed.call, "--help")
    listed = done(installed.call, "config", "list").splitlines()
    assert {line.split()[0] for line in listed} == SHIPPED.keys()


def test_only_run_time_dependencies_are_installed(installed):
    """What an extra brings is absent, and asked for in a sentence with its name."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for name in ("matplotlib", "pyarrow", "can_remote"):
        code = [installed.venv / "bin/python", "-I", "-c", f"import {name}"]
        assert "No module named" in subprocess.run(code, capture_output=True, text=True).stderr
    found = installed.call("demo", "--bus", "remote:127.0.0.1")
    assert found.returncode == 2
    assert "pip install 'cylforce[remote]'" in found.stderr
    assert "remote" in extras


def test_a_shipped_file_is_copied_once(installed):
    """`config copy` refuses what exists, a folder that does not, and a name that is not shipped."""
    here, call = installed.here / "copies", installed.call
    here.mkdir()
    changed = here / "cylforce.dbc"
    assert done(call, "config", "copy", changed.name, "-o", here) == f"{changed}\n"
    assert changed.read_bytes() == SHIPPED[changed.name].read_bytes()
    changed.write_text("mine")
    for words, why in (
        (("cylforce.dbc", "-o", here), f"{changed}: exists and is not replaced"),
        (("cylforce.dbc", "-o", here / "absent"), "is not a folder"),
        (("cylforce.bdc",), "'cylforce.bdc' is not shipped with cylforce: choose one of excavator_20t.toml, "),
    ):
        found = call("config", "copy", *words)
        assert found.returncode == 2
        assert why in found.stderr
        assert found.stderr.count("\n") == 1
    assert changed.read_text() == "mine"


def test_a_machine_is_simulated_identified_and_replayed(installed):
    """From nothing but what the package holds."""
    call, here = installed.call, installed.here
    assert done(call, "config", "copy", "excavator_20t.toml") == "excavator_20t.toml\n"
    assert "Excavator 20 t" in done(call, "describe", "excavator_20t.toml", "--eds", "node.eds", "--dbc", "node.dbc")
    assert (here / "node.dbc").read_bytes() == SHIPPED["cylforce.dbc"].read_bytes()
    sim = ("sim", "excavator_20t.toml", "--seed", "3")
    done(call, *sim, "--scenario", "moves", "--duration", "60", "--log", "moves.log")
    done(call, *sim, "--cycles", "1", "--log", "cycle.log")
    assert "boom.X" in done(call, "identify", "moves.log", "-o", "identified.toml", "--no-statistics")
    words = ("replay", "excavator_20t.toml", "cycle.log", "--identified", "identified.toml", "-o", "estimates.csv")
    assert "weight OK in" in done(call, *words)
    assert len((here / "estimates.csv").read_text().splitlines()) > 1000


def test_the_demo_needs_nothing_else(installed):
    """On the bus inside its process, with the shipped machine: what is booked is near the truth, and the demo says that
    a load is not booked. A busy computer misses steps of the real clock; then a load may wait for motion of the empty
    bucket, at most one of two."""
    found = installed.call("demo", "--cycles", "2", "--seed", "6", "--json", "demo.json")
    cycles = json.loads((installed.here / "demo.json").read_text())["cycles"]
    booked = [cycle for cycle in cycles if cycle["estimated_kg"] is not None]
    assert len(cycles) == 2
    assert found.returncode == (len(booked) < 2), found.stderr
    assert ("not booked" in found.stdout) == (len(booked) < 2)
    assert booked
    assert all(abs(cycle["estimated_kg"] - cycle["true_kg"]) < 0.02 * 1500.0 for cycle in booked)
