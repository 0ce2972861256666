"""How well buckets are weighed: on reference machines, which share no code with the estimator, or on machines of a
foreign generator; with adaptation and without, and without single parts of the model. The truth is not filtered."""

import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.table import Table

from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Array

from .baselines import parabola, quasi_static
from .bucket import Work, foreign, reference
from .parts import parts
from .parts import table as of_parts
from .reference import DRAWN, Ride
from .score import figures
from .trial import WHOLE, Variant, weighed

WAYS = {
    "service": WHOLE,
    "no_adaptation": Variant(adapt=False),
    "no_stribeck": Variant(("stribeck",)),
    "no_rocker": Variant(("rocker",)),
    "no_load_dependent": Variant(("load_dependent",)),
}
BASELINES = {"quasi_static": quasi_static, "parabola": parabola}


def works(options: argparse.Namespace) -> list[Work]:
    """The machines that are asked for."""
    if options.foreign:
        shared = os.environ.get("CYLFORCE_SHARED", "../shared")
        return foreign(Path(options.folder or Path(shared) / "data" / "foreign_machines"))[: options.machines]
    seeds, cache = range(options.seed, options.seed + options.machines), Path(options.folder or ".weighing")
    lifts = {"both": (False, True), "no": (False,), "yes": (True,)}[options.lift]
    ride = Ride(options.rock, options.drive, options.oil)
    return [
        reference(options.machine, seed, options.cycles, cache, lift=lift, ride=ride)
        for lift in lifts
        for seed in seeds
    ]


def measured(work: Work, way: str) -> Array:
    """Booked and true weights of one machine, one way."""
    return BASELINES[way](work) if way in BASELINES else weighed(work, WAYS[way])


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy weighing", description=__doc__)
    parser.add_argument("--machines", type=int, default=30)
    parser.add_argument("--machine", choices=tuple(DRAWN), default="excavator", help="kind of the reference machines")
    parser.add_argument("--rock", type=float, default=0.0, help="of a loader's base [degrees rms]")
    parser.add_argument("--drive", type=float, default=0.0, help="largest acceleration of a loader [m/s^2]")
    parser.add_argument("--oil", type=float, help="of the work [degC]; without: drawn (commissioned at 40)")
    parser.add_argument("--seed", type=int, default=9100, help="of the first reference machine")
    parser.add_argument("--cycles", type=int, default=34, help="of each reference machine")
    parser.add_argument("--lift", choices=("both", "yes", "no"), default="both", help="of a known weight before")
    parser.add_argument("--foreign", action="store_true", help="on the machines of a foreign generator")
    parser.add_argument("--folder", type=Path, help="of the recordings")
    parser.add_argument("--parts", action="store_true", help="of the standard error, beside the true error")
    parser.add_argument("--ways", nargs="+", choices=(*WAYS, *BASELINES), default=["service"])
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    console, found = Console(highlight=False), {}
    machines = works(options)
    if options.parts:
        with ProcessPoolExecutor(options.processes) as pool:
            each = pool.map(parts, machines)
            console.print(of_parts({work.name: one for work, one in zip(machines, each, strict=True)}))
        return
    rated = load(machines[0].folder / "machine.toml").service.machine.rated_payload
    with ProcessPoolExecutor(options.processes) as pool:
        for way in options.ways:
            rows = {}
            for work, booked in zip(machines, pool.map(partial(measured, way=way), machines), strict=True):
                rows[work.name] = booked
                console.print(way, figures({work.name: booked}, rated)["machines"])
            found[way] = figures(rows, rated)
            if options.json:
                options.json.write_text(json.dumps(found, indent=1) + "\n")
    console.print(table(found))


def table(found: dict[str, dict[str, object]]) -> Table:
    """One row for each way of weighing."""
    shown = Table(title="errors of the weight, % of rated payload")
    keys = ("buckets", "availability", "rms", "p95", "p997", "bias", "coverage", "coverage_worst", "truck_p95")
    for column in ("way", *keys, "class Y(b) n"):
        shown.add_column(column, justify="left" if column == "way" else "right")
    for way, each in found.items():
        cells = [str(each[k]) if k == "buckets" else f"{100 * float(str(each[k])):.2f}" for k in keys]
        shown.add_row(way, *cells, str(each["class_y_b_n"]))
    return shown


if __name__ == "__main__":
    main()
