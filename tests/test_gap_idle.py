"""Recordings of a machine in order that was at work: blocks with a load or with contact do not count."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cylforce.diagnosis.columns.rows import BLOCK
from cylforce.diagnosis.inference.idle import LOADS, TIPS, _at_rest
from cylforce.effects.fault import INCIDENTAL

OWN, ROWS, COUNT = 6, 3, 40


def _made(rng: np.random.Generator, load: float, force: float) -> tuple[Any, "np.ndarray[Any, Any]"]:
    """A problem, and blocks of three joints: in the second quarter a load hangs, in the third a force acts."""
    usual = np.ones(len(INCIDENTAL))
    usual[list(LOADS)], usual[list(TIPS)] = (500.0, 300.0, 300.0), 8e3
    problem = SimpleNamespace(lasting=OWN, spread=np.ones(OWN), unusual=usual)
    blocks = np.zeros((COUNT, BLOCK, ROWS, OWN + len(INCIDENTAL) + 1))
    blocks[..., :OWN] = 500.0 * rng.standard_normal((COUNT, BLOCK, ROWS, OWN))
    lever = np.array([7.0, 4.0, 1.2]) * (1.0 + 0.2 * rng.standard_normal((COUNT, BLOCK, 1)))
    blocks[..., OWN + LOADS[0]], blocks[..., OWN + TIPS[0]] = 9.81 * lever, lever
    left = blocks[..., :OWN] @ rng.standard_normal(OWN) + 200.0 * rng.standard_normal((COUNT, BLOCK, ROWS))
    left[COUNT // 4 : COUNT // 2] += load * blocks[COUNT // 4 : COUNT // 2, ..., OWN + LOADS[0]]
    left[COUNT // 2 : 3 * COUNT // 4] += force * blocks[COUNT // 2 : 3 * COUNT // 4, ..., OWN + TIPS[0]]
    blocks[..., -1] = left
    return problem, blocks


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_blocks_at_work_do_not_count(seed: int) -> None:
    kept = _at_rest(*_made(np.random.default_rng(seed), 900.0, 2e4))
    work = np.arange(COUNT) // (COUNT // 4)
    assert np.array_equal(kept, (work == 0) | (work == 3))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_blocks_count_of_a_machine_that_does_not_work(seed: int) -> None:
    assert np.all(_at_rest(*_made(np.random.default_rng(seed), 0.0, 0.0)))


def test_blocks_that_tell_nothing_are_no_work() -> None:
    """A recording that rests between its steps is not at work there."""
    problem, blocks = _made(np.random.default_rng(1), 900.0, 2e4)
    blocks[: COUNT // 8] = 0.0
    work = np.arange(COUNT) // (COUNT // 4)
    assert np.array_equal(_at_rest(problem, blocks), (work == 0) | (work == 3))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_machine_that_works_most_of_the_time_is_found_in_the_rest(seed: int) -> None:
    """Digging cycles are free of load and contact for a quarter to a third of the time."""
    rng = np.random.default_rng(seed)
    problem, blocks = _made(rng, 0.0, 0.0)
    quiet = np.isin(np.arange(COUNT), rng.permutation(COUNT)[: int(0.3 * COUNT)])
    load, force = rng.uniform(500.0, 1500.0, COUNT), rng.uniform(1e4, 1e5, COUNT)
    added = load[:, None, None] * blocks[..., OWN + LOADS[0]]
    added = np.where(rng.random(COUNT)[:, None, None] < 0.5, added, force[:, None, None] * blocks[..., OWN + TIPS[0]])
    blocks[..., -1] += np.where(quiet[:, None, None], 0.0, added)
    assert np.array_equal(_at_rest(problem, blocks), quiet)


def test_what_a_poor_quarter_does_not_tell_of_the_machine_is_no_work() -> None:
    """The quarter with which the search begins moves one joint; in the others the machine shows what it tells there."""
    rng = np.random.default_rng(4)
    problem, blocks = _made(rng, 0.0, 0.0)
    own, values = blocks[..., :OWN], 3.0 * rng.standard_normal(OWN)
    own[: COUNT // 3, ..., OWN // 2 :] = 0.0
    blocks[..., -1] = own @ values + 200.0 * rng.standard_normal(blocks.shape[:3])
    blocks[: COUNT // 3, ..., -1] = own[: COUNT // 3] @ values + 150.0 * rng.standard_normal((COUNT // 3, BLOCK, ROWS))
    assert np.all(_at_rest(problem, blocks))


@pytest.mark.parametrize("rows", [1, OWN])
def test_a_joint_of_which_a_quarter_has_hardly_a_row_is_not_fitted_exactly_there(rows: int) -> None:
    """As many rows as columns show no noise: beside none, all else was work, or the sums were singular."""
    problem, blocks = _made(np.random.default_rng(5), 0.0, 0.0)
    values = np.random.default_rng(6).standard_normal(OWN)
    blocks[: COUNT // 2, :, 0] = 0.0
    blocks[0, :rows, 0, :OWN] = 500.0 * np.random.default_rng(7).standard_normal((rows, OWN))
    blocks[..., -1] = blocks[..., :OWN] @ values
    noise = 200.0 * np.random.default_rng(8).standard_normal(blocks.shape[:3])
    noise[: COUNT // 2] *= 0.1
    blocks[..., -1] += np.where(np.any(blocks[..., :OWN] != 0.0, axis=-1), noise, 0.0)
    assert np.all(_at_rest(problem, blocks))
