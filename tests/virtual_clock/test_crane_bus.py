"""A real crane's recording played onto a bus and measured by the daemon: the numbers of a replay without a bus."""

import subprocess
import sys
import time
from itertools import pairwise, takewhile
from pathlib import Path
from typing import NamedTuple

import pytest

from crane.figures import with_known_scale
from cylforce.files.candump import Sent
from cylforce.files.recording import open_recording
from cylforce.programs.common.readings import make_core
from cylforce.programs.identify import run_identify
from cylforce.programs.replay import run_replay
from cylforce.service.publication import frames
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Status
from cylforce.signals.events import Frame, Tick

TOOLS = Path(__file__).resolve().parents[2] / "tools"
SECONDS = 20
COMMAND = (sys.executable, "-m", "cylforce")


@pytest.fixture(scope="module")
def crane(shared, tmp_path_factory):
    """Machine file, tares as after a known lift, and the first seconds of a run that they were not identified from."""
    folder, data = tmp_path_factory.mktemp("crane"), shared / "data" / "hmf_crane"
    machine, tares, short = folder / "crane.toml", folder / "identified.toml", folder / "short.csv"
    subprocess.run([sys.executable, "-m", "crane", data, "-o", machine], cwd=TOOLS, check=True)
    loaded = load(machine)
    with_known_scale(run_identify(loaded, [data / "Dual1SineRun_230425.csv"], tares), loaded, tares)
    with (data / "Dual2SineTest_230425.csv").open() as whole:
        short.write_text("".join(line for line, _ in zip(whole, range(1 + 100 * SECONDS), strict=False)))
    return loaded, tares, short


def play(crane, log):
    """The daemon's log of the recording played onto vcan0."""
    loaded, tares, recording = crane
    bus = ("--bus", "socketcan:vcan0")
    with subprocess.Popen([*COMMAND, "run", loaded.path, *bus, "--identified", tares, "--log", log]) as daemon:
        try:
            while not log.exists():
                assert daemon.poll() is None
                time.sleep(0.05)
            subprocess.run([*COMMAND, "replay", loaded.path, recording, *bus], check=True, timeout=60 + SECONDS)
        finally:
            daemon.terminate()
        assert daemon.wait(10.0) == 0
    return list(open_recording(log, loaded.service).events)


class Step(NamedTuple):
    """A tick of the daemon: its time, how many frames of each sensor PDO came before it, what was sent after it."""

    t_us: int
    came: list[int]
    sent: dict[int, bytes]


def steps(service, events):
    """The daemon's log by ticks."""
    inputs = [pdo.can_id for node in service.nodes for pdo in node.pdos]
    outputs = {pdo.can_id: pdo.number for pdo in service.publication}
    came, found = [0] * len(inputs), []
    for event in events:
        if isinstance(event, Tick):
            found.append(Step(event.t_us, came, {}))
            came = [0] * len(inputs)
        elif isinstance(event, Frame) and event.can_id in inputs:
            came[inputs.index(event.can_id)] += 1
        elif isinstance(event, Sent) and event.can_id in outputs and found:
            found[-1].sent[outputs[event.can_id]] = event.data
    return found


def played(found, period_us):
    """The steps that saw the recording, its first row first, as long as each step saw just the next row."""
    first = next((k for k, step in enumerate(found) if all(step.came)), len(found))
    good = takewhile(
        lambda pair: pair[1].t_us - pair[0].t_us == period_us and set(pair[1].came) == {1}, pairwise(found[first:])
    )
    return [step for _, step in good]


def test_daemon_gives_the_numbers_of_a_replay(crane, tmp_path):
    """Equal to the last bit of every PDO, from the first belief in the sensors on."""
    loaded, tares, recording = crane
    core = make_core(loaded, tares)
    wanted = run_replay(loaded, recording, tares).estimates
    found = played(steps(core.service, play(crane, tmp_path / "events.log")), core.period_us)
    assert len(found) > 0.9 * len(wanted)
    begin = core.service.health.good_frames
    # a replay's first tick sees the second row, so does the first of these steps
    pairs = [(s.sent, dict(frames(core.service.publication, e))) for s, e in zip(found, wanted, strict=False)]
    compared = [(sent, expected) for sent, expected in pairs[begin:] if sent]
    assert all(sent.items() <= expected.items() for sent, expected in compared)  # each PDO has a period of its own
    assert len(compared) > 0.09 * min(len(found), len(wanted))  # every tenth step is published
    assert any(estimate.gross.status is Status.OK for estimate in wanted[: len(found)])
