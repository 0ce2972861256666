"""`cylforce seal`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import MachineFile, example

EXAMPLE = example('cylforce seal machine.toml identified.toml --reason "scale corrected after test weight 12"')


def seal(
    machine: MachineFile,
    identified: Annotated[Path, typer.Argument(metavar="IDENTIFIED.toml", help="The file that was changed.")],
    reason: Annotated[str, typer.Option(help="Why; it stays in the file and in the audit trail.")],
) -> None:
    """Accept an identified.toml that was changed by hand."""
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.identify import run_seal

    run_seal(load_machine(machine), identified, reason)
