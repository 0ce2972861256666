"""A station on a bus that a test reads and writes over SDO."""

import struct

from cylforce.canopen.access import LockState
from cylforce.canopen.dictionary.object_dictionary import CODE, LOCK_STATE, PROTECTION
from cylforce.programs.live.station import Station
from cylforce.settings.machine_file import load
from cylforce.signals.events import Frame
from scenarios import EXCAVATOR

LOADED = load(EXCAVATOR)
SERVICE = LOADED.service
OWN = SERVICE.node_id
SECRET = 20_261_125


class FakeBus:
    """A bus on which an SDO client asks and hears."""

    def __init__(self):
        self.sent = []

    def send(self, can_id, data):
        self.sent.append((can_id, bytes(data)))
        return True


class Log:
    full, failure, closed = False, "", False

    def __init__(self):
        self.events = []

    def log(self, event):
        self.events.append(event)


class Silent:
    """A handler that obeys nothing and publishes nothing."""

    def on_frame(self, frame):
        return None

    def on_tick(self, t_us):
        return None


class Recorded(Station):
    """A station whose events of the lock go to the list `said`."""

    def protected(self, words):
        self.said.append(words)


class Bench:
    """A station without a loop; `t_us` is the time of the next request."""

    def __init__(self, code=SECRET):
        self.bus, self.log = FakeBus(), Log()
        self.station = Recorded(SERVICE, Silent(), self.bus, self.log, code)
        self.said = self.station.said = []
        self.t_us = 1_000_000
        self.station.node.boot()

    def ask(self, data):
        self.bus.sent.clear()
        self.station.on_frame(Frame(self.t_us, 0x600 + OWN, data))
        return self.bus.sent[-1][1]

    def write(self, address, value):
        """0, or the abort code."""
        index, sub, code = address
        raw = struct.pack(code, value)
        answer = self.ask(struct.pack("<BHB", 0x23 | (4 - len(raw)) << 2, index, sub) + raw.ljust(4, b"\0"))
        return 0 if answer[0] == 0x60 else aborted(answer)

    def read(self, index, sub):
        answer = self.ask(struct.pack("<BHB4x", 0x40, index, sub))
        assert answer[0] & 0xE3 == 0x43, aborted(answer)
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def unlock(self, code=SECRET):
        return self.write((PROTECTION, CODE, "<I"), code)

    def nmt(self, command):
        self.station.on_frame(Frame(self.t_us, 0, bytes([command, OWN])))

    @property
    def lock(self):
        return LockState(self.read(PROTECTION, LOCK_STATE))


def aborted(answer):
    assert answer[0] == 0x80
    code = int.from_bytes(answer[4:8], "little")
    assert code
    return code
