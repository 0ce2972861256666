"""Figures of how well the tares fit: torques, residuals against speed, friction laws tried."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from cylforce.commissioning.identification import Identification
from cylforce.programs.reports.drawing import (
    BLUE,
    GREEN,
    GRID,
    INK,
    ORANGE,
    PALE,
    banded,
    bounded,
    canvas,
    cloud,
    noted,
    nothing,
)
from cylforce.programs.reports.evidence import Drawn, DrawnMinute, DrawnSamples, friction, push
from cylforce.signals.estimate import Array

SPEED_BINS = 16


def torques(found: Identification, shown: Drawn) -> Figure:
    """Draw for each joint measured and predicted torque over the stretch, the residual, and one over the other."""
    machine = found.model.machine
    figure = canvas(0.4 + 2.35 * len(machine.rows))
    outer = figure.add_gridspec(len(machine.rows), 2, width_ratios=(4.2, 1.0))
    for row, joint in enumerate(machine.rows):
        upper = _series(figure, outer[row, 0], shown.stretch, row, row == len(machine.rows) - 1)
        upper.set_title(f"{machine.links[joint].name}: torque about its pin [kN m]")
        _against(figure.add_subplot(outer[row, 1]), shown.points, row)
        if row == 0:
            upper.legend(loc="lower right", ncols=3, bbox_to_anchor=(1.0, 0.98), borderaxespad=0.0)
    return figure


def _series(figure: Figure, place: SubplotSpec, stretch: DrawnMinute, row: int, last: bool) -> Axes:
    """Draw measured and predicted torque, and below them the difference."""
    inner = place.subgridspec(2, 1, height_ratios=(2.6, 1.0), hspace=0.0)
    upper = figure.add_subplot(inner[0])
    lower = figure.add_subplot(inner[1], sharex=upper)
    measured, predicted = (part[:, row] * 1e-3 for part in stretch.seen[:2])
    used = np.where(np.isfinite(measured), predicted, np.nan)
    upper.plot(stretch.t, predicted, color=PALE, linewidth=0.7, linestyle=":", label="not used")
    upper.plot(stretch.t, measured, color=INK, linewidth=2.4, label="measured")
    upper.plot(stretch.t, used, color=ORANGE, linewidth=1.1, label="predicted")
    lower.axhline(0.0, color=PALE, linewidth=0.8)
    lower.plot(stretch.t, measured - predicted, color=BLUE, linewidth=0.9)
    lower.set_ylabel("residual")
    upper.tick_params(labelbottom=False, bottom=False)
    lower.tick_params(labelbottom=last, bottom=last)
    if last:
        lower.set_xlabel(f"seconds into the stretch of {stretch.recording} that shows most")
    return upper


def _against(axes: Axes, points: DrawnSamples, row: int) -> None:
    measured, predicted = (part[:, row] * 1e-3 for part in points[:2])
    good = np.isfinite(measured)
    if not np.any(good):
        nothing(axes)
        return
    axes.scatter(predicted[good], measured[good], s=3, color=BLUE, alpha=0.25, linewidths=0, rasterized=True)
    ends = np.array([np.min(measured[good]), np.max(measured[good])])
    axes.plot(ends, ends, color=INK, linewidth=0.8)
    axes.set_xlabel("predicted")
    axes.set_ylabel("measured")


def residuals(found: Identification, shown: Drawn) -> Figure:
    """Draw for each cylinder, over its speed, identified friction and the samples; below, the residual."""
    machine, wanted = found.model.machine, shown.plan
    pairs = [(j, c) for j, c in zip(wanted.joints, wanted.cylinders, strict=True) if j in machine.rows]
    figure = canvas(5.4)
    axes = figure.subplots(2, len(pairs), squeeze=False, sharex="col", height_ratios=(1.25, 1.0))
    for k, (j, c) in enumerate(pairs):
        left = push(found.model, shown.points, j, c)
        axes[0, k].set_title(f"{machine.cylinders[c].name} cylinder")
        if np.any(np.isfinite(left)):
            _law(figure, axes[0, k], found, shown.points, left, c)
            _left(axes[1, k], shown.points.speed[:, c], left)
        else:
            nothing(axes[0, k])
            nothing(axes[1, k])
    axes[0, 0].set_ylabel("friction [kN]")
    axes[1, 0].set_ylabel("unexplained force [kN]")
    return figure


def _law(figure: Figure, axes: Axes, found: Identification, points: DrawnSamples, left: Array, c: int) -> None:
    """Draw the friction law at the median force, with its 95 % band, over the samples that it was fitted to."""
    good = np.isfinite(left)
    speed, force = points.speed[good, c], points.force[good, c]
    seen = friction(found.model, found.tares, c, speed, force)[0] + left[good]
    cloud(figure, axes, speed, seen, force)
    at = np.linspace(-1.0, 1.0, 201) * np.max(np.abs(speed))
    law, error = friction(found.model, found.tares, c, at, np.full_like(at, np.median(force)))
    axes.fill_between(at * 1e3, (law - 1.96 * error) * 1e-3, (law + 1.96 * error) * 1e-3, color=ORANGE, alpha=0.35)
    axes.plot(at * 1e3, law * 1e-3, color=ORANGE, linewidth=2.0)
    bounded(axes, seen * 1e-3)


def _left(axes: Axes, speed: Array, left: Array) -> None:
    good = np.isfinite(left)
    axes.scatter(speed[good] * 1e3, left[good] * 1e-3, s=3, color=BLUE, alpha=0.2, linewidths=0, rasterized=True)
    fast = float(np.max(np.abs(speed[good])))
    banded(axes, speed * 1e3, left * 1e-3, np.linspace(-fast, fast, SPEED_BINS + 1) * 1e3, INK)
    axes.axhline(0.0, color=PALE, linewidth=0.8)
    axes.set_xlabel("← retracting · speed [mm/s] · extending →")
    bounded(axes, left[good] * 1e-3)


def laws(found: Identification) -> Figure:
    """Draw the error of every friction law tried, in postures excluded from its fit, in units of each joint's noise."""
    names = list(found.held_out)
    error = np.sqrt([found.held_out[name] for name in names])
    kept = [name in found.model.friction for name in names]
    figure = canvas(0.9 + 0.36 * len(names))
    axes = figure.subplots()
    axes.barh(range(len(names)), error, color=[GREEN if k else GRID for k in kept], height=0.62)
    for k, (value, stays) in enumerate(zip(error, kept, strict=True)):
        noted(axes, value, k, f"{value:.3f}: {'kept' if stays else 'left out'}")
    axes.axvline(1.0, color=PALE, linewidth=0.8, linestyle="--")
    axes.set_yticks(range(len(names)), [("" if k == 0 else "with ") + n.replace("_", " ") for k, n in enumerate(names)])
    axes.set_xlim(0.0, 1.35 * float(np.max(error)))
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("error in postures left out of the fit, in units of the noise of each joint")
    return figure
