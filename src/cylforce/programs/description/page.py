"""The description as one page of HTML that loads nothing."""

from collections.abc import Iterable, Sequence
from html import escape

import cylforce
from cylforce.programs.description.drawing import drawing
from cylforce.programs.description.tables import TextTable
from cylforce.settings.machine_file import Loaded

_STYLE = """
body { font: 15px/1.45 sans-serif; color: #1d2733; margin: 2em auto; max-width: 80em; padding: 0 1em }
h1 { font-size: 1.5em } h2 { font-size: 1.15em; margin-top: 2em }
table { border-collapse: collapse; display: block; overflow-x: auto }
td, th { padding: 0.2em 0.8em; text-align: left; border-bottom: 1px solid #d9dee4 }
th { color: #7b8794; font-weight: normal } .warning { color: #c22f2f } .note { color: #7b8794 } svg { width: 100% }
"""


def page(loaded: Loaded, shown: Sequence[TextTable], warnings: Sequence[str]) -> str:
    """Return the HTML: warnings, drawing, tables."""
    name = escape(loaded.service.machine.name)
    origin = f"{loaded.path.name}, SHA-256 {loaded.sha256[:16]}..., cylforce {cylforce.__version__}"
    parts = [
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{name}</title>',
        '<meta name="viewport" content="width=device-width">',
        f"<style>{_STYLE}</style></head><body><h1>{name}</h1><p class=note>{escape(origin)}</p>",
        *(f"<p class=warning>{escape(sentence)}</p>" for sentence in warnings),
        drawing(loaded.service.machine),
        *(_table(table) for table in shown),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _table(table: TextTable) -> str:
    rows = "\n".join(_row("td", row) for row in table.rows)
    notes = "".join(f"<p class=note>{escape(note)}</p>" for note in table.notes)
    return f"<h2>{escape(table.title)}</h2>\n<table>{_row('th', table.head)}\n{rows}</table>{notes}"


def _row(tag: str, texts: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(text)}</{tag}>' for text in texts)}</tr>"
