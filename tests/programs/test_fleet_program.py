"""`cylforce fleet` on a small simulated fleet: what it finds, what it keeps, whatever can be wrong with its input."""

import os
import shutil
import signal
import socket
import tempfile
import threading
import time
from contextlib import contextmanager

import can
import fsspec
import numpy as np
import pyarrow.parquet as pq
import pytest

from cylforce.files.atomic import RecordingError
from cylforce.files.recording import open_pieces, sensor_frames
from cylforce.fleet.changes import Shape
from cylforce.programs.common.progress import silent
from cylforce.programs.common.usual_file import everyday_from, everyday_of, read_usual
from cylforce.programs.common.usual_tables import UsualQuantity
from cylforce.programs.fleet import gathering, page, store, task, workers
from cylforce.programs.fleet.kept import KeptResults, packed
from cylforce.programs.fleet.run import Wanted, run_fleet
from cylforce.programs.fleet.workers import Where
from cylforce.programs.identify import JOINTLY, run_identify
from cylforce.settings.error import SettingsError
from cylforce.settings.machine_file import load
from studies._fleets import MACHINE_FILE, Size, day_of, name_of, write_fleet

HERE = Where(None, 0)
SIZE = Size(machines=3, days=6, seconds=45.0, changing=1)
SEED = 3
OF_THE_RUN = ["took_s", "memory_mb"]


def run(folder, output, cache, **more):
    return run_fleet(Wanted((str(folder),), output, cache=cache, **more), HERE, say=lambda _: None)


@contextmanager
def looked_at(folder, cache):
    """Names of the recordings of a folder that are computed within the block: their results in the cache are new."""
    seen, before = [], results_in(cache)
    yield seen
    new = {key for key, _ in results_in(cache) - before}
    text = (folder / "machine.toml").read_text()
    names = {path.name: task.key_of(task.content_sha256(str(path)), text) for path in sorted(folder.glob("*/*"))}
    seen.extend(name for name, key in names.items() if key in new)


def results_in(cache):
    """Keys of the results in a cache, each with the time at which it was written."""
    return {(path.stem, path.stat().st_mtime_ns) for path in cache.glob("*.result")}


def rows_of(path):
    return pq.read_table(path).drop_columns(OF_THE_RUN)


def reasons(result):
    return {(row["machine"], row["recording"]): row["reason"] for row in result.rows if row["reason"]}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A fleet of which a machine changes; its folder, truth, cache, and what the program says."""
    base = tmp_path_factory.mktemp("fleet")
    truth = write_fleet(base / "data", SIZE, SEED, processes=1)
    output = base / "results.parquet"
    wanted = Wanted((str(base / "data"),), output, base / "usual.toml", base / "fleet.html", base / "cache")
    return base, truth, run_fleet(wanted, HERE, say=lambda _: None)


@pytest.fixture
def few(small, tmp_path):
    """A folder with one machine of two recordings, and the cache."""
    base, _, _ = small
    shutil.copytree(base / "data" / name_of(1), tmp_path / "few" / name_of(1))
    for path in sorted((tmp_path / "few" / name_of(1)).iterdir())[2:]:
        path.unlink()
    shutil.copy(base / "data/machine.toml", tmp_path / "few")
    return tmp_path / "few", base / "cache"


def test_every_recording_is_a_row(small):
    base, _, result = small
    table = rows_of(base / "results.parquet")
    assert table.num_rows == SIZE.machines * SIZE.days
    assert set(table["state"].to_pylist()) <= {"ok", "doubtful"}
    assert table["made"].to_pylist()[: SIZE.days] == [f"{day_of(k)}T00:00:00" for k in range(SIZE.days)]
    assert {"value:boom.coulomb", "error:stick.X", "own:bucket_angle.angle_offset"} <= set(table.column_names)
    left, past = (np.array(table[f"{name}:boom"].to_pylist(), dtype=float) for name in ("left_nm", "past_nm"))
    assert np.all(left <= past * 1.5)
    assert len(result.rows) == table.num_rows


def test_earlier_recordings_are_a_prior(small):
    """They make every error smaller, and say what to expect."""
    table = rows_of(small[0] / "results.parquet").slice(SIZE.days, SIZE.days)  # a machine in order
    own, known = (np.array(table[f"{e}:boom.X"].to_pylist()) for e in ("own_error", "error"))
    assert np.all(known[1:] < own[1:])
    value, expected = (np.array(table[f"{e}:boom.X"].to_pylist()) for e in ("value", "expected"))
    assert np.all(np.abs(value[2:] - expected[2:]) < 6.0 * own[2:])


def test_the_page_links_every_machine(small):
    base, truth, _ = small
    text = (base / "fleet.html").read_text()
    for number in range(SIZE.machines):
        assert f'href="fleet_machines/{name_of(number)}.html"' in text
        assert "Courses" in (base / "fleet_machines" / f"{name_of(number)}.html").read_text()
    (changed,) = truth.values()
    page = (base / "fleet_machines" / f"{changed.machine}.html").read_text()
    assert f"--usual {base / 'usual.toml'} --html gap.html" in page
    assert f">{day_of(0)}</text>" in page
    assert "http://" not in text
    assert "https://" not in text


def test_the_page_says_what_differs_from_day_to_day_in_all(small):
    """Friction by its level, too."""
    (kind,) = small[2].analysis.types
    names, usual = [c.name for c in kind.fleet.known], kind.fleet.usual
    own, level = names.index("boom.coulomb"), names.index("boom.friction_level")
    daily, within = page.everyday(kind)
    parts = np.array([usual.days[own], usual.days[level] * usual.mean[own]])
    assert daily[own] == pytest.approx(np.hypot(*parts))
    assert within[own] > usual.within[own]
    assert f"days ± {daily[own]:.4g}" in (small[0] / "fleet.html").read_text()


def test_the_page_says_why_nothing_is_told_of_a_machine(few, tmp_path):
    folder, cache = few
    (folder / "EX 7").mkdir()
    (folder / "EX 7" / f"{day_of(0)}.csv").write_text("t_s,boom_angle\n0.0,1.0\n")
    run(folder, tmp_path / "r.parquet", cache, report=tmp_path / "fleet.html")
    assert "Nothing can be told of EX 7: failed: has no column" in (tmp_path / "fleet.html").read_text()


def test_every_machine_has_a_page_of_its_own(few, tmp_path):
    """However alike the names are as names of files."""
    folder, cache = few
    for name in ("EX 7", "EX_7"):
        shutil.copytree(folder / name_of(1), folder / name)
    run(folder, tmp_path / "r.parquet", cache, report=tmp_path / "fleet.html")
    texts = [path.read_text() for path in (tmp_path / "fleet_machines").iterdir()]
    titles = [text.partition("<h1>")[2].partition("<")[0] for text in texts]
    assert sorted(titles) == ["EX 7", name_of(1), "EX_7"]


def test_a_second_run_looks_at_nothing_and_says_the_same(small, tmp_path):
    base, _, _ = small
    with looked_at(base / "data", base / "cache") as seen:
        run(base / "data", tmp_path / "again.parquet", base / "cache")
    assert seen == []
    assert rows_of(tmp_path / "again.parquet").equals(rows_of(base / "results.parquet"))


def test_only_new_content_is_looked_at(few, tmp_path):
    """A copy of a known recording has its hash; a new one is computed."""
    folder, cache = few
    one, two = sorted((folder / name_of(1)).iterdir())
    shutil.copy(one, two.with_name(f"{day_of(20)}.parquet"))
    with looked_at(folder, cache) as seen:
        run(folder, tmp_path / "r.parquet", cache)
    assert seen == []
    table = pq.read_table(two).slice(0, 2500)
    pq.write_table(table, two.with_name(f"{day_of(21)}.parquet"))
    with looked_at(folder, cache) as seen:
        run(folder, tmp_path / "r.parquet", cache)
    assert seen == [f"{day_of(21)}.parquet"]


def test_a_killed_run_goes_on(few, tmp_path):
    """What was done before the end is kept, and can be read."""
    folder, cache = few[0], tmp_path / "cache"

    def ends_after_the_first(what, share):
        if what == "recordings" and share:
            raise KeyboardInterrupt

    wanted = Wanted((str(folder),), tmp_path / "r.parquet", cache=cache)
    with looked_at(folder, cache) as first, pytest.raises(KeyboardInterrupt):
        run_fleet(wanted, HERE, ends_after_the_first, lambda _: None)
    with looked_at(folder, cache) as rest:
        run(folder, tmp_path / "r.parquet", cache)
    assert [first, rest] == [[f"{day_of(k)}.parquet"] for k in (0, 1)]


def test_a_worker_that_ends_for_want_of_memory(few, tmp_path, monkeypatch):
    """The system ends it as it does when memory is short: its recording is a row with the cure, the others are done
    and kept."""
    folder, _ = few
    bad = folder / name_of(1) / f"{day_of(8)}.csv"
    bad.write_text("t_s\n")
    real = task.summarised

    def summarised(job, known):
        if job.address.endswith(".csv"):
            os.kill(os.getpid(), signal.SIGKILL)
        return real(job, known)

    monkeypatch.setattr(gathering, "summarised", summarised)
    wanted = Wanted((str(folder),), tmp_path / "r.parquet", cache=tmp_path / "cache")
    result = run_fleet(wanted, Where(None, 1, retries=0), say=lambda _: None)
    states = {row["recording"]: row["state"] for row in result.rows}
    assert states.pop(bad.name) == "failed"
    assert set(states.values()) <= {"ok", "doubtful"}
    assert "for want of memory: split the file" in reasons(result)[name_of(1), bad.name]
    monkeypatch.undo()
    with looked_at(folder, tmp_path / "cache") as seen:
        run(folder, tmp_path / "r.parquet", tmp_path / "cache")
    assert seen == [bad.name]


@pytest.fixture
def three(small, few):
    """The same machine with a third recording: so many are given to workers."""
    folder, _ = few
    shutil.copy(small[0] / "data" / name_of(1) / f"{day_of(2)}.parquet", folder / name_of(1))
    return folder


def test_a_worker_that_is_killed_once_changes_nothing(three, tmp_path, monkeypatch):
    """Its recording is computed again; the table is that of one process."""
    once = tmp_path / "once"
    real = task.summarised

    def summarised(job, known):
        if job.address.endswith(f"{day_of(1)}.parquet") and not once.exists():
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return real(job, known)

    run(three, tmp_path / "one.parquet", None)
    monkeypatch.setattr(gathering, "summarised", summarised)
    said = []
    run_fleet(Wanted((str(three),), tmp_path / "two.parquet"), Where(None, 2), say=said.append)
    assert once.exists()
    assert rows_of(tmp_path / "one.parquet").equals(rows_of(tmp_path / "two.parquet"))
    assert said[0].startswith("2 workers of at most 800MB; dashboard http://127.0.0.1:")


def test_the_order_of_the_work_changes_nothing(three):
    def result(outcome):
        return packed(outcome._replace(facts={k: v for k, v in outcome.facts.items() if k not in OF_THE_RUN}))

    found = store.found_in((str(three),))
    ways = []
    for order in (found, found[::-1]):
        reading = gathering.FleetReading(order, KeptResults(None), HERE, silent, lambda _: None, lambda _: None)
        gathered = reading.gathered()
        assert [each.stored for each in gathered] == order
        ways.append({each.stored.address: result(each.outcome) for each in gathered})
    assert ways[0] == ways[1]


def test_results_are_read_while_the_work_goes_on(three, tmp_path):
    """Each result can be read when the next one is there."""
    output, seen = tmp_path / "r.parquet", {}

    def watch(what, share):
        if what == "recordings":
            seen[share] = pq.read_table(output)["state"].to_pylist() if output.exists() else []

    run_fleet(Wanted((str(three),), output, flush_s=0.0), HERE, watch, lambda _: None)
    assert {share: len(states) for share, states in seen.items()} == {0.0: 0, 1 / 3: 0, 2 / 3: 1, 1.0: 2}
    assert set(seen[1.0]) <= {"ok", "doubtful"}


def test_a_worker_near_its_limit_of_memory_goes_on():
    """It neither waits for memory that no task gives back, nor writes to disk; beyond the limit it is ended. Dask's
    profiler, which keeps more memory with every second, is off."""
    with workers.cluster_client(Where(None, 1), lambda _: None) as client:
        (said,) = client.run(lambda dask_worker: vars(dask_worker.memory_manager)).values()
        time.sleep(3.0)  # Dask's profiler would have kept two by then
        (kept_calls,) = client.run(lambda dask_worker: len(dask_worker.profile_history)).values()
    assert kept_calls == 0
    assert said["memory_limit"] == 800_000_000
    assert [said[f"memory_{name}_fraction"] for name in ("target", "spill", "pause")] == [False, False, False]


def test_a_worker_of_another_version_is_refused():
    """Results must not depend on where they were computed."""

    class Client:
        def __init__(self, programs):
            self._programs = programs

        def run(self, function):
            return self._programs

    own = task.on_worker()
    workers.check_version(Client({"tcp://1.2.3.4:5": own}))
    with pytest.raises(RecordingError, match=r"tcp://1.2.3.4:6 has another version of cylforce .* install the same"):
        workers.check_version(Client({"tcp://1.2.3.4:5": own, "tcp://1.2.3.4:6": ("another", 1)}))
    with pytest.raises(RecordingError, match="has no worker: start one"):
        workers.check_version(Client({}))


def write_bus(loaded, table, path):
    """What candump or python-can would have recorded while the sensors sent a table's samples."""
    path.parent.mkdir(parents=True)
    pieces = open_pieces(table, loaded.service, loaded.columns, report=lambda _: None)
    with can.Logger(path) as log:
        for frame in sensor_frames(pieces, loaded.service):
            message = can.Message(1.7e9 + frame.t_us / 1e6, frame.can_id, is_extended_id=False, data=frame.data)
            log(message)


@pytest.mark.parametrize("suffix", [".log", ".blf", ".asc"])
def test_a_fleet_of_logs_of_the_bus(few, tmp_path, suffix):
    """The frames of the sensors tell the same as the table from which they were made, to the resolution of the bus; in
    a store the same as in a folder."""
    folder, cache = few
    table = folder / name_of(1) / f"{day_of(0)}.parquet"
    loaded = load(folder / "machine.toml")
    near = run(folder, tmp_path / "near.parquet", cache)
    write_bus(loaded, table, tmp_path / "bus" / name_of(1) / f"{day_of(0)}{suffix}")
    shutil.copy(folder / "machine.toml", tmp_path / "bus")
    far = run(tmp_path / "bus", tmp_path / "far.parquet", tmp_path / "cache")
    assert [row["state"] for row in far.rows] == ["ok"]
    for name in ("boom.X", "stick.coulomb", "bucket_angle.angle_offset"):
        error = near.rows[0][f"own_error:{name}"]
        assert far.rows[0][f"own:{name}"] == pytest.approx(near.rows[0][f"own:{name}"], abs=3.0 * error)
    fsspec.filesystem("memory").put(f"{tmp_path / 'bus'}/", f"/bus{suffix}/", recursive=True)
    run(f"memory://bus{suffix}", tmp_path / "stored.parquet", None)
    far_rows, stored = (rows_of(tmp_path / f"{name}.parquet").drop_columns("address") for name in ("far", "stored"))
    assert stored.equals(far_rows)


def test_a_cluster_says_the_same(few, tmp_path):
    from distributed import LocalCluster

    folder, _ = few
    own = run(folder, tmp_path / "one.parquet", None)
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0") as cluster:
        said = []
        wanted = Wanted((str(folder),), tmp_path / "two.parquet")
        other = run_fleet(wanted, Where(cluster.scheduler_address), say=said.append)
    assert rows_of(tmp_path / "one.parquet").equals(rows_of(tmp_path / "two.parquet"))
    assert len(own.rows) == len(other.rows) == 2
    assert "2 workers" in said[0]


def test_usual_is_a_prior_of_identification(small, tmp_path):
    base, _, _ = small
    loaded = load(base / "data/machine.toml")
    recording = base / "data" / name_of(2) / f"{day_of(1)}.parquet"
    found = [
        run_identify(loaded, [recording], tmp_path / "i.toml", JOINTLY._replace(usual=usual))
        for usual in (None, base / "usual.toml")
    ]
    places = [each.tares.names.index("bucket.coulomb") for each in found]
    alone, beside = (each.tares.covariance[k, k] for each, k in zip(found, places, strict=True))
    assert beside < alone


def test_usual_replaces_what_the_diagnosis_states(small):
    machine = load(MACHINE_FILE).service.machine
    usual = read_usual(small[0] / "usual.toml", machine)
    said = everyday_of(small[0] / "usual.toml", machine)
    assert said["friction_level_change"] == pytest.approx(
        np.sqrt(np.mean([usual[f"{c.name}.friction_level"].between_days ** 2 for c in machine.cylinders])) / 0.08
    )
    assert everyday_of(None, machine) != said


def test_friction_at_creeping_speed_differs_with_the_level_too():
    """The level of the diagnosis is that of the other laws: 30 N of its own and 4 % of 1000 N."""
    spreads = {"between_machines": 1.0, "within_a_day": 1.0}
    own = UsualQuantity(name="boom.stribeck", unit="N", mean=1000.0, between_days=30.0, **spreads)
    level = UsualQuantity(name="boom.friction_level", unit="1", mean=0.0, between_days=0.04, **spreads)
    assert everyday_from({q.name: q for q in (own, level)})["stribeck"] == pytest.approx(50.0 / 200.0)


def test_usual_of_another_type_is_refused(small):
    other = load(MACHINE_FILE.with_name("wheel_loader.toml")).service.machine
    with pytest.raises(SettingsError, match="tells nothing of the type"):
        read_usual(small[0] / "usual.toml", other)
    with pytest.raises(SettingsError, match="is not TOML"):
        read_usual(small[0] / "results.parquet", other)


class TestBadInput:
    def test_a_broken_file_is_a_row_with_its_reason(self, few, tmp_path):
        folder, cache = few
        (folder / name_of(1) / f"{day_of(30)}.parquet").write_bytes(b"no Parquet")
        (folder / name_of(1) / f"{day_of(31)}.csv").write_text("t_s,boom_angle\n0.0,1.0\n0.01,1.0\n")
        (folder / name_of(1) / f"{day_of(32)}.log").write_text("(1.0) can0 zzz\n")
        result = run(folder, tmp_path / "r.parquet", cache)
        said = reasons(result)
        assert "is no Parquet file" in said[name_of(1), f"{day_of(30)}.parquet"]
        assert "has no column" in said[name_of(1), f"{day_of(31)}.csv"]
        assert "line 1: is no frame" in said[name_of(1), f"{day_of(32)}.log"]
        assert sum(row["state"] in ("ok", "doubtful") for row in result.rows) == 2

    def test_two_machines_of_one_name_are_kept_apart_and_told(self, few, tmp_path):
        folder, cache = few
        shutil.copytree(folder, folder / "other")
        result = run(folder, tmp_path / "r.parquet", cache)
        assert {row["machine"] for row in result.rows} == {f"few/{name_of(1)}", f"other/{name_of(1)}"}
        assert f"{name_of(1)}: is the name of 2 machines" in result.notes[0]

    def test_mixed_types_are_told(self, few, tmp_path):
        """A machine file of the same type's name, but with other parts."""
        folder, cache = few
        shutil.copytree(folder / name_of(1), folder / "EX-777")
        text = MACHINE_FILE.with_name("excavator_stick_bucket.toml").read_text()
        name = load(MACHINE_FILE).service.machine.name
        own = load(MACHINE_FILE.with_name("excavator_stick_bucket.toml")).service.machine.name
        (folder / "EX-777/machine.toml").write_text(text.replace(f'"{own}"', f'"{name}"', 1))
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        assert all("other parts than that of EX-001" in said["EX-777", f"{day_of(k)}.parquet"] for k in (0, 1))

    def test_the_parts_of_most_recordings_are_those_of_the_type(self, few, tmp_path):
        """Even if the machine with other parts comes first."""
        folder, cache = few
        (folder / "EX-000").mkdir()
        shutil.copy(folder / name_of(1) / f"{day_of(0)}.parquet", folder / "EX-000")
        other = MACHINE_FILE.with_name("excavator_stick_bucket.toml")
        kinds = [load(path).service.machine.name for path in (other, MACHINE_FILE)]
        renamed = other.read_text().replace(f'"{kinds[0]}"', f'"{kinds[1]}"', 1)
        (folder / "EX-000/machine.toml").write_text(renamed)
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        refused = [name for (name, _), reason in said.items() if "other parts than that of EX-001" in reason]
        assert refused == ["EX-000"]

    def test_without_a_machine_file(self, few, tmp_path):
        folder, cache = few
        (folder / "machine.toml").unlink()
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        assert all(reason.startswith("no machine.toml") for reason in said.values())
        assert len(said) == 2

    def test_a_broken_machine_file(self, few, tmp_path):
        folder, cache = few
        (folder / "machine.toml").write_text("[machine]\nname = 3\n")
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        assert len(said) == 2
        assert all("machine.toml" in reason for reason in said.values())

    def test_a_file_that_changes_while_it_is_read(self, few, tmp_path):
        """Another thread writes to it every few milliseconds, hundreds of times while it is computed."""
        folder, complete = few[0], threading.Event()
        path = folder / name_of(1) / f"{day_of(0)}.parquet"

        def still_written():
            while not complete.wait(0.003):
                path.touch()

        writer = threading.Thread(target=still_written)
        writer.start()
        try:
            result = run(folder, tmp_path / "r.parquet", tmp_path / "cache")
        finally:
            complete.set()
            writer.join()
        assert result.rows[0]["state"] == "changed while read"
        assert "run again" in result.rows[0]["reason"]
        assert run(folder, tmp_path / "r.parquet", tmp_path / "cache").rows[0]["state"] == "ok"

    def test_a_clock_that_runs_backwards_within_a_recording(self, few, tmp_path):
        folder, cache = few
        table = pq.read_table(folder / name_of(1) / f"{day_of(0)}.parquet")
        both = table.slice(100, 200).to_pylist() + table.slice(0, 100).to_pylist()
        header = ",".join(both[0])
        lines = [",".join(map(repr, row.values())) for row in both]
        (folder / name_of(1) / f"{day_of(9)}.csv").write_text("\n".join([header, *lines]) + "\n")
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        assert "does not increase" in said[name_of(1), f"{day_of(9)}.csv"]

    def test_a_clock_that_contradicts_the_dates(self, few, tmp_path):
        """The clock of a later recording says an earlier day."""
        import pyarrow as pa

        folder, cache = few
        for k, begins in ((0, 1.8e9), (1, 1.7e9)):
            path = folder / name_of(1) / f"{day_of(k)}.parquet"
            table = pq.read_table(path)
            shifted = pa.array(np.asarray(table["t_s"]) + begins)
            pq.write_table(table.set_column(0, "t_s", shifted), path)
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        assert (
            "its clock says 2023-11-14, which is before the recording before it"
            in said[name_of(1), f"{day_of(1)}.parquet"]
        )

    def test_a_recording_without_a_date_among_dated_ones(self, few, tmp_path):
        folder, cache = few
        one = folder / name_of(1) / f"{day_of(0)}.parquet"
        one.rename(one.with_name("first.parquet"))
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        assert "has no date in its name" in said[name_of(1), "first.parquet"]

    def test_the_same_recording_twice(self, few, tmp_path):
        folder, cache = few
        (folder / name_of(1) / f"{day_of(0)}.csv").write_text("t_s\n")
        said = reasons(run(folder, tmp_path / "r.parquet", cache))
        assert f"is there twice, as {day_of(0)}.csv, too" in said[name_of(1), f"{day_of(0)}.parquet"]

    def test_nothing_there(self, tmp_path):
        with pytest.raises(RecordingError, match="does not exist"):
            run(tmp_path / "absent", tmp_path / "r.parquet", None)
        (tmp_path / "empty").mkdir()
        with pytest.raises(RecordingError, match="holds no recording"):
            run(tmp_path / "empty", tmp_path / "r.parquet", None)

    def test_a_store_that_cannot_be_reached(self, tmp_path, monkeypatch, closed_port):
        store_at(monkeypatch, closed_port)
        begun = time.monotonic()
        with pytest.raises(RecordingError, match="this place cannot be read"):
            run("s3://fleet/data", tmp_path / "r.parquet", None)
        assert time.monotonic() - begun < store.ANSWER_S

    def test_a_store_that_does_not_answer(self):
        with pytest.raises(RecordingError, match=r"s3://x: no answer within 0.1 s"):
            store.within(0.1, lambda: time.sleep(1.0), "s3://x")

    def test_a_scheduler_that_cannot_be_reached(self, few, tmp_path, closed_port):
        wanted = Wanted((str(few[0]),), tmp_path / "r.parquet")
        with pytest.raises(RecordingError, match="cannot be reached"):
            run_fleet(wanted, Where(f"tcp://127.0.0.1:{closed_port}", connect_s=1.0))

    def test_a_scheduler_that_ends_while_it_works(self, three, tmp_path):
        """A sentence, and what was done is kept."""
        import dask
        from distributed import LocalCluster

        def watch(what, share):
            if what == "recordings" and share:
                cluster.loop.add_callback(cluster.scheduler.close)

        cluster = LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address="127.0.0.1:0")
        # Else it looks for the scheduler, which is gone, for half a minute before it is closed.
        with dask.config.set({"distributed.comm.timeouts.connect": "1s"}), cluster:
            wanted = Wanted((str(three),), tmp_path / "r.parquet", cache=tmp_path / "cache")
            with pytest.raises(RecordingError, match=r"the scheduler ended, .*: what was done is kept"):
                run_fleet(wanted, Where(cluster.scheduler_address, connect_s=1.0, ahead=1), watch, lambda _: None)
        with looked_at(three, tmp_path / "cache") as seen:
            run(three, tmp_path / "r.parquet", tmp_path / "cache")
        assert seen == [f"{day_of(k)}.parquet" for k in (1, 2)]

    def test_the_extra_that_is_missing(self, monkeypatch):
        monkeypatch.setattr(store, "find_spec", lambda name: None)
        with pytest.raises(RecordingError, match=r"pip install 'cylforce\[fleet\]'"):
            store.check_fleet_extra()


@pytest.fixture
def closed_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def store_at(monkeypatch, port):
    """Whatever asks for s3:// asks this computer."""
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "nobody")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "nothing")
    monkeypatch.setenv("AWS_DEFAULT_REGION", "us-east-1")
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{port}")


def test_a_store_by_its_s3_interface(few, tmp_path, monkeypatch):
    from moto.server import ThreadedMotoServer

    folder, _ = few
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    try:
        store_at(monkeypatch, server.get_host_and_port()[1])
        there, _ = store.opened("s3://fleet")
        there.mkdir("fleet")
        there.put(str(folder), "fleet/data", recursive=True)
        (tmp_path / "scratch").mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "scratch"))
        result = run("s3://fleet/data", tmp_path / "far.parquet", tmp_path / "cache")
        assert list((tmp_path / "scratch").iterdir()) == []  # no file is copied to disk
        with looked_at(folder, tmp_path / "cache") as seen:
            run("s3://fleet/data", tmp_path / "again.parquet", tmp_path / "cache")
        assert seen == []
    finally:
        server.stop()
    run(folder, tmp_path / "near.parquet", None)
    near, far = (rows_of(tmp_path / f"{name}.parquet").drop_columns("address") for name in ("near", "far"))
    assert near.equals(far)
    assert result.rows[0]["address"] == f"s3://fleet/data/{name_of(1)}/{day_of(0)}.parquet"


def test_the_change_is_found_and_told(small):
    """With its day, its cause and its size, and nothing else."""
    base, truth, result = small
    (fault,) = truth.values()
    (change,) = [c for c in result.changes if c.altered.shape is not Shape.DAY]
    altered = change.altered
    assert (change.machine, altered.name, altered.at) == (fault.machine, fault.name, fault.at)
    assert change.date == day_of(fault.first)
    assert altered.size == pytest.approx(fault.size, abs=max(4.0 * altered.error, 0.1 * fault.size))
    table = rows_of(base / "results.parquet")
    at = table["recording"].to_pylist().index(f"{day_of(fault.first)}.parquet")
    assert table["machine"][at].as_py() == fault.machine
    assert f"mass on the {fault.at}" in table["change"][at].as_py()
    assert f"mass on the {fault.at}" in (base / "fleet.html").read_text()
