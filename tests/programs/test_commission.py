"""The commissioning as a program: what it shows, what it refuses, and what is left when it is ended. (On a bus, to the
end: virtual_clock/test_commission_on_a_bus.py.)"""

import io
import re
import signal
import subprocess
import sys
from dataclasses import replace
from itertools import count

import numpy as np
import pytest
from rich.console import Console

from cylforce.can.bus import BusError
from cylforce.can.opening import open_bus
from cylforce.can.python_can import Relay
from cylforce.commissioning.guidance import Guide
from cylforce.files.logreader import read_events
from cylforce.programs import commission
from cylforce.programs.commission import Order, run_commission, unbooked
from cylforce.programs.common.readings import model_of
from cylforce.programs.live.collector import Collector
from cylforce.programs.live.picture import FULL, NONE, known, picture, summary
from cylforce.programs.sim import START_US
from cylforce.settings.machine_file import load
from cylforce.signals.events import Frame
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.sensor_bus import bus_events
from scenarios import EXCAVATOR, carried, truth_of

LOADED = load(EXCAVATOR)
GUIDE = Guide(model_of(LOADED), every_s=5.0)
BUSES = count()


@pytest.fixture
def collector():
    """On a bus of which nobody reads the clock: events are fed by hand."""
    bus = open_bus(f"virtual:commission{next(BUSES)}")
    made = Collector(LOADED, GUIDE, bus, None)
    yield made
    made.close()
    bus.close()


def fed(collector, load=0.0, seconds=30.0, without=(), seed=70):
    """Views every second of moves of machine `seed` with a load [kg]; PDOs of some nodes never come."""
    service = LOADED.service
    scene = moves(service.machine, np.random.default_rng((seed, 1)), seconds)
    scene = scene._replace(dig=carried(load)) if load else scene
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng((seed, 2))
    records = run(service.machine, truth_of(LOADED, seed), made, [scene], dt=1.0 / service.filters.rate_hz, rng=rng)
    lost = {pdo.can_id for node in service.nodes if node.name in without for pdo in node.pdos}
    ticks = 0
    for event in bus_events(service, made, records, START_US, np.random.default_rng((seed, 3))):
        if isinstance(event, Frame):
            if event.can_id not in lost:
                collector.on_frame(event)
            continue
        collector.taker.on_tick(event.t_us)
        ticks += 1
        if ticks % 100 == 0:
            collector.think()
            if collector.pending is not None:
                collector.pending.result()
            collector.think()
            yield collector.view()


def drawn(view):
    console = Console(file=io.StringIO(), width=140, record=True)
    console.print(picture(GUIDE, view))
    return console.export_text()


def test_the_picture_fills_as_the_machine_moves(collector):
    views = list(fed(collector))
    first, last = drawn(views[0]), drawn(views[-1])
    assert FULL not in first
    assert first.count(NONE) == np.count_nonzero(GUIDE.plan.needed)
    assert last.count(FULL) > 4
    assert last.count(NONE) < first.count(NONE)
    for link in LOADED.service.machine.links:
        assert link.name in first
    assert last.count("▲") == 3
    assert "> move the" in last
    assert re.match(
        r"0:2\d of motion, strokes \d+ %, postures \d+ %, error at 1500 kg by motion: \+- \d+ kg \(enough: 15\); by",
        summary(GUIDE, views[-1]),
    )


@pytest.mark.parametrize(
    ("area_error", "said"),
    [(0.032, r"by pins and bores: \+- 48 kg, until a known weight"), (0.0074, r"by pins and bores: \+- 12 kg$")],
)
def test_what_motion_cannot_reduce_is_said_apart(collector, area_error, said):
    """Areas of the pistons that are known to 3.2 %: of 1500 kg 48 kg, more than the 15 kg that a booked weight may
    have. With 0.74 %, and 0.3 % of pressure sensors and pins, it is 12 kg."""
    *_, view = fed(collector, seconds=5.0)
    view = view._replace(advice=view.advice._replace(weight_error=8.0))
    service = LOADED.service
    cylinders = tuple(replace(cylinder, area_error=area_error) for cylinder in service.machine.cylinders)
    other = LOADED._replace(service=service._replace(machine=replace(service.machine, cylinders=cylinders)))
    text = known(Guide(model_of(other)), view)
    assert "by motion: +- 8 kg (enough: 15); " in text
    assert re.search(said, text)


def test_the_end_says_which_weights_are_not_booked():
    """1 % of the rated payload is booked at most: with 4 % of the weight that is a quarter of the payload."""
    assert unbooked(GUIDE.model.data_sheet._replace(scale_error=0.04)).startswith(
        "; with it no weight above 25 % of the rated payload is booked: its pins"
    )
    assert unbooked(GUIDE.model.data_sheet._replace(scale_error=0.009)) == ""


def test_the_pointer_is_where_the_joint_is(collector):
    *_, view = fed(collector, seconds=10.0)
    (k,) = [k for k, j in enumerate(GUIDE.plan.joints) if LOADED.service.machine.links[j].name == "stick"]
    low, high = GUIDE.plan.edges[k, [0, -1]]
    places = []
    for share in (0.05, 0.5, 0.95):
        here = view.here.copy()
        here[GUIDE.plan.joints[k]] = low + share * (high - low)
        pointers = [line for line in drawn(view._replace(here=here)).splitlines() if "▲" in line]
        places.append([m.start() for m in re.finditer("▲", pointers[0])][k])
    assert places == sorted(places) or places == sorted(places, reverse=True)
    assert len(set(places)) == 3


def test_a_loaded_bucket_ends_it(collector):
    for view in fed(collector, load=900.0, seconds=60.0):
        if view.advice.refusal:
            break
    assert view.instruction.startswith("the bucket is not empty")
    with pytest.raises(ValueError, match="the bucket is not empty"):
        commission.check_outcome(GUIDE, view)


def test_a_silent_node_is_named_within_seconds(collector):
    node = LOADED.service.nodes[1]
    for view in fed(collector, seconds=10.0, without=(node.name,)):
        if view.trouble:
            break
    assert view.deaf_s < 5.0
    assert f"(node {node.node_id}) silent, check its power, cable, bit rate and node number" in view.instruction
    others = [f"node {n.node_id})" for n in LOADED.service.nodes if n is not node]
    assert not any(name in view.instruction for name in others)
    assert np.all(np.isnan(view.here))


def test_zero_is_refused_while_nothing_is_weighed(collector):
    frame = Frame(START_US, 0x600 + LOADED.service.node_id, b"\x23\x25\x61\x01zero")
    assert collector.taker.on_frame(frame).verdict == 0x08000022


def test_a_bus_without_sensors_is_given_up(tmp_path):
    out = io.StringIO()
    said = r"nothing can be measured: .*silent, check its power, cable"
    with Relay() as relay:
        order = Order(relay.name, tmp_path / "o.toml", tmp_path / "o.log", give_up_s=4.0)
        with pytest.raises(BusError, match=said):
            run_commission(LOADED, order, Console(file=out, width=100))
    told = out.getvalue()
    for node in LOADED.service.nodes:
        assert f"(node {node.node_id})" in told
    assert not (tmp_path / "o.toml").exists()


def test_ctrl_c_keeps_the_log_and_says_how_to_go_on(tmp_path):
    output = tmp_path / "o.toml"
    command = [sys.executable, "-m", "cylforce", "commission", EXCAVATOR, "-o", output]
    pipe = subprocess.PIPE
    with (
        Relay() as relay,
        subprocess.Popen([*command, "--bus", relay.name], stdout=pipe, stderr=pipe, text=True) as it,
    ):
        while "silent" not in it.stdout.readline():
            assert it.poll() is None
        it.send_signal(signal.SIGINT)
        said, told = it.communicate(timeout=20.0)
    assert it.returncode == 130
    assert "stopped after 0 s of motion, too few to identify anything; the log is kept" in said
    assert "Traceback" not in told
    assert sorted(path.name for path in tmp_path.iterdir()) == ["o.log"]
    header, events = read_events(tmp_path / "o.log", 10_000)
    assert header.machine == str(EXCAVATOR.resolve())
    assert len(list(events)) > 100


def test_who_stops_late_is_told_the_command(collector, tmp_path):
    *_, view = fed(collector, seconds=40.0)
    out, order = io.StringIO(), Order("virtual:a", tmp_path / "o.toml", tmp_path / "o.log")
    commission.report_stop(LOADED, order, view, Console(file=out, width=100))
    assert f"cylforce identify {EXCAVATOR} {tmp_path}/o.log -o {tmp_path}/o.toml" in out.getvalue()
