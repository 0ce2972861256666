"""`cylforce replay`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import IdentifiedFile, MachineFile, example

EXAMPLE = example("cylforce replay machine.toml events.log --identified identified.toml -o estimates.csv")


def replay(
    machine: MachineFile,
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A log or a table.")],
    identified: IdentifiedFile = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write the estimates there (CSV, SI).")] = None,
    bus: Annotated[
        str | None, typer.Option(metavar="INTERFACE:CHANNEL", help="Play it onto this bus, as if its sensors sent it.")
    ] = None,
) -> None:
    """Put a recording through the service, or play it onto a bus."""
    from rich.console import Console

    from cylforce.files.atomic import check_outputs
    from cylforce.files.logreader import log_header
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.common.readings import check_machine
    from cylforce.programs.replay import run_replay, show, write_estimates

    check_outputs((output,), (machine, recording, identified), (".csv",))
    loaded = load_machine(machine)
    check_machine(recording, log_header(recording), loaded)
    if bus is not None:
        from cylforce.programs.live.player import play

        play(loaded, recording, bus)
        return
    found = run_replay(loaded, recording, identified)
    if output is not None:
        write_estimates(output, found.estimates)
    show(found, loaded.service.machine.rated_payload, Console())
    raise typer.Exit(1 if found.different else 0)
