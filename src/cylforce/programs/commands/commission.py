"""`cylforce commission`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import INTERRUPTED, Bus, MachineFile, example

EXAMPLE = example("cylforce commission machine.toml --bus socketcan:can0 -o identified.toml --known-kg 1000")


def _log(output: Path, attachment: str) -> Path:
    named = "" if attachment == "standard" else f".{attachment}"
    return output.with_name(f"{output.stem}{named}.log")


def commission(
    machine: MachineFile,
    bus: Bus,
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write, for `run --identified`.")],
    log: Annotated[
        Path | None, typer.Option(help="The recording to write (candump text). Default: the output's name with .log.")
    ] = None,
    known_kg: Annotated[
        float | None, typer.Option(help="A known weight, to be lifted afterwards for the scale.")
    ] = None,
    attachment: Annotated[
        str, typer.Option(help="The tool on the machine: a minute, and its tares are added to the output.")
    ] = "standard",
) -> None:
    """Guide the moves of the empty machine, then identify.

    Shows what has been recorded and what to do next. Never commands the machine."""
    from rich.console import Console

    from cylforce.programs.commission import Order, run_commission
    from cylforce.programs.common.machine_file import load_machine

    order = Order(bus, output, log or _log(output, attachment), known_kg, attachment)
    if not run_commission(load_machine(machine), order, Console(highlight=False)):
        raise typer.Exit(INTERRUPTED)
