"""The command line: one command per program."""

import sys
from typing import Annotated

import typer
from typer.core import TyperGroup

import cylforce
from cylforce.programs.commands import (
    checkup,
    commission,
    config,
    demo,
    describe,
    display,
    fleet,
    gap,
    identify,
    new,
    records,
    replay,
    run,
    scale,
    sim,
)
from cylforce.programs.commands.options import INTERRUPTED


class _Commands(TyperGroup):
    """The commands. One that Ctrl-C ends says so and leaves nothing unfinished behind: files are replaced whole."""

    def invoke(self, ctx: typer.Context) -> object:  # type: ignore[override]  # the base class is private
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as error:
            print("cylforce: stopped; no unfinished file was written", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from error


app = typer.Typer(
    cls=_Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # help is text: square brackets in it mean what can be left out
    context_settings={"help_option_names": ["-h", "--help"]},
)


def print_version(wanted: bool) -> None:
    """The version on standard output, then the end."""
    if wanted:
        print(f"cylforce {cylforce.__version__}")
        raise typer.Exit


@app.callback()
def cylforce_command(
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Interaction force and payload weight of a hydraulic machine, over CANopen."""


# In the order of a user's day, which is the order in `cylforce --help`.
app.command(epilog=new.EXAMPLE)(new.new)
app.command(epilog=describe.EXAMPLE)(describe.describe)
app.command(epilog=commission.EXAMPLE)(commission.commission)
app.command(epilog=identify.EXAMPLE)(identify.identify)
app.command(epilog=identify.SEAL_EXAMPLE)(identify.seal)
app.command(epilog=run.EXAMPLE)(run.run)
app.command(epilog=display.EXAMPLE)(display.display)
app.command(epilog=scale.EXAMPLE)(scale.scale)
app.command(epilog=replay.EXAMPLE)(replay.replay)
app.command(epilog=gap.EXAMPLE)(gap.gap)
app.command(epilog=checkup.EXAMPLE)(checkup.checkup)
app.command(epilog=fleet.EXAMPLE)(fleet.fleet)
app.command(epilog=sim.EXAMPLE)(sim.sim)
app.command(epilog=demo.EXAMPLE)(demo.demo)

booked = typer.Typer(no_args_is_help=True, help="What was booked: lists, totals, tickets, exports.")
booked.command("list", epilog=records.LIST_EXAMPLE)(records.list_)
booked.command("totals", epilog=records.TOTALS_EXAMPLE)(records.totals)
booked.command("ticket", epilog=records.TICKET_EXAMPLE)(records.ticket)
booked.command("label", epilog=records.LABEL_EXAMPLE)(records.label)
booked.command("export", epilog=records.EXPORT_EXAMPLE)(records.export)
booked.command("telematics", epilog=records.TELEMATICS_EXAMPLE)(records.telematics)
booked.command("audit", epilog=records.AUDIT_EXAMPLE)(records.audit)
booked.command("mqtt", epilog=records.MQTT_EXAMPLE)(records.mqtt)
app.add_typer(booked, name="records")

configs = typer.Typer(no_args_is_help=True, help="List or copy machine files and others that are shipped.")
configs.command("list", epilog=config.LIST_EXAMPLE)(config.list_)
configs.command("copy", epilog=config.COPY_EXAMPLE)(config.copy)
app.add_typer(configs, name="config")


def user_errors() -> tuple[type[Exception], ...]:
    """Errors that a user can correct. Their modules are loaded when there is an error, not before."""
    from cylforce.can.bus import BusError
    from cylforce.files.atomic import RecordingError
    from cylforce.settings.error import SettingsError

    return SettingsError, RecordingError, BusError, ValueError, OSError


def main() -> None:
    """Entry point of the ``cylforce`` command: an error that a user can correct is one sentence, not a traceback."""
    try:
        app(prog_name="cylforce")  # also where it runs as `python -m cylforce`
    except SystemExit:  # the ordinary end, without loading what only errors need
        raise
    except user_errors() as error:
        print(f"cylforce: {error}", file=sys.stderr)
        sys.exit(2)
