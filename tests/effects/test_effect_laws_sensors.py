"""Laws of sensors' errors, of what lies between sensors and joints, and of the linkages' geometry: each pinned to
numbers worked out by hand."""

from dataclasses import replace
from math import hypot, radians

import numpy as np
import pytest

from cylforce.effects.fault import Place
from cylforce.effects.geometry.backlash import Backlash, fallen
from cylforce.effects.geometry.boom_motion import BoomMotion
from cylforce.effects.geometry.compliance import Compliance
from cylforce.effects.geometry.linkage_geometry import LinkageGeometry
from cylforce.effects.imposed import Imposed, distorted
from cylforce.effects.incidents.clock_fault import ClockFault
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.angle_scale import AngleScale
from cylforce.effects.sensors.delay import Delay
from cylforce.effects.sensors.encoder_eccentricity import EncoderEccentricity
from cylforce.effects.sensors.intermittent_glitch import IntermittentGlitch, glitches
from cylforce.effects.sensors.pressure_drift import PressureDrift
from cylforce.effects.sensors.pressure_gain import PressureGain
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.effects.sensors.pressure_sensor_hysteresis import PressureSensorHysteresis
from cylforce.effects.sensors.pressure_zero import PressureZero
from cylforce.effects.sensors.pressure_zero_settling import PressureZeroSettling
from cylforce.effects.sensors.tilt_ignored import TiltIgnored
from cylforce.estimation.channels import Channels
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.machine import base_parameters, with_parameters
from cylforce.mechanics.motion import Attitude, motion
from cylforce.mechanics.reading import measured_torque, rigid_torque
from cylforce.signals.kinds import Kind
from machines import excavator
from rig import BAR, HEAD, LEVER, LINK, ROD, SIGNALS, reading, readings, rig, turning

FILTERS = Filters(100.0, 5.0, 2.0, 2.0, 0.002)
E_1 = 0.3678794  # 1/e


def changed(effect, size, name, t=(0.0,), **given):
    """What an effect of a size adds to the signal `name` at times t."""
    times, values = np.asarray(t), readings(len(t), **given)
    where = 0 if effect.about.place is Place.LINK else SIGNALS.index(name)
    return reading(effect.distorted(rig(), values, times, where, size) - values, name)


def test_an_offset_is_added():
    assert changed(PressureOffset(), 2 * BAR, "head", head=100 * BAR)[0] == pytest.approx(2 * BAR)
    assert changed(AngleOffset(), 0.02, "angle", angle=-0.3)[0] == pytest.approx(0.02)


def test_an_offset_on_the_rod_side_lowers_the_torque():
    """2 bar on 60 cm^2 at 2.4 m: 2880 N m less; on the head side, 100 cm^2, 4800 N m more."""
    torque = {
        name: measured_torque(
            rig(), PressureOffset().distorted(rig(), readings(1), np.zeros(1), SIGNALS.index(name), 2 * BAR), 0
        )[0]
        for name in ("head", "rod")
    }
    assert torque == {"head": pytest.approx(4800.0), "rod": pytest.approx(-2880.0)}


def test_a_gain_of_three_percent_is_six_bar_of_two_hundred():
    np.testing.assert_allclose(changed(PressureGain(), 0.03, "rod", (0, 1), rod=[200 * BAR, 0.0]), [6 * BAR, 0.0])


def test_a_drift_of_twenty_bar_an_hour_is_ten_after_half_an_hour():
    t = (0.0, 1800.0, 3600.0)
    np.testing.assert_allclose(changed(PressureDrift(), 20 * BAR, "head", t), [0.0, 10 * BAR, 20 * BAR])


def test_a_drift_that_fades_begins_alike_and_ends():
    """Warm after 250 s: by then 1 - 1/e of 250 s' worth; in the end all of it."""
    found = changed(PressureDrift(fading=0.004), 14.4 * BAR, "head", (0.0, 2.5, 250.0, 25e3))
    np.testing.assert_allclose(found, [0.0, 0.01 * BAR, (1.0 - E_1) * BAR, BAR], rtol=6e-3)


def test_a_zero_that_settles_is_wrong_at_the_start_and_right_in_the_end():
    """2 bar at the start; 1/e of that after the sensor's time of 60 s."""
    found = changed(PressureZeroSettling(60.0), 2 * BAR, "rod", (0.0, 60.0, 6000.0))
    np.testing.assert_allclose(found, [2 * BAR, 2 * BAR * E_1, 0.0], rtol=1e-6, atol=1e-9)


def test_an_encoder_off_its_axis_errs_by_one_wave_per_turn():
    """20 mrad: at 0, 30, 90 and 180 degrees; a length sensor does not turn."""
    angle, t = np.radians([0.0, 30.0, 90.0, 180.0]), np.arange(4.0)
    found = changed(EncoderEccentricity(), 0.02, "angle", t, angle=angle)
    np.testing.assert_allclose(found, [0.0, 0.010, 0.020, 0.0], atol=1e-15)
    found = changed(EncoderEccentricity(across=True), 0.02, "angle", t, angle=angle)
    np.testing.assert_allclose(found, [0.020, 0.02 * 0.8660254, 0.0, -0.020], atol=1e-9)
    signals = tuple(replace(s, kind=Kind.CYLINDER_LENGTH) if s.name == "angle" else s for s in rig().signals)
    values = readings(4, angle=angle)
    assert EncoderEccentricity().distorted(replace(rig(), signals=signals), values, t, 2, 0.02) is values


def test_a_scale_is_off_by_more_the_farther_from_the_middle():
    """The range is -40 to 60 degrees: 10 is its middle, 50 half of it."""
    angle = np.radians([10.0, 60.0, -40.0])
    found = changed(AngleScale(), 0.02, "angle", (0, 1, 2), angle=angle)
    np.testing.assert_allclose(found, np.radians([0.0, 1.0, -1.0]), atol=1e-15)
    for right, expected in ((0.0, [1.0, 2.0, 0.0]), (1.0, [-1.0, 0.0, -2.0])):
        off = changed(AngleScale(right), 0.02, "angle", (0, 1, 2), angle=angle)
        np.testing.assert_allclose(off, np.radians(expected), atol=1e-15)


def test_a_sensor_with_play_reads_half_of_it_less_on_the_way_up_and_more_on_the_way_down():
    """4 bar of play: 1 bar up from the middle the reading has moved by nothing, 2 bar up it follows, 2 bar behind.
    Back by 2 bar it is right, by 4 it follows, 2 bar above."""
    pressure = np.array([0.0, 1.0, 2.0, 9.0, 7.0, 5.0, 0.0]) * BAR
    found = changed(PressureSensorHysteresis(), 4 * BAR, "head", np.arange(7.0), head=pressure)
    np.testing.assert_allclose(found, np.array([0.0, -1.0, -2.0, -2.0, 0.0, 2.0, 2.0]) * BAR)


def test_a_play_that_is_removed_stays_on_its_branch_while_the_pressure_rests():
    """Up by 20 bar, down by 15, half a minute of rest, up again; noise of 0.1 bar. Of the error of 2 bar up or down
    less than a third is left, none but noise in the rest until shortly before the pressure rises."""
    t, rng = np.arange(0.0, 60.0, 0.01), np.random.default_rng(1)
    pressure = np.interp(t, [0.0, 5.0, 10.0, 40.0, 50.0, 60.0], np.array([10.0, 30.0, 15.0, 15.0, 35.0, 20.0]) * BAR)
    play, where = PressureSensorHysteresis(), SIGNALS.index("head")
    values = readings(len(t), head=pressure)
    true = values + np.where(np.arange(values.shape[1]) == where, 0.1 * BAR * rng.standard_normal(values.shape), 0.0)
    read = play.distorted(rig(), true, t, where, 4 * BAR)
    left = (play.distorted(rig(), read, t, where, -4 * BAR) - true)[:, where]
    assert np.sqrt(np.mean(left**2)) < 1.0 / 3.0 * np.sqrt(np.mean((read - true)[:, where] ** 2))
    assert np.max(np.abs(left[(t > 11.0) & (t < 37.0)])) < 0.2 * BAR


def test_a_loose_contact_jumps_for_moments_and_the_jumps_are_found_in_the_reading():
    """A tenth of the range, once in every 6 s for 0.05 to 0.3 s; the sensor has noise and moves as a joint does."""
    t, rng = np.arange(0.0, 120.0, 0.01), np.random.default_rng(1)
    machine = replace(rig(), signals=tuple(replace(s, low=-2.0, high=2.0) for s in rig().signals))
    values = readings(len(t), angle=0.5 * np.sin(t) + 1e-3 * rng.standard_normal(len(t)))
    where = SIGNALS.index("angle")
    found = IntermittentGlitch(seed=3).distorted(machine, values, t, where, 0.1)
    off = found[:, where] - values[:, where]
    jumping = off != 0.0
    np.testing.assert_allclose(np.abs(off[jumping]), 0.4)
    lasting = np.diff(np.flatnonzero(np.diff(jumping.astype(int))))[::2]
    assert len(lasting) == 20
    assert 5 <= lasting.min() < lasting.max() <= 30
    np.testing.assert_array_equal(glitches(found[:, where], 0.01), jumping)
    assert not np.any(glitches(values[:, where], 0.01))
    assert not np.any(np.delete(found - values, where, axis=1))


def test_a_diaphragm_that_is_not_quite_elastic_opens_its_loop_by_and_by():
    """4 bar wide, opening over 30 bar: 30 bar up 1 - 1/e of 2 bar too little; then 30 bar down the rest of that is
    1/e times as far from 2 bar too much."""
    found = changed(PressureSensorHysteresis(30 * BAR), 4 * BAR, "rod", np.arange(3.0), rod=np.array([0, 30, 0]) * BAR)
    up = 1.0 - E_1
    np.testing.assert_allclose(found, [0.0, -2 * BAR * up, -2 * BAR * (-1.0 + (up + 1.0) * E_1)], rtol=1e-6)


def test_a_late_sensor_reads_what_was():
    """Rising by 0.2 rad/s and 50 ms late it reads 10 mrad too little."""
    t = np.arange(0.0, 1.0, 0.01)
    found = changed(Delay(), 0.05, "angle", t, angle=0.2 * t)
    np.testing.assert_allclose(found[5:], -0.010)


def test_angles_that_come_late_lack_the_rise_of_the_force():
    """The force rises by 50 kN/s; 20 ms before it was 1000 N less, and so is what the late angles explain: at 2.4 m
    2400 N m are missing, and must be added."""
    later = turning(rig(), [0.1])._replace(force_rate=np.array([[50e3]]))
    column = Delay().halves(rig(), later)
    assert column.momentum is None
    assert 0.02 * column.static[0, 0, 0] == pytest.approx(2400.0)


def test_the_rate_of_a_force_has_the_sign_of_its_pressure():
    """5 bar/s on 100 cm^2 are 5000 N/s, and as much on the rod side 3000 N/s less."""
    t = np.arange(0.0, 3.0, 0.01)
    for name, rate in (("head", 5000.0), ("rod", -3000.0)):
        values = readings(len(t), **{name: 5 * BAR * t})
        found = Channels(rig(), FILTERS).run(values).motion.force_rate[-1, 0]
        assert found == pytest.approx(rate, rel=1e-6)


def test_clocks_that_part_leave_the_pressures_behind():
    """Rising by 4 bar/s, 50 ms late from second 2 on and 10 ms more each second: after 3 s more 80 ms, 0.32 bar too
    little; the angles are in time."""
    t = np.arange(0.0, 8.0, 0.01)
    values = readings(len(t), head=4 * BAR * t, rod=4 * BAR * t, angle=0.1 * t)
    found = distorted(rig(), [Imposed((ClockFault(),), "machine", 0, (0.05, 0.01), 2.0)], values, t) - values
    for name in ("head", "rod"):
        off = reading(found, name)
        np.testing.assert_allclose(off[[100, 200, 500]], [0.0, -0.20 * BAR, -0.32 * BAR], atol=1e-4)
    assert not np.any(reading(found, "angle"))


def test_a_zero_error_is_a_force_at_its_lever():
    """200 N at 2.4 m."""
    assert 200.0 * PressureZero().halves(rig(), turning(rig(), [0.0])).static[0, 0, 0] == pytest.approx(480.0)
    assert 200.0 * PressureZero().halves(rig(4j), turning(rig(4j), [0.0])).static[0, 0, 0] == pytest.approx(-480.0)


def test_a_slope_shows_along_the_tracks_and_after_a_quarter_turn_across_them():
    """The house turns by 0.1 rad/s: a quarter after 15.7 s, half a turn after 31.4 s. One step more or less (1 mrad)
    makes a thousandth of the slope."""
    t = np.arange(0.0, 32.0, 0.01)
    quarter = [0, 1571, 3142]
    for across, expected in ((False, [0.03, 0.0, -0.03]), (True, [0.0, 0.03, 0.0])):
        found = changed(TiltIgnored(across), 0.03, "pitch", t, slew=0.1)
        np.testing.assert_allclose(found[quarter], expected, atol=6e-5)


def test_a_link_gives_in_proportion_to_its_torque():
    """100 bar on 100 cm^2 less 50 bar on 60 cm^2: 70 kN at 2.4 m, 168 kN m; 4e-8 rad/(N m) turn it by 6.72 mrad; the
    other way under the opposite load."""
    t = np.arange(0.0, 1.0, 0.01)
    found = changed(Compliance(), 4e-8, "angle", t, head=100 * BAR, rod=50 * BAR)
    np.testing.assert_allclose(found, 6.72e-3)
    np.testing.assert_allclose(changed(Compliance(), 4e-8, "angle", t, rod=70e3 / ROD), -6.72e-3)


def test_missing_pressures_do_not_spoil_the_deflection_after_them():
    t = np.arange(0.0, 2.0, 0.01)
    values = readings(len(t), head=100 * BAR, rod=50 * BAR)
    missing = values.copy()
    missing[20:23, SIGNALS.index("head")] = np.nan
    whole, found = (
        Compliance().distorted(rig(), each, t, 0, 4e-8)[:, SIGNALS.index("angle")] for each in (values, missing)
    )
    np.testing.assert_allclose(found[-50:], whole[-50:], rtol=1e-3)


def test_a_link_that_stiffens_gives_by_the_root_of_a_large_torque():
    """At sqrt(15) times the knee half as much as in proportion: (1 + 15)^(1/4) = 2; far beyond it four times the torque
    turn it twice as far."""
    t, torque = np.arange(0.0, 1.0, 0.01), LEVER * HEAD
    found = changed(Compliance(stiffening=15**0.5 / 168e3), 4e-8, "angle", t, head=168e3 / torque)
    np.testing.assert_allclose(found, 3.36e-3)
    far = [changed(Compliance(stiffening=1.0), 4e-8, "angle", t, head=tau / torque)[-1] for tau in (1e4, 4e4)]
    assert far[1] / far[0] == pytest.approx(2.0)


def test_a_link_follows_its_load_within_its_time():
    """30 ms after a step 1 - 1/e of the way."""
    t = np.arange(0.0, 1.0, 1e-3)
    found = changed(Compliance(), 4e-8, "angle", t, head=np.where(t < 0.5, 0.0, 70e3 / HEAD))
    assert found[499] == 0.0
    assert found[529] == pytest.approx(6.72e-3 * (1.0 - E_1))  # the step's own sample is the first of thirty


def test_play_lies_to_the_side_to_which_the_weight_presses_whatever_the_pressures():
    """20 mrad of play: 10 to either side. A link that turns over slowly: its weight presses to the other side once its
    centre of gravity has passed above the pin, at 90 degrees."""
    t = np.arange(0.0, 20.0, 0.01)
    angle = np.pi / 2 + 0.1 * (t - 10.0)
    found = changed(Backlash(), 0.02, "angle", t, angle=angle, head=np.where(t < 5.0, 200 * BAR, 0.0))
    np.testing.assert_allclose(found[t < 10.0], 0.010)
    np.testing.assert_allclose(found[t > 10.7], -0.010)


def test_play_of_a_cylinders_pin_jumps_where_its_force_changes_its_sign_whatever_the_weight():
    """The cylinder pushes until second 5, then it pulls: 10 mrad to one side, then to the other, on a level link."""
    t = np.arange(0.0, 10.0, 0.01)
    given = {"head": np.where(t < 5.0, 50 * BAR, 0.0), "rod": np.where(t < 5.0, 0.0, 50 * BAR)}
    found = changed(Backlash(pushed=True), 0.02, "angle", t, **given)
    np.testing.assert_allclose(found[t < 5.0], 0.010)
    np.testing.assert_allclose(found[t > 5.3], -0.010)
    assert not np.any(changed(Backlash(), 0.02, "angle", t, **given))


def test_play_that_never_opens_is_no_effect():
    assert not np.any(changed(Backlash(), 0.02, "angle", np.arange(0.0, 2.0, 0.01), angle=0.3))


def test_a_gap_in_the_readings_leaves_the_play_where_it_was():
    t = np.arange(0.0, 20.0, 0.01)
    angle = np.pi / 2 + 0.1 * (t - 10.0)
    angle[(t > 4.0) & (t < 4.5)] = np.nan
    found = changed(Backlash(), 0.02, "angle", t, angle=angle)
    np.testing.assert_allclose(found[(t < 4.0) | ((t > 4.5) & (t < 9.9))], 0.010)
    np.testing.assert_allclose(found[t > 10.7], -0.010)


def test_what_falls_through_a_play_does_so_as_fast_as_it_is_accelerated():
    """18 mrad at 4 rad/s^2: 95 ms, after which it stays; in half the time a quarter of the way. Pressed back on the way
    it returns."""
    found = fallen(np.where(np.arange(2000) < 500, 4.0, -4.0), 1e-3, 0.018)
    assert found[499] == 1.0
    assert found[500 + 47] == pytest.approx(1.0 - 2.0 * 0.25, abs=0.03)
    assert np.flatnonzero(found == -1.0)[0] - 500 == pytest.approx(95, abs=1)
    assert np.all(found[600:] == -1.0)
    turned = fallen(np.select([np.arange(400) < 100, np.arange(400) < 150], [4.0, -4.0], 4.0), 1e-3, 0.018)
    assert -0.2 < turned.min() < 0.0
    assert np.all(turned[280:] == 1.0)


def test_torque_that_holds_and_swings_a_link():
    """500 kg, 2 m out: 19.6 kN m to hold it level at 9.8 m/s^2 (half of that at 60 degrees), and 2000 kg m^2 to
    accelerate it."""
    t = np.arange(0.0, 4.0, 0.01)
    machine = rig()
    held = rigid_torque(machine, readings(len(t), angle=radians(60)), t, 0)
    np.testing.assert_allclose(held, 500.0 * machine.gravity * 1.0, rtol=1e-9)
    swung = rigid_torque(machine, readings(len(t), angle=0.05 * t**2), t, 0)[:-15]
    np.testing.assert_allclose(swung, 2000.0 * 0.1 + 1000.0 * machine.gravity * np.cos(0.05 * t[:-15] ** 2), rtol=1e-3)


def test_weights_are_the_same_whether_angles_or_inclinations_are_read():
    """A chain on a slope: an inclinometer reads the angles of all links inwards and the slope, too."""
    theta, slope, t = np.tile([0.4, -1.2, -0.9], (60, 1)), 0.1, np.arange(60) / 100.0
    found = []
    for kind in (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION):
        machine = excavator()
        read = theta if kind is Kind.JOINT_ANGLE else slope + np.cumsum(theta, axis=1)
        signals = tuple(replace(s, kind=kind) if s.kind is Kind.JOINT_ANGLE else s for s in machine.signals)
        values = np.zeros((60, len(signals)))
        for k, signal in enumerate(signals):
            values[:, k] = slope if signal.kind is Kind.PITCH else read[:, signal.index] if signal.kind is kind else 0.0
        found.append([rigid_torque(replace(machine, signals=signals), values, t, joint)[30] for joint in range(3)])
    assert found[0] == pytest.approx(found[1])
    assert np.ptp(found[0]) > 1e3


def test_a_machine_with_other_base_parameters_has_these():
    machine = excavator()
    wanted = base_parameters(machine.links) * np.linspace(0.8, 1.2, 3 * machine.size)
    found = with_parameters(machine, wanted)
    np.testing.assert_allclose(base_parameters(found.links), wanted, rtol=1e-9)
    assert [k.mass for k in found.links] == [k.mass for k in machine.links]


@pytest.mark.parametrize(
    ("effect", "length", "lever"),
    [
        (LinkageGeometry(0), hypot(2.99, 4.0), 3.0 * 4.0),  # foot 10 mm forward
        (LinkageGeometry(0, across=True), hypot(3.0, 3.99), 3.0 * 3.99),  # foot 10 mm up
        (LinkageGeometry(1), hypot(3.01, 4.0), 3.01 * 4.0),  # eye 10 mm farther out
        (LinkageGeometry(1, across=True), hypot(3.0, 4.01), 3.0 * 4.01 - 0.01 * 3.0),  # eye 10 mm above the link
    ],
)
def test_a_pin_off_by_ten_millimetres(effect, length, lever):
    """Length between the pins, and lever: cross product of (foot to eye) and (pin to eye), over that length."""
    found = effect.altered(rig(), 0, 0.010).geometry(np.zeros((1, 1)))
    assert found.length[0, 0] == pytest.approx(length, rel=1e-12)
    assert found.lever[0, 0, 0] == pytest.approx(lever / length, rel=1e-12)


def test_a_bar_longer_by_ten_millimetres():
    """A bar has no across: the machine is the same."""
    bars = FourBar((0, -1 + 1j), (0, 0 + 1j), (1, 0.5 + 0j), 0.5, 1.0, 1)
    machine = replace(rig(), cylinders=(replace(rig().cylinders[0], linkage=bars),))
    assert LinkageGeometry(3).altered(machine, 0, 0.010).cylinders[0].linkage == replace(bars, rocker_length=0.51)
    assert LinkageGeometry(4).altered(machine, 0, 0.010).cylinders[0].linkage == replace(bars, link_length=1.01)
    assert LinkageGeometry(3, across=True).altered(machine, 0, 0.010) is machine


def test_a_boom_that_turns_pulls_its_stick_outwards():
    """A mass of 500 kg, 2 m from a pin that goes round 4 m from its foot, all at 0.5 rad/s: the way to it from the foot
    is R + r, so it must be pulled by m w^2 (R + r) towards the foot. With R level and r at 30 degrees, the moment of
    that about the pin is m w^2 4 m * 2 m sin 30: 500 N m. Speeding up by alpha it is m alpha (r r + R r): per rad/s^2
    500 (4 + 4 * 2 cos 30) = 5464.1 N m."""
    angle = np.array([[radians(30.0)]])
    still = motion(rig(), angle, 0.0 * angle, 0.0 * angle, Attitude(0.0))
    base = np.array([[LINK.mass * 2.0**2, LINK.mass * 2.0, 0.0]])
    found = BoomMotion().halves(rig(), still, np.array([0.5]), base)
    sizes = np.array([4.0, 0.0, 1.0])
    assert (found.static @ sizes)[0, 0] == pytest.approx(500.0)
    assert (found.momentum @ sizes)[0, 0] == pytest.approx(0.5 * 5464.1016)
