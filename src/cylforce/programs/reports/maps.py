"""Figures of the state reached: coverage of postures, weighing error over the working range, parameters."""

from itertools import pairwise

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from cylforce.commissioning.coverage import BINS, Pace, Way
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.workspace import driven
from cylforce.programs.reports.drawing import AMBER, BLUE, GRID, INK, PALE, RED, canvas, noted
from cylforce.programs.reports.evidence import Drawn
from cylforce.programs.reports.findings import Findings, ParameterLine
from cylforce.programs.wording.parameter_words import meaning
from cylforce.signals.estimate import Array

LINES = (
    (Way.EXTENDING, Pace.FAST),
    (Way.EXTENDING, Pace.SLOW),
    (Way.RETRACTING, Pace.SLOW),
    (Way.RETRACTING, Pace.FAST),
)
MUCH_S = 6.0  # seconds from which on a cell has the darkest colour
CLASSES = (0.0, 0.25, 0.5, 1.0, 2.0, 5.0, 100.0)  # per cent of the rated payload
COLOURS = ("#1a7a3c", "#5fae6e", "#b9dcae", "#f4d58d", "#e8915b", "#b5342c")
NEVER = "#f6d9d5"
WIDE = 4.0  # of the data sheet's tolerances: values farther out are drawn at the edge


def covered(machine: Machine, shown: Drawn) -> Figure:
    """Draw for each joint the seconds by angle, direction and pace, with missing ones framed.

    Beside them are the seconds of pairs of joints.
    """
    count = len(shown.plan.joints)
    figure = canvas(0.5 + 2.0 * count)
    axes = figure.subplots(count, 2, squeeze=False, width_ratios=(2.4, 1.0))
    for k, joint in enumerate(shown.plan.joints):
        _cells(axes[k, 0], shown, k)
        axes[k, 0].set_title(f"{machine.links[joint].name}: seconds per angle, way and speed of its cylinder")
        axes[k, 1].set_visible(k < count - 1)
    for k, pair in enumerate(pairwise(shown.plan.joints)):
        _plane(axes[k, 1], shown.planes[k], shown.plan.edges[k], shown.plan.edges[k + 1])
        axes[k, 1].set_xlabel(f"{machine.links[pair[0]].name} [°]")
        axes[k, 1].set_ylabel(f"{machine.links[pair[1]].name} [°]")
        axes[k, 1].set_title("seconds together")
    axes[-1, 0].set_xlabel("joint angle [°]")
    return figure


def _cells(axes: Axes, shown: Drawn, k: int) -> None:
    table = np.stack([shown.seconds[k, :, way, pace] for way, pace in LINES])
    needed = np.stack([shown.plan.needed[k, :, way, pace] for way, pace in LINES])
    axes.imshow(table, cmap="Greens", vmin=0.0, vmax=MUCH_S, aspect="auto", extent=(0.0, BINS, len(LINES), 0.0))
    for (y, x), seconds in np.ndenumerate(table):
        lacks = seconds < needed[y, x] - 1e-9
        colour = "white" if seconds > 0.6 * MUCH_S else RED if lacks else INK
        axes.text(
            x + 0.5,
            y + 0.5,
            f"{np.floor(10.0 * seconds) / 10.0:.1f}" if seconds or lacks else "",
            ha="center",
            va="center",
            color=colour,
        )
        if lacks:
            axes.add_patch(
                Rectangle((x + 0.04, y + 0.06), 0.92, 0.88, fill=False, edgecolor=RED, hatch="///", alpha=0.7)
            )
    names = [f"{way.name.lower()}, {pace.name.lower()}" for way, pace in LINES]
    axes.set_yticks(np.arange(len(LINES)) + 0.5, names)
    axes.set_xticks(np.arange(BINS + 1), [f"{v:.0f}" for v in np.degrees(shown.plan.edges[k])])
    axes.grid(visible=False)


def _plane(axes: Axes, seconds: Array, first: Array, second: Array) -> None:
    across, up = np.degrees(first), np.degrees(second)
    shown, colours = np.ma.masked_equal(seconds, 0.0), colormaps["Greens"].with_extremes(bad=NEVER)
    axes.pcolormesh(across, up, shown.T, cmap=colours, vmin=0.0, vmax=MUCH_S, edgecolor="white", linewidth=0.4)
    axes.grid(visible=False)


def weighing(machine: Machine, concluded: Findings) -> Figure:
    """Draw the standard error of a rated payload over the tool's working range, with a sketch of the arm.

    Beside it are the contributions to the error.
    """
    figure = canvas(4.8)
    axes, beside = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    _map(figure, axes, machine, concluded)
    _arm(axes, machine, concluded.grid.theta)
    axes.set_aspect("equal")
    axes.set_xlabel(f"tool point before the {machine.links[0].name} pin [m]")
    axes.set_ylabel("above it [m]")
    _limits(beside, concluded)
    return figure


def _map(figure: Figure, axes: Axes, machine: Machine, concluded: Findings) -> None:
    error = 100.0 * np.nan_to_num(concluded.expected.standard_error, nan=np.inf) / machine.rated_payload
    place, shown = concluded.grid.tool, np.minimum(error, CLASSES[-1] - 1e-6)
    norm, colours = BoundaryNorm(CLASSES, len(COLOURS)), ListedColormap(COLOURS)
    if len(driven(machine)) > 1:
        axes.contourf(place.real, place.imag, shown, levels=CLASSES, cmap=colours, norm=norm)
    else:
        axes.scatter(place.real, place.imag, c=shown, cmap=colours, norm=norm)
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axes, ticks=CLASSES[:-1], shrink=0.9)
    bar.ax.set_yticklabels([f"{share:g} % = {share / 100.0 * machine.rated_payload:.3g} kg" for share in CLASSES[:-1]])
    axes.set_title("standard error after 3 s of motion")


def _limits(axes: Axes, concluded: Findings) -> None:
    names = [name for name, _ in concluded.limits]
    masses = [mass for _, mass in concluded.limits]
    axes.barh(range(len(names)), masses, color=BLUE, height=0.62)
    for k, mass in enumerate(masses):
        noted(axes, mass, k, f"{mass:.1f} kg")
    axes.set_yticks(range(len(names)), names)
    axes.set_xlim(0.0, 1.3 * max([*masses, 1e-3]))
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_title("what limits it, at the median")


def _arm(axes: Axes, machine: Machine, theta: Array) -> None:
    turned = theta[theta.shape[0] // 2, theta.shape[1] // 2]
    at = machine.pose(turned)
    points = np.append(at.origin[1:], machine.tool_point(turned).place)
    axes.plot(points.real, points.imag, color=INK, linewidth=4.0, alpha=0.75, solid_capstyle="round", marker="o")
    for link, start, end in zip(machine.links, points[:-1], points[1:], strict=True):
        half = (start + end) / 2.0
        axes.annotate(link.name, (half.real, half.imag), xytext=(5, 7), textcoords="offset points")


def parameters(concluded: Findings) -> Figure:
    """Draw parameters of bodies in units of the data sheet's tolerance."""
    bodies = [p for p in concluded.parameters if p.unit.startswith("kg")]
    figure = canvas(1.1 + 0.27 * len(bodies))
    axes = figure.subplots()
    for band, alpha in ((2.0, 0.25), (1.0, 0.55)):
        axes.axvspan(-band, band, color=GRID, alpha=alpha, linewidth=0)
    for k, p in enumerate(bodies):
        _bar(axes, k, p)
    axes.set_yticks(range(len(bodies)), [f"{p.name}: {meaning(p.name)}" for p in bodies])
    axes.set_ylim(len(bodies) - 0.4, -0.6)
    axes.set_xlim(-WIDE, WIDE)
    axes.axvline(0.0, color=PALE, linewidth=0.8)
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("difference from the data sheet, in units of its tolerance (bars: 95 % confidence)")
    return figure


def _bar(axes: Axes, k: int, p: ParameterLine) -> None:
    away, error = (p.value - p.sheet) / p.sheet_error, 1.96 * p.error / p.sheet_error
    colour = AMBER if not p.determined else RED if abs(away) > 3.0 else BLUE
    axes.errorbar(np.clip(away, -WIDE, WIDE), k, xerr=error, color=colour, fmt="o", markersize=5, capsize=3)
    note = "kept from the data sheet" if not p.determined else f"{p.sheet_error / p.error:.0f} times sharper"
    axes.text(WIDE, k, note + " ", ha="right", va="center", color=PALE, fontsize=8.5)
