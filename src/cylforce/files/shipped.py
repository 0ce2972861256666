"""The files that are shipped with the program: machine files, EDS and DBC of our node, systemd unit, network files.

In the repository they are in `config/` and `systemd/`, in an installed package in `cylforce/shipped/`."""

from pathlib import Path

FOLDERS = ("config", "systemd")
SUFFIXES = (
    ".toml",
    ".json",
    ".eds",
    ".dbc",
    ".xml",
    ".service",
    ".network",
    ".link",
)  # not pages and drawings of the repository
_PACKAGE = Path(__file__).resolve().parents[1]


def shipped_files() -> dict[str, Path]:
    """All shipped files by name, machine files first."""
    folders = [_folder(name) for name in FOLDERS]
    files = sorted((path for folder in folders for path in folder.iterdir() if path.suffix in SUFFIXES), key=_place)
    return {path.name: path for path in files}


def shipped(name: str) -> Path:
    """Path of one shipped file. Raises ValueError, in a sentence with all names, when there is none of that name."""
    files = shipped_files()
    if name not in files:
        raise ValueError(f"{name!r} is not shipped with cylforce: choose one of {', '.join(files)}")
    return files[name]


def _folder(name: str) -> Path:
    """The installed folder, or the repository's when the program runs from its sources."""
    installed = _PACKAGE / "shipped" / name
    return installed if installed.is_dir() else _PACKAGE.parents[1] / name


def _place(path: Path) -> tuple[bool, str]:
    return path.suffix != ".toml", path.name
