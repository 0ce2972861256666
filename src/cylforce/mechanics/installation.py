"""The settings of the service in SI units: the content of a machine file after it has been checked."""

from typing import NamedTuple

from cylforce.mechanics.machine import Machine
from cylforce.signals.layout import Pdo

HIGHEST = 0.4  # highest cut-off frequency of the force, times the step rate (Nyquist: 0.5); chosen
LATE_PERIODS = 1.5  # periods of a sensor after which its next value is late: the nearest multiple of the period is two


class Filters(NamedTuple):
    """Step rate and cut-off frequencies of all filters.

    rate_hz: rate of the service's steps [Hz]
    channel_hz: second-order low-pass on angles and forces before anything is computed from them [Hz]
    regressor_hz: first-order low-pass of the filtered regressor [Hz]
    smoothing_hz: second-order low-pass on the regressor's columns and on the torque [Hz]
    direction_speed: speed v_0 of the friction's rounded sign, sgn(v) = tanh(v / v_0) [m/s]
    force_hz: second-order low-pass of the cylinder forces, for the force at the tool [Hz]
    inertia_hz: first-order low-pass of the torque of inertia, for the force at the tool [Hz]
    """

    rate_hz: float
    channel_hz: float
    regressor_hz: float
    smoothing_hz: float
    direction_speed: float
    force_hz: float = 20.0
    inertia_hz: float = 8.0

    @property
    def slowest_hz(self) -> float:
        """Return the rate above which the step rate must lie for all filters but those of the force (Nyquist) [Hz]."""
        return 2.0 * max(self.channel_hz, self.regressor_hz, self.smoothing_hz)

    def at(self, rate_hz: float) -> "Filters":
        """Return these filters at another step rate; the cut-offs of the force are limited to HIGHEST times that
        rate.
        """
        force_hz, inertia_hz = (min(hz, HIGHEST * rate_hz) for hz in (self.force_hz, self.inertia_hz))
        return self._replace(rate_hz=rate_hz, force_hz=force_hz, inertia_hz=inertia_hz)


class SensorNode(NamedTuple):
    """A sensor node on the bus.

    name: name in the machine file
    node_id: CANopen node number
    profile: number of its device profile
    identity: vendor, product, revision and serial number of object 1018h; None: not checked
    heartbeat_s: heartbeat period [s]
    pdos: TPDOs that it sends
    writable_mapping: whether the service may write the mapping of its TPDOs
    """

    name: str
    node_id: int
    profile: int
    identity: tuple[int | None, int | None, int | None, int | None]
    heartbeat_s: float
    pdos: tuple[Pdo, ...]
    writable_mapping: bool


class Health(NamedTuple):
    """Limits beyond which signals are not used.

    hold_s: longest time for which the last value of a signal is used while it is late or refused [s]
    good_frames: valid values after which a failed sensor is used again
    frozen_samples: equal samples, while the machine moves, after which a sensor counts as frozen
    max_tilt: largest tilt of the chassis [rad]
    max_step_s: longest time between two ticks [s]; after a longer one the filters start again
    """

    hold_s: float
    good_frames: int
    frozen_samples: int
    max_tilt: float
    max_step_s: float


STANDARD = "standard"  # name of the tool that the machine file's last link describes


class Attachment(NamedTuple):
    """A tool that can replace the last link.

    name: name in the machine file
    kind: bucket, grab or fork
    machine: the machine with this tool
    """

    name: str
    kind: str
    machine: Machine


class Service(NamedTuple):
    """Settings of a running service.

    machine: the machine with the standard tool
    nodes: sensor nodes on the bus
    publication: TPDOs that the service sends
    node_id: CANopen node number of the service
    sync_producer: whether it sends SYNC
    heartbeat_s: its heartbeat period [s]
    filters: step rate and cut-off frequencies
    health: limits beyond which signals are not used
    effects: names of the friction laws from which the identification chooses
    adapt: whether friction and pressure zeros are adapted in service to temperature and wear
    attachments: the other tools
    j1939_address: its source address on J1939; None: nothing is sent there
    """

    machine: Machine
    nodes: tuple[SensorNode, ...]
    publication: tuple[Pdo, ...]
    node_id: int
    sync_producer: bool
    heartbeat_s: float
    filters: Filters
    health: Health
    effects: tuple[str, ...]
    adapt: bool = True
    attachments: tuple[Attachment, ...] = ()
    j1939_address: int | None = None

    @property
    def tools(self) -> tuple[str, ...]:
        """Return the names of all tools; the number of a tool is its position in this tuple."""
        return (STANDARD, *(attachment.name for attachment in self.attachments))

    def fitted(self, tool: str) -> "Service":
        """Return the settings of the machine file with another tool: `machine` is replaced, all else stays.

        STANDARD returns these settings unchanged: call it on those with the standard tool. Raises ValueError where
        there is no tool of this name.
        """
        if tool == STANDARD:
            return self
        attachment = next((attachment for attachment in self.attachments if attachment.name == tool), None)
        if attachment is None:
            raise ValueError(f"{tool}: is no attachment of {self.machine.name}: use one of {', '.join(self.tools)}")
        return self._replace(machine=attachment.machine)
