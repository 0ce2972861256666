"""References' rows from one diagnosis to the next: the same bits, and nothing that is broken, old or too much."""

import os

import numpy as np
import pytest

from cylforce.diagnosis.columns.recorded import GapRows, Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.search import asked
from cylforce.programs.common.row_cache import KeepingViewer, RowCache, cache_folder
from gap_scene import MACHINE, as_it_was

WANTED = [p for p in asked(MACHINE) if p.name in ("coulomb_friction", "pressure_offset")]


@pytest.fixture
def recorded():
    """Half a minute of a reference."""
    return as_it_was().clean[0].recorded._replace(values=as_it_was().clean[0].recorded.values[:3000].copy())


@pytest.fixture
def counted(monkeypatch):
    """How often rows were computed."""
    calls, plain = [], Viewer.rows
    monkeypatch.setattr(Viewer, "rows", lambda self, *args: calls.append(1) or plain(self, *args))
    return calls


def viewer(folder, name, machine="a", tares=0.0):
    known = as_it_was().viewer
    return KeepingViewer(known.model, known.tares + tares, RowCache(folder), frozenset([name]), machine)


def same(one, other):
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


def test_the_second_time_they_come_from_the_folder_bit_for_bit(tmp_path, recorded, counted):
    folder = tmp_path / "made" / "when needed"
    first = viewer(folder, recorded.name).rows(recorded, WANTED)
    again = viewer(folder, recorded.name).rows(recorded, WANTED)
    assert len(counted) == 1
    assert same(first, again)
    assert not [p for p in folder.iterdir() if p.suffix != ".npz"]


def test_whatever_they_depend_on_makes_them_anew(tmp_path, recorded, counted):
    plain = viewer(tmp_path, recorded.name)
    plain.rows(recorded, WANTED)
    changed = recorded.values.copy()
    changed[7, 0] += 1e-9
    plain.rows(recorded._replace(values=changed), WANTED)
    plain.rows(recorded._replace(begins=1.0), WANTED)
    plain.rows(recorded._replace(load=500.0), WANTED)
    plain.rows(recorded._replace(counts=np.ones(10_000, dtype=np.bool_)), WANTED)
    plain.rows(recorded, WANTED[1:])
    viewer(tmp_path, recorded.name, machine="b").rows(recorded, WANTED)
    viewer(tmp_path, recorded.name, tares=1e-9).rows(recorded, WANTED)
    assert len(counted) == 8


def test_only_references_are_kept(tmp_path, recorded, counted):
    for _ in range(2):
        viewer(tmp_path, "another").rows(recorded, WANTED)
    assert len(counted) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("spoil", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b[:-2000] + b"x" * 2000])
def test_a_broken_file_is_replaced(tmp_path, recorded, counted, spoil):
    first = viewer(tmp_path, recorded.name).rows(recorded, WANTED)
    (path,) = tmp_path.iterdir()
    whole = path.read_bytes()
    path.write_bytes(spoil(whole))
    assert same(first, viewer(tmp_path, recorded.name).rows(recorded, WANTED))
    assert len(counted) == 2
    assert len(path.read_bytes()) == len(whole)


def test_a_folder_that_cannot_be_written_is_no_hindrance(tmp_path, recorded):
    (tmp_path / "file").write_text("no folder")
    assert isinstance(viewer(tmp_path / "file" / "rows", recorded.name).rows(recorded, WANTED), GapRows)


def test_what_was_not_used_for_longest_goes_first(tmp_path):
    rows = GapRows(*(np.zeros(1000) for _ in GapRows._fields))
    kept = RowCache(tmp_path)
    for k, key in enumerate("abc"):
        kept.put(key, rows)
        os.utime(tmp_path / f"{key}.npz", (k, k))
    assert kept.get("a") is not None  # used
    size = (tmp_path / "a.npz").stat().st_size
    RowCache(tmp_path, 3 * size).put("d", rows)
    assert sorted(p.stem for p in tmp_path.iterdir()) == ["a", "c", "d"]


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "cylforce" / "rows"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == tmp_path / "home" / ".cache" / "cylforce" / "rows"


def test_recordings_are_plain_values():
    assert Recorded._fields == ("name", "values", "load", "begins", "counts")  # what a key is made of
