"""`cylforce fleet`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import example

EXAMPLE = example("cylforce fleet recordings/ -o results.parquet --usual usual.toml --report fleet.html")


def fleet(
    recordings: Annotated[
        list[str],
        typer.Argument(
            metavar="RECORDINGS...", help="Folders or addresses of a store (s3://...) with MACHINE/DATE recordings."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="The table to write (Parquet).")],
    report: Annotated[
        Path | None, typer.Option(help="Write the fleet's page there (HTML), machines beside it.")
    ] = None,
    usual: Annotated[Path | None, typer.Option(help="Write there what is usual for each type (TOML).")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Use this Dask cluster instead of local processes.")
    ] = None,
    workers: Annotated[int, typer.Option(min=0, help="Local processes. 0: work in this one.")] = 2,
    weights: Annotated[bool, typer.Option(help="Book the weights of recordings at work.")] = True,
    cache: Annotated[
        Path | None, typer.Option(help="Where results are kept for the next run; by default the user's cache folder.")
    ] = None,
) -> None:
    """Say which machines of a fleet changed, and what is usual.

    The machine file of a type, machine.toml, is in the folder above its machines', or in each machine's own.
    A second run does only what is new."""
    from rich.console import Console

    from cylforce.files.atomic import RecordingError, check_outputs
    from cylforce.programs.common.progress import progress_bar
    from cylforce.programs.fleet.store import check_fleet_extra

    check_fleet_extra()
    if report is not None:
        from cylforce.programs.reports.report import check_extra  # imports the whole diagnosis

        check_extra()
    if output.suffix.lower() != ".parquet":
        raise RecordingError(f"{output}: the table must end in .parquet: by that ending other programs know its format")
    check_outputs((output, usual, report), (), (".parquet", ".toml", ".html"))
    from cylforce.programs.fleet.kept import fleet_cache_folder
    from cylforce.programs.fleet.run import Wanted, run_fleet, show_fleet
    from cylforce.programs.fleet.workers import Where

    wanted = Wanted(tuple(recordings), output, usual, report, cache or fleet_cache_folder(), weights)
    console = Console(highlight=False)
    with progress_bar() as watch:
        result = run_fleet(wanted, Where(scheduler, workers), watch, console.print)
    show_fleet(result, wanted, console)
