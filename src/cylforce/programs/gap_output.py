"""What `cylforce gap` writes and prints: JSON, patch file, text."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit
from rich.console import Console
from rich.table import Table
from rich.text import Text

from cylforce.diagnosis.explain import blocks_of
from cylforce.files.atomic import RecordingError, replacing
from cylforce.files.motion_table import write_motion
from cylforce.mechanics.machine import Machine
from cylforce.programs.common.tables import print_table
from cylforce.programs.experiments.catalogue import checkup
from cylforce.programs.experiments.motions import table_of
from cylforce.programs.gap import Diagnosed
from cylforce.programs.wording.plain import MOST_OF, Plain, looked, percent, plain
from cylforce.signals.estimate import Array


class Outputs(NamedTuple):
    """Where to write what, None where not: the answer as JSON, the effects as a patch, the report, the residuals."""

    answer: Path | None
    patch: Path | None
    report: Path | None
    residuals: Path | None


def write_all(found: Diagnosed, report: str | None, outputs: Outputs) -> None:
    """Write what was asked for, each file whole or not at all."""
    texts = (_answer_text(found), _patch_text(found), report)
    for path, text in zip(outputs[:3], texts, strict=True):
        if path is not None and text is not None:
            with replacing(path) as temporary:
                temporary.write_text(text, encoding="utf-8")
    if outputs.residuals is not None:
        with replacing(outputs.residuals) as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **_residuals(found))


def _residuals(found: Diagnosed) -> dict[str, Array]:
    """Return the residual of every recording before and after: NAME.t, NAME.before, NAME.after."""
    columns: dict[str, list[Array]] = {}
    begins: dict[str, float] = {}  # of a recording's first stretch
    if found.diagnosis is None:
        return {}
    seen, both = found.diagnosis.evidence.found.question.seen, found.diagnosis.simulated
    for each, before, after in zip(seen, both.before, both.after, strict=True):
        recording = each.recording
        name = Path(recording.name).stem
        t = each.rows.t - begins.setdefault(recording.name, recording.begins_s)
        for kind, values in (("t", t), ("before", before), ("after", after)):
            columns.setdefault(f"{name}.{kind}", []).append(values)
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def _answer_text(found: Diagnosed) -> str:
    """JSON has no NaN: what has no value is null."""
    finite = json.loads(json.dumps(found.answer, default=float), parse_constant=lambda _: None)
    return json.dumps(finite, indent=1, allow_nan=False) + "\n"


def _patch_text(found: Diagnosed) -> str:
    """Return the named effects as blocks of TOML."""
    if found.diagnosis is None or not found.diagnosis.named:
        return "effects = []\n"
    causes = [named.cause for named in found.diagnosis.named]
    part = blocks_of(found.diagnosis.evidence.found.question, causes)
    return tomlkit.dumps({"effects": part}) if part else "effects = []\n"


def write_next_motion(path: Path, found: Diagnosed, machine: Machine) -> None:
    """Write the best motion to record next: of the catalogue, else, while the machine works, that of the check-up.

    Raises RecordingError where no motion helps.
    """
    plan = found.plan
    if plan is None or not (plan.advice or plan.stop_first):
        reason = "no motion of the catalogue says more"
        raise RecordingError(f"--next-motion {path}: is not written: {reason}; leave the option out")
    motion = checkup(machine)[0] if plan.stop_first else plan.advice[0].motion
    write_motion(path, table_of(motion), [link.name for link in machine.links])


def show(found: Diagnosed, machine: Machine, console: Console) -> None:
    """The answer in plain words, then the effects by the names that options and files use."""
    said = plain(machine, found.answer)
    console.print(said.headline)
    console.print(_points(said))
    for part in found.answer.get("looked_at", ()):
        if part["seconds"] < MOST_OF * part["of_seconds"]:
            console.print(f"{part['name']}: {looked(part)}")
    if found.answer["effects"]:
        show_effects(found.answer["effects"], console)


def _points(said: Plain) -> Table:
    """Titles beside their lines."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(no_wrap=True)
    grid.add_column(overflow="fold")
    for point in said.points:
        for k, line in enumerate(point.lines):
            grid.add_row("" if k else point.title, Text(line))
    return grid


def show_effects(effects: Sequence[dict[str, Any]], console: Console) -> None:
    """A table with one row for each effect, as options and files name it, with their units."""
    rows = [
        (f"{effect['name']}@{effect['at']}", f"{size['value']:.4g}", size["unit"], percent(effect["confidence"]))
        for effect in effects
        for size in effect["parameters"].values()
    ]
    print_table(console, ("name in the files", "size", "unit", "how sure"), rows, ("size", "how sure"))
