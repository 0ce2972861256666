"""A simulated fleet: machines of one type, recorded on several days, of which some change on a known day."""

from argparse import ArgumentParser, Namespace
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from datetime import date, timedelta
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.effects.imposed import Imposed, imposed
from cylforce.estimation.model import EXPECTED
from cylforce.files.tables import Table, write_table
from cylforce.mechanics.machine import Machine
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth

MACHINE_FILE = Path(__file__).resolve().parents[2] / "config/excavator_20t.toml"
BEGINS = date(2026, 3, 2)
APART = 7  # days between two recordings
MASS_ERROR = 0.05  # of the masses, machine from data sheet
ZERO, ANGLE = 3e4, 0.003  # Pa, rad: standard deviations between machines
SLOPE = 0.02  # rad, standard deviation of the ground from day to day
DIRT = 3.0  # kg on each link, standard deviation from day to day: the least plausible mass is five times that
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
CAUSES = ("friction_level_change", "pressure_offset", "angle_offset", "extra_mass")
# Sizes of changes: friction [1], zero [Pa], angle [rad], mass [kg].
RANGES = {
    "friction_level_change": (0.3, 0.6),
    "pressure_offset": (1.0e5, 3.0e5),
    "angle_offset": (0.010, 0.020),
    "extra_mass": (60.0, 150.0),
}
MASS_SHAPE = (1.0, 0.3, 0.1, 0.1)  # of a mass that is mounted: kg, kg m along and across, kg m^2 for each kg


class Size(NamedTuple):
    """So many machines, each with so many recordings of so many seconds; so many of them change."""

    machines: int
    days: int
    seconds: float
    changing: int


def add_size(parser: ArgumentParser) -> None:
    """Options that say how large a fleet is, and where it is kept."""
    parser.add_argument("--machines", type=int, default=100)
    parser.add_argument("--days", type=int, default=10, help="recordings of each machine, a week apart")
    parser.add_argument("--seconds", type=float, default=180.0, help="length of a recording")
    parser.add_argument("--changing", type=int, default=10, help="machines that change")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="keep the recordings there; what is there is not made again")
    parser.add_argument("--cache", type=Path, help="keep results there")
    parser.add_argument("--json", type=Path)


def size_of(options: Namespace) -> Size:
    """By these options."""
    return Size(options.machines, options.days, options.seconds, options.changing)


class Faulty(NamedTuple):
    """What is true of a machine that changes: the effect, the cylinder, sensor or link, the size, the number of the
    first recording that has it."""

    machine: str
    name: str
    at: str
    size: float
    first: int


def name_of(number: int) -> str:
    """A machine's name."""
    return f"EX-{number:03d}"


def day_of(number: int) -> str:
    """The date of a machine's recording."""
    return (BEGINS + timedelta(days=APART * number)).isoformat()


def faults(loaded: Loaded, size: Size, seed: int) -> dict[int, Faulty]:
    """Which machines change, by number: evenly spread over the fleet, each cause in turn, not before the fourth day and
    not after the last but three."""
    found = dict[int, Faulty]()
    for k in range(size.changing):
        rng, name = np.random.default_rng((seed, 1, k)), CAUSES[(k + seed) % len(CAUSES)]
        number = k * size.machines // size.changing
        found[number] = drawn(loaded.service.machine, name_of(number), name, size.days, rng)
    return found


def drawn(machine: Machine, own: str, name: str, days: int, rng: np.random.Generator) -> Faulty:
    """A change of this name in the machine `own`: its size, place and day."""
    low, high = RANGES[name]
    value = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    sign = 1.0 if name in ("friction_level_change", "extra_mass") else float(rng.choice((-1.0, 1.0)))
    at = places(machine, name)[int(rng.integers(len(places(machine, name))))]
    return Faulty(own, name, at, sign * value, int(rng.integers(3, max(days - 2, 4))))


def places(machine: Machine, name: str) -> list[str]:
    """Where a change of this name may be."""
    if name == "friction_level_change":
        return [c.name for c in machine.cylinders]
    if name == "extra_mass":
        return [link.name for link in machine.links[:-1]]  # a bracket is welded to the boom or the stick
    kinds = PRESSURES if name == "pressure_offset" else (Kind.JOINT_ANGLE,)
    return [s.name for s in machine.signals if s.kind in kinds]


def _imposed(machine: Machine, fault: Faulty) -> Imposed:
    if fault.name != "extra_mass":
        return imposed(machine, fault.name, fault.at, fault.size)
    return imposed(machine, fault.name, fault.at, tuple(share * fault.size for share in MASS_SHAPE))


def _always(machine: Machine, rng: np.random.Generator) -> list[Imposed]:
    """What a machine's sensors always have."""
    found = []
    for s in machine.signals:
        if s.kind in PRESSURES:
            found.append(imposed(machine, "pressure_offset", s.name, float(rng.normal(0.0, ZERO))))
        elif s.kind is Kind.JOINT_ANGLE:
            found.append(imposed(machine, "angle_offset", s.name, float(rng.normal(0.0, ANGLE))))
    return found


def _today(machine: Machine, rng: np.random.Generator) -> list[Imposed]:
    """What is different from day to day: friction and zeros as `estimation.model.EXPECTED` says, and dirt."""
    sizes = [("friction_level_change", c.name, EXPECTED.friction) for c in machine.cylinders]
    sizes += [("pressure_offset", s.name, EXPECTED.zero) for s in machine.signals if s.kind in PRESSURES]
    found = [imposed(machine, name, at, float(rng.normal(0.0, size))) for name, at, size in sizes]
    for link in machine.links:
        mass = abs(float(rng.normal(0.0, DIRT)))
        found.append(imposed(machine, "extra_mass", link.name, (mass, 0.0, 0.0, 0.0)))
    return found


def samples(
    loaded: Loaded, number: int, day: int, seconds: float, seed: int, fault: Faulty | None
) -> tuple[Array, Array]:
    """Times (T,) [s] and readings (T, S) of the empty machine's moves on a day."""
    machine, rng = loaded.service.machine, np.random.default_rng((seed, 3, number, day))
    effects = [*_always(machine, np.random.default_rng((seed, 2, number))), *_today(machine, rng)]
    if fault is not None and day >= fault.first:
        effects.append(_imposed(machine, fault))
    truth = draw_truth(machine, np.random.default_rng((seed, 4, number)), MASS_ERROR, tuple(effects))
    truth = truth._replace(pitch=float(rng.normal(0.0, SLOPE)), roll=float(rng.normal(0.0, SLOPE)))
    made, dt = sensors(machine, loaded.service.nodes), 1.0 / loaded.service.filters.rate_hz
    records = list(run(machine, truth, made, [moves(machine, rng, seconds)], dt=dt, rng=rng))
    return np.concatenate([r.t for r in records]), np.concatenate([r.values for r in records])


class _One(NamedTuple):
    folder: Path
    number: int
    size: Size
    seed: int
    suffix: str


def _write_machine(work: _One) -> None:
    loaded = load(MACHINE_FILE)
    fault = faults(loaded, work.size, work.seed).get(work.number)
    folder = work.folder / name_of(work.number)
    folder.mkdir(parents=True, exist_ok=True)
    signals = tuple(s.name for s in loaded.service.machine.signals)
    for day in range(work.size.days):
        if (folder / f"{day_of(day)}{work.suffix}").exists():
            continue
        t, values = samples(loaded, work.number, day, work.size.seconds, work.seed, fault)
        write_table(folder / f"{day_of(day)}{work.suffix}", Table(t, values, signals))


def write_fleet(folder: Path, size: Size, seed: int, processes: int = 2, suffix: str = ".parquet") -> dict[str, Faulty]:
    """Write the recordings of a fleet and its machine file, except those that are there; returns what is true of the
    machines that change."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.toml").write_text(MACHINE_FILE.read_text())
    works = [_One(folder, k, size, seed, suffix) for k in range(size.machines)]
    for _ in _mapped(works, processes):
        pass
    return {each.machine: each for each in faults(load(MACHINE_FILE), size, seed).values()}


def _mapped(works: list[_One], processes: int) -> Iterator[None]:
    if processes <= 1:
        yield from map(_write_machine, works)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(_write_machine, works)
