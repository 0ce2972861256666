"""tools/release --verify: signed and whole, or refused."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def run(*words, folder=None):
    return subprocess.run(
        [str(word) for word in words], capture_output=True, text=True, cwd=folder, timeout=60, check=False
    )


@pytest.fixture
def released(tmp_path):
    """Files, their checksums and signature, as the command makes them; the public key that is allowed."""
    key, folder, allowed = tmp_path / "key", tmp_path / "dist", tmp_path / "allowed"
    assert run("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", key).returncode == 0
    folder.mkdir()
    for name in ("a.whl", "b.json"):
        (folder / name).write_text(name)
    (folder / "SHA256SUMS").write_text(run("sha256sum", "a.whl", "b.json", folder=folder).stdout)
    assert run("ssh-keygen", "-Y", "sign", "-q", "-f", key, "-n", "file", folder / "SHA256SUMS").returncode == 0
    allowed.write_text(f"release@cylforce {key.with_suffix('.pub').read_text()}")
    return folder, allowed


def verify(folder, allowed):
    return run(ROOT / "tools/release", "--verify", folder, "--allowed", allowed)


def test_what_was_released_is_accepted(released):
    done = verify(*released)
    assert (done.returncode, "as it was released" in done.stdout) == (0, True), done.stderr


@pytest.mark.parametrize("name", ["a.whl", "b.json", "SHA256SUMS", "SHA256SUMS.sig"])
def test_a_changed_file_is_refused(released, name):
    (released[0] / name).write_text("changed")
    assert verify(*released).returncode == 1


def test_another_key_is_refused(released, tmp_path):
    assert run("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", tmp_path / "other").returncode == 0
    released[1].write_text(f"release@cylforce {(tmp_path / 'other.pub').read_text()}")
    done = verify(*released)
    assert (done.returncode, "not signed by an allowed key" in done.stderr) == (1, True)


def test_without_a_key_nothing_is_made(tmp_path):
    done = run(ROOT / "tools/release", "-o", tmp_path / "dist")
    assert (done.returncode, "needs --key FILE" in done.stderr) == (2, True)
    assert not (tmp_path / "dist").exists()
