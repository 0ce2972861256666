"""`cylforce sim`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import MachineFile, example

EXAMPLE = example("cylforce sim machine.toml --scenario moves --duration 120 --seed 1 --log empty.log")


def sim(
    machine: MachineFile,
    bus: Annotated[str | None, typer.Option(metavar="INTERFACE:CHANNEL", help="Be the sensors on this bus.")] = None,
    scenario: Annotated[str, typer.Option(help="moves (for commissioning) or cycles (digging).")] = "cycles",
    cycles: Annotated[int, typer.Option(min=1, help="How many digging cycles.")] = 3,
    duration: Annotated[float, typer.Option(help="Length of the moves, in seconds.")] = 120.0,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the random numbers. Without it, one is drawn and printed.")
    ] = None,
    mass_error: Annotated[
        float, typer.Option(help="How far the true masses are off the machine file's, as a fraction.")
    ] = 0.1,
    effects: Annotated[
        Path | None, typer.Option(help="A TOML file of effects, as `cylforce gap --patch` writes it.")
    ] = None,
    library: Annotated[
        Path | None, typer.Option(metavar="FILE.py", help="Effects of your own, in Python, for --effects.")
    ] = None,
    motion: Annotated[
        Path | None,
        typer.Option(metavar="FILE.csv", help="Play this motion, as `cylforce gap --next-motion` writes it."),
    ] = None,
    payload_kg: Annotated[float, typer.Option(help="Load in the bucket during the moves.")] = 0.0,
    turning: Annotated[bool, typer.Option(help="The house turns to and fro during the moves.")] = False,
    attachment: Annotated[str, typer.Option(help="The tool on the machine.")] = "standard",
    truth: Annotated[Path | None, typer.Option(help="Write what is true of the simulated machine there (CSV).")] = None,
    log: Annotated[Path | None, typer.Option(help="Without a bus: write the events there.")] = None,
    table: Annotated[Path | None, typer.Option(help="Without a bus: write the samples there.")] = None,
) -> None:
    """Simulate the machine with its sensors, into files or on a bus."""
    from cylforce.programs.sim import run_sim

    run_sim(
        machine,
        scenario=scenario,
        cycles=cycles,
        duration=duration,
        seed=seed,
        mass_error=mass_error,
        effects=effects,
        library=library,
        motion=motion,
        payload=payload_kg,
        turning=turning,
        attachment=attachment,
        truth=truth,
        bus=bus,
        log=log,
        table=table,
    )
