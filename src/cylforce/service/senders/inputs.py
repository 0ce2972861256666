"""What is remembered of the frames that came: one array, which the kernel writes (estimation/kernel/inputs.py), and
views of it by name."""

from typing import Any, NamedTuple

from cylforce.estimation.kernel.inputs import NEVER, SENDER, SIGNAL
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.signals.estimate import Reason

QUIET_US = 2_000_000  # after the last sign of a second producer, until an identifier is trusted again; chosen
REASONS = {float(reason): reason for reason in Reason}


class Channel(NamedTuple):
    """One signal: its last accepted `value` (while it has not yet sent enough good values: its last value); `t_us`:
    time of the last accepted value; `seen_us`: time of the last value of any kind; `reason`: what was wrong with that
    one; `good`: number of good values in a row; `equal`: number of equal values in a row while the machine moved;
    `jumps`: number of values in a row that are off by a `leap`, the `last` one of them; `leapt`: sum of the leaps that
    were believed after so many of them; `since_us`: the last value of any kind was measured after that time, however
    long it then waited for the bus."""

    value: float
    t_us: float
    seen_us: float
    reason: Reason
    good: float
    equal: float
    jumps: float
    leap: float = 0.0
    last: float = 0.0
    leapt: float = 0.0
    since_us: float = NEVER


class FrameCounters(NamedTuple):
    """Numbers of frames with an unknown identifier, too short, too long."""

    unknown: float
    short: float
    long: float


class LastHeartbeat(NamedTuple):
    """A node's last heartbeat: time [us] and state; NEVER: none yet. `booted`: it has told that it booted, so that its
    heartbeat must follow its first PDO."""

    t_us: float = NEVER
    state: float = 5.0
    booted: float = 0.0


class PdoRate(NamedTuple):
    """A PDO: time of its last frame [us], frames beyond those that one producer sends, time of the last sign of a
    second one [us]."""

    t_us: float = NEVER
    excess: float = 0.0
    doubled_us: float = NEVER


class Inputs(NamedTuple):
    """State of all signals, PDOs and nodes, the frame counters, and who else sends: the array that is `kept`, and the
    numbers of signals, PDOs and nodes."""

    kept: Numbers
    sizes: tuple[int, int, int]

    @property
    def channels(self) -> tuple[Channel, ...]:
        """All signals."""
        found = []
        for o in range(0, SIGNAL * self.sizes[0], SIGNAL):
            each: list[Any] = self.kept[o : o + SIGNAL].tolist()
            found.append(Channel._make([*each[:3], REASONS[each[3]], *each[4:]]))
        return tuple(found)

    @property
    def pdos(self) -> tuple[PdoRate, ...]:
        """All PDOs, in the order of `Supervisor.pdos`."""
        begin, end = self.place_of_pdo(0), self.place_of_pdo(self.sizes[1])
        return tuple(PdoRate(*self.kept[o : o + SENDER]) for o in range(begin, end, SENDER))

    @property
    def nodes(self) -> tuple[LastHeartbeat, ...]:
        """All nodes."""
        begin, end = self.place_of_node(0), self.place_of_node(self.sizes[2])
        return tuple(LastHeartbeat(*self.kept[o : o + SENDER]) for o in range(begin, end, SENDER))

    @property
    def counters(self) -> FrameCounters:
        """Numbers of frames."""
        return FrameCounters(*self.kept[-5:-2])

    @property
    def long_us(self) -> float:
        """Time of the last frame that was longer than its mapping [us]."""
        return self.kept[-2]

    def spoofed(self, t_us: int) -> bool:
        """Whether somebody else sends our identifiers."""
        return abs(t_us - self.kept[-1]) < QUIET_US

    def place_of_pdo(self, k: int) -> int:
        """Where the numbers of a PDO begin."""
        return SIGNAL * self.sizes[0] + SENDER * k

    def place_of_node(self, k: int) -> int:
        """Where the numbers of a node begin."""
        return SIGNAL * self.sizes[0] + SENDER * (self.sizes[1] + k)
