"""Addresses and secrets as they are given on the command line."""

from pathlib import Path

from cylforce.files.atomic import is_large, is_stream


def host_and_port(option: str, address: str) -> tuple[str, int]:
    """Of HOST:PORT; an IPv6 address stands in square brackets. Raises ValueError that names the option."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(f"{option} {address}: is no address: write HOST:PORT, e.g. 127.0.0.1:8080")
    return host.strip("[]"), int(port)


def secret_of(option: str, path: Path) -> str:
    """The text of a file, without blanks at its ends. Raises ValueError that names the option."""
    if is_stream(path) or is_large(path):
        raise ValueError(f"{option} {path}: is no small text file: write it into one")
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{option} {path}: cannot be read: write it into a text file") from error
