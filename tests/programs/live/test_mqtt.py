"""Bookings to an MQTT broker: all of them, in order, also those made while the link was down."""

import json
import socketserver
import sqlite3
import threading
import time
from contextlib import closing, contextmanager
from dataclasses import replace

import pytest

from cylforce.files.atomic import RecordingError
from cylforce.programs.common.addresses import host_and_port
from cylforce.programs.live.mqtt import Broker, pass_on, run_mqtt, summaries
from cylforce.records.outbox import pending
from cylforce.records.recorder import Recorder
from cylforce.records.schema import MIGRATIONS, migrate, open_labels
from cylforce.records.writing import Change
from cylforce.service.loading.truck import set_accepted
from shifts import START, shift


@pytest.fixture
def path(tmp_path):
    return tmp_path / "records.db"


@pytest.fixture
def opened(path):
    shift(path, 3)
    with closing(open_labels(path)) as connection:
        yield connection


def collected(into, most=99):
    """A broker that confirms the first `most` messages."""

    def publish(topic, payload, keep):
        into.append((topic, json.loads(payload)))
        return len(into) <= most

    return publish


def test_what_is_not_confirmed_comes_again(opened):
    first, second = [], []
    assert pass_on(opened, "a", "x", collected(first, 2)) == 2
    assert pass_on(opened, "a", "x", collected(second)) == 1
    assert [said["mass_kg"] for _, said in first] == [100.0, 101.0, 102.0]
    assert [said["mass_kg"] for _, said in second] == [102.0]
    assert pending(opened, "a") == []
    assert len(pending(opened, "b")) == 3  # another receiver has its own place


def test_a_cancelled_booking_comes_once_more(path, opened):
    said = []
    pass_on(opened, "a", "x", collected(said))
    recorder = Recorder(path, START)
    kept = recorder.kept
    for _ in range(2):  # the same once more is no change
        kept = replace(kept, truck=set_accepted(kept.truck, 2, accepted=False).truck)
        recorder.put(Change(START.t_us + 9, kept, None, "cancelled"))
    recorder.close()
    said.clear()
    assert pass_on(opened, "a", "x", collected(said)) == 1
    assert (said[0][1]["booking"], said[0][1]["accepted"]) == (2, False)
    assert said[0][1]["revision"] > 3


def test_what_the_broker_keeps(opened):
    kept = {topic: json.loads(text) for topic, text in summaries(opened, "x").items()}
    assert kept["x/totals"] == [{"product": 0, "name": "", "loads": 3, "mass_kg": 303.0}]
    assert kept["x/telematics"]["CumulativeLoadCount"]["Count"] == 3


def test_records_of_the_version_before_are_renewed_with_all_bookings_waiting(path):
    with closing(sqlite3.connect(path, isolation_level=None)) as old:
        for number, text in enumerate(MIGRATIONS[:2]):
            old.executescript(f"{text} PRAGMA user_version = {number + 1};")
        old.execute("INSERT INTO starts VALUES (1, 1, 2, 'stopped', '0', 'm')")
        for k in range(2):
            old.execute(
                "INSERT INTO bookings VALUES (?, 1, ?, 1, 1, 0, 9.0, 1, 1, 0, 1, 1, 1, 0, 0, 'a', 0, 'OK', 1, 1)",
                (k + 1, k + 1),
            )
        old.row_factory = sqlite3.Row
        with pytest.raises(RecordingError, match="of an older version: start `cylforce run --records` once"):
            run_mqtt(path, Broker("127.0.0.1", 1, "x"))
        migrate(old)
        assert [p.revision for p in pending(old, "a")] == [1, 2]


class Handler(socketserver.StreamRequestHandler):
    """One client of a broker: CONNACK, PUBACK, and what was published goes into `server.got`."""

    def handle(self):
        while head := self.rfile.read(1):
            length = shifted = 0
            while True:
                (byte,) = self.rfile.read(1)
                length |= (byte & 0x7F) << shifted
                shifted += 7
                if byte < 0x80:
                    break
            self.take(head[0], self.rfile.read(length))

    def take(self, head, body):
        if head >> 4 == 1:
            self.wfile.write(b"\x20\x02\x00\x00")
        elif head >> 4 == 3:
            end = 2 + int.from_bytes(body[:2], "big")
            self.server.got.append((body[2:end].decode(), body[end + 2 :].decode(), bool(head & 1)))
            self.wfile.write(b"\x40\x02" + body[end : end + 2])


@contextmanager
def broker(port=0):
    """A broker on 127.0.0.1: what it got, its port."""
    socketserver.ThreadingTCPServer.allow_reuse_address = True
    with socketserver.ThreadingTCPServer(("127.0.0.1", port), Handler) as server:
        server.daemon_threads, server.got = True, []
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        yield server.got, server.server_address[1]
        server.shutdown()


def until(true, seconds=20.0):
    """Waits for what is certain to come."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_real_client_passes_on_what_was_booked_while_the_broker_was_away(path):
    shift(path, 2)
    stop = threading.Event()
    with broker() as (_, port):
        pass  # its port is free again: nobody answers there
    running = threading.Thread(target=run_mqtt, args=(path, Broker("127.0.0.1", port, "m"), stop))
    running.start()
    try:
        with broker(port) as (got, _):
            until(lambda: sum(topic == "m/booking" for topic, *_ in got) == 2 and "m/totals" in {t for t, *_ in got})
            shift(path, 1)
            until(lambda: sum(topic == "m/booking" for topic, *_ in got) == 3)
            stop.set()
            running.join(20.0)
            assert [json.loads(text)["revision"] for topic, text, _ in got if topic == "m/booking"] == [1, 2, 3]
            assert got[0] == ("m/state", "online", True)
            assert got[-1] == ("m/state", "offline", True)
            assert all(keep is (topic != "m/booking") for topic, _, keep in got)
    finally:
        stop.set()
        running.join(20.0)


def test_what_is_no_address():
    with pytest.raises(ValueError, match="--broker here: is no address: write HOST:PORT"):
        host_and_port("--broker", "here")
