"""`cylforce records`."""

from pathlib import Path
from typing import Annotated

import typer

from cylforce.programs.commands.options import Unit, example

LIST_EXAMPLE = example("cylforce records list records.db --last 20")
TOTALS_EXAMPLE = example("cylforce records totals records.db --which shift")
EXPORT_EXAMPLE = example("cylforce records export records.db -o bookings.csv")
TELEMATICS_EXAMPLE = example("cylforce records telematics records.db")
TICKET_EXAMPLE = example("cylforce records ticket records.db")
LABEL_EXAMPLE = example("cylforce records label records.db --product 1 --name gravel")

AUDIT_EXAMPLE = example("cylforce records audit records.db --last 20")
MQTT_EXAMPLE = example("cylforce records mqtt records.db --broker broker.example:1883 --topic cylforce/machine7")

File = Annotated[Path, typer.Argument(metavar="RECORDS.db", help="What `cylforce run --records` writes.")]
Since = Annotated[str, typer.Option(metavar="TIME", help="Only from this time on, e.g. 2026-03-31T06:00 (UTC).")]
Truck = Annotated[int | None, typer.Option(help="Number of the truck.")]


def list_(
    records: File,
    since: Since = "",
    truck: Truck = None,
    last: Annotated[int, typer.Option(min=1, help="How many.")] = 50,
    unit: Unit = "kg",
) -> None:
    """List bookings, the last ones or those of a truck."""
    from cylforce.programs.records import list_bookings
    from cylforce.signals.units import mass_unit

    list_bookings(records, since, truck, last, mass_unit(unit))


def totals(
    records: File,
    which: Annotated[str, typer.Option(help="short, shift or grand.")] = "grand",
    zero: Annotated[bool, typer.Option("--zero", help="Afterwards it begins anew (short and shift).")] = False,
    unit: Unit = "kg",
) -> None:
    """Loads and mass per product."""
    from cylforce.files.atomic import RecordingError
    from cylforce.programs.records import show_totals
    from cylforce.signals.units import mass_unit

    if which not in ("short", "shift", "grand"):
        raise RecordingError(f"--which {which}: is no total: use short, shift or grand")
    show_totals(records, which, zero, mass_unit(unit))


def export(
    records: File,
    output: Annotated[Path, typer.Option("-o", "--output", help="A .csv, .json or .parquet file.")],
    since: Since = "",
) -> None:
    """Write the bookings as CSV, JSON or Parquet."""
    from cylforce.programs.records import export_bookings

    export_bookings(records, output, since)


def telematics(records: File) -> None:
    """The payload figures of ISO 15143-3: all that was ever loaded, in how many loads."""
    from cylforce.programs.records import show_telematics

    show_telematics(records)


def ticket(records: File, truck: Truck = None, unit: Unit = "kg") -> None:
    """Print a truck's ticket, the last truck's where none is named; again: a copy."""
    from cylforce.programs.records import print_ticket
    from cylforce.signals.units import mass_unit

    print_ticket(records, truck, mass_unit(unit))


def label(
    records: File,
    truck: Truck = None,
    customer: Annotated[str | None, typer.Option(help="Who gets the load.")] = None,
    job: Annotated[str | None, typer.Option(help="Job or site.")] = None,
    operator: Annotated[str | None, typer.Option(help="Who loaded.")] = None,
    note: Annotated[str | None, typer.Option(help="Anything else.")] = None,
    product: Annotated[int | None, typer.Option(min=1, help="Number of the product that --name names.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the product.")] = None,
) -> None:
    """Say whose truck it is, or what a product is called."""
    from cylforce.files.atomic import RecordingError
    from cylforce.programs.records import given, label

    if (product is None) is not (name is None):
        raise RecordingError("--product and --name belong together: give both")
    named = None if product is None or name is None else (product, name)
    label(records, truck, given(customer=customer, job=job, operator=operator, note=note), named)


def audit(
    records: File,
    last: Annotated[int, typer.Option(min=0, help="Only so many, the latest; 0: all.")] = 0,
) -> None:
    """Who changed what and when; fails if the chain of entries is broken."""
    from cylforce.programs.records import show_audit

    if not show_audit(records, last):
        raise typer.Exit(1)


def mqtt(
    records: File,
    broker: Annotated[str, typer.Option(metavar="HOST:PORT", help="The MQTT broker.")],
    topic: Annotated[str, typer.Option(help="First part of all topics.")] = "cylforce",
    user: Annotated[str, typer.Option(help="User name at the broker.")] = "",
    password_file: Annotated[Path | None, typer.Option(help="A text file with the password.")] = None,
    tls: Annotated[bool, typer.Option("--tls", help="Encrypt, and check the broker's certificate.")] = False,
) -> None:
    """Pass bookings on to an MQTT broker, until Ctrl-C; what it has not confirmed waits."""
    from cylforce.programs.common.addresses import host_and_port, secret_of
    from cylforce.programs.live.mqtt import Broker, run_mqtt

    host, port = host_and_port("--broker", broker)
    password = secret_of("--password-file", password_file) if password_file else ""
    run_mqtt(records, Broker(host, port, topic.strip("/"), user, password, tls))
