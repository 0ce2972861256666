"""The display's server on real sockets: how soon a weight is on the page, with clients that never read, and the end."""

import asyncio
import json
import os
import signal
import socket
import time
from dataclasses import replace

import numpy as np
import pytest

from cylforce.can.opening import open_bus
from cylforce.display import serving
from cylforce.display.picture import Marks
from cylforce.display.serving import Served, listen, serve_display
from cylforce.display.stream import MOST
from cylforce.service.publication import frames
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Quantity, Reason, Status, no_estimate
from scenarios import EXCAVATOR

SERVICE = load(EXCAVATOR).service
STUCK = MOST - 4  # clients that ask for the stream and never read it
ASK = b"GET /stream/work HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"


def published(weight, bus):
    """What the service sends for a weight."""
    quantity = Quantity(weight, 5.0, Status.OK, Reason.NONE)
    estimate = replace(no_estimate(1, Reason.STARTING, None), gross=quantity, net=quantity)
    ids = {pdo.number: pdo.can_id for pdo in SERVICE.publication}
    for number, data in frames(SERVICE.publication, estimate):
        bus.send(ids[number], data)


async def seen(reader, weight):
    """Until the stream shows this weight."""
    while True:
        line = await reader.readline()
        if line.startswith(b"data: ") and json.loads(line[6:])["weight"]["net"] == weight:
            return


async def asked(port):
    reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 20)
    writer.write(ASK)
    await writer.drain()
    return reader, writer


def never_reads(port):
    """A client with a small buffer that asks and then does nothing."""
    client = socket.create_connection(("127.0.0.1", port))
    client.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    client.sendall(ASK)
    return client


async def measured(count):
    """Seconds from PDO to page, of 20 weights, with `count` clients that never read; seconds that the end took."""
    bus, panel = open_bus("virtual:serving"), open_bus("virtual:serving")
    listening = listen("127.0.0.1", 0)
    port = listening.getsockname()[1]
    served = Served(SERVICE, None, "127.0.0.1", port, (), "", Marks(), "en")
    server = asyncio.create_task(serve_display(served, bus, listening))
    await asyncio.sleep(0.3)
    stuck = [never_reads(port) for _ in range(count)]
    reader, writer = await asked(port)
    await asyncio.sleep(0.5)
    delays = []
    for k in range(20):
        await asyncio.sleep(0.013 * (k % 7))
        begun = time.monotonic()
        published(100.0 + k, panel)
        await asyncio.wait_for(seen(reader, 100.0 + k), 5.0)
        delays.append(time.monotonic() - begun)
    begun = time.monotonic()
    os.kill(os.getpid(), signal.SIGTERM)  # uvicorn's own handler takes it
    await asyncio.wait_for(server, 10.0)
    ended = time.monotonic() - begun
    writer.close()
    for each in (*stuck, bus, panel):
        each.close()
    return delays, ended


@pytest.fixture(autouse=True)
def handlers():
    """The server raises the signal that ended it again: here nothing happens then."""
    before = {number: signal.signal(number, lambda *_: None) for number in (signal.SIGTERM, signal.SIGINT)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("count", [0, STUCK])
def test_a_weight_is_on_the_page_soon_whoever_does_not_read(count):
    delays, ended = asyncio.run(measured(count))
    figures = f"median {1e3 * np.median(delays):.0f} ms, largest {1e3 * max(delays):.0f} ms, end {ended:.1f} s"
    print(f"{count} clients that never read: {figures}")
    assert np.median(delays) <= 0.2
    assert max(delays) <= 0.3 + 0.5  # the limit is 0.3 s; a busy machine may add to a single one
    assert ended < 4.0


def test_an_address_in_use_is_a_sentence():
    with listen("127.0.0.1", 0) as taken, pytest.raises(ValueError, match="choose another address or port"):
        listen("127.0.0.1", taken.getsockname()[1])
    assert serving.is_loopback("::1")
    assert not serving.is_loopback("0.0.0.0")
