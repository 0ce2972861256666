"""Effects outside the library of kinds that no detector was written for: nothing in them follows a posture, a pressure
or a friction law of the library."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import exp, pi, sin, sqrt, tanh

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, lfilter_zi

from reference_machine.datasheet import JOINTS
from reference_machine.engine import DT
from reference_machine.sensors import ANGLES, PRESSURES

from .fault import BAR, DEGREE, TYPICAL_TORQUE, Draw, Fault, Scene, on_sensors, speed, stroke_range
from .foreign import Make, Torques, at_joint, pushed
from .sensing import FAST, only

Array = NDArray[np.float64]
Truth = Mapping[str, Array]


def gusts(draw: Draw, scene: Scene) -> Fault:
    """Wind on the arm: 1-8 % of the joints' torque, in waves of 3-30 s that no motion explains."""
    size, waves = draw.size(0.01, 0.08), [(draw.shape(3.0, 30.0), draw.uniform(0.0, 2.0 * pi)) for _ in range(5)]

    def push(t: float, angles: list[float], rates: list[float]) -> Torques:
        now = size * sum(sin(2.0 * pi * t / period + phase) for period, phase in waves) / sqrt(len(waves))
        return now * TYPICAL_TORQUE["boom"], now * TYPICAL_TORQUE["stick"], 0.0

    return Fault("gusts", "machine", size, "of torque", lambda m, _: pushed(m, push))


def neighbour_drag(draw: Draw, scene: Scene) -> Fault:
    """A hose bundle that the next joint's motion drags over this one: 3-20 % of its torque at 0.3 rad/s."""
    at, size = draw.one(JOINTS), draw.size(0.03, 0.2)
    other = JOINTS.index(draw.one(tuple(j for j in JOINTS if j != at)))

    def drag(t: float, angles: list[float], rates: list[float]) -> Torques:
        return at_joint(at, -size * TYPICAL_TORQUE[at] * tanh(rates[other] / 0.3))

    return Fault("neighbour_drag", at, size, "of torque", lambda m, _: pushed(m, drag), JOINTS[other])


@dataclass
class Swing:
    """A pendulum of natural frequency `omega` [rad/s] and damping `zeta` that a joint's speed drives."""

    at: str
    torque: float
    omega: float
    zeta: float
    t: float = 0.0
    x: float = 0.0
    v: float = 0.0

    def __call__(self, t: float, angles: list[float], rates: list[float]) -> Torques:
        """Its pull on the joint; a run begins at rest."""
        if t < self.t:
            self.x = self.v = 0.0
        step, self.t = min(max(t - self.t, 0.0), 10.0 * DT), t
        self.v += step * (-(self.omega**2) * self.x - 2.0 * self.zeta * self.omega * self.v + self.omega * rates[1])
        self.x += step * self.v
        return at_joint(self.at, self.torque * tanh(self.x / 0.3))


def swinging_tool(draw: Draw, scene: Scene) -> Fault:
    """Something that hangs from a joint and swings on: 5-30 % of its torque, 0.2-0.7 Hz."""
    at, size = draw.one(("stick", "bucket")), draw.size(0.05, 0.3)
    omega, zeta = 2.0 * pi * draw.uniform(0.2, 0.7), draw.shape(0.02, 0.2)

    def make() -> Swing:
        return Swing(at, size * TYPICAL_TORQUE[at], omega, zeta)

    return Fault("swinging_tool", at, size, "of torque", lambda m, _: pushed(m, make()))


def angle_wander(draw: Draw, scene: Scene) -> Fault:
    """An angle sensor that wanders without aim by 0.3-3 degrees."""
    at, size, seed = draw.one(ANGLES), draw.size(0.3, 3.0), int(draw.rng.integers(2**31))

    def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        steps = np.random.default_rng(seed).standard_normal(int(t[-1]) + 2)
        walk = np.convolve(np.cumsum(steps), np.hanning(9) / np.hanning(9).sum(), "same") / np.sqrt(len(steps))
        return np.asarray(values + size * DEGREE * np.interp(t, np.arange(len(walk)), walk))

    return Fault("angle_wander", at, size, "deg", lambda m, _: on_sensors(m, only(at, change)))


def coarse_steps(draw: Draw, scene: Scene) -> Fault:
    """A transmitter with few digits: steps of 2-15 bar."""
    at, size = draw.one(PRESSURES), draw.size(2.0, 15.0)
    step, shift = size * BAR, draw.uniform(0.0, 1.0)
    fault = only(at, lambda s, t, values, truth: (np.floor(values / step + shift) + 0.5 - shift) * step)
    return Fault("coarse_steps", at, size, "bar", lambda m, _: on_sensors(m, fault, digital=True))


def ringing_sensor(draw: Draw, scene: Scene) -> Fault:
    """An angle sensor on a loose bracket, which swings on at 0.8-3 Hz: it exaggerates changes 0.3-3 times."""
    at, size, hertz = draw.one(ANGLES), draw.size(0.3, 3.0), draw.uniform(0.8, 3.0)
    b, a = butter(2, (0.8 * hertz, 1.25 * hertz), "bandpass", fs=FAST)

    def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        return np.asarray(values + size * lfilter(b, a, values, zi=lfilter_zi(b, a) * values[0])[0])

    return Fault("ringing_sensor", at, size, "times", lambda m, _: on_sensors(m, only(at, change)), f"{hertz:.1f} Hz")


def jet_pressure(draw: Draw, scene: Scene) -> Fault:
    """A port in the jet of oil reads 3-20 bar more at 0.3 m/s, whichever way the oil flows."""
    at, size = draw.one(PRESSURES), draw.size(3.0, 20.0)
    joint = at.split("_", maxsplit=1)[0]

    def apply_to(specimen: object) -> Callable[..., Array]:
        def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
            fast = speed(specimen, joint, t, dict(truth)) / 0.3  # type: ignore[arg-type]
            return np.asarray(values + size * BAR * fast**2)

        return change

    return Fault("jet_pressure", at, size, "bar at 0.3 m/s", lambda m, _: on_sensors(m, only(at, apply_to(m.specimen))))


def out_of_order(draw: Draw, scene: Scene) -> Fault:
    """A node whose values arrive in the wrong order: of every 0.3-2 s, the last first."""
    at, size = draw.one((*PRESSURES, *ANGLES)), draw.size(0.3, 2.0)
    share, length, seed = draw.uniform(0.1, 0.5), max(2, round(100 * size)), int(draw.rng.integers(2**31))

    def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        rng, changed = np.random.default_rng(seed), values.copy()
        for begin in range(0, len(values) - length, length):
            if rng.random() < share:
                changed[begin : begin + length] = values[begin : begin + length][::-1]
        return changed

    return Fault("out_of_order", at, size, "s", lambda m, _: on_sensors(m, only(at, change), digital=True))


def scored_rod(draw: Draw, scene: Scene) -> Fault:
    """A rod with scores: friction torque of 2-15 % of the joint's that comes and goes 4 to 15 times over the range."""
    at, size = draw.one(JOINTS), draw.size(0.02, 0.15)
    k = JOINTS.index(at)
    low, high = stroke_range(scene.machine.specimen)[k].tolist()
    times, phase = 2.0 * pi * draw.uniform(4.0, 15.0) / (high - low), draw.uniform(0.0, 2.0 * pi)

    def scrape(t: float, angles: list[float], rates: list[float]) -> Torques:
        scored = max(0.0, sin(times * angles[k] + phase))
        return at_joint(at, -size * TYPICAL_TORQUE[at] * scored * tanh(rates[k] / 0.01))

    return Fault("scored_rod", at, size, "of torque", lambda m, _: pushed(m, scrape))


def knocking(draw: Draw, scene: Scene) -> Fault:
    """Blows of 5-40 % of a joint's torque and 0.1-0.5 s, every few seconds, whatever the machine does."""
    at, size = draw.one(JOINTS), draw.size(0.05, 0.4)
    every, lasts, way = draw.uniform(2.0, 8.0), draw.shape(0.1, 0.5), draw.one(("1", "-1"))

    def knock(t: float, angles: list[float], rates: list[float]) -> Torques:
        return at_joint(at, int(way) * size * TYPICAL_TORQUE[at] * exp(-((((t % every) - 1.0) / lasts) ** 2)))

    return Fault("knocking", at, size, "of torque", lambda m, _: pushed(m, knock))


UNHEARD: dict[str, Make] = {
    "gusts": gusts,
    "neighbour_drag": neighbour_drag,
    "swinging_tool": swinging_tool,
    "angle_wander": angle_wander,
    "coarse_steps": coarse_steps,
    "ringing_sensor": ringing_sensor,
    "jet_pressure": jet_pressure,
    "out_of_order": out_of_order,
    "scored_rod": scored_rod,
    "knocking": knocking,
}
