"""`cylforce sim` into files: the frames say what the truth says, one seed gives one run, bad input one
sentence."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cylforce.files.candump import Sent
from cylforce.files.logreader import read_events
from cylforce.files.tables import read_table
from cylforce.files.truth import read_truth
from cylforce.programs.common.play import prepare
from cylforce.programs.sim import START_US, run_sim
from cylforce.settings.machine_file import SettingsError, load
from cylforce.signals.codec import decode
from cylforce.signals.events import Frame, Tick
from cylforce.simulation.sensor_bus import bus_events

CONFIG = Path(__file__).resolve().parents[2] / "config"
MACHINES = sorted(CONFIG.glob("excavator*.toml"))
EXCAVATOR = CONFIG / "excavator_20t.toml"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """One cycle of the excavator in all files."""
    folder = tmp_path_factory.mktemp("sim")
    paths = {name: folder / name for name in ("truth.csv", "run.log", "run.csv")}
    run_sim(EXCAVATOR, cycles=1, seed=7, truth=paths["truth.csv"], log=paths["run.log"], table=paths["run.csv"])
    return paths


def test_log_table_and_truth_say_the_same(written):
    """The last frame before the tick after a sample carries that sample; its pressures give the true
    forces."""
    service = load(EXCAVATOR).service
    names = [s.name for s in service.machine.signals]
    truth, table = read_truth(written["truth.csv"]), read_table(written["run.csv"], names)
    np.testing.assert_allclose(table.t_s * 1e6 + START_US, truth.t_us, atol=1)
    layouts = {pdo.can_id: pdo for node in service.nodes for pdo in node.pdos}
    _, events = read_events(written["run.log"], 10_000)
    rows, last = [], {}
    for event in events:
        assert not isinstance(event, Sent)
        if isinstance(event, Tick):
            rows.append([last.get(name, np.nan) for name in names])
        elif event.can_id in layouts:
            last |= decode(layouts[event.can_id], event.data)
    seen = np.array(rows[1:])
    np.testing.assert_allclose(seen, table.values[: len(seen)], atol=1e-6)

    force = service.machine.cylinder_force(0, seen[:, names.index("boom_head_pressure")], seen[:, 1])
    assert np.std(force - truth.columns["force.boom"][: len(force)]) < 1000.0
    assert np.max(np.abs(seen[:, 6] - truth.columns["theta.boom"][: len(seen)])) < 0.005


def test_truth_tells_machine_and_run(written):
    truth = read_truth(written["truth.csv"])
    assert truth.header["seed"] == 7
    masses = truth.header["masses"]
    nominal = {link.name: link.mass for link in load(EXCAVATOR).service.machine.links}
    assert all(abs(abs(masses[k] / nominal[k] - 1) - 0.1) < 1e-9 for k in nominal)
    assert {"boom.J", "bucket.coulomb", "stick.stribeck"} <= truth.header["parameters"].keys()
    lifting = truth.columns["phase"] == 3
    assert 300 <= truth.columns["mass"][lifting][0] <= 1500
    assert set(truth.columns["cycle"]) == {0.0, 1.0}


def test_one_seed_is_one_run_and_one_machine(tmp_path, written):
    again, empty = tmp_path / "again.log", tmp_path / "truth.csv"
    run_sim(EXCAVATOR, cycles=1, seed=7, log=again)
    assert again.read_bytes() == written["run.log"].read_bytes()
    run_sim(EXCAVATOR, scenario="moves", duration=20.0, seed=7, truth=empty)
    assert read_truth(empty).header["parameters"] == read_truth(written["truth.csv"]).header["parameters"]


@pytest.mark.parametrize("path", MACHINES, ids=lambda path: path.stem)
def test_shipped_machines_work_within_their_sensors_ranges(path):
    loaded = load(path)
    machine = loaded.service.machine
    for scenario, amount in (("cycles", 3), ("moves", 60.0)):
        play = prepare(loaded, scenario, 11, 0.1, amount=amount)
        values = np.concatenate([record.values for record in play.records])
        low, high = np.array([(s.low, s.high) for s in machine.signals]).T
        assert np.all((values >= low) & (values <= high))
        assert np.all(np.isfinite(values))


def events_of(service, seed=3):
    loaded = load(EXCAVATOR)
    play = prepare(loaded, "cycles", seed, 0.1, amount=1)
    return list(bus_events(service, play.made, play.records, 0, np.random.default_rng(seed)))


def test_events_come_in_order_at_the_nodes_rates():
    service = load(EXCAVATOR).service
    events = events_of(service)
    assert all(a.t_us <= b.t_us for a, b in pairwise(events))
    ticks = [e.t_us for e in events if isinstance(e, Tick)]
    assert set(np.diff(ticks)) == {10_000}
    seconds = ticks[-1] * 1e-6
    for node in service.nodes:
        frames = [e for e in events if isinstance(e, Frame) and e.can_id == 0x700 + node.node_id]
        assert frames[0].data == b"\x00"
        assert abs(len(frames) - 1 - seconds / node.heartbeat_s) <= 1


def test_event_timers_run_freely_with_jitter():
    """A node without SYNC sends at its own period, about, and the values of that very moment."""
    service = load(EXCAVATOR).service
    slow = service.nodes[3]
    pdo = slow.pdos[0]._replace(synchronous=False, period_s=0.02)
    nodes = tuple(n if n is not slow else n._replace(pdos=(pdo,)) for n in service.nodes)
    events = events_of(service._replace(nodes=nodes))
    times = np.array([e.t_us for e in events if isinstance(e, Frame) and e.can_id == pdo.can_id])
    periods = np.diff(times)
    assert abs(np.mean(periods) - 20_000) < 100
    assert 200 < np.std(periods) < 800
    assert len(set((times % 10_000).tolist())) > 100


def test_quantised_values_are_whole_steps():
    play = prepare(load(EXCAVATOR), "moves", 1, 0.1, amount=15.0)
    record = next(play.records)
    steps = (record.values - play.made.origin) / play.made.quantum
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    noise = np.std(record.values - record.analog, axis=0)
    assert np.all(noise < 1.3 * play.made.noise + 0.5 * play.made.quantum)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"scenario": "dance"}, "choose moves or cycles"),
        ({"cycles": 0}, "give 1 to 10000"),
        ({"mass_error": 2.0}, "fraction"),
    ],
)
def test_bad_wishes_are_refused(change, told):
    with pytest.raises(SettingsError, match=told):
        run_sim(EXCAVATOR, **change)


def test_extra_effects_come_from_a_file(tmp_path):
    path, truth = tmp_path / "effects.toml", tmp_path / "truth.csv"
    path.write_text('[[effects]]\nname = "coulomb_friction"\nat = "boom"\nvalue = 500.0\n')
    run_sim(EXCAVATOR, cycles=1, seed=7, truth=truth, effects=path)
    plain = tmp_path / "plain.csv"
    run_sim(EXCAVATOR, cycles=1, seed=7, truth=plain)
    more, less = (read_truth(p) for p in (truth, plain))
    assert more.header["effects"] == [{"name": "coulomb_friction", "at": "boom", "value": [500.0]}]
    excess = more.columns["friction.boom"] - less.columns["friction.boom"]
    assert np.percentile(np.abs(excess), 95) == pytest.approx(500.0, rel=0.01)
    path.write_text('[[effects]]\nname = "coulomb_friction"\nat = "tail"\nvalue = 500.0\n')
    with pytest.raises(SettingsError, match="no cylinder"):
        run_sim(EXCAVATOR, cycles=1, effects=path)
    path.write_text('[[effects]]\nname = "coulomb"\nplace = "boom"\nvalue = 1.0\n')
    with pytest.raises(SettingsError, match=r"effects.coulomb lacks the key at"):
        run_sim(EXCAVATOR, cycles=1, effects=path)


def test_the_truth_header_is_one_line_of_json(written):
    first = written["truth.csv"].read_text().splitlines()[0]
    assert json.loads(first.removeprefix("# "))["scenario"] == "cycles"
