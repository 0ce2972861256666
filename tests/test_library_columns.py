"""What the diagnosis expects of an effect of the library, its column, is what the simulated machine shows of it."""

from itertools import product

import numpy as np
import pytest

from cylforce.diagnosis.columns.floor import fitted_tares
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.effects.friction.presliding_hysteresis import PreslidingHysteresis
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.imposed import imposed
from cylforce.effects.library import Proposal
from cylforce.estimation.model import FRICTION, Model
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import perfect, run
from cylforce.simulation.simulator import draw_truth
from gap_scene import MACHINE, SERVICE

SECONDS = 60.0


def recorded(*effects):
    """Empty moves, read by perfect sensors."""
    truth = draw_truth(MACHINE, np.random.default_rng(1), 0.1)
    truth = truth._replace(friction=truth.friction[:2], effects=effects)  # dry and viscous, as the model knows them
    scene = moves(MACHINE, np.random.default_rng(2), SECONDS)
    dt, rng = 1.0 / SERVICE.filters.rate_hz, np.random.default_rng(3)
    return Recorded("moves", next(iter(run(MACHINE, truth, perfect(MACHINE), [scene], dt=dt, rng=rng))).values, 0.0)


@pytest.fixture(scope="module")
def plain():
    """The recording without any effect, and what sees it."""
    found, model = recorded(), Model(MACHINE, SERVICE.filters, FRICTION)
    return found, Viewer(model, fitted_tares(model, [found]))


# name, place, size, shape, and how much of what is seen the column may lack (rms): a law of force is exact
CASES = [
    ("asymmetric_friction", "stick", 300.0, {"way": 1}, 0.01),
    ("asymmetric_friction", "boom", -300.0, {"way": -1}, 0.01),
    ("end_cushion", "bucket", 3e3, {"length": 0.15, "end": 0}, 0.01),
    ("hose_spring", "stick", 400.0, {"rest": 0.0, "cubic": False}, 0.01),
    ("hose_spring", "bucket", 400.0, {"rest": 0.5, "cubic": True}, 0.01),
    ("mud", "stick", [100.0, 40.0, -20.0], {"slowing": 0.0}, 0.02),
    ("mud", "bucket", [100.0, 0.0, 0.0], {"slowing": 0.005}, 0.02),
    ("angle_scale", "stick_angle", 0.004, {"right": 0.0}, 0.05),
    ("angle_scale", "boom_angle", -0.004, {"right": 1.0}, 0.05),
    ("friction_temperature_drift", "machine", -0.3, {"settling": 300.0}, 0.05),
    ("friction_temperature_drift", "machine", 0.3, {"settling": 900.0, "viscous": True, "cold": True}, 0.05),
    ("friction_temperature_drift", "stick", -0.3, {"settling": 900.0, "alone": True}, 0.05),
    ("pressure_sensor_hysteresis", "boom_head_pressure", 1.8e5, {"opening": 0.0}, 0.35),  # it stands still at times
    ("pressure_sensor_hysteresis", "stick_rod_pressure", 1e5, {"opening": 30e5}, 0.05),
    ("return_line_loss", "boom", [3e3, 2e3], {"power": 1.3}, 0.01),
    ("pin_friction", "stick", 0.004, {}, 0.05),
    ("counterbalance_pressure", "boom", 2e3, {"relief": 2e-6}, 0.05),
    ("ringing_compliance", "boom", 1e-7, {"frequency": 1.0, "damping": 0.1}, 0.05),
    ("soft_ground", "machine", 2e-8, {}, 0.05),
    ("backlash", "stick", 0.01, {"pushed": True}, 0.2),  # readings hold the fall: when it begins is a little off
    ("encoder_eccentricity", "stick_angle", [0.003, 0.002], {}, 0.05),
    ("pressure_zero_settling", "boom_head_pressure", 1e5, {"settling": 20.0}, 0.05),
]


@pytest.mark.parametrize(("name", "at", "value", "shape", "lacking"), CASES)
def test_the_simulated_machine_shows_the_column(plain, name, at, value, shape, lacking):
    before, viewer = plain
    effect = imposed(MACHINE, name, at, value, shape=shape)
    wanted = [Proposal(effect.group, at, effect.where)]
    rows, after = (viewer.rows(r, wanted) for r in (before, recorded(effect)))
    expected = after.effects @ np.array(effect.sizes)  # of the recording that has the effect
    seen = after.left - rows.left
    good = np.isfinite(seen)
    off = np.sqrt(np.mean((seen - expected)[good] ** 2) / np.mean(seen[good] ** 2))
    assert off < lacking, f"{off:.3f} of {np.sqrt(np.mean(seen[good] ** 2)):.1f} N m"


def test_friction_at_creep_is_not_taken_for_one_that_builds_up_after_a_reversal(plain):
    """Beside all that the model fits, both point away from each other, or share less than a quarter of their energy;
    both can only be positive."""
    for width, way in product((0.006, 0.015, 0.04), (0.0005, 0.0015, 0.003, 0.006)):
        assert -0.8 < apart(plain[1], plain[0], Stribeck(width), PreslidingHysteresis(way)) < 0.5


def apart(viewer, seen, one, other):
    """Cosine of two columns where the model's parameters explain nothing of either."""
    rows = viewer.rows(seen, [Proposal((effect,), "stick", 1) for effect in (one, other)])
    good = np.isfinite(rows.left)
    base, columns = rows.base[good], rows.effects[good]
    rest = columns - base @ np.linalg.lstsq(base, columns, rcond=None)[0]
    rest /= np.linalg.norm(rest, axis=0)
    return float(rest[:, 0] @ rest[:, 1])
