"""The page of a gap: verdict, figures and tables in one file of HTML that loads nothing."""

from collections.abc import Mapping
from typing import Any

from markupsafe import Markup

from cylforce.diagnosis.answer.shrinkage import Gap
from cylforce.diagnosis.answer.verdict import Judged, Search
from cylforce.programs.reports import gap_figures
from cylforce.programs.reports.gap_shown import shown
from cylforce.programs.reports.gap_words import least, lines, rivals
from cylforce.programs.reports.template import Wanted, drawn, rendered
from cylforce.programs.reports.units import SHOWN
from cylforce.programs.wording.plain import Plain

NOTHING: dict[str, Any] = {"lines": (), "rivals": (), "least": (), "figures": {}}


def gap_page(
    found: tuple[Search, Judged, Gap] | None, answer: Mapping[str, Any], said: Plain, origin: Mapping[str, Any]
) -> str:
    """The HTML. `found`: None where nothing could be concluded; `said`: it in plain words; `origin`: machine,
    files with their hashes and loads, date, version."""
    content = NOTHING if found is None else _content(*found, dict(answer))
    units = [(si, name, f"{factor:.6g}") for si, (name, factor) in SHOWN.items()]
    return rendered("gap.html.j2", answer=answer, said=said, origin=origin, units=units, **content)


def _content(search: Search, judged: Judged, gap: Gap, answer: dict[str, Any]) -> dict[str, Any]:
    machine = search.original.model.machine
    return {
        "lines": lines(machine, judged, answer),
        "rivals": rivals(machine, search, judged),
        "least": least(search),
        "figures": _figures(search, judged, gap, answer),
    }


def _figures(search: Search, judged: Judged, gap: Gap, answer: dict[str, Any]) -> dict[str, Markup]:
    drawing, unknown = shown(search, judged, gap), answer["unknown"]
    spots = {(s["channel"], s["regime"]) for s in answer["where"] if s["found"]}
    wanted: Wanted = {
        "evidence": (lambda: gap_figures.bars(search, judged), "evidence of the candidates"),
        "waterfall": (lambda: gap_figures.waterfall(search, drawing.steps), "residual as effects are taken out"),
        "where": (
            lambda: gap_figures.heat(drawing.heat, spots, taken=bool(judged.named) and not search.working),
            "residual by joint and regime, before and after",
        ),
        "friction": (lambda: gap_figures.friction(search, drawing), "residual force over cylinder speed"),
    }
    if unknown and unknown["of"] != "none":
        figure = (lambda: gap_figures.shape(search.original, gap, unknown), "residual over what it is a function of")
        wanted["shape"] = figure
    if drawing.overlays:
        wanted["signatures"] = (lambda: gap_figures.overlays(drawing.overlays), "effects laid over the residual")
    return drawn(wanted)
