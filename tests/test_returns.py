"""Return pressures: whose zero is off shows in the chamber that lets oil out."""

from pathlib import Path

import numpy as np
import pytest

from cylforce.diagnosis.columns.recorded import GapRows, Recorded
from cylforce.diagnosis.columns.returns import Returns
from cylforce.diagnosis.columns.rows import RATE_HZ
from cylforce.effects.sensors.pressure_drift import PressureDrift
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.settings.machine_file import load

SERVICE = load(Path(__file__).resolve().parents[1] / "config/excavator_20t.toml").service
MACHINE = SERVICE.machine
NAMES = [s.name for s in MACHINE.signals]
HEAD, ROD = NAMES.index("stick_head_pressure"), NAMES.index("stick_rod_pressure")
STICK = MACHINE.signals[HEAD].index
SECONDS = 120.0


def recording(
    seed: int, rod: float = 0.0, scatter: float = 2e4, speeds: tuple[float, float] = (0.05, 0.3)
) -> tuple[Recorded, GapRows]:
    """The stick extends, pushed by the pump, at speeds of its own in every block; its rod side lets out oil at
    5 bar + 200 bar s^2/m^2 v^2, its zero off by `rod` [Pa]."""
    rng = np.random.default_rng(seed)
    t, fine = np.arange(0.0, SECONDS, 1.0 / RATE_HZ), np.arange(0.0, SECONDS, 1.0 / SERVICE.filters.rate_hz)
    each = rng.uniform(*speeds, 100)
    speed = np.zeros((len(t), len(MACHINE.cylinders)))
    speed[:, STICK] = each[(t / 4.0).astype(int)]
    force = np.where(speed > 0.0, 1e5, 0.0)
    values = np.zeros((len(fine), len(NAMES)))
    away = np.repeat(rng.normal(0.0, scatter, 100), round(4.0 * SERVICE.filters.rate_hz))[: len(fine)]
    values[:, ROD] = 5e5 + 2e7 * each[(fine / 4.0).astype(int)] ** 2 + away + rod
    values[:, HEAD] = 80e5
    empty = np.zeros((len(t), 0))
    posture = np.zeros((len(t), MACHINE.size))
    rows = GapRows(empty, empty, empty, empty, empty, t, speed, force, posture, np.zeros(len(t)))
    return Recorded(f"{seed}", values, 0.0), rows


def returns(rod: float = 0.0, scatter: float = 2e4) -> Returns:
    """Clean recordings, and a faulty one whose rod side's zero is off."""
    clean = [recording(1, 0.0, scatter), recording(2, 0.0, scatter)]
    return Returns(MACHINE, clean, [recording(3, rod, scatter)], SERVICE.filters.rate_hz)


@pytest.mark.parametrize("rod", [2e5, -2e5])
def test_an_offset_that_is_there_is_confirmed(rod: float) -> None:
    assert returns(rod).support((PressureOffset(),), ROD, rod) > 5.0


def test_an_offset_that_is_not_there_is_refuted() -> None:
    assert returns(0.0).support((PressureOffset(),), ROD, 2e5) < -5.0


def test_the_wrong_sign_is_refuted() -> None:
    assert (
        returns(2e5).support((PressureOffset(),), ROD, -2e5)
        < returns(2e5).support((PressureOffset(),), ROD, 2e5) - 10.0
    )


def test_a_side_that_never_lets_oil_out_says_nothing() -> None:
    assert returns(2e5).support((PressureOffset(),), HEAD, 2e5) == 0.0


def test_a_level_that_scatters_says_nothing() -> None:
    assert returns(2e5, scatter=6e5).support((PressureOffset(),), ROD, 2e5) == 0.0


def test_a_drift_is_refuted_where_the_level_stays() -> None:
    per_hour = 3e5 / (SECONDS / 3600.0)
    assert returns(0.0).support((PressureDrift(),), ROD, per_hour) < -3.0


@pytest.mark.parametrize("seed", [11, 12, 13, 14])
def test_speeds_that_no_clean_recording_has_refute_nothing(seed: int) -> None:
    slow, fast = recording(seed, speeds=(0.05, 0.06)), recording(20, rod=3e5, speeds=(0.2, 0.25))
    told = Returns(MACHINE, [slow], [fast], SERVICE.filters.rate_hz)
    assert told.support((PressureOffset(),), ROD, 3e5) > -1.0
