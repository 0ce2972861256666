"""The audit trail: every change of what the scale shows is entered, and no entry can be changed unnoticed."""

import asyncio
import sqlite3
import struct
import subprocess
import sys

import pytest

from cylforce.can.opening import open_bus
from cylforce.canopen.dictionary.object_dictionary import (
    AUDIT_COUNT,
    CODE,
    MACHINE_ID,
    PARAMETERS_ID,
    PROTECTION,
    SOFTWARE_ID,
)
from cylforce.files.software import files_sha256, short, software_sha256
from cylforce.programs.common.addresses import read_code
from cylforce.programs.common.readings import make_core
from cylforce.programs.live.books import AUDIT_MOST, AUDIT_US, open_recorder
from cylforce.programs.run import Daemon
from cylforce.records.audit import Audit, entries, first_broken
from cylforce.records.recorder import Recorder
from cylforce.records.schema import open_reading
from cylforce.records.writing import Change, Start
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR
from waiting import until

MACHINE = load(EXCAVATOR)
CODE_OF_TEST = 123_456
START = Start(1_000_000, "1.0", "crane", "root", (("software", "1.0 abc"), ("parameters", "of the data sheet")))


def trail(path):
    connection = open_reading(path)
    try:
        return list(entries(connection)), first_broken(connection)
    finally:
        connection.close()


def kept(path, start, *changes):
    recorder = Recorder(path, start)
    for change in changes:
        recorder.put(change)
    recorder.close()
    return recorder


@pytest.fixture
def records(tmp_path):
    path = tmp_path / "records.db"
    kept(path, START, *(Audit(2_000_000 + k, "SDO client", f"change {k}") for k in range(5)))
    return path


def test_entries_are_numbered_without_gaps_and_chained(records):
    found, broken = trail(records)
    assert [e.number for e in found] == list(range(1, 8))
    assert [e.what for e in found[:2]] == ["software: 1.0 abc", "parameters: of the data sheet"]
    assert {e.who for e in found[:2]} == {"root"}
    assert len({e.digest for e in found}) == 7
    assert broken is None


def test_a_start_enters_only_what_is_another_than_before(records):
    kept(records, START)
    assert len(trail(records)[0]) == 7
    kept(records, START._replace(now=(("software", "1.1 def"), START.now[1])))
    kept(records, START)
    assert [e.what for e in trail(records)[0][7:]] == ["software: 1.1 def", "software: 1.0 abc"]
    assert trail(records)[1] is None


def test_what_an_operator_changed_is_entered_with_the_change(records):
    kept(records, START, Change(3_000_000, NOTHING_KEPT, None, "zero 5.0 kg, tare 0.0 kg"))
    entry = trail(records)[0][-1]
    assert (entry.who, entry.what, entry.t_us) == ("operator", "zero 5.0 kg, tare 0.0 kg", 3_000_000)


@pytest.mark.parametrize(
    "sql", ["UPDATE audit SET what = 'nothing' WHERE number = 3", "DELETE FROM audit WHERE number = 3"]
)
def test_the_database_refuses_to_change_the_trail(records, sql):
    connection = sqlite3.connect(records)
    with pytest.raises(sqlite3.IntegrityError, match="the audit trail"):
        connection.execute(sql)
    connection.close()


@pytest.mark.parametrize(
    ("sql", "at"),
    [
        ("UPDATE audit SET what = 'nothing' WHERE number = 3", 3),
        ("UPDATE audit SET who = 'nobody' WHERE number = 7", 7),
        ("UPDATE audit SET t_us = t_us + 1 WHERE number = 1", 1),
        ("DELETE FROM audit WHERE number = 4", 4),
        ("DELETE FROM audit WHERE number = 1", 1),
        ("INSERT INTO audit VALUES (8, 1, 'x', 'y', 'z')", 8),
    ],
)
def test_who_removes_the_triggers_is_found_by_the_chain(records, sql, at):
    connection = sqlite3.connect(records, isolation_level=None)
    for trigger in ("audit_stays", "audit_is_so"):
        connection.execute(f"DROP TRIGGER {trigger}")
    connection.execute(sql)
    connection.close()
    assert trail(records)[1] == at
    done = subprocess.run(
        [sys.executable, "-m", "cylforce", "records", "audit", str(records)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert f"entry {at} is missing or was changed" in done.stdout


def test_the_trail_is_listed(records):
    command = [sys.executable, "-m", "cylforce", "records", "audit", str(records), "--last", "2"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert "change 4" in done.stdout
    assert "change 2" not in done.stdout
    assert "7 entries; the chain is whole" in done.stdout


def written(index, sub, raw):
    return struct.pack("<BHB", 0x23 | (4 - len(raw)) << 2, index, sub) + raw.ljust(4, b"\0")


async def served(path, requests):
    """Start the service and send SDO requests, each when the one before is answered. Return its objects of the
    protection once they count every request."""
    recorder = open_recorder(path, MACHINE)
    bus = open_bus("virtual:audit")
    daemon = Daemon(MACHINE, make_core(MACHINE, None), bus, None, recorder.kept, recorder, CODE_OF_TEST)
    client, answers = open_bus("virtual:audit"), []
    answer = 0x580 + MACHINE.service.node_id
    client.attach(asyncio.get_running_loop(), lambda frame: frame.can_id == answer and answers.append(frame.data))
    daemon.start(asyncio.get_running_loop())
    before = daemon.node.raw(PROTECTION, AUDIT_COUNT)
    for count, data in enumerate(requests, 1):
        client.send(0x600 + MACHINE.service.node_id, data)
        await until(lambda count=count: len(answers) == count)
    await until(lambda: daemon.node.raw(PROTECTION, AUDIT_COUNT) >= before + len(requests))
    shown = {sub: daemon.node.raw(PROTECTION, sub) for sub in (AUDIT_COUNT, SOFTWARE_ID, PARAMETERS_ID, MACHINE_ID)}
    await daemon.stop(asyncio.get_running_loop())
    client.close()
    recorder.close()
    return shown


def test_what_a_stranger_does_over_sdo_is_entered_and_counted_on_the_bus(tmp_path):
    path = tmp_path / "records.db"
    requests = [
        written(0x1017, 0, b"\x64\x00"),  # refused: locked
        written(PROTECTION, CODE, b"\1\0\0\0"),  # a wrong code
        written(PROTECTION, CODE, struct.pack("<I", CODE_OF_TEST)),
        written(0x1017, 0, b"\x64\x00"),
        written(0x2190, 2, struct.pack("<I", 7)),  # an operator's: another product
    ]
    shown = asyncio.run(served(path, requests))
    found, broken = trail(path)
    assert broken is None
    said = [(e.who, e.what) for e in found[3:]]
    assert [who for who, _ in said] == ["SDO client"] * 4 + ["operator"]
    for (_, what), wanted in zip(
        said, ["1017h:0 refused", "wrong code", "unlocked", "to 0064h", "product 7"], strict=True
    ):
        assert wanted in what
    assert shown[AUDIT_COUNT] == len(found)
    assert shown[SOFTWARE_ID] == short(software_sha256())
    assert shown[MACHINE_ID] == short(MACHINE.sha256)
    assert shown[PARAMETERS_ID] == 0


def test_many_attempts_fill_neither_disk_nor_queue(tmp_path):
    path = tmp_path / "records.db"
    recorder = open_recorder(path, MACHINE)
    daemon = Daemon(MACHINE, make_core(MACHINE, None), open_bus("virtual:many"), None, NOTHING_KEPT, recorder)
    for k in range(5000):
        daemon.books.audit(10 + k, "SDO client", "refused")
    daemon.books.audit(10 + AUDIT_US, "SDO client", "refused again")
    daemon.bus.close()
    recorder.close()
    assert recorder.failure == ""
    found, broken = trail(path)
    assert broken is None
    assert len(found) == 3 + AUDIT_MOST + 1
    assert f"{5000 - AUDIT_MOST} entries were withheld" in found[-1].what


def test_the_software_id_changes_with_any_file(tmp_path):
    package = tmp_path / "cylforce"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "a.py").write_text("1")
    hashes = []
    for text in ("1", "2", "1"):
        (package / "a.py").write_text(text)
        hashes.append(files_sha256(package))
    assert hashes[0] == hashes[2] != hashes[1]
    (package / "a.py").rename(package / "b.py")
    assert files_sha256(package) != hashes[0]


@pytest.mark.parametrize(
    ("text", "fine"), [("123456\n", True), ("12345", False), ("0000000", False), ("12a456", False)]
)
def test_a_code_is_six_to_nine_digits(tmp_path, text, fine):
    path = tmp_path / "code"
    path.write_text(text)
    if fine:
        assert read_code(path) == 123_456
    else:
        with pytest.raises(ValueError, match=r"--lock-file .*: the code must be 6 to 9 digits"):
            read_code(path)
