"""A new identified file for a service that runs: taken between two events, or refused."""

import asyncio
import os
import signal
import socket
from contextlib import suppress
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.can.opening import open_bus
from cylforce.canopen.dictionary.object_dictionary import PARAMETERS_ID, PROTECTION
from cylforce.commissioning.identification import Identification
from cylforce.files.atomic import RecordingError
from cylforce.files.logfile import LogWriter, file_sha256
from cylforce.files.logreader import log_header, read_events
from cylforce.files.rotation import Rotation
from cylforce.files.software import short
from cylforce.programs.common.readings import beginning, header_of, make_core, model_of
from cylforce.programs.live import reloading
from cylforce.programs.live.books import open_recorder
from cylforce.programs.live.notify import Manager
from cylforce.programs.live.station import serve
from cylforce.programs.run import Daemon
from cylforce.records.audit import entries
from cylforce.records.schema import open_reading
from cylforce.service.booking import Weighed
from cylforce.service.commands import Scale
from cylforce.service.memory import NOTHING_KEPT
from cylforce.service.plausibility.suspicion import Level, SensorFault, SensorSuspicion
from cylforce.service.service import WeighingService
from cylforce.settings.identified import identified_seal, write_identified
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR
from waiting import until

MACHINE = load(EXCAVATOR)
STEPS = 20  # of the daemon before and after something is done to it
OLD, NEW = 60.0, 80.0  # N m: standard error of a row


def write(path, row_error):
    """A file as `cylforce identify` writes it, of the data sheet's values."""
    model = model_of(MACHINE)
    sheet = model.data_sheet
    tares = sheet._replace(covariance=1e-6 * sheet.covariance, identified=True, row_error=np.full(3, row_error))
    found = Identification(model, tares, None, (), 60.0, {}, (), np.ones(3), ())
    write_identified(path, found, MACHINE, [("empty.log", "0" * 64)])
    return path


class Running:
    """A daemon with a log and records; `messages`: what the service manager was told."""

    def __init__(self, folder):
        self.file, self.records, self.log = write(folder / "identified.toml", OLD), folder / "r.db", folder / "run.log"
        self.new = write(folder / "new.toml", NEW)
        core = make_core(MACHINE, self.file)
        header = header_of(MACHINE, self.file, "virtual:reload")
        writer = LogWriter(self.log, header, 0, "reload", rotation=Rotation(10**9, 4))
        self.recorder = open_recorder(self.records, MACHINE, self.file)
        bus = open_bus(f"virtual:{folder.name}")
        self.daemon = Daemon(MACHINE, core, bus, writer, NOTHING_KEPT, self.recorder, identified=self.file)
        self.heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.heard.bind(str(folder / "notify"))
        self.heard.setblocking(False)
        self.told = []
        self.manager = Manager({"NOTIFY_SOCKET": str(folder / "notify")})

    @property
    def error(self):
        """Of a row, with the parameters in use [N m]."""
        return float(self.daemon.core.tares.row_error[0])

    def serve(self, *deeds):
        """Serve, do these in turn, and end some steps after the parameters were read anew."""

        async def main():
            ended = asyncio.Event()
            asyncio.get_running_loop().add_reader(self.heard, self.hear)
            served = asyncio.create_task(serve(self.daemon, ended, lambda: None, manager=self.manager))
            await until(lambda: self.told.count("READY=1") == 1)
            for deed in deeds:
                steps = self.daemon.counts.steps
                await until(lambda steps=steps: self.daemon.counts.steps > steps + STEPS)
                deed()
            await until(lambda: self.told.count("READY=1") == 2)
            steps = self.daemon.counts.steps
            await until(lambda: self.daemon.counts.steps > steps + STEPS)
            ended.set()
            await served
            with suppress(BlockingIOError):  # the last one may have been heard
                self.hear()

        asyncio.run(main())
        self.recorder.close()

    def hear(self):
        """What the service manager is told, but for the watchdog's food."""
        words = self.heard.recv(200).decode()
        if words != "WATCHDOG=1":
            self.told.append(words.split("\n")[0])


@pytest.fixture
def running(tmp_path):
    made = Running(tmp_path)
    yield made
    made.heard.close()


def hang_up():
    os.kill(os.getpid(), signal.SIGHUP)


def test_a_new_file_is_taken_between_two_events(running):
    then = SimpleNamespace()

    def replaced():
        then.steps = running.daemon.counts.steps
        running.new.replace(running.file)
        hang_up()

    running.serve(replaced)
    assert running.error == NEW
    assert running.daemon.counts.steps > then.steps  # it went on
    seal = identified_seal(running.file)
    assert running.daemon.node.raw(PROTECTION, PARAMETERS_ID) == short(seal.sha256)
    assert running.told == ["READY=1", "RELOADING=1", "READY=1", "STOPPING=1"]
    with open_reading(running.records) as connection:
        said = [entry.what for entry in entries(connection)]
    assert sum(seal.sha256[:16] in what for what in said) == 1
    running.recorder = open_recorder(running.records, MACHINE, running.file)
    running.recorder.close()
    with open_reading(running.records) as connection:
        assert [entry.what for entry in entries(connection)] == said  # the next start has nothing to add


def test_the_log_goes_on_in_a_file_that_names_the_new_parameters(running):
    old = file_sha256(running.file)
    running.serve(lambda: running.new.replace(running.file), hang_up)
    new = file_sha256(running.file)
    header = log_header(running.log)
    assert header.identified_sha256 == new != old
    before = [p for p in running.log.parent.glob("run*.log") if p != running.log]
    assert [log_header(p).identified_sha256 for p in before] == [old]
    core, now = make_core(MACHINE, running.file), header_of(MACHINE, running.file, "virtual:reload")
    state = beginning(core, header, now, running.log, pytest.fail)  # it says nothing: the state fits the parameters
    assert state.sampled_us == 0
    assert list(read_events(running.log, print))


@pytest.mark.parametrize(
    "spoil",
    [
        lambda path: path.write_text("no = [TOML"),
        lambda path: path.write_text(path.read_text().replace("80.0", "81.0")),  # its seal is broken
        lambda path: path.unlink(),
    ],
)
def test_a_bad_file_is_refused_and_the_old_parameters_stay(running, spoil):
    core, shown = running.daemon.core, running.daemon.node.raw(PROTECTION, PARAMETERS_ID)

    def spoilt():
        running.new.replace(running.file)
        spoil(running.file)
        hang_up()

    running.serve(spoilt)
    assert running.daemon.core is core
    assert running.daemon.node.raw(PROTECTION, PARAMETERS_ID) == shown
    assert [*running.log.parent.glob("run*.log")] == [running.log]  # no new one
    assert running.told == ["READY=1", "RELOADING=1", "READY=1", "STOPPING=1"]


def test_a_fifo_is_refused(tmp_path):
    os.mkfifo(tmp_path / "identified.toml")
    with pytest.raises(RecordingError):
        reloading.read_anew(MACHINE, tmp_path / "identified.toml")


def test_a_file_that_is_replaced_while_it_is_read_is_refused(tmp_path, monkeypatch):
    path = write(tmp_path / "identified.toml", OLD)

    def made(*words):
        core = make_core(*words)
        write(path, NEW)
        return core

    monkeypatch.setattr(reloading, "make_core", made)
    with pytest.raises(RecordingError, match="while it was read"):
        reloading.read_anew(MACHINE, path)


def test_what_other_parameters_do_not_change_stays(tmp_path):
    """Zero and tare, a rejected signal, and that a load hung: it was weighed with the old ones."""
    old, new = (make_core(MACHINE, write(tmp_path / f"{error}.toml", error)) for error in (OLD, NEW))
    state = WeighingService.start(old)
    hung = Weighed(900.0, 4.0, np.zeros(len(old.tares.values)), np.zeros(state.drift.values.size), 200)
    burst = SensorSuspicion(Level.REJECTED, SensorFault.BURST, (0,))
    state.bookings.candidate, state.monitor.suspicion = hung, burst
    state.scale, state.stopped = Scale(5.0, 7.0), True
    after = state.with_core(new)
    assert after.scale == Scale(5.0, 7.0)
    assert after.monitor.suspicion == burst
    assert after.stopped
    assert after.inputs.state.tobytes() == state.inputs.state.tobytes()  # bytes, because NaN equals nothing
    assert after.pipeline.state is None
    missed = after.bookings.missed
    assert (after.bookings.candidate, missed.number, missed.mass) == (None, 1, 900.0)
    light = state.copied()
    light.monitor.suspicion = SensorSuspicion(Level.SUSPECTED, SensorFault.NEGATIVE_WEIGHT, (0,))
    assert light.with_core(new).monitor.suspicion.level is Level.FINE
    assert not after.memory.unconfirmed
    doubted = state.with_core(new, unconfirmed=True)
    assert doubted.memory.unconfirmed
    assert doubted.with_core(new).memory.unconfirmed  # the same, read again
    assert not doubted.with_core(new, unconfirmed=False).memory.unconfirmed


def test_the_unit_asks_for_it():
    unit = EXCAVATOR.parents[1] / "systemd" / "cylforce.service"
    assert "ExecReload=kill -HUP $MAINPID" in unit.read_text().splitlines()
