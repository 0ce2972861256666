"""`cylforce demo`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import Bus, example

EXAMPLE = example("cylforce demo --bus socketcan:vcan0 --cycles 3 --seed 6")


def demo(
    machine: Annotated[
        Path | None, typer.Option(help="The machine file. Without it, the shipped 20 t excavator.")
    ] = None,
    bus: Bus = "virtual:demo",
    clock: Annotated[str, typer.Option(help="Name of this computer's clock; it is only printed and written.")] = "real",
    cycles: Annotated[int, typer.Option(min=1, help="How many digging cycles.")] = 3,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the random numbers. Without it, one is drawn and printed.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--json", help="Write the figures there.")] = None,
    serve: Annotated[bool, typer.Option("--serve", help="End with the page in the cab, until Ctrl-C.")] = False,
    listen: Annotated[str, typer.Option(metavar="HOST:PORT", help="Where --serve serves it.")] = "127.0.0.1:8080",
) -> None:
    """Show the main job on the simulated machine.

    Identification, digging, weighing, comparison with the truth. The bus is one inside this process; `--bus
    remote:127.0.0.1` takes a relay of its own, `--bus socketcan:vcan0` the kernel's virtual bus."""
    from cylforce.files.shipped import shipped
    from cylforce.programs.demo import run_demo

    if not run_demo(
        machine or shipped("excavator_20t.toml"), bus, clock, cycles, seed, output, listen if serve else None
    ):
        raise typer.Exit(1)
