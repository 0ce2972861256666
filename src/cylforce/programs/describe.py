"""`cylforce describe`: contents of a machine file as tables, a drawing of every pin, EDS and DBC of our node."""

from pathlib import Path
from typing import NamedTuple

from cylforce.canopen.dictionary.dbc import dbc
from cylforce.canopen.dictionary.eds import eds
from cylforce.files.atomic import check_outputs, replacing
from cylforce.mechanics.installation import Service
from cylforce.programs.common.machine_file import load_machine
from cylforce.programs.description.drawing import drawing
from cylforce.programs.description.page import page
from cylforce.programs.description.tables import as_text, tables, warnings
from cylforce.settings.machine_file import Loaded


class DescriptionFiles(NamedTuple):
    """Files to be written; None: not written.

    svg:    drawing
    html:   page with drawing and tables
    eds:    EDS of our node
    dbc:    DBC of our node
    schema: JSON schema
    """

    svg: Path | None = None
    html: Path | None = None
    eds: Path | None = None
    dbc: Path | None = None
    schema: Path | None = None


def run_describe(machine: Path, outputs: DescriptionFiles) -> None:
    """Load a machine file, write the output files, print the tables. Raises SettingsError or RecordingError with a
    sentence.
    """
    check_outputs(outputs, (machine,), (".svg", ".html", ".eds", ".dbc", ".json"))
    loaded = load_machine(machine)
    shown = tables(loaded.service)
    if outputs.svg is not None:
        _write(outputs.svg, drawing(loaded.service.machine))
    if outputs.html is not None:
        _write(outputs.html, page(loaded, shown, (*loaded.warnings, *warnings(loaded.service))))
    if outputs.schema is not None:
        _write(outputs.schema, _schema())
    _write_node(loaded, outputs)
    _show(loaded)
    for table in shown:
        print(f"\n{as_text(table)}")
    for sentence in warnings(loaded.service):
        print(f"\nwarning: {sentence}")


def _write_node(loaded: Loaded, outputs: DescriptionFiles) -> None:
    service = loaded.service
    sync_us = round(1e6 / service.filters.rate_hz) if service.sync_producer else 0
    if outputs.eds is not None:
        _write(outputs.eds, eds(service.publication, round(1e3 * service.heartbeat_s), sync_us))
    if outputs.dbc is not None:
        _write(outputs.dbc, _dbc_of(service))


def _schema() -> str:
    """Return the JSON schema of machine files, for editors."""
    import json

    from cylforce.settings.schema import machine_file_schema

    return json.dumps(machine_file_schema(), indent=2) + "\n"


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


def _show(loaded: Loaded) -> None:
    machine, service = loaded.service.machine, loaded.service
    links = ", ".join(f"{link.name} ({link.mass:.0f} kg)" for link in machine.links)
    print(f"{machine.name}: {links}; rated payload {machine.rated_payload:.0f} kg")
    rows = ", ".join(machine.links[j].name for j in machine.rows)
    print(f"torque is measured at: {rows}; {len(machine.signals)} signals from {len(service.nodes)} nodes")


def _dbc_of(service: Service) -> str:
    heartbeat_ms = round(1e3 * service.heartbeat_s)
    return dbc(service.publication, service.node_id, service.nodes, heartbeat_ms, service.j1939_address)
