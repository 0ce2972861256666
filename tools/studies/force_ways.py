"""Ways to a fast force, beside each other, on machines of another generator: how quickly pressures, gravity and
friction, and inertia may each pass. The error is that of the vector relative to the unfiltered true force at the moment
of publication, one step after the sample, above 10 kN."""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import signal

from cylforce.commissioning.identification import identify
from cylforce.effects.loads.tip_force import TipForce
from cylforce.estimation.filters import fours, mean, slope
from cylforce.estimation.model import Model, Tares
from cylforce.mechanics.motion import Motion
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Array
from cylforce.signals.units import STANDARD_GRAVITY
from studies._contacts import REFERENCES, foreign_kind, foreign_truth
from studies.unexplained import SHARED

DT = 0.01
SETTLING = 100  # samples


class Course(NamedTuple):
    """A contact recording: its machine and kind, the model, tares, channels (T, D) and true force (T, 2) [N]."""

    name: str
    kind: str
    model: Model
    tares: Tares
    values: Array
    channels: Array
    force: Array


def course(folder: Path) -> Course:
    """The contact recording of a machine, identified from its references."""
    loaded = load(folder / "machine.toml")
    values = (v for name in REFERENCES for v in recorded_segments(loaded, folder / f"{name}.parquet"))
    tares = identify(model_of(loaded), values).tares
    model = Model(loaded.service.machine, loaded.service.filters, tares.friction)
    path = folder / "contact_in_order.parquet"
    (samples,) = recorded_segments(loaded, path)
    truth = foreign_truth(path)
    force = np.column_stack([truth["x"], truth["z"]])
    return Course(folder.name, foreign_kind(folder), model, tares, samples, model.channels.course(samples), force)


def low_pass(x: Array, hertz: float, order: int = 2) -> Array:
    """Butterworth low-pass, settled at the first sample."""
    b, a = signal.butter(order, hertz, fs=1.0 / DT)
    begun = signal.lfilter_zi(b, a).reshape(-1, *[1] * (x.ndim - 1)) * x[0]
    return np.asarray(signal.lfilter(b, a, x, axis=0, zi=begun)[0])


def rate(x: Array) -> Array:
    """Difference quotient."""
    return np.asarray(np.diff(x, axis=0, prepend=x[:1]) / DT)


def solved(c: Course, torque: Array, tool: Array) -> Array:
    """Force (T, 2) that explains torque (T, R), as the service solves for it."""
    machine = c.model.machine
    moment = machine.rated_payload * STANDARD_GRAVITY * machine.payload_reach
    prior = np.diag(np.array([3e5, 3e5, moment]) ** -2.0)
    weighted = np.swapaxes(tool, 1, 2) / c.tares.row_error**2
    return np.asarray(
        np.linalg.solve(weighted @ tool + prior, weighted @ (c.tares.scale * torque)[..., None])[:, :2, 0]
    )


def columns(c: Course, moving: Motion) -> Array:
    """Columns (T, R, 3) of the force."""
    return TipForce().halves(c.model.machine, moving).static[:, list(c.model.machine.rows)]


def one_filter(c: Course, channel: float, regressor: float, smoothing: float) -> Array:
    """The weighing's filters with other corners."""
    filters = c.model.filters._replace(channel_hz=channel, regressor_hz=regressor, smoothing_hz=smoothing)
    model = Model(c.model.machine, filters, c.tares.friction)
    rows, size = model.filtered.run(model.channels.run(c.values).motion), len(model.parameters)
    found = solved(c, rows.torque - rows.columns[..., :size] @ c.tares.values, rows.columns[..., model.tool])
    return np.concatenate([found[:1], found])


def moved(c: Course, position: Array, speed: Array) -> Motion:
    """Motion with unfiltered cylinder forces."""
    channels = position.copy()
    channels[:, c.model.channels.forces] = c.channels[:, c.model.channels.forces]
    return c.model.channels.moved(channels, speed).motion


def complementary(c: Course, slow: tuple[float, float, float], quick: float) -> Array:
    """The slow residual plus the part of the static torque that its filters take away."""
    moving = moved(c, low_pass(c.channels, 15.0), rate(low_pass(c.channels, 10.0)))
    _, static = c.model.empty.products(moving, c.tares.values)
    left = c.model.filtered.regressor.torque(moving) - static
    filters = c.model.filters._replace(channel_hz=slow[0], regressor_hz=slow[1], smoothing_hz=slow[2])
    model = Model(c.model.machine, filters, c.tares.friction)
    rows, size = model.filtered.run(model.channels.run(c.values).motion), len(model.parameters)
    late = rows.torque - rows.columns[..., :size] @ c.tares.values
    lost = low_pass(left, quick) - low_pass(low_pass(low_pass(left, slow[0]), slow[1], 1), slow[2])
    return solved(c, np.concatenate([late[:1], late]) + lost, columns(c, moving))


def split(c: Course, quick: float, slow: float) -> Array:
    """The service's way: motion through the weighing's channel filter, pressures through a quick one, the torque of
    inertia through a further one of first order."""
    channels = c.model.channels
    four = fours(channels.smoothed(c.channels))
    middle, speed = (np.concatenate([x[:1], x]) for x in (mean(four), slope(four, DT)))
    moving = channels.moved(middle, speed).motion
    momentum, static = c.model.empty.products(moving, c.tares.values)
    force = low_pass(c.channels[:, channels.forces], quick)
    torque = c.model.filtered.regressor.torque(moving._replace(force=force))
    return solved(c, torque - static - low_pass(rate(momentum), slow, 1), columns(c, moving))


def kalman(c: Course, jerk: float, quick: float) -> Array:
    """A steady Kalman filter per joint for angle, speed and acceleration, whose jerk is white noise of density `jerk`
    [rad^2/s^5]; noise of rounding to 0.01 deg; pressures through a quick low-pass."""
    x, n = _tracked(c.channels[:, : c.model.machine.size], jerk), c.model.machine.size
    position, speed = low_pass(c.channels, 10.0), np.zeros_like(c.channels)
    position[:, :n], speed[:, :n] = x[:, 0], x[:, 1]
    moving = moved(c, position, speed)
    _, static = c.model.empty.products(moving, c.tares.values)
    later, earlier = (_momentum(c, position, x, h) for h in (1e-3, -1e-3))
    left = low_pass(c.model.filtered.regressor.torque(moving) - static, quick)
    return solved(c, left - (later - earlier) / 2e-3, columns(c, moving))


def _momentum(c: Course, position: Array, x: Array, h: float) -> Array:
    n, speed = c.model.machine.size, np.zeros_like(position)
    ahead = position.copy()
    ahead[:, :n] += h * x[:, 1]
    speed[:, :n] = x[:, 1] + h * x[:, 2]
    return c.model.empty.products(moved(c, ahead, speed), c.tares.values)[0]


def _tracked(angles: Array, jerk: float) -> Array:
    """Angle, speed and acceleration (T, 3, N)."""
    step = np.array([[1.0, DT, DT**2 / 2.0], [0.0, 1.0, DT], [0.0, 0.0, 1.0]])
    noise = jerk * np.array(
        [[DT**5 / 20, DT**4 / 8, DT**3 / 6], [DT**4 / 8, DT**3 / 3, DT**2 / 2], [DT**3 / 6, DT**2 / 2, DT]]
    )
    spread, gain = np.eye(3), np.zeros((3, 1))
    for _ in range(5000):
        spread = step @ spread @ step.T + noise
        gain = spread[:, :1] / (spread[0, 0] + np.radians(0.01) ** 2 / 12.0)
        spread = spread - gain @ spread[:1]
    x, found = np.zeros((3, angles.shape[1])), np.empty((len(angles), 3, angles.shape[1]))
    x[0] = angles[0]
    for k, angle in enumerate(angles):
        x = step @ x
        x = x + gain * (angle - x[0])
        found[k] = x
    return found


WAYS: dict[str, Callable[[Course], Array]] = {
    "one filter 5 / 2 / 2 Hz": lambda c: one_filter(c, 5.0, 2.0, 2.0),
    "one filter 20 / 6 / 6 Hz": lambda c: one_filter(c, 20.0, 6.0, 6.0),
    "one filter 30 / 10 / 10 Hz": lambda c: one_filter(c, 30.0, 10.0, 10.0),
    "one filter 30 / 20 / 20 Hz": lambda c: one_filter(c, 30.0, 20.0, 20.0),
    "complementary, slow 5 / 2 / 2, quick 20 Hz": lambda c: complementary(c, (5.0, 2.0, 2.0), 20.0),
    "complementary, slow 20 / 6 / 6, quick 20 Hz": lambda c: complementary(c, (20.0, 6.0, 6.0), 20.0),
    "Kalman, jerk 0.01": lambda c: kalman(c, 0.01, 20.0),
    "Kalman, jerk 0.1": lambda c: kalman(c, 0.1, 20.0),
    "Kalman, jerk 1": lambda c: kalman(c, 1.0, 20.0),
    "split: pressures 10, inertia 5 and 8 Hz": lambda c: split(c, 10.0, 8.0),
    "split: pressures 20, inertia 5 and 8 Hz": lambda c: split(c, 20.0, 8.0),
    "split: pressures 30, inertia 5 and 8 Hz": lambda c: split(c, 30.0, 8.0),
    "split: pressures 20, inertia 5 and 20 Hz": lambda c: split(c, 20.0, 20.0),
}


def judged(c: Course, found: Array) -> tuple[float, float, float]:
    """95th percentile of the error over the force, of the direction [deg]; rms in the air [N]."""
    true, found = c.force[SETTLING + 1 :], found[SETTLING:-1]
    size, off = np.hypot(*true.T), np.hypot(*(found - true).T)
    large, near = size > 10e3, np.convolve(size > 1.0, np.ones(101), "same") > 0.0
    turned = np.degrees(np.abs(np.angle((found @ (1, 1j)) * np.conj(true @ (1, 1j)))))[large]
    relative = np.percentile((off / np.maximum(size, 1.0))[large], 95)
    return float(relative), float(np.percentile(turned, 95)), float(np.sqrt(np.mean(off[~near] ** 2)))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy force_ways", description=__doc__)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    courses = [course(folder) for folder in sorted(SHARED.glob("foreign_machines/machine_*"))]
    table = Table(title=f"Worst of {len(courses)} machines")
    for name in ("way", "press, drag, soil: p95", "buried: p95", "direction, p95 deg", "in the air, rms N"):
        table.add_column(name)
    figures = {}
    for name, way in WAYS.items():
        each = [(c.kind, *judged(c, way(c))) for c in courses]
        usual = [e for e in each if e[0] != "buried"]
        buried = max((e[1] for e in each if e[0] == "buried"), default=float("nan"))
        row = (max(e[1] for e in usual), buried, max(e[2] for e in usual), max(e[3] for e in each))
        figures[name] = row
        table.add_row(name, f"{100 * row[0]:.1f} %", f"{100 * row[1]:.1f} %", f"{row[2]:.1f}", f"{row[3]:.0f}")
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
