"""`cylforce gap`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import (
    Answer,
    IdentifiedFile,
    KeepStatistics,
    KnownLoads,
    MachineFile,
    NextMotion,
    References,
    UsualFile,
    example,
)

EXAMPLE = example("cylforce gap machine.toml today.log --reference in_order.log --html gap.html --patch gap.toml")


def gap(
    machine: MachineFile,
    field: Annotated[list[Path], typer.Argument(metavar="FIELD...", help="Recordings that differ from the model.")],
    reference: References = None,
    simulation: Annotated[
        list[Path] | None, typer.Option(help="A recording of your own simulation of it. May be repeated.")
    ] = None,
    identified: IdentifiedFile = None,
    load: KnownLoads = None,
    only: Annotated[str | None, typer.Option(metavar="NAME@AT", help="Fit the size of this effect alone.")] = None,
    without: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Leave this effect out of the library. May be repeated.")
    ] = None,
    library: Annotated[
        Path | None, typer.Option(metavar="FILE.py", help="Effects of your own, one class each.")
    ] = None,
    usual: UsualFile = None,
    output: Answer = None,
    html: Annotated[Path | None, typer.Option(help="Write a report there: one HTML file, with figures.")] = None,
    patch: Annotated[Path | None, typer.Option(help="Write the effects found there, for `sim --effects`.")] = None,
    residuals: Annotated[
        Path | None, typer.Option(help="Write the unexplained torques before and after there (npz).")
    ] = None,
    next_motion: NextMotion = None,
    cache: KeepStatistics = True,
) -> None:
    """Say why recordings differ from the model.

    Names the joint, the effect, its size, and how far the gap shrinks once it is simulated."""
    from rich.console import Console

    from cylforce.effects.library import LIBRARY
    from cylforce.files.atomic import check_outputs
    from cylforce.programs.common.gap_question import Question, known_loads
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.common.processes import map_in_processes
    from cylforce.programs.common.progress import progress_bar
    from cylforce.programs.common.statistics_cache import StatisticsCache, cache_folder
    from cylforce.programs.common.user_library import load_library
    from cylforce.programs.gap import STEPS, diagnose
    from cylforce.programs.gap_output import Outputs, show, write_all, write_next_motion
    from cylforce.programs.reports.report import check_extra, gap_report

    if html is not None:
        check_extra()
    healthy = tuple(reference or ()), tuple(simulation or ())
    inputs = (machine, *field, *healthy[0], *healthy[1], identified, usual, library)
    outputs = (output, patch, html, residuals, next_motion)
    check_outputs(outputs, inputs, (".json", ".toml", ".html", ".npz", ".csv"))
    loads = known_loads(load or ())
    question = Question(tuple(field), healthy[0], identified, loads, only, tuple(without or ()), usual, healthy[1])
    loaded, folder = load_machine(machine), cache_folder() if cache else None
    own = () if library is None else load_library(library, loaded.service.machine)
    kept = StatisticsCache(folder) if folder else None
    with progress_bar(len(question.field) + len(question.healthy) + STEPS + (html is not None)) as watch:
        found = diagnose(loaded, question, (*LIBRARY, *own), watch=watch, cache=kept, parallel_map=map_in_processes)
        report = None if html is None else gap_report(loaded, question, found, watch)
    write_all(found, report, Outputs(output, patch, html, residuals))
    show(found, loaded.service.machine, Console(highlight=False))
    if next_motion is not None:  # last: where no motion helps, the answer stands above that sentence
        write_next_motion(next_motion, found, loaded.service.machine)
