"""Pressures and angles that are not on one clock are noticed before any effect is named, and nothing else is taken for
that. (Our own simulator; a real machine: tools/test_crane_gap.py.)"""

import numpy as np
import pytest

from cylforce.effects.fault import Place, places
from cylforce.effects.imposed import imposed
from cylforce.estimation.model import Model
from cylforce.programs.common.gap_clocks import off_clock
from cylforce.programs.common.play import prepare
from cylforce.readings.clock_rows import JointRows
from cylforce.readings.clocks import LATE_S, clock_faults, clock_faults_of_groups, faults_of_piece
from cylforce.readings.recording import Recording
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from scenarios import EXCAVATOR, moved, truth_of

LOADED = load(EXCAVATOR)
SERVICE = LOADED.service
MODEL = Model(SERVICE.machine, SERVICE.filters, ())
RATE = SERVICE.filters.rate_hz
SECONDS = 90.0


@pytest.fixture(scope="module")
def values():
    """Samples of the machine in order."""
    return moved(LOADED, seed=5, seconds=SECONDS)


def paired(values, rate, late=0.0, only=None):
    """Beside sample k of the angles stands what the pressures (of the sensors `only`) were at rate k - late."""
    k, found = np.arange(len(values)), values.copy()
    for name, signal in places(SERVICE.machine, Place.PRESSURE):
        if only is None or name in only:
            found[:, signal] = np.interp(rate * k - late * RATE, k, values[:, signal])
    return found


def test_one_clock_is_one_clock(values):
    assert not clock_faults(MODEL, [Recording("order", values, 0.0)])


@pytest.mark.parametrize(
    ("rate", "late", "first", "last"),
    [(1.0, 0.5, 0.5, 0.5), (1.0, -0.3, -0.3, -0.3), (0.995, 0.0, 0.01, 0.44), (0.5, 0.0, 2.0, 45.0)],
)
def test_a_lag_is_measured_whether_it_grows_or_not(values, rate, late, first, last):
    """Pressures shown at t are those of rate t - late: what belongs to t is shown at (t + late)/rate."""
    (fault,) = clock_faults(MODEL, [Recording("field", paired(values, rate, late), 0.0)])
    told = np.interp([fault.begins, fault.ends], [0.0, SECONDS], [late, (SECONDS + late) / rate - SECONDS])
    assert np.all(np.abs(np.array([fault.first, fault.last]) - told) < 4.0 * fault.errors + 0.02), (fault, told)
    assert [fault.first, fault.last] == pytest.approx([first, last], abs=0.3)
    assert fault.closed > 0.9


@pytest.mark.parametrize(
    "only", [("boom_head_pressure",), ("boom_head_pressure", "stick_head_pressure", "stick_rod_pressure")]
)
def test_each_sensor_may_have_a_clock_of_its_own(values, only):
    """As on a scope with two time bases: some pressures slower, all else right."""
    (fault,) = clock_faults(MODEL, [Recording("field", paired(values, 0.9, only=only), 0.0)])
    assert fault.sensors == only
    assert not fault.whole
    assert fault.last == pytest.approx(fault.ends / 9.0, abs=4.0 * fault.errors[1] + 0.02)


def test_each_group_of_recordings_has_its_own_faults(values):
    """Recordings of two groups may have the same name."""
    late, right = (Recording("log", paired(values, 1.0, lag), 0.0) for lag in (0.5, 0.0))
    one, two, none = clock_faults_of_groups(MODEL, ((right,), (right, late), ()))
    assert (one, none) == ([], [])
    assert [fault.first for fault in two] == pytest.approx([0.5], abs=0.1)


def test_two_nodes_may_have_two_clocks(values):
    field = paired(values, 0.9, only=("boom_head_pressure", "boom_rod_pressure"))
    field = paired(field, 1.0, 0.5, only=("stick_head_pressure", "stick_rod_pressure"))
    first, second = clock_faults(MODEL, [Recording("field", field, 0.0)])
    assert first.sensors == ("boom_head_pressure", "boom_rod_pressure")
    assert second.sensors == ("stick_head_pressure", "stick_rod_pressure")
    assert [second.first, second.last] == pytest.approx([0.5, 0.5], abs=0.1)


def test_a_jump_is_measured(values):
    """From one instant on the pressures are those of so much later."""
    jump, k = -0.7, np.arange(len(values))
    field = np.where((k > 0.4 * len(values))[:, None], paired(values, 1.0, jump), values)
    (fault,) = clock_faults(MODEL, [Recording("field", field, 0.0)])
    assert fault.first == 0.0
    assert abs(fault.last - jump) < 4.0 * fault.errors[1] + 0.02


def test_it_is_told_by_name_with_its_cure(values):
    told = clock_faults(MODEL, [Recording("field", paired(values, 0.9), 0.0)])
    answer = off_clock(told)
    assert answer["verdict"] == "explained"
    (effect,) = answer["effects"]
    assert (effect["name"], effect["at"]) == ("clock_fault", "machine")
    assert effect["sensors"] == [name for name, _ in places(SERVICE.machine, Place.PRESSURE)]
    assert "pressures and angles are not on one clock in field" in answer["reason"]


def test_motion_that_repeats_itself_has_other_lags_that_are_told():
    """A joint that swings every three seconds, its pressure 1.2 s late, or 1.8 s early."""
    period, late, rng = 3.0, 1.2, np.random.default_rng(8)
    t, shown = np.arange(2.0, 58.0, 0.4), np.arange(0.0, 60.0, 0.05)
    torque = 1e4 * np.sin(2.0 * np.pi * t / period) + 100.0 * rng.standard_normal(len(t))
    pressure = np.sin(2.0 * np.pi * (shown - late) / period)
    joint = JointRows(
        np.ones((len(t), 1)), torque, np.full((len(t), 1), 1e4), t, pressure[:, None], 0.05, ("boom_head",)
    )
    (fault,) = faults_of_piece(Recording("field", np.zeros((0, 1)), 0.0), 0.0, [joint])
    lags = sorted([(fault.first, fault.last), *fault.alternatives])
    assert [lags[0], lags[-1]] == [pytest.approx((lag, lag), abs=0.1) for lag in (late - period, late)]
    told = off_clock([fault])
    assert len(told["effects"][0]["alternatives"]) == len(fault.alternatives)
    assert "repeats itself" in told["reason"]


def test_a_smaller_lag_is_left_to_the_search(values):
    assert not clock_faults(MODEL, [Recording("field", paired(values, 1.0, 0.5 * LATE_S), 0.0)])


@pytest.mark.parametrize(
    ("name", "at", "size"),
    [
        ("sensor_delay", "boom_head_pressure", 0.2),
        ("sensor_delay", "stick_angle", 0.2),
        ("angle_offset", "boom_angle", 0.05),
        ("coulomb_friction", "bucket", 8000.0),
        ("extra_mass", "bucket", [800.0, 0.0, 0.0, 0.0]),
    ],
)
def test_nothing_else_is_taken_for_it(name, at, size):
    truth = truth_of(LOADED)._replace(effects=(imposed(SERVICE.machine, name, at, size),))
    scene = moves(SERVICE.machine, np.random.default_rng(6), 60.0)
    made, rng = sensors(SERVICE.machine, SERVICE.nodes), np.random.default_rng(7)
    (record,) = run(SERVICE.machine, truth, made, [scene], dt=1.0 / RATE, rng=rng)
    assert not clock_faults(MODEL, [Recording("field", record.values, 0.0)])


def test_digging_is_not_taken_for_it():
    play = prepare(LOADED, "cycles", 6, 0.1, amount=4)
    assert not clock_faults(MODEL, [Recording("dug", record.values, 0.0) for record in play.records])
