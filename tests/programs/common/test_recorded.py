"""What the diagnosis looks at of recordings of any length: all of short ones, of long ones a bounded number of
stretches, spread evenly, each with the time at which it begins."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cylforce.estimation.segments import Part, parts, stretches
from cylforce.files.tables import Table, write_table
from cylforce.programs.common.recorded import PART_S, SHORTEST_S, chosen
from cylforce.programs.common.spread import Kept, Spread
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR

MOST, SIZE, LEAST, LONGEST = 6, 10, 4, 2
LOADED = load(EXCAVATOR)
RATE = LOADED.service.filters.rate_hz


def samples(length, missing):
    """Rows that tell their number; some are missing."""
    values = np.arange(length, dtype=float)[:, None] + [0.0, 1000.0]
    values[[k for k in missing if k < length]] = np.nan
    return values


@given(st.integers(1, 120), st.sets(st.integers(0, 119), max_size=40), st.sets(st.integers(1, 119), max_size=8))
def test_parts_of_pieces_are_the_stretches_of_the_whole(length, missing, cuts):
    """Wherever the recording is cut in pieces."""
    values = samples(length, missing)
    ends = [0, *sorted(cut for cut in cuts if cut < length), length]
    found: list[Part] = []
    for part in parts((values[a:b] for a, b in pairwise(ends)), LONGEST, SIZE, LEAST):
        assert LEAST <= len(part.values) < SIZE + LEAST
        if part.goes_on:
            assert part.first == found[-1].first + len(found[-1].values)
            found[-1] = Part(found[-1].first, np.concatenate([found[-1].values, part.values]), found[-1].goes_on)
        else:
            found.append(part)
    wanted = [(first, stretch) for first, stretch in stretches(values, LONGEST) if len(stretch) >= LEAST]
    assert [part.first for part in found] == [first for first, _ in wanted]
    for part, (_, stretch) in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(part.values, stretch)


def spread(*counts):
    """What is kept of recordings of so many parts, as numbers of parts."""
    found = Spread(MOST)
    for recording, count in enumerate(counts):
        for number in range(count):
            rows = samples(SIZE * (number + 1), ())[SIZE * number :]
            found.add(Kept(recording, number, Part(SIZE * number, rows, goes_on=number > 0)))
    kept = [list(found.of(recording)) for recording in range(len(counts))]
    return [[n for part in own for n in (part.values[::SIZE, 0] / SIZE).astype(int).tolist()] for own in kept], kept


@given(st.lists(st.integers(0, 60), min_size=1, max_size=20))
def test_what_is_kept_is_bounded_and_evenly_spread(counts):
    numbers, kept = spread(*counts)
    assert sum(map(len, numbers)) <= MOST
    for own, count in zip(numbers, counts, strict=True):
        assert len(set(np.diff(own))) <= 1
        assert not own or (own[0] == 0 and count - 1 - own[-1] < 2 * max(np.diff(own), default=count))
    assert sum(counts) <= MOST or sum(map(len, numbers)) > MOST // 3
    assert all(len(own) == 1 for own, count in zip(kept, counts, strict=True) if count > 0 and sum(counts) <= MOST)


def test_a_short_recording_beside_long_ones_is_kept_whole():
    assert spread(2, 40, 2)[0][::2] == [[0, 1], [0, 1]]
    assert spread(40, 3)[0][1] == [0, 1, 2]


def table(path, seconds, begins=0.0, gap=slice(0, 0)):
    """A recording of constant readings, but for the oil's temperature, which tells the time."""
    signals = LOADED.service.machine.signals
    t_s = begins + np.arange(int(seconds * RATE)) / RATE
    values = np.tile([(s.low + s.high) / 2.0 for s in signals], (len(t_s), 1))
    values[:, 0] = t_s
    values[gap] = np.nan
    write_table(path, Table(t_s, values, tuple(s.name for s in signals)))
    return values


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_all_of_a_short_recording_is_looked_at(tmp_path, suffix):
    path = tmp_path / f"run{suffix}"
    values = table(path, 2.5 * PART_S, begins=130.0)
    found = chosen(LOADED, [path], {path.name: 900.0})
    (whole,) = found.stretches
    np.testing.assert_array_equal(whole.values, values)
    assert (whole.name, whole.load_kg, whole.begins_s) == (path.name, 900.0, 130.0)
    assert found.looked_at == [(path.name, 2.5 * PART_S, 2.5 * PART_S, 1)]


def test_of_a_long_one_stretches_that_begin_when_they_did(tmp_path):
    long, short = tmp_path / "long.parquet", tmp_path / "short.parquet"
    table(long, 11.5 * PART_S, begins=7.0, gap=slice(int(2.2 * PART_S * RATE), int(2.3 * PART_S * RATE)))
    table(short, SHORTEST_S + 1.0)
    found = chosen(LOADED, [long, short], {}, most=4)
    assert sum(len(r.values) for r in found.stretches) / RATE <= 4 * (PART_S + SHORTEST_S)
    for r in found.stretches:
        np.testing.assert_allclose(r.values[:, 0], r.begins_s + np.arange(len(r.values)) / RATE, atol=1e-6)
    begins = np.array([r.begins_s for r in found.stretches if r.name == long.name])
    assert begins[0] == 7.0
    assert np.all(np.diff(begins) > 2.0 * PART_S)
    told = {each.name: each for each in found.looked_at}
    assert told[short.name].seconds == told[short.name].of_seconds == SHORTEST_S + 1.0
    assert told[long.name].seconds < 0.5 * told[long.name].of_seconds == 0.5 * 11.5 * PART_S
    assert told[long.name].stretches == len(begins) >= 2
