"""The settings of the service in SI units: the content of a machine file after it has been checked."""

from typing import NamedTuple

from cylforce.mechanics.machine import Machine
from cylforce.signals.layout import Pdo

HIGHEST = 0.4  # times the rate: cut-off frequency of the force where the rate is low; chosen
LATE_PERIODS = 1.5  # of a sensor, after which its next value is late: the nearest multiple of the period is two


class Filters(NamedTuple):
    """Step rate `rate_hz` and cut-off frequencies [Hz]. `channel_hz`: second-order low-pass on angles and forces before
    anything is computed from them; `regressor_hz`: first-order low-pass of the filtered regressor; `smoothing_hz`:
    second-order low-pass on its columns and torque. sgn(v) of friction is tanh(v / `direction_speed`) [m/s]. For the
    force at the tool: `force_hz`, second-order low-pass of the cylinder forces; `inertia_hz`, first-order low-pass of
    the torque of inertia."""

    rate_hz: float
    channel_hz: float
    regressor_hz: float
    smoothing_hz: float
    direction_speed: float
    force_hz: float = 20.0
    inertia_hz: float = 8.0

    @property
    def slowest_hz(self) -> float:
        """The rate that all filters but those of the force need more than (Nyquist)."""
        return 2.0 * max(self.channel_hz, self.regressor_hz, self.smoothing_hz)

    def at(self, rate_hz: float) -> "Filters":
        """The same at another rate, those of the force no faster than it allows."""
        force_hz, inertia_hz = (min(hz, HIGHEST * rate_hz) for hz in (self.force_hz, self.inertia_hz))
        return self._replace(rate_hz=rate_hz, force_hz=force_hz, inertia_hz=inertia_hz)


class SensorNode(NamedTuple):
    """A sensor node on the bus: device profile number, identity objects (None: not checked), heartbeat period [s],
    TPDOs, and whether the service may write their mapping."""

    name: str
    node_id: int
    profile: int
    identity: tuple[int | None, int | None, int | None, int | None]  # 1018h: vendor, product, revision, serial
    heartbeat_s: float
    pdos: tuple[Pdo, ...]
    writable_mapping: bool


class Health(NamedTuple):
    """Limits beyond which signals are not used: a value is repeated for `hold_s` [s] at most; a sensor that failed is
    used again after `good_frames` good values; `frozen_samples` equal values while the machine moves mean a frozen
    sensor; `max_tilt` [rad] of the chassis; `max_step_s` [s] between two ticks."""

    hold_s: float
    good_frames: int
    frozen_samples: int
    max_tilt: float
    max_step_s: float


STANDARD = "standard"  # the tool that the machine file's last link describes


class Attachment(NamedTuple):
    """A tool that can take the last link's place: its name, kind (bucket, grab, fork), and the machine with it."""

    name: str
    kind: str
    machine: Machine


class Service(NamedTuple):
    """All settings of a running service: the machine, the sensor nodes, the TPDOs that it publishes, its own node id,
    whether it sends SYNC, its heartbeat period [s], filters and limits. `machine` has the standard tool; `attachments`:
    the others."""

    machine: Machine
    nodes: tuple[SensorNode, ...]
    publication: tuple[Pdo, ...]
    node_id: int
    sync_producer: bool
    heartbeat_s: float
    filters: Filters
    health: Health
    effects: tuple[str, ...]  # names of the friction laws from which the identification chooses
    adapt: bool = True  # whether friction and pressure zeros are adapted in service to temperature and wear
    attachments: tuple[Attachment, ...] = ()
    j1939_address: int | None = None  # source address on J1939; None: nothing is sent there

    @property
    def tools(self) -> tuple[str, ...]:
        """Names of all tools; a tool's number is its place here."""
        return (STANDARD, *(attachment.name for attachment in self.attachments))

    def fitted(self, tool: str) -> "Service":
        """The settings with a tool. Raises ValueError where there is none of this name."""
        if tool == STANDARD:
            return self
        found = next((attachment for attachment in self.attachments if attachment.name == tool), None)
        if found is None:
            raise ValueError(f"{tool}: is no attachment of {self.machine.name}: use one of {', '.join(self.tools)}")
        return self._replace(machine=found.machine)
