"""What a run should do, at 100 Hz: lengths to follow, slew, payload, known force at the teeth, oil temperature."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .soil import Ground

Array = NDArray[np.float64]
RATE = 100
RAMPS = (0.8, 0.5, 0.35)  # s in which an operator brings boom, stick and bucket to speed
PHASES = ("air", "reach", "dig", "lift", "dump", "return", "hold", "still")
AIR, REACH, DIG, LIFT, DUMP, RETURN, HOLD, STILL = range(len(PHASES))


@dataclass(frozen=True)
class Plan:
    """A piece of T rows at 100 Hz, beginning at `begin` [s]. `lengths` (T, 3) [m] and `slew` (T,) [rad] to follow;
    `payload` (T, 4): mass, centre x and z, radius of gyration; `tip` (T, 2): known force on the teeth, forward and up
    in the house's axes [N]; `kelvin` (T,); `wear` (T,): factor of all friction; `phase`, `cycle` (T,). `still_s`: how
    long the machine then stands without being simulated [s]."""

    lengths: Array
    slew: Array
    payload: Array
    tip: Array
    kelvin: Array
    wear: Array
    phase: Array
    cycle: Array
    ground: Ground | None = None
    begin: float = 0.0
    still_s: float = 0.0
    notes: dict[str, object] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """T."""
        return len(self.slew)


def empty(lengths: Array, kelvin: float) -> Plan:
    """A plan of nothing but motion."""
    rows = len(lengths)
    zero = np.zeros(rows)
    still = np.tile((0.0, 0.6, 0.1, 0.3), (rows, 1))
    return Plan(lengths, zero, still, np.zeros((rows, 2)), zero + kelvin, zero + 1.0, zero, zero)


def duration(distance: float, speed: float, ramp: float) -> float:
    """Time [s] of a stroke that reaches `speed` within `ramp` [s] and keeps it."""
    return max(abs(distance) / speed + ramp, 2.0 * ramp) if distance else 0.0


def stroke(u: Array, time: float, ramp: float) -> Array:
    """Share of a stroke covered `u` [s] after its start: speed rises and falls along half a cosine."""
    top = 1.0 / (time - ramp)
    up = np.clip(u, 0.0, ramp)
    rest = np.clip(time - u, 0.0, ramp)
    steady = np.clip(u, ramp, time - ramp) - ramp

    def climb(x: Array) -> Array:
        return x / 2.0 - ramp / (2.0 * np.pi) * np.sin(np.pi * x / ramp)

    return np.asarray(top * (climb(up) + steady + climb(np.full_like(rest, ramp)) - climb(rest)))


def smooth(x: Array) -> Array:
    """0 below 0, 1 above 1, without a kink between."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * x * (10.0 - 15.0 * x + 6.0 * x * x))


class Path:
    """Cylinder lengths over time, stroke after stroke. `now` (C,) is where the last stroke ends; `ramps` (C,): s in
    which each cylinder is brought to speed."""

    def __init__(self, start: Array, ramps: tuple[float, ...] = RAMPS) -> None:
        self.parts: list[Array] = [start[None]]
        self.now = start.copy()
        self.ramps = ramps

    @property
    def rows(self) -> int:
        """Rows so far."""
        return sum(len(part) for part in self.parts)

    @property
    def seconds(self) -> float:
        """Time so far [s]."""
        return self.rows / RATE

    def rest(self, seconds: float) -> None:
        """Stand."""
        self.parts.append(np.tile(self.now, (max(round(seconds * RATE), 0), 1)))

    def go(self, target: Array, speed: "float | Array", delay: "Array | None" = None) -> None:
        """All cylinders to `target`, each at its own speed [m/s], each after its delay [s]."""
        part = self.sketch(target, speed, delay)
        self.parts.append(part)
        self.now = np.array(target, dtype=np.float64)

    def sketch(self, target: Array, speed: "float | Array", delay: "Array | None" = None) -> Array:
        """What `go` would add (rows, C)."""
        count = len(self.now)
        speeds, late = np.broadcast_to(speed, count), np.zeros(count) if delay is None else delay
        times = [duration(float(target[k] - self.now[k]), float(speeds[k]), self.ramps[k]) for k in range(count)]
        t = np.arange(1, round(max(x + float(d) for x, d in zip(times, late, strict=True)) * RATE) + 2) / RATE
        columns = [
            self.now[k] + (target[k] - self.now[k]) * stroke(t - late[k], times[k], self.ramps[k])
            if times[k]
            else np.full_like(t, self.now[k])
            for k in range(count)
        ]
        return np.stack(columns, axis=-1)

    def done(self) -> Array:
        """All rows (T, C)."""
        return np.concatenate(self.parts)
