"""Which software runs: one hash over all its files; and on which controller."""

import hashlib
from functools import cache
from pathlib import Path

import cylforce

MACHINE_ID = Path("/etc/machine-id")


@cache
def software_sha256() -> str:
    """SHA-256 over the names and bytes of all Python files of the package, in the order of their names. The same files
    give the same hash on every computer; a file that was changed after installation gives another."""
    root = Path(cylforce.__file__).parent
    whole = hashlib.sha256()
    for path in sorted(root.rglob("*.py"), key=lambda path: path.relative_to(root).as_posix()):
        whole.update(f"{path.relative_to(root).as_posix()}\0{path.stat().st_size}\0".encode())
        whole.update(path.read_bytes())
    return whole.hexdigest()


def controller_id() -> str:
    """What tells this controller from others: a hash of systemd's machine id, which itself is not to be passed on
    (machine-id(5)). Empty where there is none."""
    try:
        said = MACHINE_ID.read_text().strip()
    except (OSError, ValueError):
        return ""
    return hashlib.sha256(f"cylforce\0{said}".encode()).hexdigest()[:16] if said else ""


def short(sha256: str) -> int:
    """The first four bytes of a hash, as it is said on the bus; 0 for none."""
    return int(sha256[:8] or "0", 16)
