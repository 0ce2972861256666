"""Writes recordings of a reference machine.

python -m reference_machine --seed 3 --friction foreign --scenario commissioning --scenario cycles -o FOLDER
"""

import argparse
import sys
import tomllib
from pathlib import Path
from typing import Any

from .machine import draw
from .scenarios import SCENARIOS


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="reference_machine", description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, default=0, help="which machine")
    parser.add_argument("--run-seed", type=int, default=0, help="which run of it")
    parser.add_argument("--scenario", action="append", choices=list(SCENARIOS), required=True, help="may be repeated")
    parser.add_argument("--friction", choices=("own", "foreign", "none"), default="own")
    parser.add_argument("--sensors", default="class", help="class, perfect, or parts of the errors, by commas")
    parser.add_argument("--massless-linkages", action="store_true", help="cylinders and bars have no mass of their own")
    parser.add_argument("--duration", type=float, metavar="S")
    parser.add_argument(
        "--option", action="append", default=[], metavar="KEY=VALUE", help="of the scenario, as in TOML"
    )
    parser.add_argument("--form", choices=("parquet", "csv", "log"), default="parquet")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FOLDER")
    return parser.parse_args()


def _options(given: list[str]) -> dict[str, Any]:
    found = tomllib.loads("\n".join(given))
    return {key: tuple(value) if isinstance(value, list) else value for key, value in found.items()}


def main() -> int:
    """The program."""
    asked = _arguments()
    try:
        sensors = asked.sensors if "," not in asked.sensors else tuple(asked.sensors.split(","))
        machine = draw(asked.seed, friction=asked.friction, sensors=sensors, linkage_masses=not asked.massless_linkages)
        for scenario in asked.scenario:
            recording = machine.run(scenario, seed=asked.run_seed, duration_s=asked.duration, **_options(asked.option))
            print(recording.write(asked.output, asked.form))
    except (ValueError, OSError) as error:
        print(f"reference_machine: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
