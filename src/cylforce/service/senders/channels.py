"""State of signals, PDOs and nodes by name. The kernel keeps them in one flat array (`kernel/inputs.py`), whose parts
`InputLayout` names; the order of the fields is that of the kernel."""

from dataclasses import dataclass
from math import nan
from typing import Self

from cylforce.estimation.kernel.inputs import NEVER
from cylforce.signals.estimate import Reason

QUIET_US = 2_000_000  # after the last sign of a second producer, until an identifier is trusted again; chosen
REASONS = {float(reason): reason for reason in Reason}


@dataclass(frozen=True, slots=True)
class Channel:
    """One signal.

    value:    last accepted value [SI]; while not enough good values were received: the last one
    t_us:     time of the last accepted value [us]
    seen_us:  time of the last value of any kind [us]
    reason:   what was wrong with that one, as a number of `Reason`
    good:     number of good values in a row
    equal:    number of equal values in a row while the machine moved
    jumps:    number of values in a row that are off by a `leap`
    leap:     difference from the value before the leap [SI]
    last:     last implausible value [SI]
    leapt:    sum of the leaps that were accepted after enough such values [SI]
    since_us: the last value of any kind was measured after this time, however long it then waited for the bus [us]
    """

    value: float
    t_us: float
    seen_us: float
    reason: float
    good: float
    equal: float
    jumps: float
    leap: float = 0.0
    last: float = 0.0
    leapt: float = 0.0
    since_us: float = NEVER

    @classmethod
    def without_value(cls, reason: Reason, leapt: float = 0.0) -> Self:
        """Return a signal of which no value was accepted."""
        return cls(nan, t_us=NEVER, seen_us=NEVER, reason=reason, good=0.0, equal=0.0, jumps=0.0, leapt=leapt)


@dataclass(frozen=True, slots=True)
class FrameCounters:
    """Numbers of frames that were not as expected.

    unknown: with an identifier of no sensor
    short:   shorter than their mapping
    long:    longer than their mapping
    """

    unknown: float
    short: float
    long: float


@dataclass(frozen=True, slots=True)
class LastHeartbeat:
    """A node's last heartbeat.

    t_us:   its time [us]; NEVER: none yet
    state:  NMT state
    booted: 1 after a boot-up message, so that its heartbeat must follow its first PDO
    """

    t_us: float = NEVER
    state: float = 5.0
    booted: float = 0.0


@dataclass(frozen=True, slots=True)
class PdoRate:
    """Rate of a PDO.

    t_us:       time of its last frame [us]
    excess:     frames beyond those that one producer sends
    doubled_us: time of the last sign of a second producer [us]
    """

    t_us: float = NEVER
    excess: float = 0.0
    doubled_us: float = NEVER
