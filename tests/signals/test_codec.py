"""Values at the ends of what a field can carry."""

import struct

import numpy as np
import pytest

from cylforce.signals.codec import decode, decoders, encode, layout
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


@pytest.mark.parametrize(("low", "high"), [(-2.0, 8.0), (-WIDE, WIDE)], ids=["narrow", "wide"])
def test_a_value_is_its_steps_above_the_offset_little_endian(low, high):
    """5 is 4 steps of 0.5 above 3, -1 is 8 below; where the range is wider than the integers, too."""
    one = pdo("h", low=low, high=high)
    assert encode(one, {"x": 5.0}) == b"\x04\x00"
    assert encode(one, {"x": -1.0}) == (-8).to_bytes(2, "little", signed=True)
    assert encode(one, {}) == encode(one, {"x": np.inf}) == b"\x00\x80"


def test_a_value_far_beyond_the_integers_is_none():
    for code in (code for code in CODES if code != "f"):
        for value in (1e20, -1e20):
            assert np.isnan(there_and_back(pdo(code), value))


def test_a_real_number_is_sent_as_one():
    one = pdo("f", scale=2.0, offset=1.0, low=-10.0, high=10.0)
    assert struct.unpack("<f", encode(one, {"x": 6.0})) == (2.5,)
    assert decode(one, struct.pack("<f", 2.5)) == {"x": 6.0}
    for value in (np.nan, 10.5, -10.5):
        assert np.isnan(struct.unpack("<f", encode(one, {"x": value}))).all()


@pytest.mark.parametrize(
    ("low", "high", "offset", "fits"),
    [
        (-63.5, 63.5, 0.0, True),
        (-64.0, 63.5, 0.0, True),  # the least is what means "no value"
        (-64.5, 63.5, 0.0, False),
        (-63.5, 64.0, 0.0, False),
        (-WIDE, WIDE, 0.0, False),
        (0.0, np.inf, 0.0, False),
        (-1.0, 1.0, 3.0, False),
    ],
)
def test_values_that_all_have_an_integer_need_no_second_look(low, high, offset, fits):
    """-127 to 127 steps of half; a float never."""
    (field,) = layout(pdo("b", low=low, high=high, offset=offset)).fields
    assert field.fits is fits
    (real,) = layout(pdo("f", low=-1.0, high=1.0, offset=0.0)).fields
    assert not real.fits


def test_unused_bytes_are_zero_and_carry_nothing():
    fields = (Field(None, 0, 0, "B", 1.0, 0.0, "", 0.0, 255.0), *pdo("h", low=-2.0, high=8.0).fields)
    both = pdo("h")._replace(fields=fields)
    assert encode(both, {"x": 5.0}) == b"\x00\x04\x00"
    assert decode(both, b"\x07\x04\x00") == {"x": 5.0}


def test_a_decoder_has_a_slot_for_each_signal_that_is_known():
    names = ("a", None, "b", "c")
    codes = ("h", "B", "f", "H")
    fields = tuple(
        Field(name, 0x6000, k, code, 0.5 + k, 3.0 - k, "", -1.0 - k, 9.0 + k)
        for k, (name, code) in enumerate(zip(names, codes, strict=True))
    )
    found = decoders((pdo("h")._replace(fields=fields, node_id=5),), {"b": 7, "c": 2})
    decoder = found[0x181]
    assert [(s.signal, s.item, s.scale, s.offset, s.low, s.high) for s in decoder.slots] == [
        (7, 2, 2.5, 1.0, -3.0, 11.0),
        (2, 3, 3.5, 0.0, -4.0, 12.0),
    ]
    assert (decoder.node_id, decoder.struct.format) == (5, "<hBfH")
    assert decoder.missing == (-(1 << 15), 255, None, (1 << 16) - 1)
