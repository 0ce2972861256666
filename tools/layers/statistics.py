"""What a recording says of every effect, as sufficient statistics that are computed once and stored: layers that decide
are then compared in seconds.

Rows are whitened by the noise floor of the machine's references. Of every joint r and block b of three seconds the
first Legendre polynomials are taken out by themselves, so that a smooth discrepancy of any level can be put in
later."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from cylforce.diagnosis.diagnosis import asked
from cylforce.diagnosis.floor import fitted_tares, noise_floor
from cylforce.diagnosis.problem import Problem, looked_at
from cylforce.diagnosis.rows import BLOCK, Recorded, Viewer
from cylforce.diagnosis.whitening import Floor, whitened
from cylforce.effects.fault import INCIDENTAL, Incident
from cylforce.estimation.model import FRICTION, Model
from cylforce.programs.common.recorded import chosen
from cylforce.settings.machine_file import Loaded

Array = NDArray[np.float64]
SMOOTH = 6  # Legendre polynomials of a block
SEED = 1  # of the sensors' noise
DRY, UNEVEN = "coulomb_friction", "asymmetric_friction"
NEVER = 1e-4  # of its spread: what no machine has as a part of itself, because others stand for it
FEWEST = 12  # rows of a block and joint, below which nothing smooth is taken out of it
MOMENTARY = [k for k, name in enumerate(INCIDENTAL) if name.startswith(("tip.", "load.m", "load.X", "load.Z"))]


class Statistics(NamedTuple):
    """Of a recording with R joints, B blocks, K columns: `whole` (R, K+1, K+1) Gram matrices of [columns | left],
    `smooth` (B, R, SMOOTH, K+1) their share along the polynomials, `rows` (B, R) counted; of the I columns of forces
    at the teeth and of loads `across` (B, R, I, K+1), `within` (B, R, I, I), `waves` (B, R, SMOOTH, I). `crossed`
    (R, K+1): what of the columns' product with what is left is the sensors' noise in both (errors in variables),
    simulated with the declared standard errors and scaled to one white noise of the floor's strength."""

    whole: Array
    smooth: Array
    rows: Array
    across: Array
    within: Array
    waves: Array
    crossed: Array


class Column(NamedTuple):
    """One proposal: name, place, its columns, plausible range of its size, its sign, its axes."""

    name: str
    at: str
    columns: tuple[int, ...]
    low: float
    high: float
    sign: int
    axes: int


class Scene(NamedTuple):
    """What all recordings of a machine have in common: `parameters` P of the model, prior standard errors of all
    columns, `always` (K,) as part of the machine and `spread` (K,), of those at moments `unusual` (I,), proposals, the
    floor's `rms` (R,) [N m]."""

    parameters: int
    always: Array
    spread: Array
    unusual: Array
    proposals: tuple[Column, ...]
    rms: Array


def statistics(columns: Array, noisy: Array, size: int, floor: Floor) -> Statistics:
    """The statistics of a recording's columns (T, R, N) (see `Problem.columns`), of which `size` last; `noisy`: the
    same with sensor noise once more."""
    own, moments = [*range(size), -1], [size + k for k in MOMENTARY]
    blocks, joints, n = -(-len(columns) // BLOCK), columns.shape[1], len(own)
    found = Statistics(
        np.zeros((joints, n, n)),
        np.zeros((blocks, joints, SMOOTH, n)),
        np.zeros((blocks, joints)),
        np.zeros((blocks, joints, len(moments), n)),
        np.zeros((blocks, joints, len(moments), len(moments))),
        np.zeros((blocks, joints, SMOOTH, len(moments))),
        np.zeros((joints, n)),
    )
    share = 2.0 * (np.arange(len(columns)) % BLOCK + 0.5) / BLOCK - 1.0
    shapes = legvander(share, SMOOTH - 1)
    for r in range(joints):
        white = whitened(columns[:, r], floor.memory[r]) / floor.white[r]
        good = np.all(np.isfinite(white), axis=1)
        added = whitened(noisy[:, r][:, own] - columns[:, r][:, own], floor.memory[r])
        added = added[good & np.all(np.isfinite(added), axis=1)]
        found.crossed[r] = np.sum(good) * added.T @ added[:, -1] / max(float(np.sum(added[:, -1] ** 2)), 1e-300)
        for b in range(blocks):
            here = np.flatnonzero(good[b * BLOCK : (b + 1) * BLOCK]) + b * BLOCK
            if not here.size:
                continue
            part = white[here]
            one, moment = part[:, own], part[:, moments]
            found.whole[r] += one.T @ one
            found.rows[b, r] = len(here)
            found.across[b, r], found.within[b, r] = moment.T @ one, moment.T @ moment
            if len(here) >= FEWEST:
                basis = np.linalg.qr(shapes[here])[0]
                found.smooth[b, r], found.waves[b, r] = basis.T @ one, basis.T @ moment
    return found


@dataclass(frozen=True)
class Machine:
    """A machine with its references, and the columns of every effect."""

    loaded: Loaded
    references: tuple[Path, ...]
    loads: dict[str, float]

    def stored(self, folder: Path, fields: Mapping[str, tuple[Path, ...]]) -> None:
        """Write `folder`/scene.npz, references.npz and one file per name of `fields` (recordings of one case)."""
        folder.mkdir(parents=True, exist_ok=True)
        clean = chosen(self.loaded, self.references, self.loads).stretches
        model = Model(self.loaded.service.machine, self.loaded.service.filters, FRICTION)
        viewer = Viewer(model, fitted_tares(model, clean))
        wanted = asked(model.machine)
        seen = looked_at(viewer, clean, wanted)
        known = np.sqrt(np.diag(model.prior.covariance))
        first = looked_at(viewer, chosen(self.loaded, next(iter(fields.values())), self.loads).stretches, wanted)
        problem = Problem(model, known, wanted, seen, first, tares=viewer.tares)  # loads have columns of their own
        floor = noise_floor(problem)
        _write(folder / "scene.npz", _scene(problem, floor)._asdict())
        again = looked_at(viewer, self._noisy(clean), wanted)
        twin, size = replace(problem, clean=again), problem.lasting
        for k, (each, noisy) in enumerate(zip(seen, again, strict=True)):
            found = statistics(problem.columns(each), twin.columns(noisy), size, floor)
            _write(folder / f"reference_{k}.npz", found._asdict())
        for name, paths in fields.items():
            stretches = chosen(self.loaded, paths, self.loads).stretches
            plain, noisier = (looked_at(viewer, group, wanted) for group in (stretches, self._noisy(stretches)))
            pairs = zip(plain, noisier, strict=True)
            parts = [statistics(problem.columns(a), problem.columns(b), size, floor) for a, b in pairs]
            _write(folder / f"{name}.npz", joined(parts)._asdict())

    def _noisy(self, recordings: Sequence[Recorded]) -> list[Recorded]:
        """The same recordings with the sensors' declared noise once more."""
        errors = np.array([s.standard_error for s in self.loaded.service.machine.signals])
        rng = np.random.default_rng(SEED)
        return [r._replace(values=r.values + errors * rng.standard_normal(r.values.shape)) for r in recordings]


def joined(parts: Sequence[Statistics]) -> Statistics:
    """Several stretches as one."""
    summed = {"whole", "crossed"}  # all others are by block
    each = {name: [getattr(p, name) for p in parts] for name in Statistics._fields}
    return Statistics(**{k: np.sum(v, axis=0) if k in summed else np.concatenate(v) for k, v in each.items()})


def _scene(problem: Problem, floor: Floor) -> Scene:
    size = problem.lasting
    pairs = zip(problem.proposals, problem.places, strict=True)
    listed = tuple(
        Column(p.name, p.at, own, p.about.low, p.about.high, p.about.sign, p.about.axes)
        for p, own in pairs
        if not isinstance(p.group[0], Incident)
    )
    moments = problem.unusual[MOMENTARY]
    return Scene(problem.first, problem.always[:size], problem.spread[:size], moments, listed, floor.rms)


def _write(path: Path, values: dict[str, Any]) -> None:
    """Large arrays in single precision, but the Gram matrices."""
    kept = {k: v.astype(np.float32) if isinstance(v, np.ndarray) and v.ndim > 3 else v for k, v in values.items()}
    if "proposals" in kept:
        kept["proposals"] = json.dumps(kept["proposals"])
    np.savez(path, allow_pickle=False, **kept)


def read_scene(folder: Path) -> Scene:
    """The scene of a machine that was stored."""
    with np.load(folder / "scene.npz") as file:
        listed = (Column(n, a, tuple(c), *rest) for n, a, c, *rest in json.loads(str(file["proposals"])))
        always, spread, unusual, rms = (file[name] for name in ("always", "spread", "unusual", "rms"))
        return Scene(int(file["parameters"]), always, spread, unusual, tuple(listed), rms)


def read_statistics(path: Path) -> Statistics:
    """A recording that was stored."""
    with np.load(path) as file:
        return Statistics(*(np.asarray(file[name], dtype=np.float64) for name in Statistics._fields))


def one_way(scene: Scene) -> tuple[Scene, Array]:
    """The scene with one more form of asymmetric friction, larger in one direction only (half a change of dry friction,
    half an asymmetry), and what makes its columns (K+1, K'+1) of those that are stored."""
    known = {(p.name, p.at): p for p in scene.proposals}
    pairs = [(known[DRY, p.at], p) for p in scene.proposals if p.name == UNEVEN and (DRY, p.at) in known]
    size, new = len(scene.spread), 2 * len(pairs)
    made, more, spread = np.zeros((size + 1, size + 1 + new)), list[Column](), []
    made[:size, :size], made[-1, -1] = np.eye(size), 1.0
    for dry, uneven in pairs:
        for sign in (1.0, -1.0):
            k = size + len(more)
            made[dry.columns[0], k], made[uneven.columns[0], k] = 0.5, 0.5 * sign
            more.append(uneven._replace(columns=(k,), low=2.0 * uneven.low, high=2.0 * uneven.high))
            spread.append(2.0 * scene.spread[uneven.columns[0]])
    return scene._replace(
        always=np.append(scene.always, NEVER * np.array(spread)),
        spread=np.append(scene.spread, spread),
        proposals=(*scene.proposals, *more),
    ), made


def made_of(each: Statistics, made: Array) -> Statistics:
    """Statistics with columns made of those that are stored."""
    return each._replace(
        whole=made.T @ each.whole @ made,
        smooth=each.smooth @ made,
        across=each.across @ made,
        crossed=each.crossed @ made,
    )
