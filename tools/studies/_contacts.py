"""Machines in contact with the ground, with the true force and never filtered: recordings of another generator from the
shared folder, and reference machines."""

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pyarrow.parquet as pq

from cylforce.commissioning.identification import identify
from cylforce.files.atomic import RecordingError
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.programs.replay import replay_through
from cylforce.service.core import Core
from cylforce.settings.machine_file import load
from cylforce.signals.contact import ContactEvent, EventKind
from cylforce.signals.estimate import Array, Estimate
from cylforce.signals.units import STANDARD_GRAVITY
from reference_machine.machine import draw
from studies.unexplained import SHARED

REFERENCES = ("reference_static", "reference_moving")
# s from the tick that a table's replay has at the time of its samples to the bytes on the bus: live, sensors are read
# one step before they are used, and a PDO waits 5 ms on average
SENT_S = 0.015
SHARP_RAMP_S = 0.1  # s in which a cylinder is brought to speed by a lever thrown over, three spool lags; chosen
TOUCHING = ("press", "drag", "soil", "buried", "air")
FOREIGN_KINDS = {"contact_press": "press", "contact_drag": "drag", "contact_soil": "soil", "contact_buried": "buried"}


class Wanted(NamedTuple):
    """What a study of contacts is asked for: its runs, the seed of the first reference machine, the JSON file."""

    runs: "Iterator[Run]"
    seed: int
    json: Path | None


def wanted(study: str, words: str | None, kinds: tuple[str, ...]) -> Wanted:
    """The command line of a study; `kinds`: what it looks at of reference machines."""
    parser = argparse.ArgumentParser(prog=f"accuracy {study}", description=words)
    parser.add_argument(
        "--foreign", action="store_true", help="machines of the other generator, from the shared folder"
    )
    parser.add_argument("--machines", type=int, default=4, help="reference machines")
    parser.add_argument("--seed", type=int, default=9000, help="of the first reference machine")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    seeds = range(options.seed, options.seed + options.machines)
    runs = foreign_runs(TOUCHING) if options.foreign else reference_runs(seeds, kinds)
    return Wanted(runs, options.seed, options.json)


class Run(NamedTuple):
    """A recording as the service saw it: of which machine, of which kind, the core; times (T,) [s] at which its
    estimates are on the bus; true force (T, 2) [N] of the ground on the teeth at those times, and mass (T,)
    [kg] in the bucket."""

    machine: str
    kind: str
    core: Core
    t_s: Array
    force: Array
    mass: Array
    estimates: list[Estimate]

    @property
    def size(self) -> Array:
        """Size (T,) [N] of the true force of the ground."""
        return np.asarray(np.hypot(*self.force.T))

    def found(self, what: str) -> tuple[Array, Array]:
        """Published components (T, 2) [N] and their standard errors; `what`: force or soil."""
        forces = [getattr(e, what) for e in self.estimates]
        value = np.array([(f.x.value, f.z.value) for f in forces])
        return value, np.array([(f.x.standard_error, f.z.standard_error) for f in forces])

    def times(self, *kinds: EventKind) -> list[float]:
        """Times [s] at which events of some kinds are on the bus."""
        return [event.t_us * 1e-6 + SENT_S for event in self.events if event.kind in kinds]

    @property
    def events(self) -> list[ContactEvent]:
        """All events, in their order."""
        return list({event.number: event for e in self.estimates for event in e.events}.values())


def run_of(machine: str, kind: str, core: Core, estimates: list[Estimate], truth: dict[str, Array]) -> Run:
    """A run with the truth of the moment of publication."""
    t_s = np.array([e.t_us for e in estimates]) * 1e-6 + SENT_S
    force = np.column_stack([np.interp(t_s, truth["t_s"], truth[axis]) for axis in "xz"])
    return Run(machine, kind, core, t_s, force, np.interp(t_s, truth["t_s"], truth["mass"]), estimates)


def foreign_runs(kinds: tuple[str, ...]) -> Iterator[Run]:
    """Recordings of the other generator, each machine identified from its own references. `kinds`: press, drag, soil,
    buried, air or digging."""
    for folder in sorted(SHARED.glob("foreign_machines/machine_*"), key=lambda p: int(p.name.split("_")[1])):
        loaded = load(folder / "machine.toml")
        values = (v for name in REFERENCES for v in recorded_segments(loaded, folder / f"{name}.parquet"))
        core = Core(loaded.service, identify(model_of(loaded), values).tares)
        for kind, path in foreign_paths(folder, kinds):
            found = replay_through(core, loaded, path, quiet)
            yield run_of(folder.name, kind, core, found.estimates, foreign_truth(path))


def quiet(sentence: str) -> None:
    """What a replay says about a recording is not of interest here."""


def foreign_paths(folder: Path, kinds: tuple[str, ...]) -> Iterator[tuple[str, Path]]:
    """(kind, recording) of a machine."""
    contact = foreign_kind(folder)
    if contact in kinds:
        yield contact, folder / "contact_in_order.parquet"
    if "air" in kinds:
        yield "air", folder / "reference_moving.parquet"
        yield "air", folder / "empty_in_order.parquet"
    if "digging" in kinds:
        yield "digging", folder / "digging_in_order.parquet"


def foreign_kind(folder: Path) -> str:
    """What a machine's contact recording shows."""
    labels = json.loads((folder.parent / "labels.json").read_text())
    said = [label for label in labels if (label["machine"], label["recording"]) == (folder.name, "contact_in_order")]
    if len(said) != 1:
        raise RecordingError(f"{folder}: labels.json does not say what contact_in_order shows")
    return FOREIGN_KINDS[said[0]["what"]]


def foreign_truth(path: Path) -> dict[str, Array]:
    """Times [s], force of the ground on the teeth [N] and mass in the bucket [kg]; zero where nothing touches."""
    truth = path.with_name(f"{path.stem}_truth.parquet")
    if not truth.exists():
        t_s = pq.read_table(path)["t_s"].to_numpy()
        return {"t_s": t_s} | dict.fromkeys(("x", "z", "mass"), np.zeros(len(t_s)))
    table, pitch = pq.read_table(truth), pq.read_table(path)["chassis_pitch_rad"].to_numpy().mean()
    x, z = (table[f"tip_force_{axis}_n"].to_numpy().astype(np.float64) for axis in "xz")
    turned = (x + 1j * z) * np.exp(1j * pitch)  # the frame of the house is pitched, our force is truly vertical
    return {
        "t_s": table["t_s"].to_numpy(),
        "x": turned.real,
        "z": turned.imag,
        "mass": table["payload_kg"].to_numpy().astype(np.float64),
    }


def reference_runs(machines: range, kinds: tuple[str, ...]) -> Iterator[Run]:
    """Reference machines: `tip_load` (known forces in all directions), `digging`, five minutes of empty motion (`air`),
    and four whose strokes begin and end sharply (`sharp`)."""
    sharp: dict[str, Any] = {"duration_s": 240.0, "ramp_s": SHARP_RAMP_S}
    scenarios: dict[str, tuple[str, dict[str, Any]]] = {
        "tip_load": ("tip_load", {}),
        "digging": ("cycles", {}),
        "air": ("commissioning", {}),
        "sharp": ("commissioning", sharp),
    }
    for seed in machines:
        machine = draw(seed, friction="foreign" if seed % 2 else "own")
        with TemporaryDirectory() as folder:
            path = machine.run("commissioning", seed=0).write(Path(folder))
            loaded = load(Path(folder) / "machine.toml")
            core = Core(loaded.service, identify(model_of(loaded), recorded_segments(loaded, path)).tares)
            for number, kind in enumerate(kinds, 1):
                scenario, options = scenarios[kind]
                recording = machine.run(scenario, seed=number, name=kind, **options)
                found = replay_through(core, loaded, recording.write(Path(folder)), quiet)
                yield run_of(machine.name, kind, core, found.estimates, reference_truth(recording.t_s, recording.truth))


def reference_truth(t_s: Array, truth: dict[str, Array]) -> dict[str, Array]:
    """As `foreign_truth`."""
    x, z = truth["tip_force_horizontal"], truth["tip_force_vertical"]
    return {"t_s": t_s, "x": x, "z": z, "mass": truth["payload"]}


def resultant(run: Run) -> Array:
    """True force (T, 2) [N] of all that acts on the tool: the ground's and the weight of what is in the bucket."""
    return np.column_stack([run.force[:, 0], run.force[:, 1] - run.mass * STANDARD_GRAVITY])
