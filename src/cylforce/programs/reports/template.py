"""How templates and figures become a page, whichever the report."""

from collections.abc import Callable
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from cylforce.programs.reports.drawing import style, svg

Wanted = dict[str, tuple[Callable[[], Figure], str]]  # figures by name: how to draw them, what they show in words


def rendered(name: str, **values: Any) -> str:  # noqa: ANN401 - any value that the template names
    """The page that a template of this package makes of values; a name that it misses is an error."""
    made = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, loader=FunctionLoader(_source)
    )
    return made.get_template(name).render(**values)


def _source(name: str) -> str:
    return (files(__package__) / name).read_text(encoding="utf-8")


def drawn(wanted: Wanted) -> dict[str, Markup]:
    """The figures as elements of HTML."""
    return {name: _drawn(name, *how) for name, how in wanted.items()}


def _drawn(name: str, draw: Callable[[], Figure], description: str) -> Markup:
    with style(name):
        return Markup(svg(draw(), description))  # noqa: S704 - our own drawing; names in it are escaped where it is drawn
