"""The files that are shipped with the program: machine files, EDS and DBC of our node, systemd unit, network files.

In the repository they are in `config/` and `systemd/`, in an installed package in `cylforce/shipped/`.
"""

from pathlib import Path

FOLDERS = ("config", "systemd")
# Endings of shipped files; pages and drawings stay in the repository.
SUFFIXES = (".toml", ".json", ".eds", ".dbc", ".xml", ".service", ".network", ".link")
_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_files() -> dict[str, Path]:
    """Return all shipped files by name, machine files first."""
    folders = [_folder(name) for name in FOLDERS]
    files = sorted((path for folder in folders for path in folder.iterdir() if path.suffix in SUFFIXES), key=_place)
    return {path.name: path for path in files}


def shipped(name: str) -> Path:
    """Return the path of one shipped file. Raises ValueError, in a sentence with all names, when there is none of that
    name.
    """
    files = shipped_files()
    if name not in files:
        raise ValueError(f"{name!r} is not shipped with cylforce: choose one of {', '.join(files)}")
    return files[name]


def _folder(name: str) -> Path:
    """Return the installed folder, or the repository's when the program runs from its sources."""
    installed = _PACKAGE / "shipped" / name
    return installed if installed.is_dir() else _PACKAGE.parents[1] / name


def _place(path: Path) -> tuple[bool, str]:
    """Return the key by which files are sorted: machine files first, then by name."""
    return path.suffix != ".toml", path.name
