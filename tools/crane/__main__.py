"""Writes the machine file of the HMF 2020-K4 loader crane, to replay its recordings or to play them onto a bus."""

import argparse
import sys
from pathlib import Path

from .geometry import CURVES, PARAMETERS, crane
from .machine_file import text


def main() -> int:
    """Write the file; exit code 2 where the folder lacks something."""
    parser = argparse.ArgumentParser(prog="hmf_crane", description=__doc__)
    parser.add_argument("folder", type=Path, metavar="FOLDER", help=f"with {PARAMETERS} and {CURVES}")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE.toml")
    options = parser.parse_args()
    try:
        options.output.write_text(text(crane(options.folder)))
    except (OSError, ValueError, KeyError) as error:
        print(f"hmf_crane: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
