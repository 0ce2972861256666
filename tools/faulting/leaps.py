"""How pressures change from message to message in order, beside the leaps of faults: which leaps are doubted in order,
and how many of those that are put in at random."""

import argparse
import os
from array import array
from collections.abc import Iterator, Sequence
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from crane.figures import recordings
from crane.geometry import crane
from crane.machine_file import text
from cylforce.estimation.kernel.making import numbers
from cylforce.files.recording import open_recording
from cylforce.files.tables import Table as Samples
from cylforce.programs.common.readings import model_of
from cylforce.service.plausibility.detector import MonitoredMachine
from cylforce.service.plausibility.detectors.pressure_step import AFTER, LONGEST, PressureStep, StepTest
from cylforce.service.plausibility.suspicion import SensorFault
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array

from .edits import BAR
from .works import ROOT, reference_case, simulated_case

STEPS_BAR = (5.0, 10.0, 20.0)
TRIED = 400  # moments of a recording at which each leap is put in
AIR, WORK, CONTACT = ("empty_in_order", "reference_moving", "reference_static"), "digging_in_order", "contact_in_order"


class Piece(NamedTuple):
    """A recording in order: its source, what looks for leaps, its pressures (T, P) [Pa]."""

    source: str
    leaping: PressureStep
    pressures: Array


class Seen(NamedTuple):
    """What a recording shows: hours; changes between messages [bar] that 1 % exceed, and the largest; leaps in
    order, as if no friction turned round; shares found of exchanged sides and nodes, and of steps of STEPS_BAR."""

    hours: float
    exceeded: float
    largest: float
    stepped: int
    sides: float
    nodes: float
    steps: tuple[float, ...]


def pieces(folder: Path, numbers: Sequence[int], seeds: Sequence[int], simulated: Sequence[int]) -> Iterator[Piece]:
    """All recordings that can be had."""
    for number in numbers:
        place = folder / "foreign_machines" / f"machine_{number}"
        loaded = load(place / "machine.toml")
        for source, names in (("digging", (WORK,)), ("contact", (CONTACT,)), ("in the air", AIR)):
            for name in names:
                yield _piece(f"foreign, {source}", loaded, place / f"{name}.parquet")
    for seed in seeds:
        case = reference_case(seed)
        yield _made("reference, digging", case.loaded, case.table.values)
    for seed in simulated:
        case = simulated_case(seed)
        yield _made("simulated, digging", case.loaded, case.table.values)
    if (folder / "hmf_crane").exists():
        yield from _crane(folder / "hmf_crane")


def _crane(folder: Path) -> Iterator[Piece]:
    with TemporaryDirectory() as work:
        file = Path(work) / "crane.toml"
        file.write_text(text(crane(folder)))
        loaded = load(file)
        for path in recordings(folder).values():
            yield _piece("real crane", loaded, path)


def _piece(source: str, loaded: Loaded, path: Path) -> Piece:
    table = open_recording(path, loaded.service, loaded.columns)
    if not isinstance(table, Samples):
        raise TypeError(f"{path}: is no table")
    return _made(source, loaded, table.values)


def _made(source: str, loaded: Loaded, values: Array) -> Piece:
    model = model_of(loaded)
    leaping = PressureStep.start(MonitoredMachine(model, model.data_sheet, inf))
    return Piece(source, leaping, values[:, leaping.constants.test.signals])


def seen(piece: Piece, rng: np.random.Generator) -> Seen:
    """What a recording shows."""
    found, test = piece.pressures, piece.leaping.constants.test
    changes = np.abs(np.diff(found, axis=0)) / BAR
    at = rng.integers(0, len(found) - LONGEST, TRIED)
    windows = np.lib.stride_tricks.sliding_window_view(found, LONGEST, axis=0)[at].swapaxes(1, 2)
    exchanged = [_share(test, [_exchanged(w, pairs) for w in windows]) for pairs in test.swaps]
    single = [len(pairs) == 1 for pairs in test.swaps]
    return Seen(
        len(found) / piece.leaping.constants.blocks.model.filters.rate_hz / 3600.0,
        float(np.percentile(changes, 99.0)),
        float(changes.max()),
        doubted(piece.leaping, found),
        float(np.mean([x for x, one in zip(exchanged, single, strict=True) if one])),
        float(np.mean([x for x, one in zip(exchanged, single, strict=True) if not one])),
        tuple(_share(test, [_stepped(w, bar, rng) for w in windows]) for bar in STEPS_BAR),
    )


def doubted(leaping: PressureStep, pressures: Array) -> int:
    """How many leaps there are along pressures (T, P) [Pa], those of a friction that turns round among them."""
    times = set[int]()
    for k, row in enumerate(pressures.tolist(), 1):
        leaping.take(numbers(row), k, array("d"))
        times.add(leaping.since)
    return len(times - {0})


def _exchanged(window: Array, pairs: Sequence[tuple[int, int]]) -> Array:
    found, order = window.copy(), np.arange(window.shape[1])
    for a, b in pairs:
        order[[a, b]] = b, a
    found[-AFTER:] = window[-AFTER:, order]
    return found


def _stepped(window: Array, bar: float, rng: np.random.Generator) -> Array:
    found = window.copy()
    found[-AFTER:, rng.integers(window.shape[1])] += BAR * bar * rng.choice((-1.0, 1.0))
    return found


def _share(test: StepTest, windows: Sequence[Array]) -> float:
    return float(np.mean([test.suspicion(w).cause is not SensorFault.NONE for w in windows]))


def table(found: Sequence[tuple[str, Seen]]) -> Table:
    """By source."""
    shown = Table(title="changes of pressures between messages, and leaps that are doubted")
    for name in (
        "source",
        "hours",
        "1 % exceed, bar",
        "largest, bar",
        "leaps in order",
        "sides found",
        "nodes found",
    ):
        shown.add_column(name, justify="left" if name == "source" else "right")
    for bar in STEPS_BAR:
        shown.add_column(f"{bar:.0f} bar", justify="right")
    for source in dict.fromkeys(name for name, _ in found):
        own = [each for name, each in found if name == source]
        shares = [np.mean([x.sides for x in own]), np.mean([x.nodes for x in own])]
        shares += list(np.mean([x.steps for x in own], axis=0))
        shown.add_row(
            source,
            f"{sum(x.hours for x in own):.2f}",
            f"{np.mean([x.exceeded for x in own]):.2f}",
            f"{max(x.largest for x in own):.1f}",
            str(sum(x.stepped for x in own)),
            *(f"{100.0 * share:.0f} %" for share in shares),
        )
    return shown


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="leaps", description=__doc__)
    parser.add_argument("--foreign", type=int, nargs="*", default=[1, 2, 3, 4, 5], help="machines of the generator")
    parser.add_argument("--reference", type=int, nargs="*", default=[21, 22], help="seeds of reference machines")
    parser.add_argument("--simulated", type=int, nargs="*", default=[7], help="seeds of the own simulator")
    asked, rng = parser.parse_args(), np.random.default_rng(24)
    folder = Path(os.environ.get("CYLFORCE_SHARED", ROOT.parent / "shared")) / "data"
    each = pieces(folder, asked.foreign, asked.reference, asked.simulated)
    found = [(piece.source, seen(piece, rng)) for piece in each]
    Console(width=160).print(table(found))


if __name__ == "__main__":
    main()
