"""Angle sensors that pass the end of their circle: the angle is the one that the joint's range allows."""

import re
from dataclasses import replace
from math import radians

import numpy as np
import pytest

from command_line import cylforce_
from cylforce.estimation.channels import Channels
from cylforce.estimation.kernel import choice
from cylforce.files.recording import as_frames, open_pieces, open_recording
from cylforce.files.tables import Table, write_table
from cylforce.mechanics.unwrapping import Unwrapping, ends_passed
from cylforce.programs.common.readings import model_of
from cylforce.service.assembler import assembler
from cylforce.service.core import Core
from cylforce.service.samples import samples
from cylforce.settings.machine_file import load
from cylforce.signals.codec import decode, encode
from cylforce.signals.estimate import Reason
from cylforce.signals.events import Frame, Tick
from cylforce.signals.kinds import ANGLES, Kind
from cylforce.signals.turns import TURN, Follower, continuous, in_range, nearest
from cylforce.simulation.sensing import as_sent, sensors
from scenarios import EXCAVATOR, pdo_of, played, scene, through

SEED = 20
JOINTS = ("boom", "stick", "bucket")
LOADED = load(EXCAVATOR)
PDO = pdo_of(LOADED.service, "bucket_angle")
AT = {s.name: k for k, s in enumerate(LOADED.service.machine.signals)}
# The bucket's range [deg] of the excavator is -138 to 24; its inclination leaves the circle where the arm hangs.
HANGING = np.radians([-20.0, -95.0, -40.0])


def measured(kinds, ends):
    """The shipped excavator whose joints, by name, are measured by sensors of these kinds, from and to `ends` [deg]."""
    service, ends = LOADED.service, np.radians(ends)
    names = {f"{joint}_angle": kind for joint, kind in kinds.items()}

    def signal(s):
        return replace(s, kind=names[s.name], low=ends[0], high=ends[1]) if s.name in names else s

    def field(f):
        return replace(f, low=ends[0], high=ends[1], code="i", scale=radians(0.001)) if f.signal in names else f

    def node(n):
        return n._replace(pdos=tuple(p._replace(fields=tuple(map(field, p.fields))) for p in n.pdos))

    machine = replace(service.machine, signals=tuple(map(signal, service.machine.signals)))
    return LOADED._replace(service=service._replace(machine=machine, nodes=tuple(map(node, service.nodes))))


INCLINED = dict.fromkeys(JOINTS, Kind.LINK_INCLINATION)
ENCODED = dict.fromkeys(JOINTS, Kind.JOINT_ANGLE)
MIXED = {"boom": Kind.LINK_INCLINATION, "stick": Kind.JOINT_ANGLE, "bucket": Kind.LINK_INCLINATION}


def readings(machine, theta, pitch, low):
    """Samples (T, S) of ideal sensors at joint angles `theta` (T, N) [rad], from `low` [rad] to a turn beyond."""
    values = np.zeros((len(theta), len(machine.signals)))
    values[:, AT["pitch"]] = pitch
    slope = pitch[:, None] + np.cumsum(theta, axis=1)
    for k, s in enumerate(machine.signals):
        if s.kind in (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION):
            true = (theta if s.kind is Kind.JOINT_ANGLE else slope)[:, s.index]
            values[:, k] = low + np.mod(true - low, TURN)
    return values


@pytest.mark.parametrize("low", [-180.0, 0.0, -90.0])
@pytest.mark.parametrize("kinds", [INCLINED, ENCODED, MIXED], ids=["inclined", "encoded", "mixed"])
def test_every_posture_is_read_wherever_the_circle_of_the_sensors_begins(kinds, low):
    """Each sample by itself, so that none depends on those before it; as numbers the same bits as in an array."""
    machine, rng = measured(kinds, (low, low + 360.0)).service.machine, np.random.default_rng(SEED)
    ends = np.array([(link.angle_low, link.angle_high) for link in machine.links]).T
    theta = rng.uniform(*ends, (500, 3))
    values = readings(machine, theta, rng.uniform(-0.25, 0.25, 500), np.radians(low))
    found = Unwrapping(machine).of(values)
    np.testing.assert_allclose(Channels(machine, LOADED.service.filters).read(found)[:, :3], theta, atol=1e-12)
    for row, wanted in zip(values.tolist(), found, strict=True):
        Unwrapping(machine).apply(row)
        np.testing.assert_array_equal(row, wanted)


def test_an_inclinometer_beyond_a_joint_that_is_measured_by_its_cylinder_is_read():
    """The boom's angle comes from its cylinder's length: the bucket hangs at -196 degrees, the sensor says 164."""
    loaded = measured(INCLINED, (-180.0, 180.0))
    machine = loaded.service.machine
    signals = list(machine.signals)
    signals[AT["boom_angle"]] = replace(signals[AT["boom_angle"]], kind=Kind.CYLINDER_LENGTH, low=0.0, high=4.0)
    machine = replace(machine, signals=tuple(signals))
    theta = np.radians([[20.0, -120.0, -96.0]])
    values = readings(machine, theta, np.zeros(1), -np.pi)
    values[:, AT["boom_angle"]] = machine.geometry(theta).length[:, 0]
    assert np.degrees(values[0, AT["bucket_angle"]]) == pytest.approx(164.0)
    found = Unwrapping(machine).of(values)
    assert np.degrees(found[0, AT["bucket_angle"]]) == pytest.approx(-196.0)
    assert found[0, AT["boom_angle"]] == values[0, AT["boom_angle"]]


def test_a_chassis_stands_upright_where_its_inclinometer_counts_from_0_to_360():
    values = np.zeros((1, len(AT)))
    values[0, [AT["pitch"], AT["roll"]]] = np.radians([357.0, 2.0])
    found = Unwrapping(LOADED.service.machine).of(values)
    np.testing.assert_allclose(np.degrees(found[0, [AT["pitch"], AT["roll"]]]), [-3.0, 2.0])


def test_an_angle_that_is_not_known_leaves_the_others_as_they_are():
    machine = measured(INCLINED, (-180.0, 180.0)).service.machine
    values = readings(machine, np.radians([[20.0, -120.0, -96.0]]), np.zeros(1), -np.pi)
    values[0, AT["stick_angle"]] = np.nan
    np.testing.assert_array_equal(Unwrapping(machine).of(values), values)


def test_whole_turns_change_no_direction():
    rng = np.random.default_rng(SEED)
    angle, middle, low = rng.uniform(-20.0, 20.0, (3, 200))
    for found in (nearest(angle, middle), in_range(angle, low, low + TURN), continuous(angle[:, None], [0.0])[:, 0]):
        np.testing.assert_allclose(np.exp(1j * found), np.exp(1j * angle), atol=1e-12)
    assert np.all(np.abs(nearest(angle, middle) - middle) <= np.pi + 1e-12)
    assert np.all(np.abs(np.diff(continuous(angle[:, None], [0.0])[:, 0], prepend=0.0)) <= np.pi + 1e-12)
    assert np.all((in_range(angle, low, low + TURN) >= low) & (in_range(angle, low, low + TURN) <= low + TURN))
    assert in_range(1.0, -0.5, 0.5) == 1.0  # no whole turn leads there


@pytest.fixture(params=["interpreted", "chosen"])
def form(request):
    """Each form of the kernel."""
    with choice.using(choice.INTERPRETED if request.param == "interpreted" else choice.choice().kernel):
        yield


def watched(loaded, angles):
    """Reasons and values of the bucket's inclination while it has these `angles` [rad] at 100 Hz, after a while at the
    first, and the links before hang; the signals that stepped."""
    service = loaded.service
    names = [s.name for s in service.machine.signals]
    others = {f"{joint}_angle": slope for joint, slope in zip(JOINTS, np.cumsum(HANGING), strict=True)}
    inputs, seen, started = assembler(service), [], service.health.good_frames
    for k, angle in enumerate([*angles[:1]] * started + [*angles]):
        values = dict.fromkeys(names, 0.0) | others | {"bucket_angle": angle}
        pdos = [pdo for node in service.nodes for pdo in node.pdos]
        frames = [Frame(1_000_000 + 10_000 * k + n, pdo.can_id, encode(pdo, values)) for n, pdo in enumerate(pdos)]
        inputs.receive(frames)
        sample = inputs.sample(frames[-1].t_us)
        seen.append((Reason(int(inputs.channels[AT["bucket_angle"]].reason)), sample.values[AT["bucket_angle"]]))
    return *zip(*seen[started:], strict=True), inputs.stepped


@pytest.mark.usefixtures("form")
@pytest.mark.parametrize("way", [1.0, -1.0])
def test_passing_the_end_of_the_circle_is_no_leap(way):
    """From -160 to -200 degrees or back at 1.4 rad/s; the sensor sends 160 to 180 where the bucket is beyond."""
    angles = np.radians(np.linspace(-160.0, -200.0, 50))[:: int(way)]
    reasons, values, stepped = watched(measured(INCLINED, (-180.0, 180.0)), angles)
    assert set(reasons) == {Reason.NONE}
    np.testing.assert_allclose(values, angles, atol=radians(0.001))
    assert stepped == ()


@pytest.mark.usefixtures("form")
def test_a_leap_across_the_end_of_the_circle_is_a_leap():
    """By 6 degrees, from -177 to -183: more than 3 rad/s make in 10 ms."""
    angles = np.radians([-177.0] * 30 + [-183.0] * 130)
    reasons, values, stepped = watched(measured(INCLINED, (-180.0, 180.0)), angles)
    assert reasons[:30] + reasons[30:130] == (Reason.NONE,) * 30 + (Reason.IMPLAUSIBLE_JUMP,) * 100
    np.testing.assert_allclose(np.degrees([values[29], values[-1]]), [-177.0, -183.0], atol=0.001)
    assert stepped == (AT["bucket_angle"],)
    back = np.radians([-177.0] * 30 + [-183.0] * 130 + [-177.0] * 130)
    assert watched(measured(INCLINED, (-180.0, 180.0)), back)[2] == ()


@pytest.mark.parametrize("ends", [(-180.0, 180.0), (0.0, 360.0), (0.0, 359.99)])
def test_a_simulated_sensor_goes_on_at_the_other_end(ends):
    """To a digit it says the true angle or that less a turn; without an end (300 degrees) it says the true one."""
    service, rng = measured(INCLINED, ends).service, np.random.default_rng(SEED)
    made, k = sensors(service.machine, service.nodes), AT["bucket_angle"]
    analog = np.zeros((4000, len(AT)))
    analog[:, k] = np.radians(np.linspace(-300.0, 100.0, 4000))
    sent = as_sent(made, analog, rng)[:, k]
    assert np.all((np.degrees(sent) >= ends[0] - 1e-6) & (np.degrees(sent) <= ends[1] + 0.01))
    np.testing.assert_allclose(np.exp(1j * sent), np.exp(1j * analog[:, k]), atol=6.0 * made.noise[k])
    endless = measured(INCLINED, (-350.0, 350.0)).service
    plain = as_sent(sensors(endless.machine, endless.nodes), analog, np.random.default_rng(SEED))[:, k]
    np.testing.assert_allclose(plain, analog[:, k], atol=6.0 * made.noise[k])


def course(machine, seconds=4.0, hz=50.0):
    """Times (T,) and true samples (T, S) while the bucket curls past the end and the house slews past it, too."""
    t = np.arange(0.0, seconds, 1.0 / hz)
    theta = HANGING + np.stack([0.1 * np.sin(t), 0.1 * np.cos(t), -0.4 * t], axis=1)
    values = np.zeros((len(t), len(machine.signals)))
    values[:, AT["pitch"]] = 0.05 * np.sin(t)
    slope = 0.05 * np.sin(t)[:, None] + np.cumsum(theta, axis=1)
    for joint, true in zip(JOINTS, slope.T, strict=True):
        values[:, AT[f"{joint}_angle"]] = true
    values[:, AT["slew_rate"]] = 2.8 + 0.3 * t
    return t, values


def with_slew_angle(loaded):
    """The machine with an encoder on the house in place of the gyro."""
    service, pdo = loaded.service, pdo_of(loaded.service, "slew_rate")
    signals = tuple(
        replace(s, kind=Kind.SLEW_ANGLE, low=-np.pi, high=np.pi) if s.name == "slew_rate" else s
        for s in service.machine.signals
    )
    fields = tuple(replace(f, unit="rad", low=-np.pi, high=np.pi) for f in pdo.fields)
    nodes = tuple(n._replace(pdos=(pdo._replace(fields=fields),)) if pdo in n.pdos else n for n in service.nodes)
    machine = replace(service.machine, signals=signals)
    return loaded._replace(service=service._replace(machine=machine, nodes=nodes))


def tabled(path, loaded, t, values):
    """A table of these samples as the sensors say them: all angles within half a turn of zero."""
    signals = loaded.service.machine.signals
    said = values.copy()
    for k, s in enumerate(signals):
        if s.kind in ANGLES:
            said[:, k] = in_range(values[:, k], -np.pi, np.pi)
    write_table(path, Table(t, said, tuple(s.name for s in signals)))
    return path


def test_a_table_is_not_interpolated_across_the_circle(tmp_path):
    """Every second sample is between two rows, one of which is at +180 degrees and one at -180; so it is in pieces."""
    loaded = with_slew_angle(measured(INCLINED, (-180.0, 180.0)))
    t, true = course(loaded.service.machine)
    path = tabled(tmp_path / "run.csv", loaded, t, true)
    assert np.ptp(np.loadtxt(path, delimiter=",", skiprows=1)[:, 1 + AT["bucket_angle"]]) > 6.0
    found = open_recording(path, loaded.service)
    for k in range(len(AT)):
        off = 0.0 if k != AT["slew_rate"] else TURN * np.round((found.values[0, k] - true[0, k]) / TURN)
        wanted = np.interp(found.t_s, t, true[:, k])
        np.testing.assert_allclose(found.values[:, k] - off, wanted, atol=1e-9)
    pieces = np.concatenate([piece.values for piece in open_pieces(path, loaded.service)])
    np.testing.assert_array_equal(pieces[: len(found.values)], found.values)


def test_a_table_of_unwrapped_angles_is_played_as_its_sensors_would_send_it():
    """Beyond the sensor's range stands no "no value", but the reading at the other end of the circle."""
    service = measured(INCLINED, (-180.0, 180.0)).service
    t, true = course(service.machine)
    pdo = pdo_of(service, "bucket_angle")
    table = Table(t, true, tuple(s.name for s in service.machine.signals))
    said = np.array([decode(pdo, frame.data)["bucket_angle"] for frame in as_frames(table, [pdo])])
    assert np.all(np.abs(said) <= np.pi)
    np.testing.assert_allclose(np.exp(1j * said), np.exp(1j * true[:, AT["bucket_angle"]]), atol=radians(0.001))


@pytest.mark.parametrize("size", [1, 7, 1000])
def test_angles_go_on_over_pieces_of_any_length(size):
    """With gaps, also at the ends of pieces."""
    true = np.linspace(0.0, 30.0, 1000)[:, None] * [1.0, -0.5, 0.0]
    values, follower = in_range(true, -np.pi, np.pi), Follower([0, 1])
    values[::13, 1] = values[200:215] = np.nan
    found = np.concatenate([follower.follow(values[k : k + size]) for k in range(0, 1000, size)])
    np.testing.assert_allclose(found, np.where(np.isnan(values), np.nan, true), atol=1e-9)


def test_a_log_is_read_as_its_angles_go_on():
    """Rows are missing where the house passes the end of its encoder's circle."""
    loaded = with_slew_angle(measured(INCLINED, (-180.0, 180.0)))
    t, true = course(loaded.service.machine, hz=100.0)
    names = tuple(s.name for s in loaded.service.machine.signals)
    pdos = [pdo for node in loaded.service.nodes for pdo in node.pdos]
    ends = int(np.argmax(true[:, AT["slew_rate"]] > np.pi))
    lost = 1e6 * t[ends - 2] - 1, 1e6 * t[ends + 2] + 1
    events = [Tick(round(1e6 * s) + 5000) for s in t]
    events += [
        frame
        for frame in as_frames(Table(t, true, names), pdos)
        if not (lost[0] < frame.t_us < lost[1] and frame.can_id == pdo_of(loaded.service, "slew_rate").can_id)
    ]
    events.sort(key=lambda event: event.t_us)
    pieces = list(samples(assembler(loaded.service), events, 10_000))
    found, started = np.concatenate(pieces), loaded.service.health.good_frames
    known = np.isfinite(found[:, 0])
    assert np.count_nonzero(known) >= len(t) - started - 10
    assert not np.all(known[started:])
    for name in ("slew_rate", "bucket_angle"):  # the value before a missing one stands for one step more, 3 mrad
        np.testing.assert_allclose(found[known, AT[name]], true[known, AT[name]], atol=0.004)


def quantities(estimate):
    return [estimate.gross, estimate.net]


@pytest.mark.parametrize(("kinds", "ends"), [(INCLINED, (-180.0, 180.0)), (ENCODED, (0.0, 360.0))])
def test_the_service_measures_as_with_sensors_without_an_end(kinds, ends):
    """The bucket curls past the end and back, with 800 kg: every estimate is that of sensors that count on."""
    strokes = [(2, 1.0, 3.5, -1.4), (2, 4.0, 6.5, 1.4), (0, 2.0, 5.0, 0.3)]
    moves, runs, sent = [scene(HANGING, strokes, 8.0, 800.0)], [], []
    for loaded in (measured(kinds, (-350.0, 350.0)), measured(kinds, ends)):
        core, events = Core(loaded.service, model_of(loaded).data_sheet), played(loaded, moves)
        runs.append(through(core, events)[1])
        pdo = pdo_of(loaded.service, "bucket_angle")
        frames = (e for e in events if isinstance(e, Frame) and e.can_id == pdo.can_id)
        sent.append([decode(pdo, frame.data)["bucket_angle"] for frame in frames])
    assert 0.2 < np.mean(np.abs(np.subtract(*sent)) > 6.0) < 0.8 or kinds is ENCODED  # beyond the end for some time
    assert any(np.isfinite(estimate.gross.value) for estimate in runs[0])
    for endless, ending in zip(*runs, strict=True):
        for a, b in zip(quantities(endless), quantities(ending), strict=True):
            assert (a.status, a.reason) == (b.status, b.reason)
            np.testing.assert_allclose(a.value, b.value, rtol=1e-6, atol=1e-3)


def test_the_sensors_that_pass_their_end_are_found():
    """By the joints' ranges: boom -40 to 58 degrees, stick -150 to -35, bucket -138 to 24."""

    def names(kinds, ends):
        machine = measured(kinds, ends).service.machine
        return [machine.signals[passed.signal].name for passed in ends_passed(machine)]

    assert names(INCLINED, (-180.0, 180.0)) == ["stick_angle", "bucket_angle"]
    assert names(ENCODED, (-180.0, 180.0)) == []
    assert names(ENCODED, (0.0, 360.0)) == ["boom_angle", "stick_angle", "bucket_angle"]
    assert names(INCLINED, (-90.0, 90.0)) == []  # no circle: a warning of the machine file's checks


def written(path, kind, ends, joints="boom|stick|bucket"):
    """The shipped machine file with sensors of this kind and range [deg] at some joints."""
    entry = rf'kind = "joint_angle"(\nat = "(?:{joints})".*?)type = "u32"(.*?)offset_deg = .*?range_deg = \[.*?\]'
    text = rf'kind = "{kind}"\1type = "i32"\2range_deg = [{ends[0]}, {ends[1]}]'
    path.write_text(re.sub(entry, text, EXCAVATOR.read_text(encoding="utf-8"), flags=re.DOTALL), encoding="utf-8")
    return path


def test_describe_lists_the_sensors_that_pass_the_end_of_their_circle(capsys, tmp_path):
    """By the joints' ranges the stick hangs at -40 - 150 degrees at most, the bucket at -40 - 150 - 138."""
    assert cylforce_("describe", written(tmp_path / "machine.toml", "link_inclination", (-180, 180))) == 0
    said = capsys.readouterr()
    assert "stick_angle passes the end of its circle: the inclination of the stick goes from -190 to 23 deg" in said.out
    assert (
        "bucket_angle passes the end of its circle: the inclination of the bucket goes from -328 to 47 deg" in said.out
    )
    assert "boom_angle passes" not in said.out
    assert "warning" not in said.out + said.err


def test_an_inclinometer_that_ends_before_its_link_does_is_a_warning(capsys, tmp_path):
    """At 90 degrees: the boom goes from -40 to 58 degrees and is seen; stick and bucket are not."""
    assert cylforce_("describe", written(tmp_path / "machine.toml", "link_inclination", (-90, 90))) == 0
    said = capsys.readouterr()
    for name, reach in (("stick", "-190 deg to 23 deg"), ("bucket", "-328 deg to 47 deg")):
        text = f"sensors.{name}_angle.range_deg is -90 deg to 90 deg, the {name}'s inclination on level ground {reach}"
        assert text in " ".join(said.err.split())
    assert "boom_angle" not in said.err
    assert "passes the end" not in said.out


def test_an_encoder_of_a_whole_circle_sees_a_joint_on_its_other_side(capsys, tmp_path):
    """The stick goes from -150 to -35 degrees, which its encoder calls 210 to 325."""
    assert cylforce_("describe", written(tmp_path / "machine.toml", "joint_angle", (0, 359.99), "stick")) == 0
    said = capsys.readouterr()
    assert "stick_angle passes the end of its circle: the angle of the stick goes from -150 to -35 deg" in said.out
    assert said.err == ""


@pytest.mark.usefixtures("form")
@pytest.mark.parametrize(
    ("ends", "sent", "read"),
    [
        ((-180.0, 180.0), 200.0, -160.0),  # mounted 30 degrees off it sends 170
        ((-45.0, 63.0), 350.0, -10.0),  # an encoder from 0 to 360 on a joint that passes its 0
        ((-200.0, 60.0), 164.0, -196.0),  # the inclinations of a bucket, of a sensor that ends at 180
        ((-45.0, 63.0), 100.0, None),
        ((-45.0, 63.0), -100.0, None),
        ((-45.0, 63.0), 260.0, None),
    ],
)
def test_a_direction_is_in_range_wherever_the_circle_of_the_sensor_ends(ends, sent, read):
    service = measured(INCLINED, (-350.0, 350.0)).service
    raw = encode(PDO._replace(fields=pdo_of(service, "boom_angle").fields), {"boom_angle": radians(sent)})
    service = measured({"boom": Kind.JOINT_ANGLE}, ends).service
    inputs, pdo = assembler(service), pdo_of(service, "boom_angle")
    for k in range(20):
        inputs.receive([Frame(1_000_000 + 10_000 * k, pdo.can_id, raw)])
    channel = inputs.channels[AT["boom_angle"]]
    assert channel.reason == (Reason.OUT_OF_RANGE if read is None else Reason.NONE)
    assert read is None or np.degrees(channel.value) == pytest.approx(read, abs=0.001)


@pytest.mark.usefixtures("form")
def test_the_largest_number_of_a_signed_field_is_an_error_code_and_no_direction():
    """7FFFh of 0.01 degrees is 327.67 degrees, a turn beyond -32.33, which the joint reaches."""
    service = measured({"boom": Kind.JOINT_ANGLE}, (-45.0, 63.0)).service

    def field(f):
        return replace(f, code="h", scale=radians(0.01), offset=0.0) if f.signal == "boom_angle" else f

    nodes = tuple(
        n._replace(pdos=tuple(p._replace(fields=tuple(map(field, p.fields))) for p in n.pdos)) for n in service.nodes
    )
    service = service._replace(nodes=nodes)
    pdo = pdo_of(service, "boom_angle")
    for raw, reason in ((0x7FFF, Reason.OUT_OF_RANGE), (0x7FFE, Reason.NONE)):
        inputs = assembler(service)
        for k in range(20):
            frame = Frame(1_000_000 + 10_000 * k, pdo.can_id, raw.to_bytes(2, "little"))
            inputs.receive([frame])
        assert inputs.channels[AT["boom_angle"]].reason == reason
