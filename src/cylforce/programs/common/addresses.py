"""Addresses and secrets as they are given on the command line."""

from pathlib import Path

from cylforce.files.atomic import is_large, is_stream

LEAST_CODE, MOST_CODE = 6, 9  # digits


def host_and_port(option: str, address: str) -> tuple[str, int]:
    """Return host and port of HOST:PORT; an IPv6 address is in square brackets.

    Raises ValueError that names the option.
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise ValueError(f"{option} {address}: is no address: write HOST:PORT, e.g. 127.0.0.1:8080")
    return host.strip("[]"), int(port)


def secret_of(option: str, path: Path) -> str:
    """Return the text of a file, without blanks at its ends. Raises ValueError that names the option."""
    if is_stream(path) or is_large(path):
        raise ValueError(f"{option} {path}: is no small text file: write it into one")
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{option} {path}: cannot be read: write it into a text file") from error


def read_code(path: Path) -> int:
    """Return the code that unlocks protected objects. Raises ValueError with a sentence."""
    text = secret_of("--lock-file", path)
    if not (text.isascii() and text.isdecimal() and LEAST_CODE <= len(text) <= MOST_CODE) or int(text) == 0:
        raise ValueError(f"--lock-file {path}: the code must be {LEAST_CODE} to {MOST_CODE} digits, not all of them 0")
    return int(text)
