"""`cylforce records mqtt`: passes bookings on to an MQTT broker, from the outbox in the records. A process of its own,
so that a slow or dead broker delays nothing."""

import json
import signal
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from threading import Event
from typing import NamedTuple

from cylforce.files.atomic import RecordingError
from cylforce.records.export import row_of, telematics
from cylforce.records.outbox import check_outbox, confirm, pending
from cylforce.records.queries import GRAND, totals
from cylforce.records.schema import open_labels

LOOK_S = 1.0
CONFIRM_S = 10.0  # for a broker to confirm one message
ONLINE, OFFLINE = "online", "offline"
Publish = Callable[[str, str, bool], bool]  # topic, payload, whether the broker keeps it; whether it was confirmed


class Broker(NamedTuple):
    """Broker that receives bookings.

    host:     its host
    port:     its port
    topic:    prefix of all topics
    user:     user name; empty: none
    password: password; empty: none
    tls:      whether the connection is encrypted
    """

    host: str
    port: int
    topic: str
    user: str = ""
    password: str = ""
    tls: bool = False

    @property
    def receiver(self) -> str:
        """Name of the broker in the records."""
        return f"mqtt://{self.host}:{self.port}/{self.topic}"


def pass_on(connection: sqlite3.Connection, receiver: str, topic: str, publish: Publish) -> int:
    """Publish the waiting bookings until the broker no longer confirms; return how many it confirmed."""
    taken = 0
    while waiting := pending(connection, receiver):
        for revision, booking in waiting:
            said = json.dumps(row_of(booking) | {"revision": revision}, allow_nan=False)
            if not publish(f"{topic}/booking", said, False):
                return taken
            confirm(connection, receiver, revision)
            taken += 1
    return taken


def summaries(connection: sqlite3.Connection, topic: str) -> dict[str, str]:
    """Return the retained messages, payload by topic."""
    sums = [
        {"product": total.product, "name": total.name, "loads": total.loads, "mass_kg": total.mass}
        for total in totals(connection, GRAND)
    ]
    return {f"{topic}/totals": json.dumps(sums), f"{topic}/telematics": json.dumps(telematics(connection))}


class BrokerLink:
    """The connection to a broker; it comes back by itself. Raises RecordingError where paho-mqtt is missing."""

    def __init__(self, broker: Broker) -> None:
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError as error:
            raise RecordingError("MQTT needs one more package: pip install 'cylforce[mqtt]'") from error
        self._state, self._name = f"{broker.topic}/state", f"{broker.host}:{broker.port}"
        self._client = Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect = self._connected
        self._client.on_disconnect = self._gone
        self._client.will_set(self._state, OFFLINE, qos=1, retain=True)
        if broker.user:
            self._client.username_pw_set(broker.user, broker.password)
        if broker.tls:
            self._client.tls_set()
        self._client.connect_async(broker.host, broker.port)
        self._client.loop_start()

    def _connected(self, *said: object) -> None:
        print(f"{self._name}: {said[3]}", flush=True)
        self._client.publish(self._state, ONLINE, qos=1, retain=True)

    def _gone(self, *said: object) -> None:
        print(f"{self._name}: {said[3]}; bookings wait in the records", flush=True)

    def publish(self, topic: str, payload: str, keep: bool) -> bool:
        """Publish a message and return whether the broker has confirmed it."""
        if not self._client.is_connected():
            return False
        sent = self._client.publish(topic, payload, qos=1, retain=keep)
        if sent.rc == 0:
            sent.wait_for_publish(CONFIRM_S)
        return sent.rc == 0 and sent.is_published()

    def close(self) -> None:
        """Publish that no more comes, and disconnect."""
        self.publish(self._state, OFFLINE, True)
        self._client.disconnect()
        self._client.loop_stop()


def run_mqtt(records: Path, broker: Broker, stop: Event | None = None) -> None:
    """Publish bookings until a signal comes or `stop` is set. Raises RecordingError with a sentence."""
    with closing(open_labels(records)) as connection:
        check_outbox(connection)
        with closing(BrokerLink(broker)) as link:
            _until(stop or _signalled(), connection, broker, link.publish)


def _signalled() -> Event:
    stop = Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    return stop


def _until(stop: Event, connection: sqlite3.Connection, broker: Broker, publish: Publish) -> None:
    told: dict[str, str] = {}
    while not stop.wait(LOOK_S):
        pass_on(connection, broker.receiver, broker.topic, publish)
        for topic, payload in summaries(connection, broker.topic).items():
            if told.get(topic) != payload and publish(topic, payload, True):
                told[topic] = payload
