"""Tables whose rows repeat the last value are refused by name; readings that rest, coarse or slow ones are not."""

from itertools import pairwise

import numpy as np
import pytest

from cylforce.files.atomic import RecordingError
from cylforce.files.held import held
from cylforce.files.recording import open_pieces, open_recording
from cylforce.files.tables import Table, write_table
from cylforce.mechanics.installation import LATE_PERIODS
from cylforce.programs.common.recorded import chosen
from cylforce.programs.identify import run_identify
from cylforce.programs.replay import run_replay
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR, moved

SEED = 11
LOADED = load(EXCAVATOR)
SERVICE = LOADED.service
SIGNALS = SERVICE.machine.signals
NAMES = tuple(s.name for s in SIGNALS)
RATE = SERVICE.filters.rate_hz
LATE_S = [LATE_PERIODS * s.period_s for s in SIGNALS]
BAR, DEGREE = 1e5, np.pi / 180.0


@pytest.fixture(scope="module")
def healthy():
    """A minute of moves at the service's rate."""
    values = moved(LOADED, SEED)
    return Table(np.arange(len(values)) / RATE, values, NAMES)


def repeated(table, rows, columns=slice(None), begin=0):
    """The same with each value repeated, in some columns, from a row on."""
    values = table.values.copy()
    source = begin + np.arange(len(values) - begin) // rows * rows
    values[begin:, columns] = table.values[source][:, columns]
    return table._replace(values=values)


def names(table):
    return [each.signal for each in held(table, LATE_S)]


def coarse(table, bar, degree):
    """The same with readings in steps."""
    steps = np.array([bar * BAR if "pressure" in name else degree * DEGREE for name in NAMES])
    return table._replace(values=np.round(table.values / steps) * steps)


def by_threshold(table, bar, degree):
    """The same with readings that follow only when they are off by so much."""
    steps = np.array([bar * BAR if "pressure" in name else degree * DEGREE for name in NAMES])
    values = table.values.copy()
    for last, row in pairwise(values):
        row[:] = np.where(np.abs(row - last) >= steps, row, last)
    return table._replace(values=values)


@pytest.mark.parametrize("rows", [3, 5, 10, 20])
def test_repeated_values_are_found_in_every_signal(healthy, rows):
    found = held(repeated(healthy, rows), LATE_S)
    assert [each.signal for each in found] == list(NAMES)
    for each in found:
        assert each.every_s == pytest.approx(rows / RATE)
        assert each.from_s < 10.0


def test_only_what_is_repeated_is_named(healthy):
    assert names(repeated(healthy, 5, columns=[7])) == [NAMES[7]]
    late = held(repeated(healthy, 10, begin=3000), LATE_S)
    assert [each.signal for each in late] == list(NAMES)
    assert all(29.9 <= each.from_s < 35.0 for each in late)


def test_repeated_rows_of_a_slow_table_are_found(healthy):
    slow = Table(healthy.t_s[::5], healthy.values[::5], NAMES)
    assert names(slow) == []
    assert names(repeated(slow, 2)) == list(NAMES)


def test_readings_that_are_repeated_at_their_sensor_s_period_are_healthy(healthy):
    """Each row between two readings of a sensor that sends each 50 ms repeats the last one."""
    assert held(repeated(healthy, 5), [LATE_PERIODS * 0.05] * len(NAMES)) == []


def test_healthy_readings_are_not_refused(healthy):
    rests = healthy.values.copy()
    rests[2000:4000] = rests[2000]  # at rest, without noise
    rests[5000:, 6] = rests[5000, 6]
    lost = healthy.values.copy()
    lost[::7] = np.nan
    tables = {
        "as it is": healthy,
        "at rest": healthy._replace(values=rests),
        "each value twice": repeated(healthy, 2),
        "without some rows": healthy._replace(values=lost),
        "20 Hz": Table(healthy.t_s[::5], healthy.values[::5], NAMES),
    }
    for bar, degree in ((0.1, 0.05), (0.5, 0.2), (1.0, 0.5), (5.0, 2.0)):
        tables[f"steps of {bar} bar"] = coarse(healthy, bar, degree)
        tables[f"steps of {bar} bar at 20 Hz"] = coarse(tables["20 Hz"], bar, degree)
        tables[f"a threshold of {bar} bar"] = by_threshold(healthy, bar, degree)
    assert {name: names(table) for name, table in tables.items()} == {name: [] for name in tables}


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_every_command_refuses_it_with_a_sentence(tmp_path, healthy, suffix):
    path = tmp_path / f"exported.{suffix}"
    write_table(path, repeated(healthy, 10))
    sentence = (
        rf"exported\.{suffix}: values are repeated from 0\.\d+ s on \(all signals\): they change every 0\.1 s "
        "only, while rows are 0.01 s apart: export the rows at which the sensors were read"
    )
    for read in (
        lambda: run_identify(LOADED, [path], tmp_path / "identified.toml"),
        lambda: chosen(LOADED, [path], {}),
        lambda: run_replay(LOADED, path, None),
        lambda: open_recording(path, SERVICE),
    ):
        with pytest.raises(RecordingError, match=sentence):
            read()


def test_a_healthy_table_is_read_as_it_is(tmp_path, healthy):
    write_table(tmp_path / "run.parquet", healthy)
    read = np.concatenate([piece.values for piece in open_pieces(tmp_path / "run.parquet", SERVICE)])
    np.testing.assert_array_equal(read, healthy.values)
