"""Faults of bus, clock, files and computer in the middle of work: rows of the contract without a place elsewhere."""

import asyncio
import configparser
import subprocess
import sys
from pathlib import Path

import pytest
import tomlkit

from cylforce.can.opening import open_bus
from cylforce.commissioning.identification import identify
from cylforce.programs.common.readings import make_core, model_of
from cylforce.programs.run import Daemon
from cylforce.records.audit import Audit, entries, first_broken
from cylforce.records.recorder import Recorder
from cylforce.records.schema import open_reading
from cylforce.records.writing import Start
from cylforce.service.core import Core
from cylforce.service.memory import NOTHING_KEPT
from cylforce.service.plausibility.suspicion import Level
from cylforce.service.service import WeighingService
from cylforce.settings.identified import read_identified, write_identified
from cylforce.settings.machine_file import SettingsError, load
from cylforce.signals.estimate import Status
from cylforce.signals.events import Frame, Tick
from scenarios import EXCAVATOR, cycles, fed, moved, seconds, through

UNIT = Path(__file__).resolve().parents[2] / "systemd" / "cylforce.service"
FRAME_US = 250  # of 8 bytes at 500 kbit/s
HOLD_S = 0.2
TARE = bytes.fromhex("23 39 61 01") + b"tare"


class Work:
    """Two cycles of digging: events, and every two seconds (event, state) of the service; what it says of all."""

    def __init__(self):
        self.loaded = load(EXCAVATOR)
        self.found = identify(model_of(self.loaded), [moved(self.loaded)])
        self.core = Core(self.loaded.service, self.found.tares)
        self.events, _ = cycles(self.loaded, count=2)
        state, self.states, self.good = WeighingService.start(self.core), [], {}
        for k, event in enumerate(self.events):
            if isinstance(event, Tick) and seconds(event) >= 6.0 + 2.0 * len(self.states):
                self.states.append((k, state.copied()))
            out = fed(state, event)
            if out.estimate is not None:
                self.good[event.t_us] = out.estimate


@pytest.fixture(scope="module")
def work():
    """Made once."""
    return Work()


# --- 28: a bus full of others' frames ---------------------------------------------------------------------------------

MAILBOXES = {
    "oldest": lambda frames: frames[:1],
    "newest": lambda frames: frames[-1:],
    "three": lambda frames: frames[:3],
}


def filled(events, lasts, kept):
    """The events, if others have the bus for so many seconds: of what each sensor measures meanwhile, `kept` frames
    wait in its controller; then they leave one after the other, what is measured meanwhile behind them."""
    free, waiting = events[0].t_us + round(1e6 * lasts), {}
    for e in events:
        if not isinstance(e, Tick) and e.t_us < free:
            waiting.setdefault(e.can_id, []).append(e)
    wait = sorted((e for frames in waiting.values() for e in kept(frames)), key=lambda e: e.t_us)
    queue, at = [], free
    for e in [*wait, *(e for e in events if not isinstance(e, Tick) and e.t_us >= free)]:
        at = max(at + FRAME_US, e.t_us)
        queue.append(e._replace(t_us=at))
    return sorted([*queue, *(e for e in events if isinstance(e, Tick))], key=lambda e: e.t_us)


@pytest.mark.parametrize("kept", MAILBOXES)
@pytest.mark.parametrize("lasts", [0.15, 0.5, 3.0])
def test_a_bus_full_of_others_frames(work, kept, lasts):
    """Held for 0.2 s, then INVALID; back within a second after the bus is free; a value that waited is no leap."""
    for at, before in work.states[:-3]:
        begin = work.events[at].t_us
        free = begin + 1e6 * lasts
        events = [e for e in work.events[at:] if e.t_us < free + 2e6]
        state, found, _ = through(work.core, filled(events, lasts, MAILBOXES[kept]), before)
        assert state.monitor.suspicion.level is Level.FINE
        forces = {e.t_us: e.force.magnitude.status for e in found}
        assert {s for t, s in forces.items() if begin + 1e6 * HOLD_S + 20_000 < t < free} <= {Status.INVALID}
        assert not {s for t, s in forces.items() if t > free + 1e6} & {Status.INVALID, Status.HOLD}
        for e in found:
            same = work.good[e.t_us].gross
            if Status.OK is e.gross.status is same.status:
                assert abs(e.gross.value - same.value) < 3.0 * (e.gross.standard_error + same.standard_error)


# --- 35, 50: commands and clocks --------------------------------------------------------------------------------------


def test_two_tares_at_once_are_one_after_the_other(work):
    """In one step: both are answered, the weight is the same after the second one."""
    at, state = next((k, s) for k, s in work.states if s.estimate.gross.status is Status.OK)
    request = Frame(work.events[at].t_us, 0x600 + work.core.service.node_id, TARE)
    one, _, first = through(work.core, [request], state)
    two, _, both = through(work.core, [request, request], state)
    assert (first, both) == ([0], [0, 0])
    assert one.scale == two.scale != state.scale


def test_a_clock_that_stands_at_1970_changes_no_estimate(work):
    """The battery of the clock is empty: every estimate is the same but for its time."""
    shift = work.events[0].t_us - 1
    early = [e._replace(t_us=e.t_us - shift) for e in work.events if seconds(e) < 12.0]
    _, found, _ = through(work.core, early)
    assert len(found) > 1000
    for e in found:
        good = work.good[e.t_us + shift]
        assert (str(e.gross), str(e.force)) == (str(good.gross), str(good.force))


def test_the_trail_is_in_order_whatever_the_clock_says(tmp_path):
    """Started in 1970, set, started in 1970 again: entries are numbered and chained as they came."""
    path, times = tmp_path / "records.db", (5, 1_800_000_000_000_000, 7)
    for t_us in times:
        recorder = Recorder(path, Start(t_us, "1.0", "crane", "root", ()))
        recorder.put(Audit(t_us + 1, "SDO client", f"at {t_us}"))
        recorder.close()
    connection = open_reading(path)
    found, broken = list(entries(connection)), first_broken(connection)
    connection.close()
    assert [(e.number, e.what) for e in found] == [(k, f"at {t}") for k, t in enumerate(times, 1)]
    assert broken is None


# --- 39, 45: files that are changed meanwhile -------------------------------------------------------------------------


@pytest.fixture
def files(work, tmp_path):
    """A machine file and its identified file."""
    machine, tares = tmp_path / "machine.toml", tmp_path / "identified.toml"
    machine.write_text(work.loaded.text, encoding="utf-8")
    write_identified(tares, work.found, load(machine), [])
    return machine, tares


def test_files_that_are_spoilt_in_operation_change_nothing_until_the_next_start(files):
    """They are read at the start only; the next one refuses them."""
    machine, tares = files
    loaded = load(machine)
    daemon = Daemon(loaded, make_core(loaded, tares), open_bus("virtual:spoilt"), None, NOTHING_KEPT)
    told = []

    async def main():
        loop = asyncio.get_running_loop()
        daemon.start(loop)
        for path in files:
            path.write_text("scale = nan\n", encoding="utf-8")
        stepped = asyncio.Event()
        daemon.on_estimate = lambda e: (told.append(e), len(told) >= 20 and stepped.set())
        await stepped.wait()
        await daemon.stop(loop)

    asyncio.run(asyncio.wait_for(main(), 60.0))
    with pytest.raises(SettingsError, match=r"machine\.toml"):
        load(machine)
    with pytest.raises(SettingsError, match=r"identified\.toml"):
        read_identified(tares, loaded)


def test_an_identification_that_ends_in_writing_leaves_the_old_file(work, files, monkeypatch):
    machine, tares = files
    before = tares.read_bytes()

    def ends(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(tomlkit, "dumps", ends)
    with pytest.raises(KeyboardInterrupt):
        write_identified(tares, work.found, load(machine), [])
    assert tares.read_bytes() == before
    assert sorted(machine.parent.iterdir()) == [tares, machine]


def test_the_service_identifies_nothing_itself():
    """Identification is a process of its own: its load, its crash and its hanging are not the service's."""
    code = "import sys, cylforce.programs.run; print('cylforce.commissioning.identification' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == "False\n"


# --- 47, 48: the unit -------------------------------------------------------------------------------------------------


def unit():
    """The unit's words; of a word that is given twice the last one."""
    found = configparser.RawConfigParser(strict=False)
    found.optionxform = str
    found.read(UNIT, encoding="utf-8")
    return found


SLOW_START_S = 6.0  # the slowest start of the service that was measured, on a busy computer


def test_a_service_that_fails_again_and_again_is_left_off():
    """The failures that the limit allows fit into its time, each after a slow start, a hang and the pause."""
    start, service = unit()["Unit"], unit()["Service"]
    assert service["Restart"] == "on-failure"
    each = SLOW_START_S + float(service["WatchdogSec"]) + float(service["RestartSec"])
    assert int(start["StartLimitBurst"]) * each < float(start["StartLimitIntervalSec"])


def test_memory_is_limited_and_taken_from_others_first():
    service = unit()["Service"]
    assert service["MemoryMax"] == "500M"
    assert int(service["OOMScoreAdjust"]) < 0
