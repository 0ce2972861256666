"""What is stored is stored whole, and read as it was: states as JSON, files that are replaced."""

from array import array
from math import inf, isnan, nan
from typing import NamedTuple

import numpy as np
import pytest
from pydantic import JsonValue, TypeAdapter

from cylforce.files.atomic import RecordingError, check_outputs, replacing
from cylforce.files.checkpoint import packed, unpacked
from cylforce.signals.estimate import Reason


class Part(NamedTuple):
    """All that a state may consist of."""

    numbers: tuple[float, ...]
    table: np.ndarray
    plain: array
    data: bytes
    reason: Reason


def stored(part):
    """What comes back, by way of a text."""
    text = TypeAdapter(JsonValue).dump_json(packed(part))
    return unpacked(Part, TypeAdapter(JsonValue).validate_json(text))


TABLE = np.arange(12.0).reshape(3, 4) / 7.0


@pytest.mark.parametrize(
    "table", [TABLE, np.asfortranarray(TABLE), TABLE[0], TABLE > 1.0, np.arange(3), np.zeros((0, 2))], ids=range(6)
)
def test_a_state_comes_back_bit_by_bit(table):
    """Also in the order of its elements in memory, on which rounding depends."""
    part = Part((1.0 / 3.0, inf, -inf), table, array("d", [0.1, -2.5]), b"\x00\xff", Reason.TILT)
    back = stored(part)
    assert back.numbers == part.numbers
    assert back.table.dtype == table.dtype
    assert back.table.shape == table.shape
    assert back.table.tobytes("A") == table.tobytes("A")
    assert back.table.flags.f_contiguous == table.flags.f_contiguous
    assert (back.plain, back.plain.typecode, back.data) == (part.plain, "d", part.data)
    assert back.reason is Reason.TILT


def test_no_number_is_one_afterwards_either():
    assert isnan(stored(Part((nan,), TABLE, array("d"), b"", Reason.NONE)).numbers[0])


def test_no_file_is_named_twice(tmp_path):
    one, other = tmp_path / "one.csv", tmp_path / "other.csv"
    check_outputs([one, None, other], inputs=[tmp_path / "in.csv", None])
    for outputs, inputs in (([one, one], []), ([one], [one]), ([one], [tmp_path / "." / "one.csv"])):
        with pytest.raises(RecordingError, match="would replace"):
            check_outputs(outputs, inputs=inputs)


def test_a_file_of_another_kind_is_kept(tmp_path):
    kept = tmp_path / "work.log"
    check_outputs([kept], suffixes=[".csv"])
    kept.write_text("a recording")
    with pytest.raises(RecordingError, match=r"is no \.csv file"):
        check_outputs([kept], suffixes=[".csv"])
    check_outputs([kept], suffixes=[".log"])


def half_written(path):
    with replacing(path) as temporary:
        temporary.write_text("half of the n")
        raise ZeroDivisionError


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path):
    path = tmp_path / "kept.json"
    with replacing(path) as temporary:
        temporary.write_text("old")
    with pytest.raises(ZeroDivisionError):
        half_written(path)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["kept.json"]
    with replacing(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
    assert path.read_text() == "new"
