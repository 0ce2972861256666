"""Simulated sensors: first-order lag, zero error, noise and resolution; and a whole run, scene by scene."""

from collections.abc import Iterable, Iterator
from math import ceil, exp
from typing import NamedTuple

import numpy as np

from cylforce.effects.imposed import distorted
from cylforce.estimation.filters import Filter
from cylforce.mechanics.installation import SensorNode
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import ANGLES, Kind, Signal
from cylforce.signals.turns import in_range
from cylforce.simulation.simulator import Physics, Truth, simulate
from cylforce.simulation.trajectory import Scene

PRESSURE_LAG = 1.5e-3  # s, time constant of a typical pressure transmitter; chosen
ANGLE_LAG = 3e-3  # s, time constant of a magnetic encoder or of an inclinometer with gyro; chosen
PART_S = 600.0  # s, longest part of a scene that is computed at once, about 300 MB at 100 Hz; chosen
LAG = {Kind.HEAD_PRESSURE: PRESSURE_LAG, Kind.ROD_PRESSURE: PRESSURE_LAG, Kind.FORCE_PIN: PRESSURE_LAG}
OIL_START, OIL_RISE = 318.0, 0.01  # K and K/s, oil temperature; chosen
NO_END = np.array(-np.inf)  # lower end of the range of a signal that is no angle


class Sensors(NamedTuple):
    """Properties of every signal (S,), in its SI unit.

    lag: time constant [s]
    bias: zero error
    noise: standard deviation
    quantum: distance of the values that can be sent; 0: not quantised
    origin: one of these values
    low, high: ends of the range of an angle, which is sent as a value within it; infinite: no angle
    """

    lag: Array
    bias: Array
    noise: Array
    quantum: Array
    origin: Array
    low: Array = NO_END
    high: Array = -NO_END


class Record(NamedTuple):
    """A scene, or a part of a long one, as measured at T instants.

    scene: its number in the run, from 0
    t: (T,) time from the start of the run [s]
    physics: the true physics
    analog: (T, S) sensor values with lag and with the errors of `Truth.effects`, before zero error, noise and
        resolution [SI]
    values: (T, S) values as sent: `analog` with these, angles within the ranges of their sensors [SI]
    """

    scene: int
    t: Array
    physics: Physics
    analog: Array
    values: Array


def sensors(machine: Machine, nodes: tuple[SensorNode, ...]) -> Sensors:
    """Return the sensors of a machine by the machine file.

    The noise is the standard error, the zero error is 0, the resolution is that of the PDOs, and the lag is typical. A
    signal that no PDO carries, or one as a floating-point number, is not quantised.

    nodes: sensor nodes, whose PDOs give the resolution; none: no signal is quantised
    """
    fields = {f.signal: f for node in nodes for pdo in node.pdos for f in pdo.fields if f.code != "f"}
    steps = [(fields[s.name].scale, fields[s.name].offset) if s.name in fields else (0.0, 0.0) for s in machine.signals]
    quantum, origin = np.array(steps).reshape(-1, 2).T
    noise = np.array([s.standard_error for s in machine.signals])
    lag = np.array([LAG.get(s.kind, ANGLE_LAG) for s in machine.signals])
    ends = [(s.low, s.high) if s.kind in ANGLES else (-np.inf, np.inf) for s in machine.signals]
    low, high = np.array(ends).reshape(-1, 2).T
    return Sensors(lag=lag, bias=np.zeros_like(noise), noise=noise, quantum=quantum, origin=origin, low=low, high=high)


def perfect(machine: Machine) -> Sensors:
    """Return sensors without lag, error or noise."""
    zero = np.zeros(len(machine.signals))
    return Sensors(lag=zero, bias=zero, noise=zero, quantum=zero, origin=zero)


def true_values(machine: Machine, physics: Physics) -> Array:
    """Return the readings of ideal sensors (T, S) [SI]."""
    columns = [np.broadcast_to(_reading(physics, signal), physics.t.shape) for signal in machine.signals]
    return np.stack(columns, axis=-1) if columns else np.zeros((*physics.t.shape, 0))


def _reading(physics: Physics, signal: Signal) -> Array:
    """Return the reading of an ideal sensor, (T,) or a constant [SI]."""
    by_index = {
        Kind.HEAD_PRESSURE: physics.head,
        Kind.ROD_PRESSURE: physics.rod,
        Kind.FORCE_PIN: physics.moving.force,
        Kind.JOINT_ANGLE: physics.course.theta,
        Kind.LINK_INCLINATION: physics.moving.q,
        Kind.CYLINDER_LENGTH: physics.moving.length,
    }
    if signal.kind in by_index:
        return by_index[signal.kind][..., signal.index]
    of_the_house = {
        Kind.PITCH: physics.attitude.pitch,
        Kind.ROLL: physics.attitude.roll,
        Kind.PITCH_RATE: physics.turning,
        Kind.FORWARD_ACCELERATION: physics.specific.real,
        Kind.UPWARD_ACCELERATION: physics.specific.imag,
        Kind.SLEW_RATE: physics.course.slew,
        Kind.SLEW_ANGLE: physics.course.turn,
        Kind.OIL_TEMPERATURE: OIL_START + OIL_RISE * physics.t,
    }
    return np.asarray(of_the_house[signal.kind])


def lag_filter(lag: float, dt: float) -> Filter:
    """Return the first-order lag with time constant `lag` [s] at step `dt` [s].

    It is exact for an input that is linear between samples: y_1 = e y_0 + (r - e) x_0 + (1 - r) x_1, e = exp(-dt/lag),
    r = lag (1 - e)/dt.
    """
    e = exp(-dt / lag) if lag > 0 else 0.0
    r = lag * (1.0 - e) / dt
    return Filter((1.0 - r, r - e), (1.0, -e))


def as_sent(properties: Sensors, analog: Array, rng: np.random.Generator) -> Array:
    """Return the values (..., S) [SI] as sent: with zero error, noise and resolution.

    An angle that passes the end of its sensor's circle continues at the other end.

    properties: properties of the sensors
    analog: (..., S) sensor values with lag [SI]
    rng: generator of the noise
    """
    values = analog + properties.bias + properties.noise * rng.standard_normal(analog.shape)
    quantum = np.where(properties.quantum > 0, properties.quantum, 1.0)
    rounded = np.round((values - properties.origin) / quantum) * quantum + properties.origin
    return in_range(np.where(properties.quantum > 0, rounded, values), properties.low, properties.high)


def run(
    machine: Machine,
    truth: Truth,
    properties: Sensors,
    scenes: Iterable[Scene],
    *,
    dt: float,
    rng: np.random.Generator,
    part_s: float = PART_S,
) -> Iterator[Record]:
    """Yield the records of scenes one after the other, long ones in parts.

    Each scene is sampled at the multiples of `dt` that lie within it. Sensor lags and delays continue across scenes.

    truth: the true machine; its effects change the motion's forces and the sensors' values
    properties: properties of the sensors
    dt: time between two samples [s]
    rng: generator of the noise
    part_s: longest part of a scene that is computed at once [s]
    """
    filters = [lag_filter(float(lag), dt) for lag in properties.lag]
    states: list[Array] = []
    before = np.zeros((0, len(machine.signals)))  # the part before, which delayed signals still read
    for number, scene, begin, grid in _parts(scenes, dt, part_s):
        physics = simulate(machine, truth, scene, grid - begin, begin)
        ideal = true_values(machine, physics)
        states = states or [f.steady(x) for f, x in zip(filters, ideal[0], strict=True)]
        filtered = [f.run(s, x) for f, s, x in zip(filters, states, ideal.T, strict=True)]
        states = [state for state, _ in filtered]
        lagging = np.stack([y for _, y in filtered], axis=-1) if filtered else ideal
        both = np.concatenate([before, lagging])
        t = grid[0] + dt * (np.arange(len(both)) - len(before)) if len(grid) else grid
        analog = distorted(machine, truth.effects, both, t)[len(before) :]
        before = lagging
        values = as_sent(properties, analog, rng)
        yield Record(scene=number, t=grid, physics=physics, analog=analog, values=values)


def _parts(scenes: Iterable[Scene], dt: float, part_s: float) -> Iterator[tuple[int, Scene, float, Array]]:
    """Yield the parts of all scenes: number of the scene, the scene, its start [s], and the times (T,) [s] of the part.

    The start and the times count from the start of the run.

    dt: time between two samples [s]
    part_s: longest part of a scene [s]
    """
    begin, most = 0.0, round(part_s / dt)
    for number, scene in enumerate(scenes):
        first, after = ceil(begin / dt), ceil((begin + scene.duration) / dt)
        for k in range(first, max(after, first + 1), most):
            yield number, scene, begin, dt * np.arange(k, min(k + most, after), dtype=np.float64)
        begin += scene.duration
