"""Arguments that several commands share, and how their examples are written."""

from pathlib import Path
from typing import Annotated

import typer

MachineFile = Annotated[Path, typer.Argument(metavar="MACHINE.toml", help="The machine file.")]
Bus = Annotated[
    str, typer.Option(metavar="INTERFACE:CHANNEL", help="For example socketcan:can0 or remote:127.0.0.1:PORT.")
]
IdentifiedFile = Annotated[
    Path | None,
    typer.Option("--identified", help="Tares from `cylforce identify`. Without it, the data sheet's values count."),
]
UsualFile = Annotated[
    Path | None,
    typer.Option("--usual", help="What is usual for the type, from `cylforce fleet`, in place of what is stated."),
]
References = Annotated[
    list[Path] | None, typer.Option("--reference", help="A recording of the machine in order. May be repeated.")
]
KnownLoads = Annotated[
    list[str] | None,
    typer.Option("--load", metavar="FILE=KG", help="The known load in one recording. May be repeated."),
]
NextMotion = Annotated[
    Path | None,
    typer.Option(
        "--next-motion",
        metavar="OUT.csv",
        help="Write the motion to record next there: joint angles over time.",
    ),
]
KeepStatistics = Annotated[
    bool,
    typer.Option("--cache/--no-cache", help="Keep what was computed of the references in the user's cache folder."),
]
Answer = Annotated[Path | None, typer.Option("--json", help="Write the answer there.")]
Unit = Annotated[str, typer.Option(help="Unit of the masses: kg, t, lb or short-ton (2000 lb).")]
INTERRUPTED = 130  # exit code of a command that Ctrl-C ended


def example(line: str) -> str:
    """The last line of a command's help. Read back by the tests, which check that the command accepts it."""
    return f"Example: {line}"
