"""Tables are read back as they were written, foreign ones by a mapping; what is wrong has its line."""

import sys
import time
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cylforce.files.atomic import RecordingError, replacing
from cylforce.files.cells import ROWS
from cylforce.files.tables import (
    ColumnMap,
    Table,
    TableMap,
    read_table,
    resample,
    resampled,
    table_pieces,
    write_table,
)

SUFFIXES = (".csv", ".parquet")
SIGNALS = ("boom head", "Kolben, äußerer", 'stick "angle"')


def table(t_s, *columns, signals=SIGNALS):
    return Table(np.asarray(t_s, float), np.column_stack(columns).astype(float), signals[: len(columns)])


def assert_equal(one, other):
    assert one.signals == other.signals
    np.testing.assert_array_equal(one.t_s, other.t_s)
    np.testing.assert_array_equal(one.values, other.values)


def written(folder, text, name="run.csv", encoding="utf-8"):
    path = folder / name
    path.write_text(text, encoding=encoding)
    return path


TABLES = st.integers(2, 12).flatmap(
    lambda rows: st.tuples(
        arrays(float, rows, elements=st.floats(-1e6, 1e6), unique=True).map(np.sort),
        arrays(float, (rows, 3), elements=st.floats(allow_infinity=False)),
    )
)


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=60, deadline=None)
@given(TABLES)
def test_what_is_written_is_read_back_exactly(tmp_path_factory, suffix, content):
    path = tmp_path_factory.mktemp("table") / f"run{suffix}"
    original = Table(*content, SIGNALS)
    write_table(path, original)
    assert_equal(read_table(path, SIGNALS), original)
    assert_equal(read_table(path, SIGNALS[::-1]), Table(original.t_s, original.values[:, ::-1], SIGNALS[::-1]))
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_a_mapping_gives_names_units_and_signs(tmp_path):
    path = written(tmp_path, "time;MainPaCyl;unused;q;t_oil\n0;10;x;1;20\n10;20;;2;30\n")
    mapping = TableMap("time", 1e-3, (ColumnMap("head", "MainPaCyl", 1e5, 101325.0), ColumnMap("rod", "q", -2.0, 0.0)))
    found = read_table(path, ("rod", "t_oil", "head"), mapping)
    assert_equal(
        found,
        Table(
            np.array([0.0, 0.01]),
            np.array([[-2, 20, 1101325], [-4, 30, 2101325.0]]),
            ("rod", "t_oil", "head"),
        ),
    )


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_forms_of_csv(tmp_path, delimiter, end, mark):
    rows = [
        ["t_s", ' "a" '],
        ["0", " 1.5e3"],
        ["0.01", ""],
        [],
        ["0.02", "nan"],
        ["0.03", '"-2"'],
    ]
    path = tmp_path / "run.csv"
    path.write_bytes((mark + end.join(delimiter.join(row) for row in rows) + end).encode())
    assert_equal(read_table(path, ["a"]), table([0, 0.01, 0.02, 0.03], [1500, np.nan, np.nan, -2], signals=("a",)))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "has no column t_s, a; it has none at all"),
        ("t_s,b\n0,1\n1,2\n", "has no column a; it has t_s, b"),
        ("t_s,a,a\n0,1,1\n1,2,1\n", "has several columns named a; give each a name of its own"),
        ("t_s,a\n", "holds 0 rows, at least two are needed"),
        ("t_s,a\n0,1\n", "holds 1 rows, at least two are needed"),
        ("t_s,a\n0,1\n\n1,x\n2,3\n", "line 4: column 'a' holds 'x', no number"),
        ("t_s;a\n0;1,5\n", "line 2: column 'a' holds '1,5', no number"),
        ("t_s,a\n0,1\n1,2,3\n", "line 3: has 3 cells, the header has 2"),
        ("t_s,a\n0,1\n\n1,2\n1,3\n", "line 5: time (column 't_s') does not increase: sort the rows"),
        ("t_s,a\n0,1\n-1,2\n1,3\n", "line 3: time (column 't_s') does not increase: sort the rows"),
        ("t_s,a\n0,1\n,2\n1,3\n", "line 3: time (column 't_s') is empty or not a number: delete the row"),
        ("t_s,a\n0,1\n1,-inf\n", "line 3: column 'a' is infinite"),
    ],
)
def test_a_csv_that_cannot_be_used_says_why(tmp_path, text, sentence):
    path = written(tmp_path, text)
    with pytest.raises(RecordingError) as refused:
        read_table(path, ["a"])
    assert str(refused.value).startswith(str(path))
    assert str(refused.value).endswith(sentence)


def test_files_that_are_no_table(tmp_path):
    with pytest.raises(RecordingError, match=r"run\.csv: is not UTF-8 text"):
        read_table(written(tmp_path, "t_s,ä\n0,1\n", encoding="latin-1"), ["a"])
    for suffix in SUFFIXES:
        with pytest.raises(RecordingError, match=rf"absent\{suffix}: cannot be read: No such file"):
            read_table(tmp_path / f"absent{suffix}", ["a"])
    with pytest.raises(RecordingError, match=r"run\.parquet: is no Parquet file"):
        read_table(written(tmp_path, "t_s,a\n0,1\n1,2\n", "run.parquet"), ["a"])


def test_columns_of_parquet(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    path = tmp_path / "run.parquet"
    columns = {"t_s": [0, 1, 2], "a": [1, None, 3], "b": ["x", "y", "z"], "c": [1.0, 2.0, float("inf")]}
    pq.write_table(pa.table(columns), path)
    assert_equal(read_table(path, ["a"]), table([0, 1, 2], [1, np.nan, 3], signals=("a",)))
    for name, sentence in (
        ("b", "column 'b' holds string, not numbers"),
        ("c", "row 3: column 'c' is infinite"),
        ("d", "has no column d; it has t_s, a, b, c"),
    ):
        with pytest.raises(RecordingError) as refused:
            read_table(path, [name])
        assert str(refused.value).endswith(sentence)


def test_without_pyarrow_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    for attempt in (lambda p: read_table(p, ["a"]), lambda p: write_table(p, table([0, 1], [1, 2]))):
        with pytest.raises(RecordingError, match=r"Parquet needs pyarrow: pip install 'cylforce\[tables\]'"):
            attempt(tmp_path / "run.parquet")


def test_a_write_that_fails_leaves_the_old_file(tmp_path):
    path = written(tmp_path, "old")
    with pytest.raises(TypeError), replacing(path) as temporary:
        temporary.write_text("half") + "type"
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(RecordingError, match=r"absent/run\.csv: cannot be written: No such file"):
        write_table(tmp_path / "absent" / "run.csv", table([0, 1], [1, 2]))


def test_an_hour_is_read_in_seconds(tmp_path):
    rows, columns = 36_000, 20  # a tenth of an hour at 100 Hz
    names = tuple(f"s{k}" for k in range(columns))
    path = tmp_path / "hour.csv"
    values = np.random.default_rng(1).normal(1e7, 1e5, (rows, columns)).round(3)
    write_table(path, Table(np.arange(rows) / 100.0, values, names))
    start = time.process_time()
    found = read_table(path, names)
    assert time.process_time() - start < 1.5  # an hour in 15 s on a machine five times slower than ours
    np.testing.assert_array_equal(found.values, values)


def test_resampling_what_is_even_changes_nothing():
    t = np.arange(500) / 100
    original = table(t, np.sin(t), np.where(t == 1.0, np.nan, t))
    assert_equal(resample(original, 100.0), original)


@settings(max_examples=100, deadline=None)
@given(arrays(float, st.integers(20, 60), elements=st.floats(0.002, 0.049)), st.floats(-1e3, 1e6))
def test_a_straight_line_stays_one_at_even_times(steps, start):
    t = start + np.cumsum(steps)
    found = resample(table(t, 3.0 * t - 1.0, t), 100.0)
    np.testing.assert_allclose(np.diff(found.t_s), 0.01, atol=1e-9)
    assert found.t_s[0] == t[0]
    assert t[-1] - 0.01 - 1e-6 < found.t_s[-1] <= t[-1] + 1e-6
    np.testing.assert_allclose(found.values[:, 0], 3.0 * found.t_s - 1.0, atol=1e-7)


@settings(max_examples=100, deadline=None)
@given(
    arrays(float, st.integers(20, 60), elements=st.floats(0.002, 0.04)),
    st.sets(st.integers(6, 19)),
    st.sets(st.integers(6, 19), max_size=3),
)
def test_a_table_in_pieces_is_resampled_as_the_whole(steps, cuts, gaps):
    steps[list(gaps)] = 0.2
    t = 3.0 + np.cumsum(steps)
    whole = table(t, np.sin(t), np.where(steps > 0.039, np.nan, t))
    ends = [0, *sorted(cuts), len(t)]
    found = list(resampled((Table(t[a:b], whole.values[a:b], whole.signals) for a, b in pairwise(ends)), 100.0))
    joined = Table(*(np.concatenate([piece[k] for piece in found]) for k in (0, 1)), whole.signals)
    assert_equal(joined, resample(whole, 100.0))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_long_table_comes_in_pieces(tmp_path, suffix):
    """Also a time that does not increase from one piece to the next is found."""
    path, t = tmp_path / f"run{suffix}", np.arange(ROWS + 40) / 100
    write_table(path, table(t, np.sin(t)))
    found = list(table_pieces(path, SIGNALS[:1]))
    assert max(len(piece.t_s) for piece in found) == ROWS
    assert_equal(read_table(path, SIGNALS[:1]), table(t, np.sin(t)))
    t[ROWS] = t[ROWS - 1]
    write_table(path, table(t, t))
    with pytest.raises(
        RecordingError, match=rf"(line {ROWS + 2}|row {ROWS + 1}): time \(column 't_s'\) does not increase"
    ):
        read_table(path, SIGNALS[:1])


def test_gaps_become_nan_and_only_gaps():
    t = np.array([0.0, 0.01, 0.02, 0.07, 0.08, 0.14, 0.15, 0.151])
    found = resample(table(t, t), 100.0)
    assert len(found.t_s) == 16
    unknown = found.t_s[np.isnan(found.values[:, 0])]
    np.testing.assert_allclose(unknown, [0.09, 0.10, 0.11, 0.12, 0.13])
    known = ~np.isnan(found.values[:, 0])
    np.testing.assert_allclose(found.values[known, 0], found.t_s[known], atol=1e-12)


def test_nan_spreads_no_further_than_its_neighbours():
    found = resample(table([0.0, 0.015, 0.03, 0.045], [0.0, np.nan, 0.03, 0.045]), 100.0)
    np.testing.assert_allclose(found.values[:, 0], [0.0, np.nan, np.nan, 0.03, 0.04], atol=1e-12)


def test_a_table_too_slow_for_the_rate_is_refused():
    with pytest.raises(RecordingError, match="the table has 10 rows a second, too few for 100 Hz"):
        resample(table(np.arange(10) / 10, np.arange(10)), 100.0)
