"""The residual that no known effect explains, over the quantity of which it is a function."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cylforce.diagnosis.shape import Lie, Shape
from cylforce.diagnosis.track import MOVING, Track
from cylforce.mechanics.machine import Machine
from cylforce.programs.reports.drawing import BLUE, INK, ORANGE, PALE, banded, bounded, canvas
from cylforce.signals.estimate import Array
from cylforce.signals.units import DEGREE

BINS = 24
MOST_POINTS = 4000
STRETCH_S, GAP_S = 30.0, 0.2
BY_ITSELF = ("swinging", "moments")
OVER = {
    "speed": ("speed of its cylinder [mm/s]", 1e3),
    "position": ("angle of the joint [°]", 1.0 / DEGREE),
    "periodic": ("angle of the joint [°]", 1.0 / DEGREE),
    "load": ("{detail} [kN]", 1e-3),
    "turning": ("turning of the base [°/s]", 1.0 / DEGREE),
    "reversal": ("time since the motion turned back [s]", 1.0),
}
TIME = ("time since the recording began [s]", 1.0)


def shape_figure(lie: Lie, machine: Machine) -> Figure:
    """Residual of the joint over the quantity that predicts it; over time, where it is largest, if none does."""
    figure = canvas(3.4)
    axes = figure.subplots()
    if lie.shapes[0].of in BY_ITSELF:
        _worst(axes, lie.track)
    else:
        _cloud(axes, lie, machine)
    axes.axhline(0.0, color=PALE, linewidth=0.8)
    axes.set_ylabel(f"left at the {machine.links[machine.rows[lie.at]].name} [kN m]")
    return figure


def _worst(axes: Axes, track: Track) -> None:
    """The stretch with most energy, a line broken where nothing is known."""
    part = track.parts(STRETCH_S)
    here = part == np.argmax(np.bincount(part, track.left**2))
    t, y = track.time[here], track.left[here] * 1e-3
    gaps = np.flatnonzero(np.diff(t) > GAP_S) + 1
    axes.plot(np.insert(t, gaps, np.nan), np.insert(y, gaps, np.nan), color=INK, marker=".", markersize=3.0)
    axes.set_xlabel(TIME[0])


def _cloud(axes: Axes, lie: Lie, machine: Machine) -> None:
    """Extending orange, retracting blue, means with scatter."""
    shape, track = lie.shapes[0], lie.track
    label, factor = OVER.get(shape.of, TIME)
    x, y = _over(track, shape) * factor, track.left * 1e-3
    step = -(-len(x) // MOST_POINTS)
    low, high = np.percentile(x, [0.5, 99.5]).tolist()
    edges = np.linspace(low, high, BINS + 1)
    for sign, colour, way in ((1.0, ORANGE, "extending"), (-1.0, BLUE, "retracting")):
        moves = sign * track.speed > MOVING
        axes.scatter(x[moves][::step], y[moves][::step], s=4, color=colour, alpha=0.5, linewidths=0, label=way)
        banded(axes, x[moves], y[moves], edges, colour)
    resting = np.abs(track.speed) <= MOVING
    axes.scatter(x[resting][::step], y[resting][::step], s=3, color=PALE, linewidths=0, label="hardly moving", zorder=1)
    axes.set_xlabel(label.format(detail=shape.detail(machine)))
    axes.legend(loc="upper right", ncols=3, markerscale=3.0)
    bounded(axes, y)


def _over(track: Track, shape: Shape) -> Array:
    """What it is a function of (T,)."""
    if shape.of == "load":
        return np.asarray(track.loads[:, shape.whose])
    name = {"periodic": "position"}.get(shape.of, shape.of)
    return np.asarray(getattr(track, name if name in OVER else "time"))
