"""What was learnt of references, from one diagnosis to the next: the same, nothing that is broken, old or too much."""

import os
from dataclasses import replace

import numpy as np
import pytest

from cylforce.diagnosis.model import HealthyMachine, KnowledgeSource
from cylforce.effects.library import LIBRARY
from cylforce.estimation.model import Model
from cylforce.programs.common.gap_machine import ALWAYS, learnt_machine
from cylforce.programs.common.machine_statistics import arrays_of
from cylforce.programs.common.statistics_cache import StatisticsCache, cache_folder, key_of
from cylforce.readings.recording import Recording
from cylforce.settings.machine_file import load
from scenarios import CONFIG, moved

LOADED = load(CONFIG / "excavator_stick_bucket.toml")
FEW = tuple(group for group in LIBRARY if group[0].about.name in ("coulomb_friction", "pressure_offset"))


@pytest.fixture(scope="module")
def recordings():
    """Two references of half a minute."""
    return [Recording(f"run {seed}", moved(LOADED, seed=seed, seconds=30.0)) for seed in (1, 2)]


def learnt(folder, recordings):
    return learnt_machine(LOADED, recordings, FEW, None, StatisticsCache(folder))


@pytest.fixture(scope="module")
def made(tmp_path_factory, recordings):
    """A folder with what was learnt once, and that."""
    folder = tmp_path_factory.mktemp("cache") / "made" / "when needed"
    return folder, learnt(folder, recordings)


def check_same(one: HealthyMachine, other: HealthyMachine) -> None:
    """All that is known is the same; a covariance to the rounding of single precision."""
    first, second = arrays_of(one), arrays_of(other)
    for name in first.keys() - {"covariance_root"}:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)
    scale = np.sqrt(np.diag(one.machine.covariance))
    unit = np.outer(scale, scale)
    np.testing.assert_allclose(other.machine.covariance / unit, one.machine.covariance / unit, atol=1e-5)


def test_the_second_time_it_comes_from_the_folder(made, recordings):
    folder, first = made
    (path,) = folder.iterdir()
    written = path.stat().st_ino, path.read_bytes()
    check_same(first, learnt(folder, recordings))
    assert (path.stat().st_ino, path.read_bytes()) == written
    assert [p.suffix for p in folder.iterdir()] == [".npz"]


def test_whatever_it_depends_on_makes_it_anew(made, recordings):
    machine = made[1]
    noise, layout = machine.sensor_noise, machine.layout
    plain = ("a", machine.regressors, layout.proposals, recordings, noise, KnowledgeSource.REFERENCES)
    changed = recordings[0].values.copy()
    changed[7, 0] += 1e-9
    model = machine.regressors.model
    other_laws = replace(machine.regressors, model=Model(model.machine, model.filters, ALWAYS[:2]))
    other_values = replace(machine.regressors, parameters=machine.regressors.parameters + 1e-9)

    def with_first(**fields):
        return (*plain[:3], [replace(recordings[0], **fields), recordings[1]], *plain[4:])

    keys = [
        plain,
        ("b", *plain[1:]),
        ("a", other_laws, *plain[2:]),
        ("a", other_values, *plain[2:]),
        (*plain[:2], layout.proposals[1:], *plain[3:]),
        with_first(values=changed),
        with_first(name="other"),
        with_first(load_kg=500.0),
        with_first(begins_s=1.0),
        (*plain[:4], noise + 1e-9, plain[5]),
        (*plain[:5], KnowledgeSource.SIMULATION),
    ]
    assert len({key_of(*each) for each in keys}) == len(keys)
    assert key_of(*plain) == key_of(*plain)


@pytest.mark.parametrize("spoil", [lambda b: b[: len(b) // 2], lambda b: b"", lambda b: b"x" * len(b)])
def test_a_broken_file_is_replaced(made, recordings, spoil):
    folder, first = made
    (path,) = folder.iterdir()
    whole = path.read_bytes()
    path.write_bytes(spoil(whole))
    check_same(first, learnt(folder, recordings))
    assert len(path.read_bytes()) == len(whole)


def test_a_folder_that_cannot_be_written_is_no_hindrance(tmp_path, made):
    (tmp_path / "file").write_text("no folder")
    cache = StatisticsCache(tmp_path / "file" / "statistics")
    cache.put("a", made[1])
    assert cache.get("a", made[1].regressors, made[1].layout.proposals) is None


def test_what_was_not_used_for_longest_goes_first(tmp_path, made):
    machine, kept = made[1], StatisticsCache(tmp_path)
    for k, key in enumerate("abc"):
        kept.put(key, machine)
        os.utime(tmp_path / f"{key}.npz", (k, k))
    assert kept.get("a", machine.regressors, machine.layout.proposals) is not None  # used
    size = (tmp_path / "a.npz").stat().st_size
    StatisticsCache(tmp_path, 3 * size).put("d", machine)
    assert sorted(p.stem for p in tmp_path.iterdir()) == ["a", "c", "d"]


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "cylforce" / "statistics"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == tmp_path / "home" / ".cache" / "cylforce" / "statistics"
