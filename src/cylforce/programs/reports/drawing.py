"""The style of figures, and their SVG within a page: it loads nothing from elsewhere."""

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cylforce.signals.estimate import Array

SHOWN = 99.5  # per cent of the points that set an axis, so that one wrong sample does not
WIDTH = 11.0  # inches of the page: letters of figures are as large as those of the text

INK, PALE, GRID = "#1d2733", "#7b8794", "#d9dee4"
BLUE, ORANGE, GREEN, RED, AMBER = "#1668b8", "#e06c00", "#2c8a4b", "#c22f2f", "#d99a00"

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": PALE,
    "axes.labelcolor": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "savefig.transparent": True,
}
_METADATA = re.compile(r"<metadata>.*?</metadata>", re.DOTALL)
_SPACES = re.compile(r"\sxmlns(?::xlink)?=\"[^\"]*\"")  # a page of HTML knows them
_SIZE = re.compile(r"\s(?:width|height)=\"[^\"]*\"")  # the page decides


@contextmanager
def style(salt: str) -> Iterator[None]:
    """Apply the style of all figures.

    salt: keeps the names inside one figure apart from those of the others
    """
    with rc_context({**_STYLE, "svg.hashsalt": salt}):
        yield


def canvas(height: float) -> Figure:
    """Return an empty figure, as wide as the page, `height` inches high."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def svg(figure: Figure, description: str) -> str:
    """Return the figure as an element of HTML, with `description` for screen readers; it contains no address."""
    out = io.StringIO()
    figure.savefig(out, format="svg", dpi=130, metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    _, tag, rest = re.split(r"<svg([^>]*)>", out.getvalue(), maxsplit=1)
    tag = _SIZE.sub("", _SPACES.sub("", tag))
    return f'<svg role="img" aria-label="{escape(description)}"{tag}>' + _METADATA.sub("", rest)


def nothing(axes: Axes) -> None:
    """Draw a note instead of a figure without data."""
    axes.set_axis_off()
    axes.text(0.5, 0.5, "no usable motion", ha="center", color=RED, transform=axes.transAxes)


def noted(axes: Axes, x: float, y: float, text: str) -> None:
    """Draw a note right of the end of a bar."""
    axes.annotate(text, (x, y), xytext=(5, 0), textcoords="offset points", va="center")


def banded(axes: Axes, x: Array, y: Array, edges: Array, colour: str) -> None:
    """Draw mean and standard deviation of y (T,) within bins of x (T,), over a cloud of points."""
    part = np.digitize(x, edges) - 1
    within = [y[np.logical_and(part == k, np.isfinite(y))] for k in range(len(edges) - 1)]
    kept = [k for k, values in enumerate(within) if len(values) >= 20]
    middle = (edges[:-1] + edges[1:])[kept] / 2.0
    mean, spread = (np.array([f(within[k]) for k in kept]) for f in (np.mean, np.std))
    axes.errorbar(middle, mean, spread, color=colour, fmt="o", markersize=3.5, linewidth=1.1, zorder=4)


def cloud(figure: Figure, axes: Axes, speed: Array, seen: Array, force: Array) -> None:
    """Draw measured forces (T,) [N] over a cylinder's speed (T,) [m/s], coloured by its own force (T,) [N]."""
    points = axes.scatter(speed * 1e3, seen * 1e-3, c=force * 1e-3, s=3, alpha=0.6, linewidths=0, rasterized=True)
    bar = figure.colorbar(points, ax=axes, label="cylinder force [kN]", location="bottom", aspect=40, pad=0.02)
    if bar.solids is not None:
        bar.solids.set_alpha(1.0)


def bounded(axes: Axes, values: Array) -> None:
    """Set limits of y that include nearly all values (T,), both signs alike."""
    most = 1.2 * float(np.percentile(np.abs(values), SHOWN)) + 1e-6
    axes.set_ylim(-most, most)
