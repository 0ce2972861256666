"""`cylforce config`: the files that are shipped with the program."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.files.shipped import shipped_files
from cylforce.programs.commands.options import example

LIST_EXAMPLE = example("cylforce config list")
COPY_EXAMPLE = example("cylforce config copy excavator_20t.toml -o .")


def _names(incomplete: str) -> list[str]:
    """What the shell may complete a name to."""
    return [name for name in shipped_files() if name.startswith(incomplete)]


def list_() -> None:
    """List the shipped files."""
    from cylforce.programs.config import show_shipped

    show_shipped()


def copy(
    name: Annotated[str, typer.Argument(metavar="NAME", help="As `config list` shows it.", autocompletion=_names)],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FOLDER", help="The folder to copy to.")] = Path(),
) -> None:
    """Copy a shipped file. A file that is there already is not replaced."""
    from cylforce.programs.config import copy_shipped

    copy_shipped(name, output)
