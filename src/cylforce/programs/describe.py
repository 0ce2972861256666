"""`cylforce describe`: what a machine file says, checked; the EDS and DBC of what the service publishes for it."""

from pathlib import Path

from rich.console import Console

from cylforce.canopen.dictionary.dbc import dbc
from cylforce.canopen.dictionary.eds import eds
from cylforce.files.atomic import check_outputs, replacing
from cylforce.programs.common.machine_file import load_machine
from cylforce.settings.machine_file import Loaded


def run_describe(machine: Path, eds_file: Path | None, dbc_file: Path | None) -> None:
    """Load, write what is asked for, tell. Raises SettingsError or RecordingError with a sentence."""
    check_outputs((eds_file, dbc_file), (machine,))
    loaded = load_machine(machine)
    service = loaded.service
    sync_us = round(1e6 / service.filters.rate_hz) if service.sync_producer else 0
    if eds_file is not None:
        _write(eds_file, eds(service.publication, round(1e3 * service.heartbeat_s), sync_us))
    if dbc_file is not None:
        _write(dbc_file, dbc(service.publication, service.node_id))
    _tell(loaded, Console(highlight=False))


def _write(path: Path, text: str) -> None:
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


def _tell(loaded: Loaded, console: Console) -> None:
    machine, service = loaded.service.machine, loaded.service
    links = ", ".join(f"{link.name} ({link.mass:.0f} kg)" for link in machine.links)
    console.print(f"{machine.name}: {links}; rated payload {machine.rated_payload:.0f} kg")
    rows = ", ".join(machine.links[j].name for j in machine.rows)
    console.print(f"torque is measured at: {rows}; {len(machine.signals)} signals from {len(service.nodes)} nodes")
    for pdo in service.publication:
        names = ", ".join(str(field.signal) for field in pdo.fields)
        console.print(f"TPDO {pdo.number}, {pdo.can_id:03X}h: {names}")
