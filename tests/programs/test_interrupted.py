"""Ctrl-C: exit code 130, one line on standard error, no table, no file."""

import signal
import subprocess
import sys
import time

import pytest

from scenarios import EXCAVATOR

STOPPED = "cylforce: stopped; no unfinished file was written\n"


def interrupted(folder, *words, after):
    """Standard output, standard error and exit code of a command that gets Ctrl-C once it prints `after`."""
    command = [sys.executable, "-u", "-m", "cylforce", *map(str, words)]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command,
        cwd=folder,
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
        text=True,
        preexec_fn=listen_to_ctrl_c,  # noqa: PLW1509
    ) as it:
        begun = ""
        while after not in begun and it.poll() is None:
            begun += it.stdout.read(1)
        time.sleep(0.5)
        it.send_signal(signal.SIGINT)
        try:
            said, told = it.communicate(timeout=30.0)
        finally:
            it.kill()
    return begun + said, told, it.returncode


def listen_to_ctrl_c():
    """A command that a shell starts in the background ignores SIGINT, and so does what it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("after", ["1. the empty machine", "3. 1 digging"])
def test_an_interrupted_demo_shows_no_figures(tmp_path, after):
    said, told, code = interrupted(
        tmp_path, "demo", "--machine", EXCAVATOR, "--cycles", 1, "--seed", 1, "--json", "x.json", after=after
    )
    assert (code, told) == (130, STOPPED)
    assert "rated payload" not in said
    assert list(tmp_path.iterdir()) == []


def test_interrupted_questions_write_nothing(tmp_path):
    _, told, code = interrupted(tmp_path, "new", "-o", "m.toml", after="type of machine")
    assert (code, told.lstrip("\n")) == (130, STOPPED)
    assert list(tmp_path.iterdir()) == []
