"""Evidence against the textbook's: the logarithm of how much likelier the data are with an effect than without,
computed from the data's whole covariance, which the Gram matrices never see."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from cylforce.diagnosis.evidence import Blocks, Evidence, Term

ROWS, SPREAD, ALWAYS = 20, 1.5, 0.7


def grams(columns):
    """Of blocks of rows (B, ROWS, K+1)."""
    return np.einsum("bri,brj->bij", columns, columns)


@pytest.mark.parametrize("size", [0.0, 2.0], ids=["absent", "present"])
def test_evidence_is_the_logarithm_of_the_odds_of_the_data(size):
    """White noise of variance one; a nuisance in clean and faulty rows, known to 0.7; an effect in the faulty ones
    alone, known to 1.5 beforehand. y ~ N(0, 1 + 0.7^2 b b' [+ 1.5^2 x x'])."""
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
    told = Evidence(blocks).of(Term((1,), np.ones((1, 3))), temper=1.0)
    without = np.eye(len(y)) + ALWAYS**2 * np.outer(b, b)
    odds = [multivariate_normal(cov=c).logpdf(y) for c in (without + SPREAD**2 * np.outer(x, x), without)]
    assert told.evidence == pytest.approx(odds[0] - odds[1], rel=1e-6)
    assert (told.evidence > 0.0) is (size > 0.0)
    assert abs(told.value[0] - size) < 3.0 * told.covariance[0, 0] ** 0.5
