"""The command line: one command per program."""

from typing import Annotated

import typer

import cylforce

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False)


def print_version(wanted: bool) -> None:
    """The version on standard output, then the end."""
    if wanted:
        print(f"cylforce {cylforce.__version__}")
        raise typer.Exit


@app.callback()
def cylforce_command(
    version: Annotated[bool, typer.Option("--version", callback=print_version, is_eager=True)] = False,
) -> None:
    """Interaction force and payload weight of a hydraulic machine, over CANopen."""


def main() -> None:
    """Entry point of the ``cylforce`` command."""
    app()
