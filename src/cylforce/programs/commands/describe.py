"""`cylforce describe`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import MachineFile, example

EXAMPLE = example("cylforce describe machine.toml --eds node.eds --dbc node.dbc")


def describe(
    machine: MachineFile,
    eds: Annotated[Path | None, typer.Option(help="Write our node's EDS there.")] = None,
    dbc: Annotated[Path | None, typer.Option(help="Write a DBC of all that we publish there.")] = None,
) -> None:
    """Check a machine file; write the EDS and DBC of our node."""
    from cylforce.programs.describe import run_describe

    run_describe(machine, eds, dbc)
