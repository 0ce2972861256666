"""Sensor readings from true values: lag, skew and jitter of sampling, errors within their class, noise, digits.

Each part can be switched off by name; `perfect` is all of them off. `analog` and `digital` take further distortions, of
a sensor's inner value at 1 kHz before it is sampled, and of its readings at 100 Hz.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .datasheet import EXCAVATOR, JOINTS
from .oil import WARM

Array = NDArray[np.float64]
PARTS = ("gain", "offset", "nonlinearity", "angle", "thermal", "lag", "skew", "jitter", "noise", "quantisation")
FAST = 1000.0  # Hz
DEGREE = np.pi / 180.0
PRESSURES = tuple(f"{joint}_{side}_pressure" for joint in JOINTS for side in ("head", "rod"))
ANGLES = tuple(f"{joint}_angle" for joint in JOINTS)
SIGNALS = (*PRESSURES, *ANGLES, "pitch", "roll", "slew_rate")
NOISE = {"pressure": 0.1e5, "angle": 0.01 * DEGREE, "tilt": 0.02 * DEGREE, "rate": 0.05 * DEGREE, "acceleration": 0.02}
QUANTUM = {
    "pressure": 0.02e5,
    "angle": 0.01 * DEGREE,
    "tilt": 0.01 * DEGREE,
    "rate": 0.01 * DEGREE,
    "acceleration": 0.01,
}
LAGS = {
    "pressure": (0.002, 0.006),
    "angle": (0.003, 0.010),
    "tilt": (0.012, 0.015),
    "rate": (0.004, 0.010),
    "acceleration": (0.004, 0.010),
}
LATEST = 0.008  # s between a node's sampling and the time that its message is given
JITTER = 0.0005  # s


class Distortion(Protocol):
    """A further effect on a signal."""

    def __call__(self, signal: str, t: Array, values: Array, truth: Mapping[str, Array]) -> Array:
        """The values of a signal at times [s] as distorted; `truth`: all signals then, without errors."""
        ...


@dataclass(frozen=True, slots=True)
class Channel:
    """One sensor's true errors, SI: value + offset + gain * value + nonlinearity * 4 x (1 - x), x = value / range,
    + harmonic * sin(value + phase) + thermal * (T - 40 degC); first-order lag; sampled `skew` too early."""

    name: str
    kind: str
    offset: float = 0.0
    gain: float = 0.0
    nonlinearity: float = 0.0
    harmonic: float = 0.0
    phase: float = 0.0
    thermal: float = 0.0
    lag: float = 0.0
    skew: float = 0.0
    jitter: float = 0.0
    noise: float = 0.0
    quantum: float = 0.0

    def delayed(self, fast: Array) -> Array:
        """The sensor's inner value at 1 kHz: exact first-order lag for an input straight between samples."""
        if self.lag <= 0.0:
            return fast
        e = float(np.exp(-1.0 / (FAST * self.lag)))
        r = self.lag * FAST * (1.0 - e)
        begun = [r * fast[0]]  # at rest before the first sample
        return np.asarray(lfilter([1.0 - r, r - e], [1.0, -e], fast, zi=begun)[0])

    def sampled(self, fast: Array, rows: int, rng: np.random.Generator) -> Array:
        """What the node takes at 100 Hz."""
        at = np.arange(rows) * 0.01 - self.skew + self.jitter * rng.standard_normal(rows)
        return np.interp(at, np.arange(len(fast)) / FAST, fast)

    def read(self, value: Array, kelvin: Array, rng: np.random.Generator) -> Array:
        """Its readings."""
        x = value / EXCAVATOR.pressure_range
        said = value + self.offset + self.gain * value + self.nonlinearity * 4.0 * x * (1.0 - x)
        said = said + self.harmonic * np.sin(value + self.phase) + self.thermal * (kelvin - WARM)
        said = said + self.noise * rng.standard_normal(len(value))
        return np.asarray(np.round(said / self.quantum) * self.quantum) if self.quantum else said

    def numbers(self) -> dict[str, object]:
        """For the truth file."""
        return asdict(self)


@dataclass(frozen=True)
class Sensors:
    """All channels, an excavator's in the order of SIGNALS."""

    channels: tuple[Channel, ...]
    analog: tuple[Distortion, ...] = ()
    digital: tuple[Distortion, ...] = ()

    def measure(self, fast: Array, kelvin: Array, still: int, rng: np.random.Generator) -> Array:
        """Values (T + still, S) of signals (10 T, S) at 1 kHz; then `still` rows of their last values."""
        rows = len(fast) // 10
        slow = np.concatenate([fast[::10], np.tile(fast[-1], (still, 1))])
        names = [channel.name for channel in self.channels]
        quick, truth = (dict(zip(names, x.T, strict=True)) for x in (fast, slow))
        columns = []
        for channel in self.channels:
            inner = channel.delayed(quick[channel.name])
            for effect in self.analog:
                inner = effect(channel.name, np.arange(len(inner)) / FAST, inner, quick)
            taken = np.concatenate([channel.sampled(inner, rows, rng), np.full(still, inner[-1])])
            said = channel.read(taken, kelvin, rng)
            for effect in self.digital:
                said = effect(channel.name, np.arange(len(said)) / 100.0, said, truth)
            columns.append(said)
        return np.stack(columns, axis=-1)


def parts(sensors: str | Iterable[str]) -> frozenset[str]:
    """The parts of the errors that are on. Raises ValueError for an unknown one."""
    chosen = {"class": PARTS, "perfect": ()}.get(sensors, (sensors,)) if isinstance(sensors, str) else tuple(sensors)
    unknown = [name for name in chosen if name not in PARTS]
    if unknown:
        raise ValueError(f"sensors has {unknown[0]!r}: choose class, perfect or some of {', '.join(PARTS)}")
    return frozenset(chosen)


def draw_sensors(rng: np.random.Generator, on: frozenset[str]) -> Sensors:
    """Sensors of a machine: the same errors with the same seed, whichever parts are on."""
    skew = {node: float(rng.uniform(0.0, LATEST)) for node in (*JOINTS, *ANGLES, "tilt", "gyro")}
    return Sensors(tuple(_channel(name, skew, rng, on) for name in SIGNALS))


def _kind(name: str) -> tuple[str, str]:
    """Kind and node of a signal."""
    if name in PRESSURES:
        return "pressure", name.split("_", maxsplit=1)[0]
    if name in ANGLES:
        return "angle", name
    return ("tilt", "tilt") if name in ("pitch", "roll") else ("rate", "gyro")


def _channel(name: str, skew: dict[str, float], rng: np.random.Generator, on: frozenset[str]) -> Channel:
    kind, node = _kind(name)
    return draw_channel(name, kind, skew[node], rng, on)


def draw_channel(name: str, kind: str, skew: float, rng: np.random.Generator, on: frozenset[str]) -> Channel:
    """One sensor of a kind (`LAGS`) whose node samples `skew` [s] too early."""
    drawn = {
        "lag": float(rng.uniform(*LAGS[kind])),
        "skew": skew,
        "jitter": JITTER,
        "noise": NOISE[kind],
        "quantum": QUANTUM[kind],
        **{"pressure": _pressure, "angle": _angle, "tilt": _angle, "rate": _rate, "acceleration": _acceleration}[kind](
            rng
        ),
    }
    part = {"quantum": "quantisation", "harmonic": "angle", "phase": "angle"}
    if kind != "pressure":
        part |= {"offset": "angle", "gain": "angle"}
    return Channel(name, kind, **{key: value for key, value in drawn.items() if part.get(key, key) in on})


def _pressure(rng: np.random.Generator) -> dict[str, float]:
    """Class 0.25-0.5 % of the range: at most half of it zero error, three tenths span error, two tenths curvature."""
    full = EXCAVATOR.pressure_range
    grade = float(rng.uniform(0.0025, 0.005))
    a, b, c, d = rng.uniform(-1.0, 1.0, 4).tolist()
    return {
        "offset": 0.5 * grade * full * a,
        "gain": 0.3 * grade * b,
        "nonlinearity": 0.2 * grade * full * c,
        "thermal": 4e-5 * full * d,
    }


def _angle(rng: np.random.Generator) -> dict[str, float]:
    """0.05 degrees in all: zero error, and the error of an eccentric magnet, one period per turn."""
    offset, harmonic = 0.03 * DEGREE * float(rng.uniform(-1.0, 1.0)), 0.02 * DEGREE * float(rng.uniform(0.0, 1.0))
    return {"offset": offset, "harmonic": harmonic, "phase": float(rng.uniform(0.0, 2.0 * np.pi))}


def _rate(rng: np.random.Generator) -> dict[str, float]:
    """A gyro: 0.05 degrees/s and 0.3 %."""
    return {"offset": 0.05 * DEGREE * float(rng.uniform(-1.0, 1.0)), "gain": 0.003 * float(rng.uniform(-1.0, 1.0))}


def _acceleration(rng: np.random.Generator) -> dict[str, float]:
    """An accelerometer: 0.03 m/s^2 and 0.3 %."""
    return {"offset": 0.03 * float(rng.uniform(-1.0, 1.0)), "gain": 0.003 * float(rng.uniform(-1.0, 1.0))}
