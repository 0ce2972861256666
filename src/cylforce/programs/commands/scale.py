"""`cylforce scale`."""

from typing import Annotated

import typer

from cylforce.programs.commands.options import Bus, MachineFile, Unit, example

EXAMPLE = example("cylforce scale machine.toml target 12000 --bus socketcan:can0")


def scale(
    machine: MachineFile,
    order: Annotated[
        str,
        typer.Argument(
            help="show, zero, tare, next, part; target, trailer, add MASS; product, cancel, accept N; attachment NAME."
        ),
    ],
    value: Annotated[str | None, typer.Argument(help="What the order needs.")] = None,
    bus: Bus = "socketcan:can0",
    unit: Unit = "kg",
) -> None:
    """Zero, tare, truck: commands to the running service."""
    from cylforce.programs.scale import run_scale
    from cylforce.signals.units import mass_unit

    if not run_scale(machine, bus, order, value, mass_unit(unit)):
        raise typer.Exit(1)
