"""A commissioning as a picture: per joint which postures were passed, which way and how fast, and where it is now."""

from itertools import product
from typing import NamedTuple, Self

import numpy as np
from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from cylforce.commissioning.coverage import BINS, Pace, Plan, Way, share
from cylforce.commissioning.guidance import GOOD_ENOUGH, Guide
from cylforce.commissioning.reaches import Reach
from cylforce.commissioning.strokes import Stroke
from cylforce.mechanics.workspace import joint_angles
from cylforce.programs.live.collector import View
from cylforce.signals.estimate import Array

WAYS = {Way.EXTENDING: "out", Way.RETRACTING: "in"}
PACES = {Pace.SLOW: "slowly", Pace.FAST: "fast"}
FULL, PART, NONE, NEEDLESS = "██", "▄▄", "··", "  "
STYLES = {FULL: "green", PART: "yellow", NONE: "dim", NEEDLESS: ""}
CELL = 3  # characters


class Joint(NamedTuple):
    """Joint in the picture.

    k:      its number in the plan
    name:   its name
    rising: whether its cylinder extends as the angle grows; the cells go from the retracted to the extended end
    """

    k: int
    name: str
    rising: bool


def picture(guide: Guide, view: View) -> RenderableType:
    """Return all joints side by side, the error of a weight, and the next instruction."""
    blocks = [_block(guide.plan, joint, view) for joint in _joints(guide)]
    head = Text(f"{guide.model.machine.name}: {summary(guide, view)}", style="bold")
    colour = "bold red" if view.trouble or view.advice.refusal else "bold"
    return Group(head, Text(), Columns(blocks, padding=(0, 3)), Text(), Text(f"> {view.instruction}", style=colour))


def summary(guide: Guide, view: View) -> str:
    """Return the seconds of motion, its coverage, and the error of a weight."""
    minutes, seconds = divmod(int(view.advice.seconds), 60)
    covered = 100 * share(guide.plan, view.advice.covered)
    return (
        f"{minutes}:{seconds:02d} of motion, strokes {covered:.0f} %, postures {100 * view.advice.visited:.0f} %, "
        f"{known(guide, view)}"
    )


def known(guide: Guide, view: View) -> str:
    """Return the error of a rated load in words.

    It has the part that motion reduces, with its goal, and that of pins and bores, which only a known weight reduces.
    """
    rated, scale = guide.model.machine.rated_payload, guide.model.scale_error
    if not np.isfinite(view.advice.weight_error):
        return "weight not known yet"
    cure = ", until a known weight is lifted (--known-kg)" if scale > GOOD_ENOUGH else ""
    return (
        f"error at {rated:.0f} kg by motion: +- {view.advice.weight_error:.0f} kg (enough: {GOOD_ENOUGH * rated:.0f}); "
        f"by pins and bores: +- {scale * rated:.0f} kg{cure}"
    )


def _joints(guide: Guide) -> list[Joint]:
    machine, plan = guide.model.machine, guide.plan
    middle = np.zeros(machine.size)
    middle[list(plan.joints)] = plan.edges.mean(axis=1)
    lever = machine.geometry(joint_angles(machine, middle)).lever
    return [
        Joint(k, machine.links[j].name, bool(lever[c, j] > 0.0))
        for k, (j, c) in enumerate(zip(plan.joints, plan.cylinders, strict=True))
    ]


def _block(plan: Plan, joint: Joint, view: View) -> Text:
    lines = [Text(f"{joint.name:<13}in{'out':>{CELL * BINS - 3}}", style="bold")]
    lines += [_row(plan, joint, view, way, pace) for way, pace in product(Way, Pace)]
    return Text("\n").join([*lines, _pointer(plan, joint, view)])


def _row(plan: Plan, joint: Joint, view: View, way: Way, pace: Pace) -> Text:
    stroke = view.advice.stroke
    asked = isinstance(stroke, Stroke) and stroke.kind == (plan.joints[joint.k], way, pace)
    text = Text(f"{'>' if asked else ' '} {WAYS[way]:<3} {PACES[pace]:<7}", style="bold" if asked else "")
    made, needed = (table[joint.k, :, way, pace].tolist() for table in (view.advice.covered, plan.needed))
    cells = [_cell(*pair) for pair in zip(made, needed, strict=True)]
    for cell in cells if joint.rising else cells[::-1]:
        text.append(f"{cell} ", style=STYLES[cell])
    return text


def _cell(seconds: float, needed: float) -> str:
    if seconds >= needed:
        return FULL if needed > 0.0 or seconds > 0.0 else NEEDLESS
    return PART if seconds > 0.0 else NONE


def _pointer(plan: Plan, joint: Joint, view: View) -> Text:
    """Return a line with the present position of the joint and the end of the requested stroke."""
    width, j = CELL * BINS, plan.joints[joint.k]
    line = [" "] * width
    marks = [(view.here[j], "▲")]
    if isinstance(view.advice.stroke, Stroke) and view.advice.stroke.joint == j:
        marks = [(view.advice.stroke.end, "|"), *marks]
    elif isinstance(view.advice.stroke, Reach):
        marks = [(view.advice.stroke.target[j], "|"), *marks]
    for angle, mark in marks:
        if np.isfinite(angle):
            line[_place(plan.edges[joint.k], float(angle), width, joint.rising)] = mark
    return Text(" " * 13 + "".join(line))


def _place(edges: Array, angle: float, width: int, rising: bool) -> int:
    part = (angle - edges[0]) / (edges[-1] - edges[0])
    return int(np.clip((part if rising else 1.0 - part) * width, 0, width - 1))


class Screen:
    """The picture on a terminal; elsewhere one line whenever the sentence changes."""

    def __init__(self, console: Console) -> None:
        self.console, self._said = console, ""
        self._live = Live(console=console, auto_refresh=False) if console.is_terminal else None

    def __enter__(self) -> Self:
        if self._live is not None:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live is not None:
            self._live.stop()

    def show(self, drawing: RenderableType, head: str, say: str) -> None:
        """Show the drawing; without a terminal print its heading and its sentence."""
        if self._live is not None:
            self._live.update(drawing, refresh=True)
        elif say != self._said:
            self.console.print(f"{head}: {say}", soft_wrap=True)
        self._said = say
