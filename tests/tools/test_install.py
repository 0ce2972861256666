"""tools/install into a folder: what comes where, twice the same, what is an administrator's stays, and away again."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
INSTALL = ROOT / "tools/install"
UNIT, NETWORK = "etc/systemd/system/cylforce.service", "etc/systemd/network/80-can0.network"


def install(root, *words, wheel=None):
    """What the command says; it must succeed. The program alone is installed, without what it needs."""
    given = ["--wheel", str(wheel)] if wheel else []
    environment = {**os.environ, "CYLFORCE_PIP_OPTIONS": "--no-deps", "PYTHON": sys.executable}
    environment.pop("PYTHONPATH", None)
    done = subprocess.run(
        [INSTALL, "--root", str(root), *given, *words],
        capture_output=True,
        text=True,
        env=environment,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def tree(root):
    """Every file with its time of change and bytes."""
    files = (path for path in sorted(root.rglob("*")) if path.is_file() and not path.is_symlink())
    return {str(path.relative_to(root)): (path.stat().st_mtime_ns, path.read_bytes()) for path in files}


@pytest.fixture(scope="module")
def installed(tmp_path_factory, wheel):
    root = tmp_path_factory.mktemp("controller")
    return root, install(root, "--bit-rate", "500K", wheel=wheel)


def test_program_unit_and_network_are_in_their_places(installed):
    root, told = installed
    assert (root / UNIT).read_bytes() == (ROOT / "systemd/cylforce.service").read_bytes()
    assert "BitRate=500K" in (root / NETWORK).read_text()
    assert (root / "opt/cylforce/bin/cylforce").read_text().startswith("#!/opt/cylforce/bin/python")
    assert list((root / "opt/cylforce/lib").glob("python3*/site-packages/cylforce/shipped/systemd/cylforce.service"))
    assert "missing   /etc/cylforce/machine.toml" in told
    assert sorted(path.name for path in (root / "opt").iterdir()) == ["cylforce"]


def test_the_program_of_the_unit_is_the_one_that_is_installed(installed):
    root, _ = installed
    command = next(x for x in (root / UNIT).read_text().splitlines() if x.startswith("ExecStart="))
    assert (root / command.partition("=")[2].split()[0].lstrip("/")).is_file()


def test_a_second_time_changes_no_byte(installed, wheel):
    root, _ = installed
    before = tree(root)
    told = install(root, wheel=wheel)
    assert tree(root) == before
    assert "written" not in told
    assert told.count("unchanged") == 3
    assert "kept      /etc/systemd/network/80-can0.network" in told


def test_what_an_administrator_changed_stays_and_the_unit_is_renewed(installed, wheel):
    root, _ = installed
    mine = {NETWORK: "mine\n", "etc/cylforce/machine.toml": "mine too\n"}
    for name, text in mine.items():
        (root / name).write_text(text)
    (root / UNIT).write_text("an older version's\n")
    told = install(root, "--bit-rate", "1M", wheel=wheel)
    assert {name: (root / name).read_text() for name in mine} == mine
    assert (root / UNIT).read_bytes() == (ROOT / "systemd/cylforce.service").read_bytes()
    assert "written   /etc/systemd/system/cylforce.service" in told
    assert "missing" not in told


def test_a_dry_run_changes_nothing(tmp_path, wheel):
    told = install(tmp_path / "new", "--dry-run", wheel=wheel)
    assert not (tmp_path / "new").exists()
    assert "would: " in told


def test_uninstall_keeps_what_is_the_owners_and_purge_does_not(installed, wheel):
    root, _ = installed
    (root / "var/lib/cylforce").mkdir(parents=True, exist_ok=True)
    (root / "var/lib/cylforce/records.db").write_text("bookings")
    told = install(root, "--uninstall")
    assert not (root / "opt/cylforce").exists()
    assert not (root / UNIT).exists()
    assert (root / "var/lib/cylforce/records.db").exists()
    assert (root / "etc/cylforce").exists()
    assert (root / NETWORK).exists()
    assert "kept      /var/lib/cylforce" in told
    assert "removed" not in install(root, "--uninstall")  # a second time there is nothing left to remove
    install(root, "--uninstall", "--purge")
    assert not (root / "var/lib/cylforce").exists()
    assert not (root / "etc/cylforce").exists()


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["--bit-rate", "fast"], "--bit-rate fast: write it as 250K or 1M"),
        (["--purge"], "--purge belongs to --uninstall"),
        (["--wheel", "absent.whl"], "--wheel absent.whl: does not exist"),
        (["--nonsense"], "tools/install [--root DIR]"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_is_done(tmp_path, words, why):
    done = subprocess.run(
        [INSTALL, "--root", tmp_path / "new", *words], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert why in done.stderr
    assert not (tmp_path / "new").exists()
