"""Force and weight against a truth from outside the estimator: an arm held still whose pressures follow from hand
statics (statics.py), sent as frames through the service."""

from math import atan2, hypot, radians

import numpy as np
import pytest

from cylforce.estimation.model import BetweenStrokes
from cylforce.estimation.residual import RELATIVE
from cylforce.service.contact.noise import PRIOR
from cylforce.service.core import Core
from cylforce.signals.estimate import Status
from held_arm import PITCH, ROW_ERROR, SERVICE, THETA, estimates, readings, served, tares
from statics import LINKS, TOOL, G, place, torques

SETTLED = 1.5  # s, by when the filters have forgotten their start


def said(core, seconds=SETTLED, **given):
    """What the service says in the end of an arm held still."""
    values = readings(**given)
    return estimates(core, lambda _: values, seconds)[-1]


@pytest.fixture(scope="module")
def core():
    return Core(SERVICE, tares())


@pytest.mark.parametrize(
    "force", [(10e3, 0.0), (-10e3, 0.0), (0.0, 10e3), (0.0, -10e3), (8e3, 6e3), (-6e3, 8e3)], ids=str
)
def test_a_known_force_on_the_teeth_is_told_with_its_sign_on_its_axis(core, force):
    """x forward, z up, on a machine that stands nose up by 5 degrees. A digit of the pressures (2 kPa) is a few dozen
    newtons in a cylinder and less at the teeth: within 100 N."""
    found = said(core, force=force).force
    assert [found.x.value, found.z.value] == pytest.approx(force, abs=100.0)
    assert abs(found.x.value - force[0]) < 3.0 * found.x.standard_error
    assert abs(found.z.value - force[1]) < 3.0 * found.z.standard_error
    assert found.magnitude.value == pytest.approx(hypot(*force), abs=100.0)
    off = (found.direction.value - atan2(force[1], force[0]) + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) < radians(0.6)
    assert {q.status for q in found.quantities} == {Status.OK}


def test_nothing_at_the_teeth_is_told_as_nothing(core):
    found = said(core).force
    assert [found.x.value, found.z.value] == pytest.approx([0.0, 0.0], abs=100.0)


def jacobian():
    """How torques (3,) follow from a force x, z and a moment on the bucket: minus the work per turn of each joint."""
    pins = [place(THETA, 1, (0.0, 0.0), PITCH), place(THETA, 2, (0, 0), PITCH), place(THETA, 3, (0, 0), PITCH)]
    arms = place(THETA, 3, TOOL, PITCH) - np.array(pins)
    return np.stack([arms[:, 1], -arms[:, 0], -np.ones(3)], axis=-1)


def expected_covariance(force, moment_error):
    """Of (x, z): of a posture that shows all three unknowns it is the rows' own, carried over. `moment_error` [kg m] is
    that of the boom's X, which asks for g cos(angle) at the boom alone."""
    asked = jacobian()[:, :2] @ force
    noise = np.diag((PRIOR * ROW_ERROR) ** 2 + (RELATIVE * asked) ** 2)
    noise[0, 0] += (moment_error * G * np.cos(THETA[0] + PITCH)) ** 2
    back = np.linalg.inv(jacobian())
    return (back @ noise @ back.T)[:2, :2]


@pytest.mark.parametrize("moment_error", [0.0, 100.0])
def test_the_covariance_of_the_force_is_that_of_its_torques_and_of_the_tares(moment_error):
    """By hand: inverse Jacobian, rows' variance, the boom's first moment known to 100 kg m. Two percent: a moment on
    the bucket is expected within a full load's."""
    force = np.array([4e3, -9e3])
    found = said(Core(SERVICE, tares({"boom.X": moment_error**2})), force=force).force
    (xx, xz), (_, zz) = expected_covariance(force, moment_error)
    assert found.covariance == pytest.approx((xx, xz, zz), rel=0.02)
    assert found.x.standard_error == pytest.approx(xx**0.5, rel=0.01)
    assert found.z.standard_error == pytest.approx(zz**0.5, rel=0.01)
    along = np.array([4.0, -9.0]) / hypot(4.0, 9.0)
    across = np.array([9.0, 4.0]) / hypot(4.0, 9.0)
    spread = np.array([[xx, xz], [xz, zz]])
    assert found.magnitude.standard_error == pytest.approx((along @ spread @ along) ** 0.5, rel=0.02)
    assert found.direction.standard_error == pytest.approx((across @ spread @ across) ** 0.5 / 9849.0, rel=0.02)


def test_the_force_is_as_uncertain_as_the_scale_besides(core):
    """2 % of 12 kN down and 5 kN forward: 240 N and 100 N more, squared, and both of one sign or the other together."""
    scaled, force = Core(SERVICE, tares(scale_error=0.02)), (5e3, -12e3)
    alone, both = (np.array(said(c, force=force).force.covariance) for c in (core, scaled))
    assert both - alone == pytest.approx([100.0**2, -100.0 * 240.0, 240.0**2], rel=0.02)


def test_a_force_is_told_within_thirty_milliseconds(core):
    """A low-pass at 20 Hz is late by sqrt(2) / (2 pi 20 Hz) = 11 ms: half of a step is there one sample after the first
    reading, all but 2 % of it after 0.1 s."""
    before, after = readings(), readings(force=(0.0, 10e3))
    found = estimates(core, lambda t: after if t >= 2.0 else before, 3.0)
    z = np.array([e.force.z.value for e in found])
    half = np.argmax(z > 5e3) * 0.01 - 2.0
    assert 0.005 < half < 0.03
    assert np.all(np.abs(z[:200][np.isfinite(z[:200])]) < 100.0)
    assert np.all(np.abs(z[210:] - 10e3) < 200.0)


def test_a_hanging_load_is_told_with_its_weight(core):
    """1000 kg, 0.7 m out: within 5 kg, and no pull upwards is a load."""
    found = said(core, held=(1000.0, 0.7, 0.1), seconds=3.0)
    assert found.gross.value == pytest.approx(1000.0, abs=5.0)
    assert found.gross.status is Status.OK
    lifted = said(core, force=(0.0, 9806.65), seconds=3.0)
    assert lifted.gross.status is Status.INVALID


def test_the_weight_is_as_uncertain_as_the_scale_besides(core):
    """2 % of 1000 kg: 20 kg more, squared."""
    scaled = Core(SERVICE, tares(scale_error=0.02))
    alone, both = (said(c, held=(1000.0, 0.7, 0.1), seconds=3.0).load.mass for c in (core, scaled))
    assert both.value == pytest.approx(alone.value)
    assert both.standard_error**2 - alone.standard_error**2 == pytest.approx((0.02 * alone.value) ** 2)


def test_the_weight_is_the_more_uncertain_the_heavier_it_is(core):
    """Friction and elasticity grow with the load, by one percent of its torque: a load of 1400 kg asks for 35 kN m at
    the boom, of which 1 % is far more than the rows' 20 N m. So the error grows nearly in proportion, where the zeros
    of the pressures are known."""
    known = Core(SERVICE, core.tares._replace(between_strokes=BetweenStrokes(0.1, 1.0)))
    light, heavy = (said(known, held=(kg, 0.7, 0.1), seconds=3.0).load.mass for kg in (350.0, 1400.0))
    assert 3.0 < heavy.standard_error / light.standard_error < 4.0


def variance_of_mass(core, held):
    """Variance of the weight of a load [kg^2] after 3 s, without that of undetected errors of the signals."""
    state, found = served(core, lambda _: readings(held=held), 3.0)
    return found[-1].load.mass.standard_error ** 2 - state.monitor.undetected.mass**2


def test_the_weight_is_as_uncertain_as_the_tares(core):
    """100 kg m more at the boom alone: what a least-squares fit of a mass at the bucket's pin and of a moment on the
    bucket to three torques makes of it, every row weighted by its own error. What undetected errors of the signals
    add is subtracted; `plausibility/test_undetected.py` has it."""
    wide = Core(SERVICE, tares({"boom.X": 100.0**2}))
    held = (1000.0, 0.7, 0.1)
    alone, both = (variance_of_mass(c, held) for c in (core, wide))
    level = np.cos(PITCH + np.cumsum(THETA))
    asked = torques(THETA, PITCH, held) - torques(THETA, PITCH)
    far = np.array(
        [LINKS[0]["length_m"] * level[0] + LINKS[1]["length_m"] * level[1], LINKS[1]["length_m"] * level[1], 0]
    )
    columns = G * np.stack([far, np.ones(3)], axis=-1)
    weighted = columns.T / (ROW_ERROR**2 + (RELATIVE * asked) ** 2)
    gain = np.linalg.solve(weighted @ columns, weighted)[0]
    more = gain[0] * 100.0 * G * level[0]
    assert both - alone == pytest.approx(more**2, rel=0.02)
