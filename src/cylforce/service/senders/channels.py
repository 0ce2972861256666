"""State of signals, PDOs and nodes with named fields.

The kernel keeps this state in one flat array (`kernel/inputs.py`), whose parts `InputLayout` names. The fields are in
the kernel's order."""

from dataclasses import dataclass
from math import nan
from typing import Self

from cylforce.estimation.kernel.inputs import NEVER
from cylforce.signals.estimate import Reason

QUIET_US = 2_000_000  # after the last sign of a second producer, until an identifier is trusted again; chosen
REASONS = {float(reason): reason for reason in Reason}


@dataclass(frozen=True, slots=True)
class Channel:
    """State of one signal.

    value:       last accepted value [SI]; last received value while too few good values were received
    t_us:        time of the last accepted value [us]
    received_us: time of the last received value, good or not [us]
    reason:      of the last received value, as a number of `Reason`
    good:        number of good values in a row
    equal:       number of equal values in a row while the machine moved
    jumps:       number of values in a row that are implausible, because they are off by a `step`
    step:        difference from the value before the step [SI]
    last:        last implausible value [SI]
    stepped:     sum of the steps that were accepted after enough such values [SI]
    since_us:    earliest time at which the last received value was measured, before it waited for the bus [us]
    """

    value: float
    t_us: float
    received_us: float
    reason: float
    good: float
    equal: float
    jumps: float
    step: float = 0.0
    last: float = 0.0
    stepped: float = 0.0
    since_us: float = NEVER

    @classmethod
    def without_value(cls, reason: Reason, stepped: float = 0.0) -> Self:
        """Return the state of a signal without an accepted value."""
        return cls(nan, t_us=NEVER, received_us=NEVER, reason=reason, good=0.0, equal=0.0, jumps=0.0, stepped=stepped)


@dataclass(frozen=True, slots=True)
class FrameCounters:
    """Numbers of unexpected frames.

    unknown: frames with an identifier of no sensor's PDO, heartbeats among them
    short:   frames shorter than their mapping
    long:    frames longer than their mapping
    """

    unknown: float
    short: float
    long: float


@dataclass(frozen=True, slots=True)
class LastHeartbeat:
    """Last heartbeat of a node.

    t_us:   time of the heartbeat [us]; NEVER: none yet
    state:  NMT state
    booted: 1 after a boot-up message: a heartbeat must then follow the node's first PDO
    """

    t_us: float = NEVER
    state: float = 5.0
    booted: float = 0.0


@dataclass(frozen=True, slots=True)
class PdoRate:
    """Rate of a PDO.

    t_us:       time of its last frame [us]
    excess:     number of frames beyond those of one producer
    doubled_us: time of the last sign of a second producer [us]
    """

    t_us: float = NEVER
    excess: float = 0.0
    doubled_us: float = NEVER
