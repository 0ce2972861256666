"""`cylforce config`: list and copy the files that are shipped with the program."""

import tomllib
from pathlib import Path

from cylforce.files.atomic import RecordingError
from cylforce.files.shipped import shipped, shipped_files

KINDS = {
    ".dbc": "what the service publishes, for CAN tools",
    ".eds": "what the service publishes, for CANopen tools",
    ".json": "JSON schema of the machine file, for editors",
    ".link": "systemd-networkd: transmit queue of can0",
    ".network": "systemd-networkd: bit rate of can0",
    ".xml": "PlotJuggler layout for the tables of `cylforce replay -o`",
    ".service": "systemd unit of the service",
}


def show_shipped() -> None:
    """Print one line for each file: its name and its kind."""
    files = shipped_files()
    width = max(len(name) for name in files)
    for name, path in files.items():
        print(f"{name:{width}}  {_kind(path)}")


def _kind(path: Path) -> str:
    if path.suffix != ".toml":
        return KINDS.get(path.suffix, "")
    return f"machine file: {tomllib.loads(path.read_text(encoding='utf-8'))['machine']['name']}"


def copy_shipped(name: str, folder: Path) -> Path:
    """Copy a shipped file into a folder; returns the copy. Raises RecordingError with a sentence."""
    source, target = shipped(name), folder / name
    if not folder.is_dir():
        raise RecordingError(f"{folder}: is not a folder: make it first, or choose another with -o")
    try:
        with target.open("xb") as file:
            file.write(source.read_bytes())
    except FileExistsError:
        raise RecordingError(f"{target}: exists and is not replaced: choose another folder with -o") from None
    except OSError as error:
        raise RecordingError(f"{target}: cannot be written: {error.strerror or error}") from error
    print(target)
    return target
