"""Return pressures: the zero of a sensor shows in the chamber that discharges oil."""

import numpy as np
import pytest

from cylforce.diagnosis.regressors import TorqueRows, return_evidence, return_laws, return_levels
from cylforce.effects.library import Proposal
from cylforce.effects.sensors.pressure_drift import PressureDrift
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.readings.constants import BLOCK_ROWS, ROWS_HZ
from cylforce.readings.recording import Recording
from diagnosis.scenes import MACHINE, RATE_HZ

NAMES = [s.name for s in MACHINE.signals]
HEAD, ROD = NAMES.index("stick_head_pressure"), NAMES.index("stick_rod_pressure")
STICK = MACHINE.signals[HEAD].index
SECONDS = 240.0
BLOCK_S = BLOCK_ROWS / ROWS_HZ


def recording(seed, rod=0.0, scatter=2e4, speeds=(0.05, 0.3)):
    """Return a recording in which the stick extends, pushed by the pump, at a speed of its own in every block.

    Its rod side discharges oil at 5 bar + 200 bar s^2/m^2 v^2, its zero off by `rod` [Pa].
    """
    rng = np.random.default_rng(seed)
    t, fine = np.arange(0.0, SECONDS, 1.0 / ROWS_HZ), np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    each, away = rng.uniform(*speeds, 100), rng.normal(0.0, scatter, 100)
    speed = np.zeros((len(t), len(MACHINE.cylinders)))
    speed[:, STICK] = each[(t / BLOCK_S).astype(int)]
    values = np.zeros((len(fine), len(NAMES)))
    block = (fine / BLOCK_S).astype(int)
    values[:, ROD] = 5e5 + 2e7 * each[block] ** 2 + away[block] + rod
    values[:, HEAD] = 80e5
    empty, nothing = np.zeros((len(t), 0)), np.zeros((len(t), 0), dtype=np.float32)
    posture = np.zeros((len(t), MACHINE.size))
    rows = TorqueRows(empty, empty, nothing, nothing, empty, t, speed, np.where(speed > 0.0, 1e5, 0.0), posture)
    return Recording(f"{seed}", values), rows


def evidence(size, sensor=ROD, law=None, rod=0.0, scatter=2e4):
    """Return the evidence for an error of a sensor where the rod side's zero is off, beside two healthy recordings."""
    healthy, field = [recording(1, 0.0, scatter), recording(2, 0.0, scatter)], [recording(3, rod, scatter)]
    return from_recordings(healthy, field, size, sensor, law or PressureOffset())


def from_recordings(healthy, field, size, sensor=ROD, law=None):
    levels = return_levels(MACHINE, return_laws(MACHINE, healthy, RATE_HZ), field, RATE_HZ)
    if sensor not in levels:
        return 0.0
    proposal = Proposal((law or PressureOffset(),), NAMES[sensor], sensor)
    return return_evidence(MACHINE, levels[sensor], proposal, size, field, RATE_HZ)


@pytest.mark.parametrize("rod", [2e5, -2e5])
def test_an_offset_that_is_there_is_confirmed(rod):
    assert evidence(rod, rod=rod) > 5.0


def test_an_offset_that_is_not_there_is_contradicted():
    assert evidence(2e5) < -5.0


def test_the_wrong_sign_is_contradicted():
    assert evidence(-2e5, rod=2e5) < evidence(2e5, rod=2e5) - 10.0


def test_a_chamber_that_never_discharges_oil_says_nothing():
    assert evidence(2e5, HEAD, rod=2e5) == 0.0


def test_a_pressure_that_scatters_says_nothing():
    assert evidence(2e5, rod=2e5, scatter=6e5) == 0.0


def test_a_drift_is_contradicted_where_the_pressure_stays():
    assert evidence(3e5 / (SECONDS / 3600.0), law=PressureDrift()) < -3.0


@pytest.mark.parametrize("seed", [11, 12, 13, 14])
def test_speeds_that_no_healthy_recording_has_contradict_nothing(seed):
    slow, fast = recording(seed, speeds=(0.05, 0.06)), recording(20, rod=3e5, speeds=(0.2, 0.25))
    assert from_recordings([slow], [fast], 3e5) > -1.0
