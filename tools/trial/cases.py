"""A case: drawn, simulated, sealed; and the folder that the diagnosis gets, which does not contain the truth."""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from .effects.fault import Draw, Fault
from .effects.foreign import FOREIGN
from .effects.library import KNOWN, TWO_LINKS, clutter
from .effects.unheard import UNHEARD
from .field import Piece, Site, faulty, scene
from .orders import Order
from .repertoire import LOAD_KG

Array = NDArray[np.float64]
MAKES = KNOWN | TWO_LINKS | FOREIGN | UNHEARD


@dataclass(frozen=True)
class Case:
    """The recordings as values (T, S) by name, when each begins [s], the rows (T,) of each at which nothing unknown
    acts, and the label."""

    order: Order
    signals: tuple[str, ...]
    references: dict[str, Array]
    field: dict[str, Array]
    begins: dict[str, float]
    quiet: dict[str, NDArray[np.bool_]]
    machine_toml: str
    label: dict[str, Any]


def simulated(site: Site, order: Order, only: int | None = None) -> tuple[Case, dict[str, Array]]:
    """The case, and the field's twin: the clean machine (without effect) on the same motion with the
    same noise. `only`: with the effect of that number alone, those of the clutter after the others."""
    rng = np.random.default_rng([*order.seed, 11])
    poor, site = order.poor, site.two_links if order.two_links else site
    pieces = site.poor(rng, 100 + order.number, poor) if poor else site.showing(order.names)
    if order.harsh:
        pieces = site.harsh
    faults, small = drawn(order, pieces, rng)
    if only is not None:
        faults, small = [*faults, *small][only : only + 1], []
    noise = (site.seed, order.number)
    field = {p.stretch.name: site.shown(p.values(faulty(p, [*faults, *small]), noise)) for p in pieces}
    twin = {p.stretch.name: site.shown(p.values(p.machine, noise)) for p in pieces}
    references = {k: v for k, v in site.references.items() if not (poor == "no_load" and k.endswith("loaded"))}
    begins = dict.fromkeys(references, 0.0) | {p.stretch.name: p.stretch.begin_s for p in pieces}
    quiet = {p.stretch.name: p.quiet for p in (*site.reference_pieces, *pieces)}
    told = label(order, faults, small) | {"references": sorted(references), "scenario": scenario(pieces)}
    case = Case(order, site.signals, references, field, begins, quiet, site.data_sheet, told)
    return case, twin


def drawn(order: Order, pieces: tuple[Piece, ...], rng: np.random.Generator) -> tuple[list[Fault], list[Fault]]:
    """The case's faults, and the small ones around them."""
    seen, draw = scene(pieces), Draw(rng)
    faults = [MAKES[name](draw, seen) for name in order.names]
    return faults, clutter(draw, seen, order.names) if order.clutter else []


def scenario(pieces: tuple[Piece, ...]) -> str:
    """What the field does, in the words of labelled folders."""
    return "dig_cycles" if any(not piece.quiet.all() for piece in pieces) else "air"


def label(order: Order, faults: list[Fault], small: list[Fault]) -> dict[str, Any]:
    """The truth of a case, which is sealed: kind, effects, clutter, machine."""
    return {
        "case": order.number,
        "kind": order.kind,
        "poor": order.poor,
        "clutter": [fault.label() for fault in small],
        "effects": [fault.label() for fault in faults],
        "machine": order.machine,
        "harsh": order.harsh,
        "friction": order.friction,
    }


def sealed(label: dict[str, object], salt: str) -> str:
    """The salted hash of a label: printed before the diagnosis starts, checked after."""
    return hashlib.sha256((salt + json.dumps(label, sort_keys=True)).encode()).hexdigest()


def write(case: Case, folder: Path) -> None:
    """Write the folder of the diagnosis: data sheet, recordings, and case.json, which lists them."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "machine.toml").write_text(case.machine_toml)
    for name, values in (case.references | case.field).items():
        t_s = case.begins[name] + np.arange(len(values)) / 100.0
        columns = dict(zip(("t_s", *case.signals), (t_s, *values.T), strict=True))
        pq.write_table(pa.table(columns), folder / f"{name}.parquet")
    (folder / "case.json").write_text(json.dumps(inputs(case), indent=1) + "\n")


def inputs(case: Case) -> dict[str, object]:
    """What case.json lists: recordings of the field, references, known loads [kg]."""
    names = [f"{name}.parquet" for name in (*case.references, *case.field)]
    return {
        "field": [f"{name}.parquet" for name in case.field],
        "reference": [f"{name}.parquet" for name in case.references],
        "loads_kg": {name: LOAD_KG for name in names if "loaded" in name},
    }
