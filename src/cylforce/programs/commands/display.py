"""`cylforce display`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import Bus, MachineFile, Unit, example

EXAMPLE = example("cylforce display machine.toml --bus socketcan:can0 --records records.db")


def display(
    machine: MachineFile,
    bus: Bus,
    records: Annotated[
        Path | None, typer.Option(help="The records of `cylforce run`, for history and tickets.")
    ] = None,
    listen: Annotated[str, typer.Option(metavar="HOST:PORT", help="Where the page is served.")] = "127.0.0.1:8080",
    name: Annotated[
        list[str] | None, typer.Option(help="Another name or address under which the page is reached; repeatable.")
    ] = None,
    pin_file: Annotated[
        Path | None, typer.Option(help="A text file with the PIN for changes; needed if HOST is not this computer.")
    ] = None,
    amber: Annotated[float, typer.Option(help="Percent of the target from which the bar is amber.")] = 75.0,
    green: Annotated[float, typer.Option(help="... green.")] = 95.0,
    red: Annotated[float, typer.Option(help="... red.")] = 110.0,
    check_zero: Annotated[float, typer.Option(help="Remind of the zero after so many minutes; 0: never.")] = 0.0,
    language: Annotated[str, typer.Option(help="For browsers that want none of ours: en or de.")] = "en",
    unit: Unit = "kg",
    terminal: Annotated[bool, typer.Option("--terminal", help="Show it as text here, and serve no page.")] = False,
) -> None:
    """Serve a page for the cab: weight, force, truck, history."""
    from cylforce.programs.display import display, display_in_terminal

    if terminal:
        display_in_terminal(machine, bus, (amber, green, red, check_zero), language, unit)
        return
    marks = (amber, green, red, check_zero)
    display(machine, bus, records, listen, tuple(name or ()), pin_file, marks, language, unit)
