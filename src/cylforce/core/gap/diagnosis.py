"""The diagnosis: noise floor, what the machine always was, which effects the faulty recordings have besides."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from cylforce.core.gap.correction import Applied, bends, without
from cylforce.core.gap.evidence import Blocks, Evidence
from cylforce.core.gap.library import LIBRARY, Group, Proposal, proposals
from cylforce.core.gap.problem import TEMPER, Problem, Seen
from cylforce.core.gap.rank import Ranked, magnitude, ranking
from cylforce.core.gap.rows import Recorded, Viewer
from cylforce.core.gap.whitening import Floor, floor_of
from cylforce.core.model import Model
from cylforce.words.estimate import Array

ENOUGH = 12.0  # nats
MOST = 4  # effects
MINOR = 0.04  # of the gap's energy: a lesser cause is not looked for
FOLDS = 4
NEAR = 0.6  # of the best's score
FIRST_GUESS = 0.1  # of the torque's rms: noise before anything is known
Watch = Callable[[str], None]


class Cause(NamedTuple):
    """An effect that was found: the option, its total sizes (M,), their standard errors (M,), `size` as one number,
    `score` [nats], `inflation` of the blocks' scores with it taken off, `rivals`: what else would explain the same."""

    ranked: Ranked
    sizes: Array
    errors: Array
    size: float
    score: float
    inflation: float
    rivals: tuple[Ranked, ...]


class Energy(NamedTuple):
    """Whitened sums of squares of the faulty blocks (B,): as they are, `before`, and with all causes, `after`; their
    `floor` (B,) from the clean ones; the same of the clean blocks."""

    before: Array
    after: Array
    floor: Array
    clean: Array


class Search(NamedTuple):
    """All that was found: the problem and blocks last looked at, the floor, the causes, energies; `first`: the first
    ranking; `evidence`: the last one, with all causes held."""

    original: Problem
    problem: Problem
    blocks: Blocks
    floor: Floor
    causes: tuple[Cause, ...]
    energy: Energy
    first: tuple[Ranked, ...]
    evidence: Evidence


def search(
    viewer: Viewer,
    faulty: Sequence[Recorded],
    clean: Sequence[Recorded | Seen],
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = lambda _: None,
    known: Array | None = None,
) -> Search:
    """Which effects of the library explain what the model leaves of the faulty recordings; `known` (P,): standard
    errors of the viewer's tares, by default the data sheet's."""
    wanted = proposals(viewer.model.machine, library)
    watch("columns of every effect")
    seen = [looked_at(viewer, group, wanted) for group in (clean, faulty)]
    spread = np.sqrt(np.diag(viewer.model.prior.covariance)) if known is None else known
    problem = Problem(viewer.model, spread, wanted, *seen)
    floor = noise_floor(problem)
    blocks = problem.blocks(floor)
    return _greedy(viewer, problem, blocks, floor, list(faulty), watch)


def looked_at(viewer: Viewer, group: Sequence[Recorded | Seen], wanted: Sequence[Proposal]) -> tuple[Seen, ...]:
    """Recordings with their rows; those that have them keep them, if they were computed for the same proposals."""
    return tuple(r if isinstance(r, Seen) else Seen(r, viewer.rows(r, wanted)) for r in group)


def fitted_tares(model: Model, clean: Sequence[Recorded]) -> Array:
    """Parameters (P,) by least squares of clean recordings, the data sheet as prior."""
    viewer = Viewer(model, np.zeros(len(model.parameters)))
    information = np.linalg.inv(model.prior.covariance)
    score = information @ model.prior.mean
    rows = [viewer.rows(r, ()) for r in clean]
    size = FIRST_GUESS * np.sqrt(np.nanmean(np.concatenate([r.left for r in rows]) ** 2, axis=0)) + 1e-9
    for recorded, seen in zip(clean, rows, strict=True):
        left = seen.left - (seen.base @ model.load[:, 0]) * recorded.load
        for r in range(left.shape[1]):
            good = np.isfinite(left[:, r])
            columns = seen.base[good, r] / size[r]
            information = information + columns.T @ columns
            score = score + columns.T @ (left[good, r] / size[r])
    return np.asarray(np.linalg.solve(information, score))


def noise_floor(problem: Problem) -> Floor:
    """From the clean recordings' residual, all lasting columns fitted; without clean ones, the faulty ones'."""
    held = problem.clean or problem.faulty
    columns = [problem.columns(seen) for seen in held]
    scale = FIRST_GUESS * np.sqrt(np.nanmean(np.concatenate([c[..., -1] for c in columns]) ** 2, axis=0)) + 1e-9
    size, rows = problem.lasting, columns[0].shape[1]
    prior = np.diag(problem.spread[:size] ** -2.0)
    floor = Floor(scale, np.zeros((rows, 1)), scale)
    for _ in range(2):
        gram = np.zeros((size, size + 1))
        for c in columns:
            gram += _normal(c, floor, size)
        values = np.linalg.solve(gram[:, :-1] + prior, gram[:, -1])
        floor = floor_of([c[..., -1] - c[..., :size] @ values for c in columns])
    return floor


def _normal(columns: Array, floor: Floor, size: int) -> Array:
    chosen = np.concatenate([columns[..., :size], columns[..., -1:]], axis=-1)
    found = np.zeros((size + 1, size + 1))
    for r in range(columns.shape[1]):
        good = np.all(np.isfinite(chosen[:, r]), axis=1)
        part = chosen[good, r] / floor.rms[r]
        found += part.T @ part
    return found[:-1]


def _greedy(
    viewer: Viewer, problem: Problem, blocks: Blocks, floor: Floor, original: list[Recorded], watch: Watch
) -> Search:
    first_problem = problem
    held: list[Ranked] = []
    applied: dict[int, Array] = {}
    rivals: list[tuple[Ranked, ...]] = []
    base = Evidence(blocks)
    _, before = base.squares((), base.fitted)
    usual = _usual(blocks)
    first: tuple[Ranked, ...] = ()
    for step in range(MOST):
        watch(f"search, step {step + 1}")
        evidence = Evidence(blocks, [r.option.term for r in held])
        ranked = ranking(problem, evidence, besides=held)
        first = first or tuple(ranked)
        worth = MINOR * float(np.sum(before) - np.sum(usual)) / (2.0 * TEMPER)
        if not ranked or ranked[0].score < max(ENOUGH, worth):
            break
        best, others = ranked[0], tuple(r for r in ranked[1:] if r.score > NEAR * ranked[0].score)
        held.append(best)
        rivals.append(others)
        if bends(best.option):
            applied = _sizes(blocks, held, applied)
            problem = without(problem, viewer, _bending(held, applied), original)
            blocks = problem.blocks(floor)
    evidence = Evidence(blocks, [r.option.term for r in held])
    clean, after = evidence.squares(evidence.held, evidence.fitted)
    energy = Energy(before, after, usual, clean)
    causes = _causes(blocks, held, rivals, applied, evidence)
    return Search(first_problem, problem, blocks, floor, causes, energy, first, evidence)


def _usual(blocks: Blocks) -> Array:
    """Whitened sums of squares (B,) that faulty blocks would have if they were clean: as clean blocks have them when
    nothing is fitted to them (every fold predicted from the others)."""
    count = len(blocks.clean)
    if count < 2 * FOLDS:
        return np.asarray(blocks.faulty_rows, dtype=np.float64)
    fold = np.arange(count) * 4 * FOLDS // count % FOLDS
    left = np.zeros(count)
    for k in range(FOLDS):
        weight = np.concatenate([np.where(fold == k, 0.0, 1.0), np.zeros(len(blocks.faulty))])
        evidence = Evidence(blocks, weight=weight)
        left = np.where(fold == k, evidence.squares((), evidence.fitted)[0], left)
    good = blocks.clean_rows > 0.0
    return np.asarray(np.sum(left[good]) / np.sum(blocks.clean_rows) * blocks.faulty_rows)


def _sizes(blocks: Blocks, held: Sequence[Ranked], applied: dict[int, Array]) -> dict[int, Array]:
    """Total sizes of all held terms: what is taken out already and what is left of it."""
    evidence = Evidence(blocks, [r.option.term for r in held])
    k, found = len(blocks.shared), dict(applied)
    for n, r in enumerate(held):
        m = len(r.option.term.columns)
        if bends(r.option):
            found[n] = found.get(n, np.zeros(m)) + evidence.fitted[k : k + m]
        k += m
    return found


def _bending(held: Sequence[Ranked], applied: dict[int, Array]) -> list[Applied]:
    return [Applied(held[n].option, sizes) for n, sizes in applied.items()]


def _causes(
    blocks: Blocks,
    held: Sequence[Ranked],
    rivals: Sequence[tuple[Ranked, ...]],
    applied: dict[int, Array],
    evidence: Evidence,
) -> tuple[Cause, ...]:
    found, k = [], len(blocks.shared)
    for n, r in enumerate(held):
        m = len(r.option.term.columns)
        others = Evidence(blocks, [o.option.term for o in held if o is not r])
        told = others.of(r.option.term, TEMPER)
        sizes = evidence.fitted[k : k + m] + applied.get(n, np.zeros(m))
        errors = np.sqrt(np.diag(told.covariance))
        found.append(Cause(r, sizes, errors, magnitude(r, sizes), r.score, told.inflation, rivals[n]))
        k += m
    return tuple(found)
