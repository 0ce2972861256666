"""The running program as a text: what is computed with it may be kept until it changes."""

from functools import cache
from hashlib import sha256
from pathlib import Path

import cylforce
from cylforce.files.logfile import running_versions


@cache
def program(rooms: tuple[str, ...]) -> str:
    """Return the versions of the program and its libraries, and a hash of the code in some rooms."""
    root = Path(cylforce.__file__).parent
    code = b"".join(file_digest(str(path)) for room in rooms for path in sorted((root / room).rglob("*.py")))
    return f"{sorted(running_versions().items())} {sha256(code).hexdigest()}"


@cache
def file_digest(path: str) -> bytes:
    """Return the SHA-256 of a file."""
    return sha256(Path(path).read_bytes()).digest()
