"""A base that rocks and drives: its acceleration acts as gravity does, in an inertial sensor as on the arm."""

from dataclasses import replace

import numpy as np
import pytest

from chains import chain, machine
from cylforce.commissioning.wiring import misplaced_inertial_sensor
from cylforce.effects.imposed import imposed
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.model import Model
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import base_parameters
from cylforce.mechanics.motion import LEVEL, Attitude, motion
from cylforce.service.contact.rocking import BaseConstants, BaseFilter
from cylforce.service.weighing import LoadConstants
from cylforce.settings.machine_file import SettingsError, load
from cylforce.signals.kinds import INERTIAL, UNIT, Kind, Signal
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import true_values
from cylforce.simulation.simulator import Truth, simulate
from instants import ALL, unexplained_of
from machines import excavator
from reference_machine.arm import GRAVITY
from reference_machine.loader import draw
from reference_machine.loader.machinefile import machine_file

PLACE = -0.6 - 0.4j
LIMITS = {"rad/s": (-3.0, 3.0), "m/s^2": (-40.0, 40.0)}
FILTERS = Filters(100.0, 5.0, 2.0, 2.0, 0.002)


def course(t, rng):
    """Angles (T, 3) of smooth motion."""
    w, at = rng.uniform(1.0, 3.0, 3), rng.uniform(0.0, 6.0, 3)
    return 0.5 * np.sin(np.multiply.outer(t, w) + at)


def differences(f, t, h=1e-3):
    """First and second derivative of f at times t, of fourth order."""
    f_2, f_1, f0, f1, f2 = (f(t + k * h) for k in (-2, -1, 0, 1, 2))
    return (8 * (f1 - f_1) - (f2 - f_2)) / (12 * h), (16 * (f1 + f_1) - (f2 + f_2) - 30 * f0) / (12 * h * h)


def test_links_on_an_accelerated_base_are_a_chain_with_one_link_more():
    """Torques of the joints beyond the first one, whose link is the base here: its pitch is the first angle, and the
    specific force of its outer pin that of gravity and of its turning."""
    links = chain(np.random.default_rng(2), 3)
    whole, outer, t = machine(links), machine(links[1:]), np.linspace(0.0, 3.0, 40)

    def angles(s):
        return course(s, np.random.default_rng(5))

    def all_of(s):
        return motion(whole, angles(s), differences(angles, s)[0], np.zeros(0))

    def seen(s):
        rate, turn = differences(angles, s)
        pitch, w, alpha = angles(s)[..., 0], rate[..., 0], turn[..., 0]
        pin = (1j * alpha - w**2) * links[0].length  # in the axes of the base
        force = 1j * whole.gravity * np.exp(-1j * pitch) + pin
        base = Attitude(pitch, 0.0, w, 0.0, force)
        return motion(outer, angles(s)[..., 1:], rate[..., 1:], np.zeros(0), base)

    found = []
    for moved, phi in ((all_of, base_parameters(links)), (seen, base_parameters(links[1:]))):
        of = outer if moved is seen else whole

        def momentum(s, moved=moved, of=of, phi=phi):
            return Rigid().halves(of, moved(s)).momentum @ phi

        found.append((differences(momentum, t)[0] + Rigid().halves(of, moved(t)).static @ phi)[:, -2:])
    np.testing.assert_allclose(found[1], found[0], atol=1e-6 * np.abs(found[0]).max())


def test_without_acceleration_nothing_changes():
    """Pitch and roll, and the specific force that a sensor at rest shows there, are the same gravity."""
    m, rng = excavator(), np.random.default_rng(3)
    theta, thetad = rng.uniform(-1.5, 0.5, (2, 30, 3))
    pitch, roll = rng.uniform(-0.2, 0.2, (2, 30))
    still = 1j * m.gravity * np.cos(roll) * np.exp(-1j * pitch)
    for effect in (Rigid(), RockerWeight()):
        one, other = (
            effect.halves(m, motion(m, theta, thetad, np.zeros((30, 3)), LEVEL._replace(pitch=pitch, **more))).static
            for more in ({"roll": roll}, {"specific": still})
        )
        np.testing.assert_allclose(other, one, atol=1e-9)


def rigged():
    """The excavator with an inertial sensor."""
    plain = excavator()
    more = tuple(Signal(k.value, k, 0, *LIMITS[UNIT[k]], 0.01, 1e-3) for k in INERTIAL)
    return replace(plain, signals=(*plain.signals, *more), inertial=PLACE)


def recorded(m, rocks):
    """Perfect samples (T, S) of a frictionless excavator, and its base parameters."""
    effects = (imposed(m, "boom_motion", "machine", [1.0 * rocks, 2.0 * rocks, rocks]),) if rocks else ()
    truth = Truth(m.links, (), np.zeros(3), 0.02, 0.0, effects)
    scene = moves(m, np.random.default_rng(4), 20.0)
    return true_values(m, simulate(m, truth, scene, np.arange(2000) / 100.0)), base_parameters(m.links)


@pytest.mark.parametrize("rocks", [0.0, 1.0])
def test_what_rocking_does_is_explained_with_the_sensor(rocks):
    """What is left of the torque; the sensor sits elsewhere than the pin, and the simulator's own equations move the
    chassis about a pivot."""
    m = rigged()
    values, phi = recorded(m, rocks)
    left = []
    for machine_ in (m, replace(m, signals=m.signals[:-3])):
        model = Model(machine_, FILTERS, ())
        moved = model.channels.run(values[:, : len(machine_.signals)]).motion
        phi_all = np.concatenate([phi, np.zeros(len(model.parameters) - len(phi))])
        rows = model.filtered.run(moved)
        rest = rows.torque - rows.columns[..., : len(phi_all)] @ phi_all
        left.append(np.sqrt(np.mean(rest[300:] ** 2, axis=0)))
    with_it, without = left
    assert np.all(with_it < 60.0)
    assert rocks == 0.0 or np.all(without > 10.0 * with_it)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda v: v, None),
        (lambda v: v[:, [0, 2, 1]], "lies on another axis"),
        (lambda v: v * [1.0, 1.0, -1.0], "lies on another axis"),
        (lambda v: v * [1.0, 1.0, 0.1], "lies on another axis"),
        (lambda v: v * [-1.0, 1.0, 1.0], "pitch_rate counts against the pitch"),
    ],
)
def test_a_sensor_on_another_axis_is_told(change, sentence):
    m = rigged()
    values, _ = recorded(m, 1.0)
    values[:, -3:] = change(values[:, -3:])
    found = misplaced_inertial_sensor(Model(m, FILTERS, ()), values)
    assert found is None if sentence is None else sentence in found


SHEET = machine_file("loader", inertial=True)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "range_m_s2 = [-40, 40]",
            "range_m_s2 = [-5, 5]",
            "upward_acceleration is 9.81: the sensor lies on another",
        ),
        ('kind = "pitch_rate"', 'kind = "slew_rate"', "forward_acceleration.kind.*add pitch_rate, or remove"),
        ("inertial_sensor_m = [-0.6, -0.4]", "", "lacks inertial_sensor_m"),
    ],
)
def test_a_file_with_half_a_sensor_or_another_axis_is_refused(tmp_path, old, new, words):
    path = tmp_path / "machine.toml"
    path.write_text(SHEET)
    assert load(path).service.machine.inertial == PLACE
    assert old in SHEET
    path.write_text(SHEET.replace(old, new))
    with pytest.raises(SettingsError, match=words):
        load(path)


def test_the_place_of_no_sensor_is_refused(tmp_path):
    path = tmp_path / "machine.toml"
    path.write_text(
        machine_file("loader").replace("payload_reach_m", "inertial_sensor_m = [0.1, 0.2]\npayload_reach_m")
    )
    with pytest.raises(SettingsError, match=r"machine.inertial_sensor_m.*is of no use without"):
        load(path)


def test_the_reference_loaders_sensor_sees_driving_rocking_and_slope():
    """Against differences of the place where it sits, by the truth's own angles."""
    loader = draw(3, friction="none", sensors="perfect", inertial=True)
    run = loader.run("cycles", payloads_kg=(2000.0,), rock_deg=0.6, drive=0.6, pitch_deg=2.0, roll_deg=0.0)
    true, sheet = run.truth, loader.specimen.sheet
    arm = complex(*sheet.inertial) - complex(*sheet.wheels)
    place = arm * np.exp(1j * true["rock"])
    acceleration = (place[:-4] - 2 * place[2:-2] + place[4:]) / 0.02**2 + true["drive_acceleration"][2:-2]
    slope = GRAVITY * (np.sin(np.radians(2.0)) + 1j * np.cos(np.radians(2.0)))
    expected = (acceleration + slope) * np.exp(-1j * true["rock"][2:-2])
    found = run.column("forward_acceleration") + 1j * run.column("upward_acceleration")
    assert np.abs(found[2:-2] - expected).max() < 0.03
    assert np.ptp(found.real) > 1.0
    assert run.column("pitch_rate") == pytest.approx(true["rock_rate"], abs=2e-3)
    assert Kind.PITCH_RATE in INERTIAL


def rocker():
    """Of an excavator without an inertial sensor, and a pose (D,) of its channels, pitched by 0.1."""
    model = Model(excavator(), FILTERS, ())
    tares = model.data_sheet
    pose = np.array([0.4, -1.4, -0.6, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    return BaseConstants(model, tares), model, tares, pose


def remainder(model, tares, pose, acceleration, error=100.0):
    """What the first pin's acceleration (forwards, upwards) leaves of the torques, by the difference of two gravities,
    while the bucket is empty."""
    phi = tares.values
    found = []
    for more in (0.0, complex(*acceleration)):
        specific = (1j * model.machine.gravity + more) * np.exp(-0.1j)
        moving = motion(model.machine, pose[:3], np.zeros(3), np.zeros(3), Attitude(0.1, specific=specific))
        found.append(model.empty.both_halves(moving)[1])
    torque = (found[1] - found[0]) @ phi
    columns = np.zeros((3, len(model.filtered.regressor.names)))
    columns[:, : len(phi)] = found[0]
    return unexplained_of(columns, torque, np.full(3, error**2))


def after(constants, lift, pose, left, samples=4000, turning=lambda k: 0.0):
    """The motion of the base after many samples, and the variance of the last rows."""
    base, lift.taken = BaseFilter.start(constants), 1000
    for k in range(samples):
        pose = pose.copy()
        pose[-3] = 0.1 + turning(k)
        base.update(left, numbers(pose), lift, ALL)
    return base, np.array(left.variance) + np.array(left.wider)


def test_what_the_torques_have_in_common_is_the_bases_acceleration():
    constants, model, tares, pose = rocker()
    lift = LoadConstants(model, tares).new_lift()
    for size in ((0.03, 0.0), (0.0, 0.008)):
        left = remainder(model, tares, pose, size, error=40.0)
        state, wide = after(constants, lift, pose, left)
        assert np.sqrt([state.forward, state.upward]) == pytest.approx(size, abs=0.2 * max(size))
        assert wide - np.array(left.variance) == pytest.approx(np.array(left.torque) ** 2, rel=0.4)
    quiet = remainder(model, tares, pose, (0.0, 0.0))
    assert after(constants, lift, pose, quiet)[1] == pytest.approx(list(quiet.variance))


def test_contact_is_no_motion_of_the_base():
    constants, model, tares, pose = rocker()
    lift = LoadConstants(model, tares).new_lift()
    left = remainder(model, tares, pose, (0.0, 0.5))
    state, wide = after(constants, lift, pose, left, 500)
    assert (state.forward, state.upward) == (0.0, 0.0)
    assert wide == pytest.approx(list(left.variance))


def test_a_tilt_that_rocks_widens_the_error():
    """One degree at 1 Hz turns the base by 0.49 rad/s^2 rms, and moves a pin at 2 m by 1 m/s^2."""
    constants, model, tares, pose = rocker()
    lift = LoadConstants(model, tares).new_lift()
    left = remainder(model, tares, pose, (0.0, 0.0))
    state, wide = after(constants, lift, pose, left, turning=lambda k: np.radians(1.0) * np.sin(0.02 * np.pi * k))
    assert np.sqrt(state.turning) == pytest.approx(np.radians(1.0) * (2 * np.pi) ** 2 / np.sqrt(2.0), rel=0.15)
    by_hand = sum(np.array(remainder(model, tares, pose, way).torque) ** 2 for way in ((1.0, 0.0), (0.0, 1.0)))
    assert wide == pytest.approx(np.array(left.variance) + state.turning * 4.0 * by_hand, rel=0.05)


def test_noise_of_the_tilt_is_no_rocking():
    constants, model, tares, pose = rocker()
    lift = LoadConstants(model, tares).new_lift()
    rng = np.random.default_rng(1)
    left = remainder(model, tares, pose, (0.0, 0.0))
    error = next(s.standard_error for s in model.machine.signals if s.kind is Kind.PITCH)
    state, wide = after(constants, lift, pose, left, turning=lambda _: error * rng.standard_normal())
    assert np.sqrt(state.turning) < 0.1
    assert np.all(wide < np.array(left.variance) * 1.5 + 300.0**2)


def test_with_the_sensor_nothing_is_widened():
    m = rigged()
    model = Model(m, FILTERS, ())
    left = unexplained_of(np.zeros((3, len(model.parameters))), np.ones(3), np.ones(3))
    lift = LoadConstants(model, model.data_sheet).new_lift()
    base = BaseFilter.start(BaseConstants(model, model.data_sheet))
    for _ in range(100):
        base.update(left, numbers(np.zeros(12)), lift, ALL)
    assert not any(left.wider)
