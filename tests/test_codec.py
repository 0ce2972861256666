"""Values at the ends of what a field can carry."""

import numpy as np
import pytest

from cylforce.signals.codec import decode, encode
from cylforce.signals.layout import CODES, Field, Pdo

WIDE = 1e30


def pdo(code, *, low=-WIDE, high=WIDE, scale=0.5, offset=3.0):
    return Pdo(0x181, 1, 1, False, 0, 0.01, (Field("x", 0x6000, 1, code, scale, offset, "", low, high),))


def there_and_back(one, value):
    return decode(one, encode(one, {"x": value}))["x"]


@pytest.mark.parametrize("code", [code for code in CODES if code != "f"])
def test_every_integer_but_one_carries_a_value(code):
    bits = 8 * CODES[code]
    least, most = (0, 2**bits - 2) if code.isupper() else (1 - 2 ** (bits - 1), 2 ** (bits - 1) - 1)
    for raw in (least, most):
        assert there_and_back(pdo(code), 0.5 * raw + 3.0) == pytest.approx(0.5 * raw + 3.0, rel=1e-15)
    for raw in (least - 1, most + 1):
        assert np.isnan(there_and_back(pdo(code), 0.5 * raw + 3.0))


def test_the_ends_of_the_declared_range_are_in_it():
    one = pdo("h", low=-2.0, high=8.0)
    assert [there_and_back(one, x) for x in (-2.0, 8.0)] == [-2.0, 8.0]
    assert np.isnan([there_and_back(one, x) for x in (-2.5, 8.5, np.nan, np.inf)]).all()


def test_a_value_is_rounded_to_the_nearest_step():
    assert [there_and_back(pdo("b"), x) for x in (3.2, 3.3)] == [3.0, 3.5]
