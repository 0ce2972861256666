"""`cylforce new`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import example

EXAMPLE = example("cylforce new -o machine.toml --type excavator --tonnes 8 --set boom.stroke_mm=885")


def new(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="The machine file to write; it must not exist.")
    ] = Path("machine.toml"),
    kind: Annotated[str | None, typer.Option("--type", help="excavator, stick_bucket or wheel_loader.")] = None,
    tonnes: Annotated[str | None, typer.Option(help="Operating mass from the data sheet, in tonnes.")] = None,
    sets: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A figure of the data sheet; see --list.")
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Ask nothing: typical values for all others.")] = False,
    show: Annotated[
        bool, typer.Option("--list", help="Only list the figures, with typical values and limits.")
    ] = False,
) -> None:
    """Write a first machine file from a data sheet."""
    from cylforce.programs.new import GivenFigures, list_figures, run_new

    given = GivenFigures(kind, tonnes, sets or (), yes)
    if show:
        list_figures(given)
        return
    run_new(given, output)
