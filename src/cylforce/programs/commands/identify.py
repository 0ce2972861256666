"""`cylforce identify`, and `cylforce seal` for the file that it writes."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import MachineFile, UsualFile, example

EXAMPLE = example("cylforce identify machine.toml empty.log -o identified.toml --report report.html")
SEAL_EXAMPLE = example('cylforce seal machine.toml identified.toml --reason "scale corrected after test weight 12"')


def identify(
    files: Annotated[list[Path], typer.Argument(metavar="[MACHINE.toml] RECORDING...")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write.")],
    two_steps: Annotated[
        bool, typer.Option(help="Identify static parameters from slow moves first, then dynamic ones.")
    ] = False,
    enforce: Annotated[bool, typer.Option(help="Find the nearest physically possible tares.")] = False,
    lift: Annotated[Path | None, typer.Option(help="A recording of a lift of a known weight, for the scale.")] = None,
    known_kg: Annotated[float | None, typer.Option(help="The known weight.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report there: one HTML file, with figures.")] = None,
    attachment: Annotated[
        str,
        typer.Option(help="The tool on the machine: its tares are added to the file."),
    ] = "standard",
    usual: UsualFile = None,
    statistics: Annotated[
        bool, typer.Option(help="Also write what `gap --identified` compares with: OUTPUT.statistics.npz.")
    ] = True,
    refuse: Annotated[
        bool,
        typer.Option(
            help="Refuse a loaded bucket, contact, dead or misplaced sensors, a wrong bore, a joint that stays "
            "unexplained; --no-refuse writes with a warning."
        ),
    ] = True,
) -> None:
    """Identify the empty machine's tares: weight, inertia, friction.

    Needs recordings of the empty machine, every joint both ways, slowly and fast.
    A log of cylforce names its machine file itself; for other recordings name it first."""
    from rich.console import Console

    from cylforce.files.atomic import RecordingError, check_outputs, warn
    from cylforce.mechanics.installation import STANDARD
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.common.machine_statistics import statistics_path
    from cylforce.programs.common.progress import progress_bar
    from cylforce.programs.common.readings import machine_file_of, named_segments
    from cylforce.programs.identify import How, run_identify, run_statistics, show
    from cylforce.programs.reports.report import check_extra, write_report

    if report is not None:
        check_extra()
    machine, recordings = machine_file_of(files)
    learn = statistics and attachment == STANDARD  # with another tool on, the arm is not that of the file
    beside = statistics_path(output) if learn else None
    check_outputs((output, report, beside), (machine, *recordings, lift, usual), (".toml", ".html", ".npz"))
    loaded = load_machine(machine)
    with progress_bar() as watch:
        how = How(two_steps, enforce, lift, known_kg, refuse, attachment, usual)
        found = run_identify(loaded, recordings, output, how, watch)
        if learn:
            try:
                run_statistics(loaded, recordings, output, how, watch)
            except (RecordingError, ValueError) as error:
                warn(str(error))
        if report is not None:
            again = named_segments(loaded, recordings, watch, lambda _: None)  # run_identify has reported on them
            write_report(report, found, again, output, watch)
    show(found, Console())


def seal(
    machine: MachineFile,
    identified: Annotated[Path, typer.Argument(metavar="IDENTIFIED.toml", help="The file that was changed.")],
    reason: Annotated[str, typer.Option(help="Why; it stays in the file and in the audit trail.")],
) -> None:
    """Accept an identified.toml that was changed by hand."""
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.identify import run_seal

    run_seal(load_machine(machine), identified, reason)
