"""A program's machine file: read, and what is unusual about it said once."""

import sys
from pathlib import Path

from cylforce.settings.machine_file import Loaded, load


def load_machine(path: Path) -> Loaded:
    """`load`, with the file's warnings on standard error. Raises SettingsError."""
    loaded = load(path)
    for warning in loaded.warnings:
        print(f"cylforce: warning: {warning}", file=sys.stderr)
    return loaded
