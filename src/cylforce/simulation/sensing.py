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
PART_S = 600.0  # longest part of a scene that is computed at once, about 300 MB at 100 Hz; chosen
LAG = {Kind.HEAD_PRESSURE: PRESSURE_LAG, Kind.ROD_PRESSURE: PRESSURE_LAG, Kind.FORCE_PIN: PRESSURE_LAG}
OIL = (318.0, 0.01)  # oil temperature: K at the start, and its rise in K/s; chosen


NO_END = np.array(-np.inf)


class Sensors(NamedTuple):
    """Properties of every signal (S,), in its SI unit: time constant `lag` [s], zero error `bias`, standard deviation
    `noise`, and the values that can be sent: `origin` + integer * `quantum` (0: not quantised)."""

    lag: Array
    bias: Array
    noise: Array
    quantum: Array
    origin: Array
    low: Array = NO_END  # ends of the range of an angle, which is sent as what lies within it; infinite: no angle
    high: Array = -NO_END


class Record(NamedTuple):
    """A scene, or a part of a long one, as measured at T instants: `scene`: its number in the run, from 0; `t` (T,) [s]
    from the start of the run; the physics; `analog` (T, S): sensor values with lag and errors, before noise and
    resolution; `values` (T, S) as sent. SI units."""

    scene: int
    t: Array
    physics: Physics
    analog: Array
    values: Array


def sensors(machine: Machine, nodes: tuple[SensorNode, ...]) -> Sensors:
    """The sensors of a machine by the machine file: noise = standard error, no zero error, resolution of their PDOs; a
    typical lag."""
    fields = {f.signal: f for node in nodes for pdo in node.pdos for f in pdo.fields if f.code != "f"}
    steps = [(fields[s.name].scale, fields[s.name].offset) if s.name in fields else (0.0, 0.0) for s in machine.signals]
    quantum, origin = np.array(steps).reshape(-1, 2).T
    noise = np.array([s.standard_error for s in machine.signals])
    lag = np.array([LAG.get(s.kind, ANGLE_LAG) for s in machine.signals])
    ends = [(s.low, s.high) if s.kind in ANGLES else (-np.inf, np.inf) for s in machine.signals]
    return Sensors(lag, np.zeros_like(noise), noise, quantum, origin, *np.array(ends).reshape(-1, 2).T)


def perfect(machine: Machine) -> Sensors:
    """Sensors without lag, error or noise."""
    zero = np.zeros(len(machine.signals))
    return Sensors(zero, zero, zero, zero, zero)


def true_values(machine: Machine, found: Physics) -> Array:
    """Readings of ideal sensors (T, S) in SI units."""
    columns = [np.broadcast_to(_reading(found, signal), found.t.shape) for signal in machine.signals]
    return np.stack(columns, axis=-1) if columns else np.zeros((*found.t.shape, 0))


def _reading(found: Physics, signal: Signal) -> Array:
    by_index = {
        Kind.HEAD_PRESSURE: found.head,
        Kind.ROD_PRESSURE: found.rod,
        Kind.FORCE_PIN: found.moving.force,
        Kind.JOINT_ANGLE: found.course.theta,
        Kind.LINK_INCLINATION: found.moving.q,
        Kind.CYLINDER_LENGTH: found.moving.length,
    }
    if signal.kind in by_index:
        return by_index[signal.kind][..., signal.index]
    of_the_house = {
        Kind.PITCH: found.attitude.pitch,
        Kind.ROLL: found.attitude.roll,
        Kind.PITCH_RATE: found.turning,
        Kind.FORWARD_ACCELERATION: found.specific.real,
        Kind.UPWARD_ACCELERATION: found.specific.imag,
        Kind.SLEW_RATE: found.course.slew,
        Kind.SLEW_ANGLE: found.course.turn,
        Kind.OIL_TEMPERATURE: OIL[0] + OIL[1] * found.t,
    }
    return np.asarray(of_the_house[signal.kind])


def lag_filter(lag: float, dt: float) -> Filter:
    """First-order lag with time constant `lag` [s] at step `dt` [s], exact for an input that is linear between samples:
    y_1 = e y_0 + (r - e) x_0 + (1 - r) x_1, e = exp(-dt/lag), r = lag (1 - e)/dt."""
    e = exp(-dt / lag) if lag > 0 else 0.0
    r = lag * (1.0 - e) / dt
    return Filter((1.0 - r, r - e), (1.0, -e))


def as_sent(made: Sensors, analog: Array, rng: np.random.Generator) -> Array:
    """Values (..., S) as sent: `analog` (..., S) with zero error, noise and resolution; an angle that passes the end of
    its sensor's circle goes on at the other end."""
    values = analog + made.bias + made.noise * rng.standard_normal(analog.shape)
    quantum = np.where(made.quantum > 0, made.quantum, 1.0)
    rounded = np.round((values - made.origin) / quantum) * quantum + made.origin
    return in_range(np.where(made.quantum > 0, rounded, values), made.low, made.high)


def run(
    machine: Machine,
    truth: Truth,
    made: Sensors,
    scenes: Iterable[Scene],
    *,
    dt: float,
    rng: np.random.Generator,
) -> Iterator[Record]:
    """Records of scenes one after the other, long ones in parts, sampled at the multiples of `dt` [s] that fall into
    each scene. Sensor lags and delays continue across scenes."""
    filters = [lag_filter(float(lag), dt) for lag in made.lag]
    states: list[Array] = []
    before = np.zeros((0, len(machine.signals)))
    for number, scene, begin, grid in _parts(scenes, dt):
        found = simulate(machine, truth, scene, grid - begin, begin)
        ideal = true_values(machine, found)
        states = states or [f.steady(x) for f, x in zip(filters, ideal[0], strict=True)]
        passed = [f.run(s, x) for f, s, x in zip(filters, states, ideal.T, strict=True)]
        states = [state for state, _ in passed]
        analog = np.stack([y for _, y in passed], axis=-1) if passed else ideal
        both, last = np.concatenate([before, analog]), slice(len(before), None)
        t = grid[0] + dt * (np.arange(len(both)) - len(before)) if len(grid) else grid
        before, seen = analog, distorted(machine, truth.effects, both, t)[last]
        yield Record(number, grid, found, seen, as_sent(made, seen, rng))


def _parts(scenes: Iterable[Scene], dt: float) -> Iterator[tuple[int, Scene, float, Array]]:
    """The scenes' numbers, scenes, starts [s] and times (T,) [s] from the start of the run, long ones in parts."""
    begin, most = 0.0, round(PART_S / dt)
    for number, scene in enumerate(scenes):
        first, after = ceil(begin / dt), ceil((begin + scene.duration) / dt)
        for k in range(first, max(after, first + 1), most):
            yield number, scene, begin, dt * np.arange(k, min(k + most, after), dtype=np.float64)
        begin += scene.duration
