"""`cylforce replay`."""

from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cylforce.programs.commands.options import IdentifiedFile, MachineFile, example

if TYPE_CHECKING:  # the command line starts faster without
    from cylforce.signals.estimate import Estimate

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
    from cylforce.programs.replay import Totals, estimates_table, show, stream_replay

    check_outputs((output,), (machine, recording, identified), (".csv",))
    loaded = load_machine(machine)
    check_machine(recording, log_header(recording), loaded)
    if bus is not None:
        from cylforce.programs.live.player import play

        play(loaded, recording, bus)
        return
    tally = Totals(loaded.service.machine.rated_payload)
    with nullcontext() if output is None else estimates_table(output) as write:

        def take(estimate: "Estimate") -> None:
            tally.take(estimate)
            if write is not None:
                write(estimate)

        found = stream_replay(loaded, recording, identified, take)
    show(found, tally, Console())
    raise typer.Exit(1 if found.different else 0)
