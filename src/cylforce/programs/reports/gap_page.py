"""The page of a gap: verdict, figures and tables in one file of HTML that loads nothing."""

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from cylforce.diagnosis import Diagnosis
from cylforce.programs.reports import gap_figures
from cylforce.programs.reports.gap_shown import shown
from cylforce.programs.reports.gap_words import least, lines, rivals
from cylforce.programs.reports.template import Wanted, drawn, rendered
from cylforce.programs.reports.units import SHOWN
from cylforce.programs.wording.plain import Plain

NO_CONTENT: dict[str, Any] = {"lines": (), "rivals": (), "least": (), "figures": {}}


def gap_page(found: Diagnosis | None, answer: Mapping[str, Any], said: Plain, origin: Mapping[str, Any]) -> str:
    """Return the HTML.

    found:  None where nothing could be concluded
    said:   the answer in plain words
    origin: machine, files with their hashes and loads, date, version
    """
    content = NO_CONTENT if found is None else _content(found, dict(answer))
    units = [(si, name, f"{factor:.6g}") for si, (name, factor) in SHOWN.items()]
    return rendered("gap.html.j2", answer=answer, said=said, origin=origin, units=units, **content)


def _content(found: Diagnosis, answer: dict[str, Any]) -> dict[str, Any]:
    machine = found.evidence.found.question.machine.regressors.model.machine
    return {
        "lines": lines(machine, found, answer),
        "rivals": rivals(machine, found),
        "least": least(found),
        "figures": _figures(found, answer),
    }


def _figures(found: Diagnosis, answer: dict[str, Any]) -> dict[str, Markup]:
    drawing, unknown, question = shown(found), answer["unknown"], found.evidence.found.question
    spots = {(s["channel"], s["regime"]) for s in answer["where"] if s["found"]}
    simulated = bool(found.named) and not answer["working"]
    wanted: Wanted = {
        "evidence": (lambda: gap_figures.bars(found), "evidence of the candidates"),
        "waterfall": (lambda: gap_figures.waterfall(question, drawing.steps), "residual as effects are simulated"),
        "where": (
            lambda: gap_figures.heat(drawing.heat, spots, taken=simulated),
            "residual by joint and regime, before and after",
        ),
        "friction": (lambda: gap_figures.friction(question, drawing), "residual force over cylinder speed"),
    }
    if drawing.picture is not None:
        picture = drawing.picture
        figure = (lambda: gap_figures.pressures(picture, named=simulated), "pressure measured and simulated over time")
        wanted["pressures"] = figure
    if unknown and unknown["of"] != "none":
        wanted["shape"] = (lambda: gap_figures.shape(found, unknown), "residual over what it is a function of")
    if drawing.overlays:
        wanted["signatures"] = (lambda: gap_figures.overlays(drawing.overlays), "effects laid over the residual")
    return drawn(wanted)
