"""`cylforce run`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import Bus, IdentifiedFile, MachineFile, example

EXAMPLE = example(
    "cylforce run machine.toml --bus socketcan:can0 --identified identified.toml --records records.db --log events.log"
)


def run(
    machine: MachineFile,
    bus: Bus,
    identified: IdentifiedFile = None,
    log: Annotated[Path | None, typer.Option(help="Write the event log there (candump text).")] = None,
    log_size: Annotated[
        float,
        typer.Option(metavar="MB", help="Begin a new log file at this size, 1 to 100000; 100 MB are half an hour."),
    ] = 100.0,
    records: Annotated[
        Path | None, typer.Option(help="Keep bookings, zero, tare and the open truck there (SQLite).")
    ] = None,
    lock_file: Annotated[
        Path | None, typer.Option(help="File with the code (6 to 9 digits) that unlocks protected objects over SDO.")
    ] = None,
    log_keep: Annotated[int, typer.Option(min=0, help="How many older files to keep, FILE.NUMBER.log.")] = 9,
) -> None:
    """Read the sensors, publish payload and force: the service."""
    from cylforce.files.atomic import RecordingError
    from cylforce.files.rotation import Rotation
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.run import run_daemon

    if not 1.0 <= log_size <= 100_000.0:
        raise RecordingError(f"--log-size {log_size:g}: is no size of a log: give 1 to 100000 MB")
    run_daemon(
        load_machine(machine), bus, identified, log, Rotation(round(1e6 * log_size), log_keep), records, lock_file
    )
