"""tools/vcan: what a command in a guest prints, when, and how it ends (-g: even where there is a vcan0)."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
VCAN = str(ROOT / "tools/vcan")
# A handler and a sleep would race: a signal just before the sleep interrupts nothing.
SAY_AND_END_WELL = """
import signal, sys
ends = {signal.SIGTERM, signal.SIGINT}
signal.pthread_sigmask(signal.SIG_BLOCK, ends)
print("ready", flush=True)
print("got", signal.Signals(signal.sigwait(ends)).name)
sys.exit(9)
"""
# Two processes on vcan0; prints a checksum of all that arrived and when.
TRANSMIT_AND_HASH = """
import can, hashlib, os, random, sys, time
receiver = can.Bus("vcan0", interface="socketcan")
if os.fork() == 0:
    draw = random.Random(1)
    with can.Bus("vcan0", interface="socketcan") as bus:
        for i in range(500):
            time.sleep(draw.random() * 0.02)
            bus.send(can.Message(arbitration_id=0x181, data=i.to_bytes(4, "little"), is_extended_id=False))
    os._exit(0)
digest = hashlib.sha256()
for i in range(500):
    message = receiver.recv(5.0)
    assert int.from_bytes(message.data, "little") == i
    digest.update(f"{time.monotonic_ns()} {message.data.hex()}".encode())
receiver.shutdown()
print(digest.hexdigest())
"""


def guest(*command, options=("-s", "60"), **settings):
    """The finished run of a command in a guest."""
    given = {"capture_output": True, "text": True, "timeout": 90, "check": False} | settings
    return subprocess.run([VCAN, "-g", *options, *command], **given)


def test_output_errors_and_status_are_the_commands(tmp_path):
    done = guest("bash", "-c", "echo out; echo err >&2; exit 7")
    assert (done.stdout, done.stderr, done.returncode) == ("out\n", "err\n", 7)


def test_output_is_byte_for_byte():
    sent = bytes(range(256)) * 20_000
    done = guest(sys.executable, "-c", "import sys; sys.stdout.buffer.write(bytes(range(256)) * 20_000)", text=False)
    assert done.stdout == sent


def test_output_comes_as_it_is_written():
    command = [VCAN, "-g", "-s", "60", "bash", "-c", "echo first; sleep 2; echo second"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout.readline() == "first\n"
        first = time.monotonic()
        assert running.stdout.readline() == "second\n"
        assert time.monotonic() - first > 1.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("clock", ["real", "idle"])
def test_signals_reach_the_command(number, clock):
    heard = ("env", "--default-signal=INT")  # a shell that starts the tests in the background has them ignore it
    command = [*heard, VCAN, "-g", "-t", clock, sys.executable, "-c", SAY_AND_END_WELL]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout.readline() == "ready\n"
        running.send_signal(number)
        assert running.stdout.read() == f"got {number.name}\n"
        assert running.wait(30) == 9


def test_the_time_limit_ends_the_command():
    assert guest("sleep", "1000", options=("-s", "2")).returncode == 124


def test_only_the_writable_folder_keeps_what_is_written(tmp_path):
    (tmp_path / "kept here").mkdir()
    script = f"cd {tmp_path}; echo kept >'kept here/file'; echo lost >lost; cat lost; mktemp"
    done = guest("bash", "-c", script, options=("-w", str(tmp_path / "kept here")))
    assert done.returncode == 0
    assert done.stdout.startswith("lost\n/tmp/")
    assert (tmp_path / "kept here/file").read_text() == "kept\n"
    assert [path.name for path in tmp_path.iterdir()] == ["kept here"]


def test_the_current_folder_is_writable_by_default(tmp_path):
    assert guest("bash", "-c", "echo kept >file", cwd=tmp_path).returncode == 0
    assert (tmp_path / "file").read_text() == "kept\n"


@pytest.mark.parametrize("clock", ["idle", "virtual"])
def test_idle_time_is_skipped(clock):
    start = time.monotonic()
    script = "import time; start = time.monotonic(); time.sleep(1000); print(round(time.monotonic() - start))"
    assert guest(sys.executable, "-c", script, options=("-t", clock, "-s", "2000")).stdout == "1000\n"
    assert time.monotonic() - start < 60


def test_two_processes_on_vcan0_are_deterministic_under_the_virtual_clock():
    runs = [guest(sys.executable, "-c", TRANSMIT_AND_HASH, options=("-t", "virtual")) for _ in range(2)]
    assert [run.stderr for run in runs] == ["", ""]
    assert len(runs[0].stdout) == 65
    assert runs[0].stdout == runs[1].stdout


def test_a_missing_kernel_is_told():
    done = guest("true", env=os.environ | {"VCAN_KERNEL": "/nowhere/linux"})
    assert done.returncode == 125
    assert "no guest kernel is ready: tools/vcan-kernel builds one" in done.stderr
