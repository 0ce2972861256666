"""Machine file of a program: read, with one warning for each unusual value."""

import sys
from pathlib import Path

from cylforce.settings.machine_file import Loaded, load


def load_machine(path: Path) -> Loaded:
    """Load a machine file and print its warnings on standard error. Raises SettingsError."""
    loaded = load(path)
    for warning in loaded.warnings:
        print(f"cylforce: warning: {warning}", file=sys.stderr)
    return loaded
