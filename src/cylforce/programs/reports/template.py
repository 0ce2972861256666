"""Pages from templates and figures, for all reports."""

from collections.abc import Callable
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup
from matplotlib.figure import Figure

from cylforce.programs.reports.drawing import style, svg

Wanted = dict[str, tuple[Callable[[], Figure], str]]  # figures by name: function that draws them, description in words


def rendered(name: str, **values: Any) -> str:  # noqa: ANN401 - any value that the template names
    """Return the page from a template of this package and values; a missing value is an error."""
    return templates().get_template(name).render(**values)


def templates(package: str | None = None) -> Environment:
    """Return the templates of a package, which may use those of this one."""
    places = [files(name) for name in (package, __package__) if name]

    def source(name: str) -> str:
        return next(p / name for p in places if (p / name).is_file()).read_text(encoding="utf-8")

    loader = FunctionLoader(source)
    return Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, loader=loader)


def drawn(wanted: Wanted) -> dict[str, Markup]:
    """Return the figures as elements of HTML."""
    return {name: _drawn(name, *how) for name, how in wanted.items()}


def _drawn(name: str, draw: Callable[[], Figure], description: str) -> Markup:
    with style(name):
        return Markup(svg(draw(), description))  # noqa: S704 - our own drawing; names in it are escaped where it is drawn
