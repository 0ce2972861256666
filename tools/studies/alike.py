"""How far apart two causes of the same torque are, to one who knows machine, noise and both forms: dry friction that
differs between the directions, and the offset of a pressure sensor that comes nearest to it.

On reference machines and the motion of the withheld trial; by the trial's own standard errors (tools/trial/sigmas.py),
which nothing that sees the recordings alone can undercut."""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from cylforce.settings.machine_file import load
from trial.effects.fault import Draw, Fault
from trial.effects.rubbing import asymmetric
from trial.effects.sensing import pressure_offset
from trial.field import Site, faulty, scene
from trial.orders import machine_seed
from trial.repertoire import LOAD_KG, PLAIN
from trial.sigmas import Effect, Floor, Rows, compared, explained

Array = NDArray[np.float64]
JOINTS = ("boom", "stick", "bucket")
FRICTION = ("own", "foreign")
SHARE, BAR = 0.35, 2.0  # of dry friction; of the offset, which is scaled to come nearest
COLUMNS = ("machine", "friction", "joint", "asymmetric", "offset", "apart")


class Given(Draw):
    """Instead of a draw: the place and the size that are asked for."""

    def __init__(self, at: str, size: float) -> None:
        super().__init__(np.random.default_rng(0))  # nothing is drawn from it
        self.at, self.given = at, size

    def one(self, names: tuple[str, ...]) -> str:
        """The place."""
        return self.at

    def portion(self) -> float:
        """Both directions alike."""
        return 0.5

    def signed(self, low: float, high: float) -> float:
        """The size."""
        return self.given


def calm(values: Array) -> NDArray[np.bool_]:
    """Nothing unknown acts at any row."""
    return np.ones(len(values), dtype=bool)


def one_site(work: tuple[int, str]) -> list[dict[str, Any]]:
    """Standard errors of an asymmetry, of an offset, and of what of the asymmetry no offset explains, by joint."""
    seed, friction = work
    site = Site(seed, friction, repertoire=PLAIN)
    with TemporaryDirectory() as folder:
        (Path(folder) / "machine.toml").write_text(site.data_sheet)
        floor = Floor(load(Path(folder) / "machine.toml"), LOAD_KG)
    references = [floor.rows(name, values, calm(values)) for name, values in site.references.items()]

    def rows(*faults: Fault) -> list[Rows]:
        made = {p.stretch.name: p.values(faulty(p, list(faults)), (seed, 1)) for p in site.pieces}
        return [floor.rows(name, site.shown(values), calm(values)) for name, values in made.items()]

    twin, seen = rows(), scene(site.pieces)
    found = []
    for joint in JOINTS:
        rubbing = asymmetric(Given(joint, SHARE), seen)
        offset = pressure_offset(Given(f"{joint}_head_pressure", BAR), seen)
        one, other = (compared(floor, references, twin, rows(fault)) for fault in (rubbing, offset))
        apart = Effect(one.signal - explained(one.signal, other.signal, one.level), one.floor, one.level)
        sizes = (one.effect.sigmas, other.effect.sigmas, apart.sigmas)
        found.append(dict(zip(COLUMNS, (seed, friction, joint, *sizes), strict=True)))
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy alike", description=__doc__)
    parser.add_argument("--machines", type=int, default=4)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    seeds = [machine_seed(options.seed, k, development=True) for k in range(options.machines)]
    with ProcessPoolExecutor(2) as pool:
        rows = [row for part in pool.map(one_site, [(s, f) for s in seeds for f in FRICTION]) for row in part]
    table = Table(title=f"{SHARE:.0%} asymmetry and the nearest offset, standard errors, seed {options.seed}")
    for column in COLUMNS:
        table.add_column(column)
    for row in rows:
        table.add_row(*(f"{row[name]:.1f}" if isinstance(row[name], float) else str(row[name]) for name in COLUMNS))
    console = Console(highlight=False)
    console.print(table)
    for joint in JOINTS:
        apart = [row["apart"] for row in rows if row["joint"] == joint]
        console.print(f"{joint}: apart by {np.median(apart):.1f} standard errors (median), {max(apart):.1f} at most")
    if options.json:
        options.json.write_text(json.dumps({"seed": options.seed, "rows": rows}, indent=1) + "\n")


if __name__ == "__main__":
    main()
