"""Figures of a gap: evidence, pressures at the worst place, heat map, friction map, signatures, waterfall."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from cylforce.diagnosis import Diagnosis
from cylforce.diagnosis.explain import Picture, quantities
from cylforce.diagnosis.search import UNKNOWN, FieldQuestion
from cylforce.programs.reports.drawing import (
    AMBER,
    BLUE,
    GREEN,
    GRID,
    INK,
    ORANGE,
    PALE,
    RED,
    banded,
    bounded,
    canvas,
    cloud,
    noted,
    nothing,
)
from cylforce.programs.reports.evidence import DrawnSamples, push
from cylforce.programs.reports.gap_shown import Heat, Overlay, Shown, Step, movers, readable
from cylforce.signals.estimate import Array
from cylforce.signals.units import DEGREE

MOST_BARS = 12
WORST = 5.0  # times the normal residual: from here on a cell is as dark as can be
SPEED_BINS = 16
BINS = 24
MOST_POINTS = 4000
OVER = {
    "speed": ("speed of its cylinder [asinh of cm/s]", 1.0),
    "position": ("angle of the joint [°]", 1.0 / DEGREE),
    "load": ("{detail} [kN]", 1e-3),
    "time": ("time since the recording began [s]", 1.0),
}


def bars(found: Diagnosis) -> Figure:
    """Draw the evidence of the candidates, each by itself."""
    evidence = found.evidence
    named = {n.cause.key for n in found.named}
    confused = {key for n in found.named for key in n.rivals}
    nats = {key: log - evidence.found.healthy.log for key, log in evidence.alone.items() if key != UNKNOWN}
    shown = sorted((key for key in nats if nats[key] > 0.0), key=lambda key: -nats[key])[:MOST_BARS]
    figure = canvas(0.8 + 0.3 * max(len(shown), 1))
    axes = figure.subplots()
    colours = [BLUE if key in named else AMBER if key in confused else GRID for key in shown]
    axes.barh(range(len(shown)), [nats[key] for key in shown], color=colours, height=0.66)
    for k, key in enumerate(shown):
        word = ": named" if key in named else ": cannot be distinguished" if key in confused else ""
        noted(axes, nats[key], k, f"{nats[key]:.0f}{word}")
    axes.set_yticks(range(len(shown)), [readable(key) for key in shown])
    axes.set_xlim(0.0, 1.25 * max([nats[key] for key in shown] or [1.0]))
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.set_xlabel("evidence [nats] of each candidate by itself, against none")
    if not shown:
        axes.text(0.5, 0.5, "no candidate has any", ha="center", color=PALE, transform=axes.transAxes)
    return figure


def pressures(picture: Picture, *, named: bool) -> Figure:
    """Draw the pressure at the worst place over time: measured, simulated before, and with the named causes."""
    figure = canvas(3.2)
    axes = figure.subplots()
    axes.plot(picture.t, picture.measured, color=INK, linewidth=2.2, label="measured")
    axes.plot(picture.t, picture.before, color=ORANGE, linewidth=1.3, label="model, as it was")
    if named:
        axes.plot(picture.t, picture.after, color=BLUE, linewidth=1.3, linestyle="--", label="model with the causes")
    axes.legend(loc="upper right", ncols=3)
    axes.set_xlabel("time since the recording began [s]")
    axes.set_ylabel(f"{picture.cylinder} cylinder, as head-side pressure [bar]")
    return figure


def heat(shown: Heat, found: set[tuple[str, str]], *, taken: bool) -> Figure:
    """Joint by regime, before and after, in units of the normal residual; (joint, regime) in `found` framed; `taken`:
    effects were taken out."""
    figure = canvas(1.1 + 0.82 * len(shown.joints))
    axes = figure.subplots(2, 1, sharex=True)
    image = _cells(axes[0], shown, shown.before)
    _cells(axes[1], shown, shown.after)
    axes[0].set_title("before: parameters fixed [N m]")
    how = "effects taken out, stretches not fitted" if taken else "no effect taken out"
    axes[1].set_title(f"after: {how} [N m]")
    for joint, regime in found:
        _framed(axes[0], shown.regimes.index(regime), shown.joints.index(joint))
    axes[1].set_xticks(range(len(shown.regimes)), [name.replace(" ", "\n") for name in shown.regimes])
    figure.colorbar(image, ax=axes, label="times the residual of a healthy machine", extend="max", aspect=30, pad=0.01)
    return figure


def _cells(axes: Axes, shown: Heat, values: Array) -> AxesImage:
    ratio = shown.excess(values)
    image = axes.imshow(ratio, cmap="OrRd", vmin=1.0, vmax=WORST, aspect="auto")
    for (y, x), value in np.ndenumerate(values):
        colour = "white" if ratio[y, x] > 0.65 * WORST else INK
        axes.text(x, y, f"{value:.0f}" if np.isfinite(value) else "–", ha="center", va="center", color=colour)
    axes.set_yticks(range(len(shown.joints)), shown.joints)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    return image


def _framed(axes: Axes, x: int, y: int) -> None:
    axes.add_patch(Rectangle((x - 0.47, y - 0.45), 0.94, 0.9, fill=False, edgecolor=INK, linewidth=1.6))


def friction(question: FieldQuestion, shown: Shown) -> Figure:
    """Residual of every joint as force of its cylinder, over speed, coloured by the cylinder's force; before, after."""
    model = question.machine.regressors.model
    pairs = list(zip(*movers(question), strict=True))
    figure = canvas(6.0)
    axes = figure.subplots(2, len(pairs), squeeze=False, sharex="col", sharey="col")
    for k, (j, c) in enumerate(pairs):
        axes[0, k].set_title(f"{model.machine.cylinders[c].name} cylinder")
        forces = [push(model, part, j, c) for part in (shown.before, shown.after)]
        for y, (part, force) in enumerate(zip((shown.before, shown.after), forces, strict=True)):
            _pushed(figure, axes[y, k], part, force, c)
        good = forces[0][np.isfinite(forces[0])]
        if good.size:
            bounded(axes[0, k], good * 1e-3)
        axes[1, k].set_xlabel("← retracting · speed [mm/s] · extending →")
    axes[0, 0].set_ylabel("before: residual force [kN]")
    axes[1, 0].set_ylabel("after [kN]")
    return figure


def _pushed(figure: Figure, axes: Axes, part: DrawnSamples, force: Array, c: int) -> None:
    good = np.isfinite(force)
    if not np.any(good):
        nothing(axes)
        return
    speed = part.speed[:, c]
    cloud(figure, axes, speed[good], force[good], part.force[good, c])
    fast = float(np.percentile(np.abs(speed[good]), 99.5)) + 1e-9
    banded(axes, speed * 1e3, force * 1e-3, np.linspace(-fast, fast, SPEED_BINS + 1) * 1e3, INK)
    axes.axhline(0.0, color=PALE, linewidth=0.8)


def overlays(shown: tuple[Overlay, ...]) -> Figure:
    """Each named effect over the residual, where it shows most; below, what it leaves."""
    figure = canvas(0.3 + 2.7 * len(shown))
    places = figure.add_gridspec(len(shown), 1)
    for k, each in enumerate(shown):
        inner = places[k].subgridspec(2, 1, height_ratios=(2.4, 1.0), hspace=0.0)
        upper = figure.add_subplot(inner[0])
        lower = figure.add_subplot(inner[1], sharex=upper)
        _laid_over(upper, lower, each)
        if k == 0:
            upper.legend(loc="lower right", ncols=2, bbox_to_anchor=(1.0, 0.98), borderaxespad=0.0)
    return figure


def _laid_over(upper: Axes, lower: Axes, each: Overlay) -> None:
    upper.plot(each.t, each.residual * 1e-3, color=INK, linewidth=2.2, label="residual without the effect")
    upper.plot(each.t, each.effect * 1e-3, color=ORANGE, linewidth=1.3, label="what the effect explains")
    upper.set_title(f"{each.title} [kN m]")
    upper.tick_params(labelbottom=False, bottom=False)
    lower.axhline(0.0, color=PALE, linewidth=0.8)
    lower.plot(each.t, (each.residual - each.effect) * 1e-3, color=BLUE, linewidth=0.9)
    lower.set_ylabel("left")
    lower.set_xlabel(f"seconds into {each.recording}")


def waterfall(question: FieldQuestion, steps: tuple[Step, ...]) -> Figure:
    """Draw how the residual falls, step by step, of all joints together and of each."""
    machine = question.machine.regressors.model.machine
    names = ["all joints", *(machine.links[j].name for j in machine.rows)]
    figure = canvas(0.9 + 0.36 * len(steps))
    axes = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for k, name in enumerate(names):
        values = [float(np.sqrt(np.mean(s.residual**2)) if k == 0 else s.residual[k - 1]) for s in steps]
        _falling(axes[k], values)
        axes[k].set_title(f"{name} [N m]")
    axes[0].set_yticks(range(len(steps)), [step.label for step in steps])
    axes[0].invert_yaxis()
    return figure


def _falling(axes: Axes, values: list[float]) -> None:
    last = len(values) - 1
    colours = [RED, AMBER, *[BLUE] * (last - 2), GREEN]
    axes.barh(range(len(values)), values, color=colours, height=0.62)
    for k, value in enumerate(values):
        noted(axes, value, k, f"{value:.0f}" if value else "nothing known")
    axes.axvline(values[last], color=GREEN, linewidth=0.9, linestyle="--")
    axes.set_xlim(0.0, 1.3 * max(values))
    axes.grid(visible=False, axis="y")


def shape(found: Diagnosis, unknown: dict[str, Any]) -> Figure:
    """Draw the residual of the joint over the quantity that predicts it, or over time if none does.

    Extending is orange, retracting blue; means have their scatter.
    """
    question = found.evidence.found.question
    machine = question.machine.regressors.model.machine
    row = [machine.links[j].name for j in machine.rows].index(unknown["at"])
    each, direction = quantities(question, row)
    name, detail, values = next((q for q in each if q[:2] == (unknown["of"], unknown["detail"])), each[-1])
    label, factor = OVER[name]
    x, y = values * factor, np.concatenate([e[:, row] for e in found.simulated.after]) * 1e-3
    figure = canvas(3.4)
    axes = figure.subplots()
    low, high = np.percentile(x, [0.5, 99.5]).tolist()
    edges, step = np.linspace(low, high, BINS + 1), -(-len(x) // MOST_POINTS)
    for sign, colour, word in ((1.0, ORANGE, "extending"), (-1.0, BLUE, "retracting")):
        moves = (sign * direction > 0.0) & np.isfinite(y)
        axes.scatter(x[moves][::step], y[moves][::step], s=4, color=colour, alpha=0.5, linewidths=0, label=word)
        banded(axes, x[moves], y[moves], edges, colour)
    axes.set_xlabel(label.format(detail=detail))
    axes.legend(loc="upper right", ncols=2, markerscale=3.0)
    bounded(axes, y[np.isfinite(y)])
    axes.axhline(0.0, color=PALE, linewidth=0.8)
    axes.set_ylabel(f"residual of the {unknown['at']} [kN m]")
    return figure
