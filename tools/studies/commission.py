"""Commissioning of reference machines, which share no code with the guidance: an operator who makes the strokes that it
asks for, how long that takes and whether the promised weight error holds; loaded and touching machines are refused,
empty ones are not."""

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from cylforce.commissioning.guidance import Advice, Guide, follow
from cylforce.commissioning.identification import identify
from cylforce.commissioning.reaches import Reach
from cylforce.commissioning.strokes import Stroke
from cylforce.programs.commission import LIMIT_S, THINK_S
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array
from reference_machine.machine import Machine, draw
from reference_machine.machinefile import machine_file
from reference_machine.plan import Plan
from reference_machine.session import Session
from studies.identification import weights

HEAVY = (150.0, 1500.0)  # kg in a bucket that should be empty
MOVED_S = 150.0  # of an empty, loaded or touching machine's moves; to refuse later is to refuse never
BRISK = 0.18  # m/s between strokes
READS_S = 1.0  # after every stroke, to read what comes next
CARELESS = 0.02  # of a cylinder's stroke, by which the operator misses where he shall go
UNEVEN = 0.15  # by which he misses the speed
PIECE = 200  # rows that the guidance sees at once


class Work(NamedTuple):
    """What one process does: kind of run, machine and its friction."""

    kind: str
    seed: int
    friction: str


def one_run(work: Work) -> dict[str, Any]:
    """A run of one kind; its figures."""
    machine = draw(work.seed, friction=work.friction)
    done = obedient(machine) if work.kind == "obedient" else followed(machine, work.kind)
    return {**work._asdict(), **done}


def guide_of(machine: Machine, folder: Path) -> tuple[Loaded, Guide]:
    """The data sheet's machine, and guidance as the program has it."""
    path = folder / "machine.toml"
    path.write_text(machine_file(machine.name))
    loaded = load(path)
    return loaded, Guide(model_of(loaded), every_s=THINK_S)


def obedient(machine: Machine) -> dict[str, Any]:
    """The operator follows the guidance until it ends; then working cycles are weighed with the identified tares."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        loaded, guide = guide_of(machine, folder)
        session = Session(machine)
        advice, values, strokes = _commissioned(session, guide)
        rated = loaded.service.machine.rated_payload
        figures = {
            "done": advice.done,
            "refusal": advice.refusal,
            "motion_s": advice.seconds,
            "duration_s": session.seconds,
            "strokes": strokes,
            "promised_kg": float(np.hypot(advice.weight_error, guide.model.scale_error * rated)),
        }
        if not advice.done:
            return figures
        try:
            found = identify(model_of(loaded), [values])
        except ValueError as error:  # the whole recording says what its beginning did not
            return figures | {"done": False, "refusal": str(error)}
        work_run = machine.run("cycles", seed=2)
        weighed = weights(loaded, found, work_run.write(folder), work_run, "")
    measured = rated * float(np.sqrt(np.mean(np.square(weighed["errors"]))))
    return {**figures, "measured_kg": measured, "scale_error": weighed["scale_error"], "z": weighed["z"]}


def _commissioned(session: Session, guide: Guide) -> tuple[Advice, Array, int]:
    """The last advice, all samples (T, S), and how many strokes were made."""
    state, values, strokes = guide.begin(), [], 0
    while True:
        advice = guide.advice(state)
        _make(session, guide, advice.stroke)
        strokes += 1
        values.append(session.move())
        for first in range(0, len(values[-1]), PIECE):
            state = guide.take(state, values[-1][first : first + PIECE])
            advice = guide.advice(state)
            if advice.done or advice.refusal is not None or advice.seconds > LIMIT_S:
                values[-1] = values[-1][: first + PIECE]
                return advice, np.concatenate(values), strokes


def _make(session: Session, guide: Guide, stroke: Stroke | Reach | None) -> None:
    """The stroke by the cylinders' places and the time of the sentence, with the errors of a hand."""
    site, path = session.site, session.path
    path.rest(READS_S)
    if stroke is None:
        site.go(path, float(site.rng.uniform(0.08, 0.2)))
        return
    if isinstance(stroke, Reach):
        _brisk(session, _lengths(session, guide, stroke.target), stroke.seconds)
        return
    begin, end = stroke.hold.copy(), stroke.hold.copy()
    begin[stroke.joint], end[stroke.joint] = stroke.begin, stroke.end
    start, target = (_lengths(session, guide, theta) for theta in (begin, end))
    others = [k for k in range(3) if k != stroke.joint]
    target[others] = start[others]
    _brisk(session, start)
    speed = abs(target[stroke.joint] - start[stroke.joint]) / stroke.seconds * (1.0 + UNEVEN * site.rng.uniform(-1, 1))
    path.rest(0.5)
    path.go(target, min(speed, float(site.quickest[stroke.joint])))
    path.rest(0.5)


def _brisk(session: Session, target: Array, seconds: float = 0.0) -> None:
    """To a posture, in so many seconds or briskly; over a raised boom where the straight way comes too near the ground,
    as near to it as the ground allows."""
    site, path = session.site, session.path
    low, high = site.geometry.working.T
    target = np.clip(target, low, high)
    while not site.clear(target[None]) and target[0] < high[0]:
        target = np.append(min(target[0] + 0.05, high[0]), target[1:])
    way = np.abs(target - path.now)
    speed = np.minimum(np.maximum(way / seconds, 0.02), site.quickest) if seconds else np.full(3, BRISK)
    if not site.clear(path.sketch(target, speed)):
        for part in (np.append(high[0], path.now[1:]), np.append(high[0], target[1:])):
            path.go(part, BRISK)
    path.go(target, speed)


def _lengths(session: Session, guide: Guide, theta: Array) -> Array:
    """Where the cylinders (3,) [m] really are at the shares of their strokes that the data sheet has at `theta`."""
    machine, specimen = guide.model.machine, session.site.geometry.specimen
    shares = [
        (length - c.length_low) / (c.length_high - c.length_low)
        for c, length in zip(machine.cylinders, machine.geometry(theta).length.tolist(), strict=True)
    ]
    low, high = np.array([specimen.cylinders[c.name].lengths for c in machine.cylinders]).T
    missed = np.array(shares) + CARELESS * session.site.rng.standard_normal(3)
    return np.asarray(np.clip(low + missed * (high - low), *session.site.geometry.working.T))


def followed(machine: Machine, kind: str) -> dict[str, Any]:
    """The scenario's own moves, of an empty, a loaded or a touching machine: whether and when they are refused, and
    with the right sentence."""
    rng = np.random.default_rng([machine.seed, 77])
    options: dict[str, Any] = {}
    if kind == "loaded":
        options["payload_kg"] = float(rng.uniform(*HEAVY))
    if kind == "touching":
        options["touching"] = True
    machine = machine_until(machine, MOVED_S)
    with TemporaryDirectory() as name:
        folder = Path(name)
        loaded, guide = guide_of(machine, folder)
        path = machine.run("commissioning", **options).write(folder)
        *_, last = follow(guide, recorded_segments(loaded, path))
    sign = {"loaded": "the bucket is not empty", "touching": "something"}.get(kind)
    named = last.refusal is not None and sign is not None and sign in last.refusal
    return {"refusal": last.refusal, "named": named, "motion_s": last.seconds, **options}


def machine_until(machine: Machine, seconds: float) -> Machine:
    """The machine whose runs end early."""

    def cut(plan: Plan) -> Plan:
        rows = min(plan.rows, round(seconds * 100))
        columns: dict[str, Any] = {
            f.name: value[:rows] for f in fields(plan) if isinstance(value := getattr(plan, f.name), np.ndarray)
        }
        return replace(plan, **columns)

    return replace(machine, edits=(*machine.edits, cut))


def summary(found: list[dict[str, Any]]) -> dict[str, float]:
    """The figures."""

    def of(kind: str) -> list[dict[str, Any]]:
        return [f for f in found if f["kind"] == kind]

    def column(rows: list[dict[str, Any]], key: str) -> Array:
        return np.array([f[key] for f in rows if key in f], dtype=float)

    guided = of("obedient")
    figures: dict[str, float] = {}
    if guided:
        motion = column(guided, "motion_s")
        promised, measured = column(guided, "promised_kg"), column(guided, "measured_kg")
        figures |= {
            "obedient": len(guided),
            "obedient_done": sum(f["done"] for f in guided),
            "motion_s_median": float(np.median(motion)),
            "motion_s_max": float(np.max(motion)),
            "promised_kg_median": float(np.median(promised)),
            "measured_kg_rms": float(np.sqrt(np.mean(measured**2))) if len(measured) else float("nan"),
        }
    for kind in ("loaded", "touching"):
        rows = of(kind)
        refused = [f for f in rows if f["refusal"] is not None]
        when = column(refused, "motion_s")
        figures |= {
            kind: len(rows),
            f"{kind}_refused": len(refused),
            f"{kind}_named": sum(f["named"] for f in rows),
            f"{kind}_refused_after_s_max": float(np.max(when, initial=0.0)),
        }
    return figures | {"empty": len(of("empty")), "empty_refused": sum(f["refusal"] is not None for f in of("empty"))}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="accuracy commission", description=__doc__)
    parser.add_argument("--machines", type=int, default=6, help="that are guided; half own friction laws, half foreign")
    parser.add_argument("--refused", type=int, default=10, help="loaded, as many touching, as many empty")
    parser.add_argument("--seed", type=int, default=700, help="of the first machine")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    kinds = [("obedient", options.machines), *((k, options.refused) for k in ("loaded", "touching", "empty"))]
    work = [Work(k, options.seed + n, ("own", "foreign")[n % 2]) for k, count in kinds for n in range(count)]
    with ProcessPoolExecutor(2) as pool:
        found = [*track(pool.map(one_run, work), "runs", len(work), console=Console(stderr=True))]
    figures = summary(found)
    table = Table(title=f"commissioning of reference machines, seeds from {options.seed}")
    table.add_column("what")
    table.add_column("figure", justify="right")
    for name, value in figures.items():
        table.add_row(name, f"{value:.4g}")
    console = Console(highlight=False)
    console.print(table)
    for f in found:
        wrong = f["refusal"] is not None if f["kind"] in ("empty", "obedient") else not f["named"]
        if wrong or (f["kind"] == "obedient" and not f["done"]):
            console.print(f"{f['kind']} {f['seed']} {f['friction']} at {f['motion_s']:.0f} s: {f['refusal']}")
    if options.json:
        options.json.write_text(json.dumps({**figures, "seed": options.seed, "runs": found}, indent=1) + "\n")


if __name__ == "__main__":
    main()
