"""Effects outside the library: the right answer to them is that no known effect explains the gap."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import cos, exp, pi, sin, tanh

import numpy as np
from numpy.typing import NDArray

from reference_machine.arm import GRAVITY
from reference_machine.datasheet import JOINTS
from reference_machine.engine import ExtraTorque
from reference_machine.machine import Machine
from reference_machine.sensors import ANGLES, PRESSURES
from reference_machine.specimen import Specimen

from .fault import BAR, DEGREE, TYPICAL_TORQUE, Draw, Fault, Scene, on_sensors, stroke_range
from .sensing import only

Array = NDArray[np.float64]
Truth = Mapping[str, Array]
Torques = tuple[float, float, float]


def pushed(machine: Machine, extra: ExtraTorque) -> Machine:
    """The machine with a further torque."""
    return replace(machine, extra=(*machine.extra, extra))


def at_joint(joint: str, torque: float) -> Torques:
    """A torque at one joint alone."""
    k = JOINTS.index(joint)
    return (torque if k == 0 else 0.0, torque if k == 1 else 0.0, torque if k == 2 else 0.0)


def hose_spring(draw: Draw, scene: Scene) -> Fault:
    """Stiff hoses over a joint: a spring that hardens, 3-25 % of the joint's torque at the ends of its range."""
    at, size = draw.one(JOINTS), draw.size(0.03, 0.25)
    low, high = stroke_range(scene.machine.specimen)[JOINTS.index(at)]
    zero, half = low + draw.uniform(0.3, 0.7) * (high - low), 0.5 * (high - low)

    def spring(t: float, angles: list[float], rates: list[float]) -> Torques:
        x = (angles[JOINTS.index(at)] - zero) / half
        return at_joint(at, -size * TYPICAL_TORQUE[at] * (0.5 * x + 0.5 * x**3))

    return Fault("hose_spring", at, size, "of torque", lambda m, _: pushed(m, spring))


def end_cushioning(draw: Draw, scene: Scene) -> Fault:
    """Cushions in the last fifth of the range that resist motion into them: 5-40 % of the joint's torque."""
    at, size = draw.one(JOINTS), draw.size(0.05, 0.4)
    k = JOINTS.index(at)
    low, high = stroke_range(scene.machine.specimen)[k].tolist()
    zone = draw.uniform(0.12, 0.22) * (high - low)

    def cushion(t: float, angles: list[float], rates: list[float]) -> Torques:
        into = rates[k] if angles[k] > 0.5 * (low + high) else -rates[k]
        depth = max(0.0, 1.0 - min(high - angles[k], angles[k] - low) / zone)
        force = size * TYPICAL_TORQUE[at] * depth * tanh(max(into, 0.0) / 0.08)
        return at_joint(at, -force if rates[k] > 0.0 else force)

    return Fault("end_cushion", at, size, "of torque", lambda m, _: pushed(m, cushion))


def sensor_hysteresis(draw: Draw, scene: Scene) -> Fault:
    """Hysteresis of a pressure transmitter: play operators of 3-15 bar."""
    at, size = draw.one(PRESSURES), draw.size(3.0, 15.0)
    widths = np.array([0.3, 0.7, 1.4]) * size * BAR

    def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        parts = [_play(values[::5], float(w)) for w in widths]
        return np.asarray(values + np.repeat(np.mean(parts, axis=0) - values[::5], 5)[: len(values)])

    return Fault("pressure_sensor_hysteresis", at, size, "bar", lambda m, _: on_sensors(m, only(at, change)))


def _play(values: Array, width: float) -> Array:
    """Backlash operator: follows once the input has moved by half the width."""
    found, now, half = [], float(values[0]), 0.5 * width
    for x in values.tolist():
        now = min(max(now, x - half), x + half)
        found.append(now)
    return np.array(found)


@dataclass(frozen=True)
class Rocking:
    """A base on soft ground that rocks by `angle` [rad]: gravity turns, and the tilt sensor is too slow to follow."""

    specimen: Specimen
    angle: Callable[[float, list[float]], float]

    def __call__(self, t: float, angles: list[float], rates: list[float]) -> Torques:
        """Torque of gravity's small horizontal part on (boom, stick, bucket) [N m]."""
        s, turned, below = self.specimen, 0.0, 0.0
        heights, masses, pins = [], [], [0.0]
        for joint, angle in zip(JOINTS, angles, strict=True):
            turned += angle
            body = s.bodies[joint]
            heights.append(below + body.centre[0] * sin(turned) + body.centre[1] * cos(turned))
            masses.append(body.mass)
            below += s.lengths[joint] * sin(turned)
            pins.append(below)
        g = GRAVITY * sin(self.angle(t, rates))
        torques = [g * sum(m * (h - pins[k]) for m, h in zip(masses[k:], heights[k:], strict=True)) for k in range(3)]
        return torques[0], torques[1], torques[2]


def rocking_base(draw: Draw, scene: Scene) -> Fault:
    """0.4-3 degrees, at 0.2-0.9 Hz, in bursts."""
    size, hertz, beat = draw.size(0.4, 3.0), draw.uniform(0.2, 0.9), draw.uniform(6.0, 15.0)

    def angle(t: float, rates: list[float]) -> float:
        return size * DEGREE * sin(2 * pi * hertz * t) * exp(-(((t % beat) - 0.3 * beat) ** 2) / (0.1 * beat * beat))

    return Fault("rocking_base", "machine", size, "deg", lambda m, _: pushed(m, Rocking(m.specimen, angle)))


def cross_talk(draw: Draw, scene: Scene) -> Fault:
    """A transmitter reads 1-8 % of another one's pressure as well."""
    at, size = draw.one(PRESSURES), draw.signed(0.01, 0.08)
    joint = at.split("_", maxsplit=1)[0]
    other = draw.one(tuple(p for p in PRESSURES if not p.startswith(joint)))
    fault = only(at, lambda s, t, values, truth: values + size * truth[other])
    return Fault("cross_talk", at, size, "of other", lambda m, _: on_sensors(m, fault), other)


def held_values(draw: Draw, scene: Scene) -> Fault:
    """A node whose values stay the same for 0.1-0.7 s, every few seconds."""
    at, size = draw.one((*PRESSURES, *ANGLES)), draw.size(0.1, 0.7)
    share, seed = draw.uniform(0.08, 0.3), int(draw.rng.integers(2**31))

    def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        rng, source, k = np.random.default_rng(seed), np.arange(len(values)), 0
        while k < len(values):
            k += max(1, int(rng.exponential(size / share) * 100.0))
            repeated = int(size * rng.uniform(0.5, 1.5) * 100.0)
            source[k : k + repeated] = k
            k += repeated
        return values[np.minimum(source, len(values) - 1)]

    return Fault("held_values", at, size, "s", lambda m, _: on_sensors(m, only(at, change), digital=True))


def position_friction(draw: Draw, scene: Scene) -> Fault:
    """A tight place in the stroke: friction torque of 2-15 % of the joint's, over a tenth of the range."""
    at, size = draw.one(JOINTS), draw.size(0.02, 0.15)
    k = JOINTS.index(at)
    low, high = stroke_range(scene.machine.specimen)[k].tolist()
    centre, width = low + draw.uniform(0.25, 0.75) * (high - low), draw.uniform(0.05, 0.12) * (high - low)

    def tight(t: float, angles: list[float], rates: list[float]) -> Torques:
        bump = exp(-(((angles[k] - centre) / width) ** 2))
        return at_joint(at, -size * TYPICAL_TORQUE[at] * bump * tanh(rates[k] / 0.01))

    return Fault("position_friction", at, size, "of torque", lambda m, _: pushed(m, tight))


def angle_ripple(draw: Draw, scene: Scene) -> Fault:
    """An encoder's periodic error of 0.2-1.2 degrees, 8-20 times a turn."""
    at, size = draw.one(ANGLES), draw.size(0.2, 1.2)
    times, phase = draw.uniform(8.0, 20.0), draw.uniform(0.0, 2.0 * pi)
    fault = only(at, lambda s, t, values, truth: values + size * DEGREE * np.sin(times * values + phase))
    return Fault("angle_ripple", at, size, "deg", lambda m, _: on_sensors(m, fault), f"{times:.0f} a turn")


def saturated_sensor(draw: Draw, scene: Scene) -> Fault:
    """A transmitter whose gain is 5-30 % lower above 20-60 bar."""
    at, size, knee = draw.one(PRESSURES), draw.size(0.05, 0.3), draw.uniform(20.0, 60.0) * BAR
    fault = only(at, lambda s, t, values, truth: values - size * np.maximum(values - knee, 0.0))
    return Fault("saturated_sensor", at, size, "of excess", lambda m, _: on_sensors(m, fault))


def shaking(draw: Draw, scene: Scene) -> Fault:
    """Something that shakes a joint at 0.6-1.8 Hz whenever it moves: 1-6 % of its torque."""
    at, size, hertz = draw.one(JOINTS), draw.size(0.01, 0.06), draw.uniform(0.6, 1.8)
    k = JOINTS.index(at)

    def shake(t: float, angles: list[float], rates: list[float]) -> Torques:
        return at_joint(at, size * TYPICAL_TORQUE[at] * sin(2 * pi * hertz * t) * tanh(abs(rates[k]) / 0.05))

    return Fault("shaking", at, size, "of torque", lambda m, _: pushed(m, shake))


Make = Callable[[Draw, Scene], Fault]
FOREIGN: dict[str, Make] = {
    "hose_spring": hose_spring,
    "end_cushion": end_cushioning,
    "pressure_sensor_hysteresis": sensor_hysteresis,
    "rocking_base": rocking_base,
    "cross_talk": cross_talk,
    "held_values": held_values,
    "position_friction": position_friction,
    "angle_ripple": angle_ripple,
    "saturated_sensor": saturated_sensor,
    "shaking": shaking,
}
