"""What `cylforce gap` writes and prints: JSON, patch file, text."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomlkit
from rich.console import Console

from cylforce.diagnosis.patch import patch
from cylforce.diagnosis.shrinkage import courses, written
from cylforce.diagnosis.verdict import Verdict
from cylforce.files.atomic import replacing
from cylforce.programs.common.tables import print_table
from cylforce.programs.gap import Diagnosed
from cylforce.signals.estimate import Array

MOSTLY = 0.5  # of what is left
SHAPES = {
    "speed": "a function of the cylinder's speed",
    "position": "a function of the joint's angle",
    "load": "a function of load",
    "time": "a function of time since the start",
    "moments": "within a tenth of the time",
}
MOST_OF = 0.9  # of a recording: where less was examined, a line says so


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
    """What is left of every recording before and after: NAME.t, NAME.before, NAME.after."""
    columns: dict[str, list[Array]] = {}
    for course in courses(found.search, found.gap) if found.search and found.gap else ():
        for kind in ("t", "before", "after"):
            columns.setdefault(f"{Path(course.name).stem}.{kind}", []).append(getattr(course, kind))
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def _answer_text(found: Diagnosed) -> str:
    """JSON has no NaN: what has no value is null."""
    finite = json.loads(json.dumps(found.answer, default=float), parse_constant=lambda _: None)
    return json.dumps(finite, indent=1, allow_nan=False) + "\n"


def _patch_text(found: Diagnosed) -> str:
    """The effects named as blocks of TOML."""
    part = patch(found.search, written(found.search, found.judged)) if found.search else []
    return tomlkit.dumps({"effects": part}) if part else "effects = []\n"


def show(found: Diagnosed, console: Console) -> None:
    """The verdict in a sentence, the effects in a table."""
    console.print(sentence(found.answer))
    for warning in found.answer.get("warnings", ()):
        console.print(f"but {warning}")
    for part in found.answer.get("looked_at", ()):
        if part["seconds"] < MOST_OF * part["of_seconds"]:
            console.print(f"{part['name']}: {looked(part)}")
    if found.answer["effects"]:
        show_effects(found.answer["effects"], console)
    for effect in found.answer["effects"]:
        if effect["confused_with"]:
            others = ", ".join(f"{o['name']} at {o['at']}" for o in effect["confused_with"])
            console.print(f"{effect['name']} at {effect['at']} may also be {others}", soft_wrap=True)
    for experiment in found.answer.get("next_experiment", ()):
        console.print(f"next: {experiment}")


def show_effects(effects: Sequence[dict[str, Any]], console: Console) -> None:
    """A table with one row for each effect."""
    rows = []
    for effect in effects:
        size = effect["parameters"]["size"]
        interval = f"{size['low']:.3g} .. {size['high']:.3g}"
        row = (f"{effect['name']} at {effect['at']}", f"{size['value']:.4g}", interval, size["unit"])
        rows.append((*row, f"{100 * effect['confidence']:.0f} %"))
    right = ("size", "90 % interval", "confidence")
    print_table(console, ("effect", "size", "90 % interval", "unit", "confidence"), rows, right)


def looked(part: dict[str, Any]) -> str:
    """How much of a recording was examined, in words."""
    many = f", in {part['stretches']} stretches" if part["stretches"] > 1 else ""
    return f"{part['seconds'] / 60.0:.1f} of {part['of_seconds'] / 60.0:.1f} min examined{many}"


def sentence(answer: dict[str, Any]) -> str:
    """The verdict in words."""
    verdict, size = answer["verdict"], answer.get("gap")
    if size is None:
        return f"{'Nothing else' if answer['effects'] else 'Nothing'} can be concluded: {answer['reason']}."
    gap_nm = f"{size['fixed']:.0f} N m (noise floor {size['floor']:.0f} N m)"
    if verdict == Verdict.NO_GAP:
        return f"No gap: what the model leaves, {gap_nm}, is normal for this machine."
    if verdict == Verdict.UNKNOWN:
        return f"There is a gap, {gap_nm}, and none of the known effects explains it{shape_words(answer)}."
    if verdict == Verdict.NOT_OBSERVABLE:
        return f"No cause can be named of what the model leaves, {gap_nm}: {answer['reason']}."
    names = " and ".join(f"{e['name']} at {e['at']}" for e in answer["effects"])
    closure = answer["effects"][0]["closure"]
    words = {Verdict.AMBIGUOUS: "may be caused by", Verdict.PARTLY: "is caused in part by"}
    verb = words.get(verdict, "is caused by")
    share = closure["value"]
    it = "it" if len(answer["effects"]) == 1 else "them"
    gone = f"{size['after']:.0f} N m are left" if share is None else f"{100 * share:.0f} % of the gap's energy is gone"
    return f"The gap, {gap_nm}, {verb} {names}; with {it} simulated, {gone}{shape_words(answer)}."


def shape_words(answer: dict[str, Any]) -> str:
    """At which joint the unexplained torque is, and of what it is a function."""
    shape = answer.get("unknown")
    if shape is None or shape["of"] == "none":
        return ""
    amount = "mostly" if shape["share"] >= MOSTLY else "in part"
    words = SHAPES[shape["of"]] + (f" ({shape['detail']})" if shape["detail"] else "")
    return f"; what is left is at the {shape['at']}, {amount} {words}: {100 * shape['share']:.0f} % of its energy"
