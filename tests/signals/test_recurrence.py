"""Recurrences along samples, followed block by block, are those followed sample by sample."""

import numpy as np
import pytest

from cylforce.signals.recurrence import clipped, followed


def one_by_one(step, count):
    z, found = 0.0, []
    for k in range(count):
        z = step(z, k)
        found.append(z)
    return np.array(found)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 99, 100, 101, 5000])
@pytest.mark.parametrize("size", [1e-3, 0.3, 1e3])
def test_as_sample_by_sample(count, size):
    rng = np.random.default_rng((count, 5))
    steps, aims, kept = size * rng.normal(size=count), rng.normal(size=count), rng.uniform(size=count)
    kept[::7], kept[3::7] = 0.0, 1.0
    play = one_by_one(lambda z, k: min(max(z + steps[k], -0.5), 0.5), count)
    np.testing.assert_allclose(clipped(steps, 0.5), play, rtol=0, atol=1e-12 * max(size, 1.0))
    aimed = one_by_one(lambda z, k: aims[k] + (z - aims[k]) * kept[k], count)
    np.testing.assert_allclose(followed(aims, kept), aimed, rtol=0, atol=1e-12)


def test_a_play_stands_still_until_it_is_crossed():
    np.testing.assert_array_equal(clipped(np.array([3.0, -0.5, 0.25, -0.25, -9.0]), 1.0), [1.0, 0.5, 0.75, 0.5, -1.0])
