"""Effects on the reference machine's signals: pressures, angles, delays, clocks, tilt, gyro, lines, backlash,
compliance."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, lfilter, lfilter_zi

from reference_machine.datasheet import EXCAVATOR, JOINTS
from reference_machine.machine import Machine
from reference_machine.sensors import ANGLES, PRESSURES, Distortion

from .fault import BAR, DEGREE, TYPICAL_TORQUE, Draw, Fault, Scene, Stretch, on_sensors, speed, torque, weight

Array = NDArray[np.float64]
Truth = Mapping[str, Array]
FAST = 1000.0  # Hz


def only(name: str, change: "Distortion") -> Distortion:
    """A distortion of one signal."""

    def effect(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        return change(signal, t, values, truth) if signal == name else values

    return effect


def _simple(name: str, at: str, size: float, unit: str, change: Distortion, form: str = "") -> Fault:
    return Fault(name, at, size, unit, lambda machine, _: on_sensors(machine, only(at, change)), form)


def pressure_offset(draw: Draw, scene: Scene) -> Fault:
    """0.5-5 bar."""
    at, size = draw.one(PRESSURES), draw.signed(0.5, 5.0)
    return _simple("pressure_offset", at, size, "bar", lambda s, t, values, truth: values + size * BAR)


def pressure_gain(draw: Draw, scene: Scene) -> Fault:
    """0.5-5 %, a little more or less at high pressures."""
    at, size, bend = draw.one(PRESSURES), draw.signed(0.005, 0.05), draw.uniform(-0.4, 0.4)

    def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        return values * (1.0 + size * (1.0 + bend * (2.0 * values / EXCAVATOR.pressure_range - 0.5)))

    return _simple("pressure_gain", at, size, "of value", change, "curved")


def pressure_drift(draw: Draw, scene: Scene) -> Fault:
    """1-8 bar at the field's end, as of a sensor that warms: exponential."""
    at, size = draw.one(PRESSURES), draw.signed(1.0, 8.0)
    end = max(s.begin_s + s.duration_s for s in scene.stretches)
    constant = end * draw.shape(0.15, 4.0)

    def apply(machine: Machine, stretch: Stretch) -> Machine:
        def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
            grown = -np.expm1(-(t + stretch.begin_s) / constant) / -np.expm1(-end / constant)
            return np.asarray(values + size * BAR * grown)

        return on_sensors(machine, only(at, change))

    return Fault("pressure_drift", at, size, "bar", apply, "exponential")


def angle_offset(draw: Draw, scene: Scene) -> Fault:
    """0.2-3 degrees."""
    at, size = draw.one(ANGLES), draw.signed(0.2, 3.0)
    return _simple("angle_offset", at, size, "deg", lambda s, t, values, truth: values + size * DEGREE)


def angle_scale(draw: Draw, scene: Scene) -> Fault:
    """0.5-4 % about where the sensor was set, in the middle half of the range."""
    at, size = draw.one(ANGLES), draw.signed(0.005, 0.04)
    low, high = EXCAVATOR.links[at.removesuffix("_angle")].range_deg
    zero = DEGREE * draw.uniform(low + 0.25 * (high - low), high - 0.25 * (high - low))
    return _simple("angle_scale", at, size, "of angle", lambda s, t, values, truth: values + size * (values - zero))


def late(t: Array, values: Array, delay: Array) -> Array:
    """Values as they were `delay` (T,) [s] before."""
    return np.interp(t - delay, t, values)


def lagged(values: Array, constant_s: float) -> Array:
    """Through a first-order lag, at rest before."""
    a = float(np.exp(-1.0 / (FAST * constant_s)))
    return np.asarray(lfilter([1.0 - a], [1.0, -a], values, zi=[a * values[0]])[0])


def sensor_delay(draw: Draw, scene: Scene) -> Fault:
    """10-120 ms: transport, and up to nine tenths of it a lag."""
    at, size, part = draw.one((*PRESSURES, *ANGLES)), draw.size(0.010, 0.120), draw.uniform(0.05, 0.9)

    def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        return late(t, lagged(values, part * size), np.full_like(t, (1.0 - part) * size))

    return _simple("sensor_delay", at, size, "s", change, "transport and lag")


def tilt_ignored(draw: Draw, scene: Scene) -> Fault:
    """The tilt sensor reads level, or keeps its last value, on a slope of up to 5 degrees; as a small effect it misses
    a share of 0.3-5 degrees."""
    stuck = [0.0, 0.0] if draw.uniform(0.0, 1.0) < 0.5 else [draw.uniform(-1.0, 1.0) * DEGREE for _ in range(2)]
    frozen = dict(zip(("pitch", "roll"), stuck, strict=True))
    whole = max(abs(s.pitch - stuck[0]) for s in scene.stretches) / DEGREE
    share = 1.0 if draw.share is None else min(draw.size(0.3, 5.0) / whole, 1.0)
    size = share * whole

    def effect(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        return values + share * (frozen[signal] - values) if signal in frozen else values

    form = "last" if any(stuck) else "level"
    return Fault("tilt_ignored", "machine", size, "deg", lambda m, _: on_sensors(m, effect, digital=True), form)


def slew_ignored(draw: Draw, scene: Scene) -> Fault:
    """The gyro reads zero while the house turns."""
    share = 1.0 if draw.share is None else draw.share

    def effect(signal: str, t: Array, values: Array, truth: Truth) -> Array:
        return (1.0 - share) * values if signal == "slew_rate" else values

    return Fault("slew_centrifugal", "machine", share, "of rate", lambda m, _: on_sensors(m, effect, digital=True))


def line_loss(draw: Draw, scene: Scene) -> Fault:
    """2-15 bar at 0.3 m/s between chamber and sensor where oil leaves, growing with a power of speed; less on the head
    side. The chamber itself, behind the loss, takes that pressure, and the other one drives against it: its sensor
    reads more."""
    at, size, power = draw.one(JOINTS), draw.size(2.0, 15.0), draw.uniform(1.0, 2.1)
    less = draw.uniform(0.1, 1.0)

    def apply(machine: Machine, _: Stretch) -> Machine:
        head, rod = machine.specimen.areas(at)

        def effect(signal: str, t: Array, values: Array, truth: Truth) -> Array:
            if signal not in (f"{at}_head_pressure", f"{at}_rod_pressure"):
                return values
            drives, share = (1.0, rod / head) if signal.endswith("head_pressure") else (-1.0, less * head / rod)
            outward = np.maximum(drives * speed(machine.specimen, at, t, dict(truth)), 0.0)
            return np.asarray(values + share * size * BAR * (outward / 0.3) ** power)

        return on_sensors(machine, effect)

    return Fault("return_line_loss", at, size, "bar at 0.3 m/s", apply, f"power {power:.2f}")


STIFFNESS = {"boom": (4e6, 20e6), "stick": (0.8e6, 5e6), "bucket": (0.25e6, 3e6)}  # N m/rad


def compliance(draw: Draw, scene: Scene) -> Fault:
    """A link that bends under its joint's torque, stiffer the more it is loaded; the angle sensor turns with the side
    that the cylinder pushes."""
    at = draw.one(JOINTS)
    low, high = STIFFNESS[at]
    give, knee = draw.size(1.0 / high, 1.0 / low), TYPICAL_TORQUE[at] * draw.shape(0.4, 6.0)
    b, a = butter(2, 6.0, fs=FAST)

    def apply(machine: Machine, _: Stretch) -> Machine:
        def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
            load = torque(machine.specimen, at, dict(truth))
            load = lfilter(b, a, load, zi=lfilter_zi(b, a) * load[0])[0]
            return np.asarray(values + give * knee * np.arcsinh(load / knee))

        return on_sensors(machine, only(f"{at}_angle", change))

    return Fault("compliance", at, 1e-6 / give, "MN m/rad", apply, "stiffening")


def backlash(draw: Draw, scene: Scene) -> Fault:
    """0.2-2.5 degrees of play, beyond the cylinder and its friction, that the weight takes up on the one side or the
    other."""
    at, size = draw.one(("stick", "bucket")), draw.size(0.2, 2.5)
    threshold, takes = draw.shape(0.01, 0.08) * TYPICAL_TORQUE[at], draw.shape(0.01, 0.1)

    def apply(machine: Machine, stretch: Stretch) -> Machine:
        def change(signal: str, t: Array, values: Array, truth: Truth) -> Array:
            side = lagged(_sides(weight(machine.specimen, at, dict(truth), stretch.pitch), threshold), takes)
            return values + 0.5 * size * DEGREE * side

        return on_sensors(machine, only(f"{at}_angle", change))

    return Fault("backlash", at, size, "deg", apply, "load sign")


def _sides(load: Array, threshold: float) -> Array:
    """+1 or -1 (T,): the last side on which the load exceeded the threshold."""
    clear = np.abs(load) > threshold
    last = np.maximum.accumulate(np.where(clear, np.arange(len(load)), 0))
    return np.where(load[last] >= 0.0, 1.0, -1.0)


def clock_fault(draw: Draw, scene: Scene) -> Fault:
    """Clocks of pressures and angles that drift apart or jump, or sample k paired with sample k of another rate."""
    form, late_ones = draw.one(("drift", "jump", "pairing")), draw.one(("pressures", "angles"))
    members = PRESSURES if late_ones == "pressures" else (*ANGLES, "pitch", "roll")
    end = max(s.begin_s + s.duration_s for s in scene.stretches)
    low, high = {"drift": (0.04, 0.25), "jump": (0.04, 0.25), "pairing": (0.1, 0.8)}[form]
    size, at_s = draw.signed(low, high), end * draw.uniform(0.15, 0.4)

    def apply(machine: Machine, stretch: Stretch) -> Machine:
        def effect(signal: str, t: Array, values: Array, truth: Truth) -> Array:
            if signal not in members:
                return values
            clock = t + stretch.begin_s
            delay = {"drift": size * clock / end, "jump": size * (clock > at_s), "pairing": size * t / 100.0}[form]
            return late(t, values, np.asarray(delay, dtype=np.float64))

        return on_sensors(machine, effect)

    return Fault("clock_fault", "machine", size, "s", apply, form)
