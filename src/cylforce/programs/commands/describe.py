"""`cylforce describe`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import MachineFile, example

EXAMPLE = example("cylforce describe machine.toml --svg arm.svg --eds node.eds --dbc node.dbc")


def describe(
    machine: MachineFile,
    svg: Annotated[Path | None, typer.Option(help="Draw the arm with every pin there (SVG).")] = None,
    html: Annotated[Path | None, typer.Option(help="Write a page with drawing and tables there.")] = None,
    schema: Annotated[Path | None, typer.Option(help="Write the JSON schema of machine files there.")] = None,
    eds: Annotated[Path | None, typer.Option(help="Write the EDS of cylforce's node there.")] = None,
    dbc: Annotated[Path | None, typer.Option(help="Write a DBC of all frames, the sensors' too, there.")] = None,
) -> None:
    """Check a machine file, show it, draw its pins."""
    from cylforce.programs.describe import DescriptionFiles, run_describe

    run_describe(machine, DescriptionFiles(svg=svg, html=html, eds=eds, dbc=dbc, schema=schema))
