"""`cylforce checkup`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import INTERRUPTED, IdentifiedFile, MachineFile, UsualFile, example

EXAMPLE = example("cylforce checkup machine.toml today.log checkup_1.log --reference in_order.log --still still.log")


def checkup(
    machine: MachineFile,
    recordings: Annotated[
        list[Path] | None, typer.Argument(metavar="RECORDING...", help="Recordings, one step each, as they come.")
    ] = None,
    reference: Annotated[
        list[Path] | None, typer.Option(help="A recording of the machine in order. May be repeated.")
    ] = None,
    identified: IdentifiedFile = None,
    usual: UsualFile = None,
    load: Annotated[
        list[str] | None, typer.Option(metavar="FILE=KG", help="The known load in one recording. May be repeated.")
    ] = None,
    still: Annotated[
        Path | None, typer.Option(help="Ten seconds of the machine without pressure: the zeros of its sensors.")
    ] = None,
    bus: Annotated[
        str | None, typer.Option(metavar="INTERFACE:CHANNEL", help="Guide and record the steps on this bus.")
    ] = None,
    folder: Annotated[Path, typer.Option(help="On the bus: the folder of the recordings.")] = Path("checkup"),
    output: Annotated[Path | None, typer.Option("--json", help="Write the answer there.")] = None,
    next_motion: Annotated[
        Path | None,
        typer.Option(metavar="OUT.csv", help="Write the motion to record next there: joint angles over time."),
    ] = None,
    cache: Annotated[
        bool, typer.Option(help="Keep what was computed of the references in the user's cache folder.")
    ] = True,
) -> None:
    """Find out what is wrong, motion by motion.

    After each recording it shows the most probable causes and what to record next: ten seconds without pressure, two
    minutes of all joints at once, two and a half of single joints in stairs, then only what separates the causes that
    are left. It ends when one cause is certain, when the machine is healthy, or when no motion tells more: then it
    names what to check by hand. Never commands the machine."""
    from rich.console import Console

    from cylforce.files.atomic import RecordingError, check_outputs
    from cylforce.programs.checkup import CheckupOutputs, run_checkup, run_guided
    from cylforce.programs.common.gap_question import Question, known_loads
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.common.statistics_cache import StatisticsCache, cache_folder

    own, references = tuple(recordings or ()), tuple(reference or ())
    if not own and bus is None:
        raise RecordingError("no recording to check: give one or more, or --bus INTERFACE:CHANNEL to record them")
    check_outputs((output, next_motion), (machine, *own, *references, identified, usual, still), (".json", ".csv"))
    question = Question(own, references, identified, known_loads(load or ()), usual=usual, still=still)
    where = cache_folder() if cache else None
    kept, outputs = StatisticsCache(where) if where else None, CheckupOutputs(output, next_motion)
    loaded, console = load_machine(machine), Console(highlight=False)
    if bus is None:
        run_checkup(loaded, question, outputs, console, kept)
    elif not run_guided(loaded, question, bus, folder, outputs, console, kept):
        raise typer.Exit(INTERRUPTED)
