"""Sizes against the textbook's, computed from all rows, which the Gram matrices never see."""

import numpy as np
import pytest

from cylforce.diagnosis.evidence import Blocks, Evidence, Term

ROWS, SPREAD, ALWAYS = 20, 1.5, 0.7


def grams(columns):
    """Of blocks of rows (B, ROWS, K+1)."""
    return np.einsum("bri,brj->bij", columns, columns)


@pytest.mark.parametrize("size", [0.0, 2.0], ids=["absent", "present"])
def test_sizes_are_those_of_bayesian_least_squares(size):
    """White noise of variance one; a nuisance in clean and faulty rows, known to 0.7; an effect in the faulty ones
    alone, known to 1.5 beforehand."""
    rng = np.random.default_rng(5)
    both = rng.standard_normal((5, ROWS, 2))
    clean, faulty = both[:2], both[2:]
    x = np.concatenate([np.zeros(2 * ROWS), faulty[..., 1].ravel()])
    b = both[..., 0].ravel()
    y = 0.5 * b + size * x + rng.standard_normal(len(x))
    left = y.reshape(5, ROWS, 1)
    blocks = Blocks(
        grams(np.concatenate([clean, left[:2]], axis=-1)),
        grams(np.concatenate([faulty, left[2:]], axis=-1)),
        np.full(2, float(ROWS)),
        np.full(3, float(ROWS)),
        np.array([1.0, SPREAD]),
        np.array([ALWAYS, 1.0]),
        (0,),
    )
    found = Evidence(blocks, [Term((1,), np.ones((1, 3)))])
    design = np.stack([b, x], axis=-1)
    precision = design.T @ design + np.diag([ALWAYS**-2.0, SPREAD**-2.0])
    np.testing.assert_allclose(found.fitted, np.linalg.solve(precision, design.T @ y), rtol=1e-9)
    np.testing.assert_allclose(found.covariance, np.linalg.inv(precision), rtol=1e-9)
