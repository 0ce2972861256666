"""Another bucket on reference machines: 30 % heavier or lighter, its centre moved by 0.1 m. Is it told before anything
is booked when nobody chose it? How well are loads weighed with it after a minute of empty motion? Is the right bucket
ever doubted?

Machines differ from their data sheet as always; the other bucket's data sheet is its true mass less the deviation of
the standard one. The scale is from a known lift with the standard bucket."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

from cylforce.commissioning.identification import identify, identify_attachment
from cylforce.estimation.model import Tares
from cylforce.programs.common.readings import calibrated, model_of, recorded_segments, tool_models
from cylforce.service.core import Core
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Booking, Estimate, Reason
from reference_machine.machine import Machine, draw

from ._quick import served

FACTORS, MOVED = (0.7, 1.3), 0.1  # of the mass; m
KNOWN_KG, MINUTE_S = 1000.0, 60.0
LOADS = (900.0, 400.0, 1300.0, 700.0)  # kg


class Outcome(NamedTuple):
    """A machine with another bucket: whether it was told, how many bookings there were before; errors of the weights
    with its own tares, as a share of rated, and how many of the loads were booked; how often the right bucket was
    doubted, in how many returns."""

    told: bool
    booked_before: int
    errors: list[float]
    booked: int
    doubted: int
    returns: int


def other_bucket(machine: Machine, factor: float) -> Machine:
    """The machine with a bucket of `factor` times the mass, the centre moved towards the teeth or the pin."""
    body = machine.specimen.bodies["bucket"]
    moved = (body.centre[0] + MOVED * float(np.sign(factor - 1.0)), body.centre[1])
    grown = {name: factor * getattr(body, name) for name in ("mass", "xx", "zz", "xz", "yy")}
    bodies = {**machine.specimen.bodies, "bucket": replace(body, centre=moved, **grown)}
    return replace(machine, specimen=replace(machine.specimen, bodies=bodies))


def attachment_table(machine: Machine, factor: float) -> str:
    """The other bucket as its maker describes it: the standard one's data sheet, as it was changed."""
    sheet, body = machine.specimen.sheet, machine.specimen.bodies["bucket"]
    link, more = sheet.links["bucket"], (factor - 1.0) * body.mass
    x = (link.mass * link.centre[0] + more * link.centre[0]) / (link.mass + more) + MOVED * float(np.sign(factor - 1.0))
    return (
        f'\n[[attachments]]\nname = "other"\nkind = "bucket"\nmass_kg = {link.mass + more:.1f}\n'
        f"centre_m = [{x:.3f}, {link.centre[1]:.3f}]\ninertia_kg_m2 = {factor * link.inertia:.1f}\n"
        f"point_m = [{sheet.tool[0]}, {sheet.tool[1]}]\nrated_payload_kg = {sheet.rated_payload}\n"
        f"payload_reach_m = {sheet.payload_reach}\ntolerance = {{ mass_percent = 20, centre_m = 0.1 }}\n"
    )


def worked(machine: Machine, core: Core, loads: Sequence[float]) -> tuple[list[Estimate], list[Booking]]:
    """Digging cycles through the service: its estimates, and the bookings as they ended."""
    made = machine.run("cycles", seed=len(loads), payloads_kg=tuple(loads))
    names = [str(signal.name) for signal in core.service.machine.signals]
    values = made.values[:, [made.signals.index(name) for name in names]]
    estimates, booked = [], {}
    for service in served(core, values):
        estimates.append(service.estimate)
        if (booking := service.estimate.booking) is not None:
            booked[booking.number] = booking
    return estimates, list(booked.values())


def common(machine: Machine, loaded: Loaded, folder: Path) -> Tares:
    """Tares with the standard bucket, with the scale of a known lift."""
    empty = machine.run("commissioning", seed=0).write(folder)
    lift = machine.run("known_lift", seed=3, weight_kg=KNOWN_KG).write(folder)
    found = identify(model_of(loaded), recorded_segments(loaded, empty), refuse=False)
    return calibrated(loaded, found, lift, KNOWN_KG).tares


def outcome(seed: int, factor: float, returns: int, folder: Path) -> Outcome:
    """One machine with one other bucket."""
    machine = draw(seed)
    machine.run("commissioning", seed=9, duration_s=25.0, name="file").write(folder)
    path = folder / "with_other.toml"
    path.write_text((folder / "machine.toml").read_text() + attachment_table(machine, factor))
    loaded, other = load(path), other_bucket(machine, factor)
    tares = common(machine, loaded, folder)
    unnoticed, wrong = worked(other, Core(loaded.service, tares), LOADS[:2])
    first = next((e.t_us for e in unnoticed if e.gross.reason is Reason.OTHER_TOOL), None)
    before = sum(first is None or b.t_us < first for b in wrong)
    minute = other.run("commissioning", seed=5, duration_s=MINUTE_S, name="minute").write(folder / "minute")
    models = tool_models(loaded, "other", tares)
    own = identify_attachment(tares, *models, recorded_segments(loaded, minute), refuse=False).tares
    _, chosen = worked(other, Core(loaded.service.fitted("other"), own), LOADS)
    rated = loaded.service.machine.rated_payload
    nearest = [min((b.dumped - mass for mass in LOADS), key=abs) / rated for b in chosen]
    right, _ = worked(machine, Core(loaded.service, tares), [600.0] * returns)
    doubts = [e.gross.reason is Reason.OTHER_TOOL for e in right]
    doubted = int(np.sum(np.diff(np.array(doubts, dtype=int), prepend=0) > 0))
    return Outcome(first is not None, before, nearest, len(chosen), doubted, returns)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy attachments", description=__doc__)
    parser.add_argument("--machines", type=int, default=5)
    parser.add_argument("--seed", type=int, default=300)
    parser.add_argument("--returns", type=int, default=20)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table = Table(title="another bucket on reference machines")
    for column in (
        "machine",
        "mass",
        "told",
        "booked before",
        "booked with it",
        "largest error %",
        "right one doubted",
    ):
        table.add_column(column, justify="right")
    figures: list[dict[str, Any]] = []
    for k in range(options.machines):
        seed, factor = options.seed + k, FACTORS[k % 2]
        with TemporaryDirectory() as folder:
            found = outcome(seed, factor, options.returns, Path(folder))
        largest = 100.0 * max((abs(error) for error in found.errors), default=float("nan"))
        booked, doubted = f"{found.booked} of {len(LOADS)}", f"{found.doubted} in {found.returns}"
        said = "yes" if found.told else "no"
        table.add_row(str(seed), f"x {factor}", said, str(found.booked_before), booked, f"{largest:.2f}", doubted)
        print(f"{seed}: {found}", flush=True)
        figures.append({"seed": seed, "factor": factor, **found._asdict()})
    Console(highlight=False).print(table)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
