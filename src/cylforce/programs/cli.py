"""The command line: one command per program."""

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

import cylforce

app = typer.Typer(no_args_is_help=True, pretty_exceptions_enable=False, add_completion=False)

MachineFile = Annotated[Path, typer.Argument(metavar="MACHINE.toml", help="The machine file.")]
Bus = Annotated[str, typer.Option(metavar="INTERFACE:CHANNEL", help="E.g. socketcan:can0, remote:127.0.0.1:PORT.")]
IdentifiedFile = Annotated[
    Path | None, typer.Option("--identified", help="Tares from `cylforce identify`; without, the data sheet's.")
]


INTERRUPTED = 130  # exit code of what Ctrl-C ended


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


@app.command()
def run(
    machine: MachineFile,
    bus: Bus,
    identified: IdentifiedFile = None,
    log: Annotated[Path | None, typer.Option(help="Write the event log (candump text) there.")] = None,
) -> None:
    """Read the sensors, publish payload and force: the service."""
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.run import run_daemon

    run_daemon(load_machine(machine), bus, identified, log)


@app.command()
def identify(
    files: Annotated[list[Path], typer.Argument(metavar="[MACHINE.toml] RECORDING...")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write.")],
    two_steps: Annotated[
        bool, typer.Option(help="Static parameters from slow moves first, then dynamic ones.")
    ] = False,
    enforce: Annotated[bool, typer.Option(help="The nearest physically consistent tares.")] = False,
    lift: Annotated[Path | None, typer.Option(help="A recording of a lift of a known weight: the scale.")] = None,
    known_kg: Annotated[float | None, typer.Option(help="That weight.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write a report there: one HTML file, with figures.")] = None,
    refuse: Annotated[
        bool,
        typer.Option(
            help="Refuse a loaded bucket, contact, dead or misplaced sensors, a wrong bore, a joint that stays "
            "unexplained; --no-refuse writes with a warning."
        ),
    ] = True,
) -> None:
    """Identify the empty machine's dynamic tares; our own logs name their machine file themselves."""
    from cylforce.files.atomic import check_outputs
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.common.progress import progress_bar
    from cylforce.programs.common.readings import machine_file_of, named_segments
    from cylforce.programs.identify import How, run_identify, show
    from cylforce.programs.reports.report import check_extra, write_report

    if report is not None:
        check_extra()
    machine, recordings = machine_file_of(files)
    check_outputs((output, report), (machine, *recordings, lift))
    loaded = load_machine(machine)
    with progress_bar() as watch:
        found = run_identify(loaded, recordings, output, How(two_steps, enforce, lift, known_kg, refuse), watch)
        if report is not None:
            write_report(report, found, named_segments(loaded, recordings, watch), output, watch)
    show(found, Console())


@app.command()
def commission(
    machine: MachineFile,
    bus: Bus,
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write: identified tares.")],
    log: Annotated[Path | None, typer.Option(help="Record there (candump text); without, beside the output.")] = None,
    known_kg: Annotated[float | None, typer.Option(help="A weight that is lifted afterwards: the scale.")] = None,
) -> None:
    """Guide whoever moves the empty machine until its tares can be identified, then identify them."""
    from cylforce.programs.commission import Order, run_commission
    from cylforce.programs.common.machine_file import load_machine

    order = Order(bus, output, log or output.with_suffix(".log"), known_kg)
    if not run_commission(load_machine(machine), order, Console(highlight=False)):
        raise typer.Exit(INTERRUPTED)


@app.command()
def replay(
    machine: MachineFile,
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A log or a table.")],
    identified: IdentifiedFile = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Write the estimates there (CSV, SI).")] = None,
    bus: Annotated[
        str | None, typer.Option(metavar="INTERFACE:CHANNEL", help="Play it onto this bus, as if its sensors sent it.")
    ] = None,
) -> None:
    """Put a recording through the service, or play it onto a bus."""
    from cylforce.files.atomic import check_outputs
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.replay import run_replay, show, write_estimates

    check_outputs((output,), (machine, recording, identified))
    loaded = load_machine(machine)
    if bus is not None:
        from cylforce.programs.live.player import play

        play(loaded, recording, bus)
        return
    found = run_replay(loaded, recording, identified)
    if output is not None:
        write_estimates(output, found.estimates)
    show(found, Console())
    raise typer.Exit(1 if found.different else 0)


@app.command()
def sim(
    machine: MachineFile,
    bus: Annotated[str | None, typer.Option(metavar="INTERFACE:CHANNEL", help="Be the sensors on this bus.")] = None,
    scenario: Annotated[str, typer.Option(help="moves (for commissioning) or cycles (digging).")] = "cycles",
    cycles: Annotated[int, typer.Option(min=1, help="How many digging cycles.")] = 3,
    duration: Annotated[float, typer.Option(help="Of the moves, in seconds.")] = 120.0,
    seed: Annotated[int | None, typer.Option(min=0, help="Without one, one is drawn and printed.")] = None,
    mass_error: Annotated[
        float, typer.Option(help="How far the true masses are off the machine file's, as a fraction.")
    ] = 0.1,
    effects: Annotated[
        Path | None, typer.Option(help="A TOML file of effects, as `cylforce gap --patch` writes it.")
    ] = None,
    payload_kg: Annotated[float, typer.Option(help="In the bucket during the moves.")] = 0.0,
    turning: Annotated[bool, typer.Option(help="The house turns to and fro during the moves.")] = False,
    truth: Annotated[Path | None, typer.Option(help="Write the truth there.")] = None,
    log: Annotated[Path | None, typer.Option(help="Without a bus: write the events there.")] = None,
    table: Annotated[Path | None, typer.Option(help="Without a bus: write the samples there.")] = None,
) -> None:
    """The simulated machine with its sensors."""
    from cylforce.programs.sim import run_sim

    run_sim(
        machine,
        scenario=scenario,
        cycles=cycles,
        duration=duration,
        seed=seed,
        mass_error=mass_error,
        effects=effects,
        payload=payload_kg,
        turning=turning,
        truth=truth,
        bus=bus,
        log=log,
        table=table,
    )


@app.command()
def demo(
    machine: Annotated[Path, typer.Option(help="The machine file.")] = Path("config/excavator_20t.toml"),
    bus: Bus = "remote:127.0.0.1",
    clock: Annotated[str, typer.Option(help="Which clock the bus's machine has: only told.")] = "real",
    cycles: Annotated[int, typer.Option(min=1)] = 3,
    seed: Annotated[int | None, typer.Option(min=0, help="Without one, one is drawn and printed.")] = None,
    output: Annotated[Path | None, typer.Option("--json", help="Write the figures there.")] = None,
) -> None:
    """Show the main job on the simulated machine."""
    from cylforce.programs.demo import run_demo

    if not run_demo(machine, bus, clock, cycles, seed, output):
        raise typer.Exit(1)


@app.command()
def gap(
    machine: MachineFile,
    field: Annotated[list[Path], typer.Argument(metavar="FIELD...", help="Recordings that differ from the model.")],
    reference: Annotated[list[Path] | None, typer.Option(help="A recording of the machine in order.")] = None,
    identified: IdentifiedFile = None,
    load: Annotated[
        list[str] | None, typer.Option(metavar="FILE=KG", help="A recording was made with this known load.")
    ] = None,
    only: Annotated[str | None, typer.Option(metavar="NAME@AT", help="Fit the size of this effect alone.")] = None,
    output: Annotated[Path | None, typer.Option("--json", help="Write the answer there.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write a report there: one HTML file, with figures.")] = None,
    patch: Annotated[Path | None, typer.Option(help="Write the effects found there, for `sim --effects`.")] = None,
    residuals: Annotated[Path | None, typer.Option(help="Write what is left before and after there (npz).")] = None,
) -> None:
    """Say why recordings differ from the model: where, which effect, how far the gap shrinks with it."""
    from cylforce.files.atomic import check_outputs
    from cylforce.programs.common.machine_file import load_machine
    from cylforce.programs.common.progress import progress_bar
    from cylforce.programs.gap import Question, diagnose, known_loads
    from cylforce.programs.gap_output import Outputs, show, write_all
    from cylforce.programs.reports.report import check_extra, gap_report

    if html is not None:
        check_extra()
    check_outputs((output, patch, html, residuals), (machine, *field, *(reference or ()), identified))
    question = Question(tuple(field), tuple(reference or ()), identified, known_loads(load or ()), only)
    loaded = load_machine(machine)
    with progress_bar() as watch:
        found = diagnose(loaded, question, watch=watch)
        report = None if html is None else gap_report(loaded, question, found, watch)
    write_all(found, report, Outputs(output, patch, html, residuals))
    show(found, Console(highlight=False))


@app.command()
def describe(
    machine: MachineFile,
    eds: Annotated[Path | None, typer.Option(help="Write our node's EDS there.")] = None,
    dbc: Annotated[Path | None, typer.Option(help="Write a DBC of all that we publish there.")] = None,
) -> None:
    """Check a machine file; write the EDS and DBC of what the service publishes for it."""
    from cylforce.programs.describe import run_describe

    run_describe(machine, eds, dbc)


def main() -> None:
    """Entry point of the ``cylforce`` command: what users can mend is one sentence, not a traceback."""
    from cylforce.can.bus import BusError
    from cylforce.files.atomic import RecordingError
    from cylforce.settings.machine_file import SettingsError

    try:
        app()
    except (SettingsError, RecordingError, BusError, ValueError, OSError) as error:
        print(f"cylforce: {error}", file=sys.stderr)
        sys.exit(2)
