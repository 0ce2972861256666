"""The diagnosis: noise floor, what the machine always was, which effects the faulty recordings have besides."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from cylforce.core.gap.correction import Applied, bends, without
from cylforce.core.gap.evidence import Blocks, Evidence
from cylforce.core.gap.library import LIBRARY, Group, proposals
from cylforce.core.gap.problem import TEMPER, Problem, Seen
from cylforce.core.gap.rank import Ranked, magnitude, ranking
from cylforce.core.gap.rows import Recorded, Viewer
from cylforce.core.gap.whitening import Floor, floor_of
from cylforce.words.estimate import Array

ENOUGH = 12.0  # nats
MOST = 4  # effects
RIVALS = 3  # that are looked at again, each with its own size taken out
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
    clean: Sequence[Recorded],
    library: tuple[Group, ...] = LIBRARY,
    watch: Watch = lambda _: None,
) -> Search:
    """Which effects of the library explain what the model leaves of the faulty recordings."""
    wanted = proposals(viewer.model.machine, library)
    watch("columns of every effect")
    seen = [[Seen(r, viewer.rows(r, wanted)) for r in group] for group in (clean, faulty)]
    problem = Problem(viewer.model, wanted, tuple(seen[0]), tuple(seen[1]))
    floor = noise_floor(problem)
    blocks = problem.blocks(floor)
    return _greedy(viewer, problem, blocks, floor, list(faulty), watch)


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
    first: tuple[Ranked, ...] = ()
    for step in range(MOST):
        watch(f"search, step {step + 1}")
        evidence = Evidence(blocks, [r.option.term for r in held])
        ranked = ranking(problem, evidence, besides=held)
        first = first or tuple(ranked)
        if not ranked or ranked[0].score < ENOUGH:
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
    usual = np.sum(clean) / max(np.sum(blocks.clean_rows), 1.0) if len(clean) else 1.0
    energy = Energy(before, after, usual * blocks.faulty_rows, clean)
    causes = _causes(blocks, held, rivals, applied, evidence)
    return Search(first_problem, problem, blocks, floor, causes, energy, first, evidence)


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
