"""Identify the software that runs, by one hash over all its files, and the controller on which it runs."""

import hashlib
from functools import cache
from pathlib import Path

import cylforce

MACHINE_ID = Path("/etc/machine-id")  # of systemd


@cache
def software_sha256() -> str:
    """Return the hash (`files_sha256`) of the package that runs."""
    return files_sha256(Path(cylforce.__file__).parent)


def files_sha256(root: Path) -> str:
    """Return the SHA-256 over the names and bytes of all Python files below a folder, in the order of their names.

    The same files give the same hash on every computer. A file that was changed after installation gives another one.
    """
    whole = hashlib.sha256()
    for path in sorted(root.rglob("*.py"), key=lambda path: path.relative_to(root).as_posix()):
        whole.update(f"{path.relative_to(root).as_posix()}\0{path.stat().st_size}\0".encode())
        whole.update(path.read_bytes())
    return whole.hexdigest()


def controller_id(path: Path = MACHINE_ID) -> str:
    """Return a hash of systemd's machine id, which identifies this controller; "" where there is none.

    The machine id itself must not leave the computer (machine-id(5)).

    path: file with the machine id
    """
    try:
        machine_id = path.read_text().strip()
    except (OSError, ValueError):
        return ""
    return hashlib.sha256(f"cylforce\0{machine_id}".encode()).hexdigest()[:16] if machine_id else ""


def short(sha256: str) -> int:
    """Return the first four bytes of a hash, the form in which the bus carries it; 0 for none."""
    return int(sha256[:8] or "0", 16)
