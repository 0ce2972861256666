"""The service's settings as plain values: what the settings file becomes once it has been checked."""

from typing import NamedTuple

from cylforce.mechanics.machine import Machine
from cylforce.signals.layout import Pdo


class Filters(NamedTuple):
    """Rates and cut-offs [Hz]; `direction_speed` [m/s] rounds sgn(v). `channel_hz` smooths angles and forces before
    anything is computed from them, `smoothing_hz` columns and torque alike, `regressor_hz` is the first-order one."""

    rate_hz: float
    channel_hz: float
    regressor_hz: float
    smoothing_hz: float
    direction_speed: float


class SensorNode(NamedTuple):
    """A sensor node to be commissioned: its identity objects (None: not checked), heartbeat, TPDOs."""

    name: str
    node_id: int
    profile: int
    identity: tuple[int | None, int | None, int | None, int | None]  # 1018h: vendor, product, revision, serial
    heartbeat_s: float
    pdos: tuple[Pdo, ...]
    writable_mapping: bool


class Health(NamedTuple):
    """When signals stop being believed: age, frozen samples, physical limits."""

    hold_s: float
    good_frames: int
    frozen_samples: int
    max_tilt: float
    max_step_s: float


class Service(NamedTuple):
    """Everything that a running service needs to know, checked and frozen."""

    machine: Machine
    nodes: tuple[SensorNode, ...]
    publication: tuple[Pdo, ...]
    node_id: int
    sync_producer: bool
    heartbeat_s: float
    filters: Filters
    health: Health
    effects: tuple[str, ...]  # friction laws to choose from, by name
    adapt: bool = True  # friction and zero follow temperature and wear in service
