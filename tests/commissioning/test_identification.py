"""Identification on simulated moves: what it finds is true, what the recording does not tell is named, what cannot be
is refused with a sentence; identified.toml is whole or not there, and for its own machine only."""

import dataclasses

import numpy as np
import pytest
import tomlkit

from cylforce.commissioning.identification import identify
from cylforce.estimation.priors.bars import represented
from cylforce.files.atomic import RecordingError
from cylforce.files.tables import Table, write_table
from cylforce.mechanics.machine import base_parameters
from cylforce.programs.common.readings import model_of
from cylforce.programs.identify import run_identify
from cylforce.settings.identified import read_identified, write_identified
from cylforce.settings.machine_file import SettingsError, load
from cylforce.simulation.scenario import posture_at
from cylforce.simulation.sensing import run, sensors
from scenarios import CONFIG, EXCAVATOR, SMALL, identified, moved, scene, truth_of

SLEWING = {f"{link}.{what}" for link in ("boom", "stick", "bucket") for what in ("D_excess", "E")}


@pytest.fixture(scope="module")
def loaded():
    return load(EXCAVATOR)


@pytest.fixture(scope="module")
def model(loaded):
    return model_of(loaded)


def recorded(loaded, strokes, seconds, seed=3):
    """Samples (T, S) of strokes of the empty machine; every seed has its own machine and noise."""
    machine = loaded.service.machine
    begin = posture_at(machine, (0.5, 0.6, 0.6))
    made, rng = sensors(machine, loaded.service.nodes), np.random.default_rng((seed, 2))
    records = run(machine, truth_of(loaded, seed), made, [scene(begin, strokes, seconds)], dt=0.01, rng=rng)
    return np.concatenate([record.values for record in records])


def to_and_fro(joints, seconds=60.0):
    """Strokes of several speeds, both ways, all joints about at once."""
    return [
        (j, t, t + 2.9 - 0.5 * (k % 3), 0.35 * (-1) ** k)
        for j in joints
        for k, t in enumerate(np.arange(0.2 + j, seconds - 3.0, 3.0))
    ]


def misses(found, loaded, seed):
    """By how many standard errors the base parameters (3 N,) are off."""
    true = base_parameters(truth_of(loaded, seed).links)
    error = np.sqrt(np.diag(found.tares.covariance))[: len(true)]
    return (found.tares.values[: len(true)] - true) / error


# --- what it finds ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        *(("excavator_stick_bucket.toml", seed) for seed in (11, 12, 13, 14)),
        *(("excavator_20t.toml", seed) for seed in (11, 12)),
        *(pytest.param("excavator_20t.toml", seed, marks=pytest.mark.long) for seed in (13, 14)),
    ],
)
def test_base_parameters_are_found_within_their_standard_errors(name, seed):
    """Two minutes of moves of machines whose masses are 10 % off the machine file: every base parameter within 4 of its
    standard errors, and the links, with the bars that a data sheet counts among them, far better known than from it."""
    loaded = load(CONFIG / name)
    found = identify(model_of(loaded), [moved(loaded, seed, 120.0)])
    assert np.abs(misses(found, loaded, seed)).max() < 4.0
    told = [k for k, p in enumerate(found.model.parameters) if p.name.endswith((".X", ".Z"))]
    sums = represented(found.model.machine, found.tares.names)
    both = (found.model.prior.covariance, found.tares.covariance)
    before, after = (np.sqrt(np.diag(sums @ c @ sums.T)) for c in both)
    assert np.median(after[told] / before[told]) < 0.1
    assert found.violations == ()


def test_several_stretches_say_the_same_as_one(loaded, model):
    """A recording in pieces loses only the filters' start of each."""
    values = moved(loaded, 11, 120.0)
    whole, parts = identify(model, [values]), identify(model, [values[:6000], values[6000:]])
    error = np.sqrt(np.diag(whole.tares.covariance))[:9]
    assert np.all(np.abs(parts.tares.values[:9] - whole.tares.values[:9]) < error)
    assert whole.seconds - 1.5 < parts.seconds < whole.seconds


def test_rows_at_an_end_stop_are_left_out(loaded, model):
    """While a cylinder stands at its end stop its pressure tells nothing (here: 60 bar too much): what is identified is
    as if those samples were not there."""
    strokes = [*to_and_fro((0, 2)), (1, 20.0, 24.0, -1.23), (1, 30.0, 34.0, 1.23)]
    strokes += [(1, t, t + 2.9, 0.3 * (-1) ** k) for k, t in enumerate(np.arange(1.0, 19.0, 3.0))]
    strokes += [(1, t, t + 2.9, 0.3 * (-1) ** k) for k, t in enumerate(np.arange(35.0, 56.0, 3.0))]
    values = recorded(loaded, strokes, 60.0)
    names = [s.name for s in loaded.service.machine.signals]
    angle, head = values[:, names.index("stick_angle")], values[:, names.index("stick_head_pressure")]
    stop = angle < np.radians(-151.0)
    assert 500 < np.sum(stop) < 1500
    head[stop] += 60e5
    found = identify(model, [values])
    assert np.abs(misses(found, loaded, 3)).max() < 4.0
    left_out = identify(model, [values[: np.argmax(stop)], values[len(stop) - np.argmax(stop[::-1]) :]])
    error = np.sqrt(np.diag(left_out.tares.covariance))[:9]
    assert np.all(np.abs(found.tares.values[:9] - left_out.tares.values[:9]) < 2.0 * error)


def test_a_dead_point_in_the_recording():
    """Poses that the linkage of the machine file cannot take, and its dead point: masked, without a warning; the other
    joint is told as well as before."""
    loaded = load(SMALL)
    machine = loaded.service.machine
    stick, bucket = machine.cylinders
    linkage = dataclasses.replace(bucket.linkage, link_length=0.25)
    other = dataclasses.replace(machine, cylinders=(stick, dataclasses.replace(bucket, linkage=linkage)))
    strokes = to_and_fro((0,)) + [(1, t, t + 2.9, 1.05 * (-1) ** k) for k, t in enumerate(np.arange(1.0, 56.0, 3.0))]
    values = recorded(loaded, strokes, 60.0)
    theta = values[:, [k for k, s in enumerate(machine.signals) if s.name.endswith("_angle")]]
    assert np.isnan(other.geometry(theta).transmission[:, 1]).any()
    found = identify(dataclasses.replace(model_of(loaded), machine=other), [values])
    assert np.all(np.isfinite(found.tares.values))
    assert np.all(np.isfinite(found.tares.covariance))
    assert np.abs(misses(found, loaded, 3))[:2].max() < 6.0


# --- what the recording does not tell ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("joints", "untold"),
    [
        ((0, 1, 2), set()),
        ((0, 1), {"bucket.J", "bucket.X", "bucket.Z", "stick.Z"}),
        ((1, 2), {"boom.J", "boom.X", "boom.Z"}),
        ((0,), {"stick.J", "stick.Z", "bucket.J", "bucket.X", "bucket.Z", "boom.Z"}),
    ],
    ids=["all", "bucket still", "boom still", "boom alone"],
)
def test_what_still_joints_do_not_tell_is_named(loaded, model, joints, untold):
    """The house never turns, so nothing tells the terms of slewing. A joint that stands still: neither what its
    cylinder's own parameters are (friction, delay), nor what only its own torque shows. What is not named is right
    within 4 standard errors, what is named has the data sheet's error."""
    found = identify(model, [recorded(loaded, to_and_fro(joints), 60.0)])
    still = {c.name for j, c in enumerate(loaded.service.machine.cylinders) if j not in joints}
    names = [p.name.split(".") for p in found.model.parameters]
    own = {f"{c}.{what}" for c, what in names if c in still and what not in ("J", "X", "Z", "D_excess", "E")}
    assert set(found.not_identified) == SLEWING | untold | own
    assert len(own) >= 2 * len(still) - 1
    off = misses(found, loaded, 3)
    assert np.abs(off).max() < 4.0
    prior, error = (np.sqrt(np.diag(c)) for c in (found.model.prior.covariance, found.tares.covariance))
    named = [k for k, p in enumerate(found.model.parameters) if p.name in found.not_identified]
    assert np.all(error[named] > 0.5 * prior[named] - 1e-9)


def test_slow_moves_tell_no_inertia(loaded, model):
    """Forty seconds for seven degrees: the moments of inertia are named, delays and friction that grows with the load
    are kept at what is usual; all is right within 4 standard errors. (With a fifth stroke the boom's is told to 0.498
    of its prior error, just below the half from which on it counts as told.)"""
    strokes = [(j, t + j, t + j + 39.5, 0.12 * (-1) ** k) for j in (0, 1, 2) for k, t in enumerate(range(0, 160, 40))]
    found = identify(model, [recorded(loaded, strokes, 200.0)])
    assert {"boom.J", "stick.J", "bucket.J"} <= set(found.not_identified)
    assert np.abs(misses(found, loaded, 3)).max() < 4.0
    place = {p.name: k for k, p in enumerate(found.model.parameters)}
    kept = [place[name] for name in found.not_identified if name.endswith((".load_dependent", ".delay"))]
    np.testing.assert_allclose(found.fit.values[kept], found.model.prior.mean[kept], atol=2e-3)


def test_gaps_of_the_clock_lose_only_the_filters_start(tmp_path, loaded, model):
    """A table whose time jumps ahead twice says what its three stretches say."""
    values = moved(loaded, 11, 120.0)
    row = np.arange(len(values))
    t = row / 100.0 + 3.0 * (row >= 4000) + 60.0 * (row >= 9000)
    path = tmp_path / "gaps.csv"
    write_table(path, Table(t, values, tuple(s.name for s in loaded.service.machine.signals)))
    found = run_identify(loaded, [path], tmp_path / "identified.toml")
    expected = identify(model, [values[:4000], values[4000:9000], values[9000:]])
    error = np.sqrt(np.diag(expected.tares.covariance))
    assert np.all(np.abs(found.tares.values - expected.tares.values) < 0.1 * error)


# --- what is refused --------------------------------------------------------------------------------------------------


def refused(model, *segments):
    with pytest.raises(ValueError, match=r"\w+ \w+") as caught:
        identify(model, list(segments))
    return str(caught.value)


def test_no_motion_is_refused(loaded, model):
    assert "no cylinder moves" in refused(model, recorded(loaded, [], 40.0))


def test_too_little_motion_is_refused(loaded, model):
    sentence = refused(model, recorded(loaded, to_and_fro((0, 1, 2), 12.0), 60.0))
    assert sentence.startswith("only ")
    assert "at least 20 s" in sentence


@pytest.mark.parametrize("rows", [0, 1, 50])
def test_nothing_long_enough_is_refused(loaded, model, rows):
    assert "no gapless stretch" in refused(model, recorded(loaded, [], 10.0)[:rows])
    assert "no gapless stretch" in refused(model)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_a_cylinder_that_moves_one_way_only_is_refused(loaded, model, joint):
    """Its friction looks like weight: the sentence names the cylinder and the way."""
    others = to_and_fro({0, 1, 2} - {joint})
    way = -0.6 if joint == 1 else 0.6
    sentence = refused(model, recorded(loaded, [*others, (joint, 0.5, 58.0, way)], 60.0))
    name = loaded.service.machine.cylinders[joint].name
    assert f"the {name} cylinder moves {'in' if joint == 2 else 'out'} only" in sentence


def test_a_table_without_a_needed_column_is_refused(tmp_path, loaded):
    """The sentence names the file and the column; nothing is written."""
    names = tuple(s.name for s in loaded.service.machine.signals)
    path, output = tmp_path / "moves.csv", tmp_path / "identified.toml"
    values = moved(loaded, 11, 20.0)
    write_table(path, Table(np.arange(len(values)) / 100.0, values[:, :-1], names[:-1]))
    with pytest.raises(RecordingError, match=rf"moves\.csv.*{names[-1]}"):
        run_identify(loaded, [path], output)
    assert not output.exists()


def test_unknown_values_in_a_table_are_gaps(tmp_path, loaded, model):
    """Cells without a value, singly and for seconds: bridged or left out; the same is found."""
    names = tuple(s.name for s in loaded.service.machine.signals)
    values = moved(loaded, 11, 120.0)
    whole = identify(model, [values])
    values[1000:1003, 2] = np.nan
    values[5000:5500] = np.nan
    path, output = tmp_path / "moves.csv", tmp_path / "identified.toml"
    write_table(path, Table(np.arange(len(values)) / 100.0, values, names))
    found = run_identify(loaded, [path], output)
    assert np.abs(misses(found, loaded, 11)).max() < 4.0
    assert whole.seconds - 8.0 < found.seconds < whole.seconds


# --- identified.toml --------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def found(loaded, model):
    return identify(model, [moved(loaded, 11, 60.0)])


@pytest.fixture
def written(tmp_path, loaded, found):
    path = tmp_path / "identified.toml"
    write_identified(path, found, loaded, [("moves.log", "ab" * 32)])
    return path


def test_tares_come_back_bit_by_bit(written, loaded, found):
    tares = read_identified(written, loaded)
    assert (tares.names, tares.friction, tares.identified) == (found.tares.names, found.tares.friction, True)
    for part in ("values", "covariance", "row_error"):
        np.testing.assert_array_equal(getattr(tares, part), getattr(found.tares, part))
    said = tomlkit.parse(written.read_text())
    untold = {p["name"] for p in said["parameters"] if not p["from_recording"]}
    assert untold == set(found.not_identified)


@pytest.mark.parametrize("at", ["while writing", "while replacing"])
def test_a_file_that_cannot_be_written_leaves_the_old_one(written, loaded, found, monkeypatch, at):
    """The disk is full, or the name cannot be replaced: a sentence; the old file is as it was, nothing else is left."""
    old = written.read_bytes()
    if at == "while writing":

        def full(*arguments, **options):
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(type(written), "write_text", full)
    else:

        def refuse(*arguments):
            raise PermissionError(13, "Permission denied")

        monkeypatch.setattr(type(written), "replace", refuse)
    with pytest.raises(RecordingError, match="cannot be written"):
        write_identified(written, found, loaded, [])
    assert written.read_bytes() == old
    assert list(written.parent.iterdir()) == [written]


def test_another_machine_file_is_refused(written, tmp_path, loaded):
    """One byte more in the machine file is another machine."""
    path = tmp_path / "other.toml"
    path.write_text(loaded.text + "\n")
    with pytest.raises(SettingsError, match="was identified with another machine file"):
        read_identified(written, load(path))


def edited(path, change):
    said = tomlkit.parse(path.read_text())
    change(said)
    path.write_text(tomlkit.dumps(said))


def other_name(said):
    said["parameters"][0]["name"] = "boom.mass"


def one_less(said):
    said["parameters"].pop()


def not_positive(said):
    said["covariance"][0][0] = -1.0


def not_symmetric(said):
    said["covariance"][0][1] = 0.9 * (said["covariance"][0][0] * said["covariance"][1][1]) ** 0.5


def too_correlated(said):
    size = 1.1 * (said["covariance"][3][3] * said["covariance"][4][4]) ** 0.5
    said["covariance"][3][4] = said["covariance"][4][3] = size


def too_small(said):
    said["covariance"].pop()


def ragged(said):
    said["covariance"][0].pop()


def a_nan(said):
    said["parameters"][2]["value"] = float("nan")


def an_infinity(said):
    said["covariance"][2][2] = float("inf")


def no_error(said):
    said["unexplained_torque_n_m"][0] = 0.0


def no_coulomb(said):
    said["friction"] = ["viscous"]


def unknown_law(said):
    said["friction"] = ["coulomb", "magic"]


def unknown_key(said):
    said["weight"] = 3


def newer(said):
    said["provenance"]["format"] = 99


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (other_name, "parameters"),
        (one_less, "parameters"),
        (not_positive, "covariance"),
        (not_symmetric, "covariance"),
        (too_correlated, "covariance"),
        (too_small, "covariance"),
        (ragged, "covariance"),
        (a_nan, r"parameters\.2\.value"),
        (an_infinity, r"covariance\.2\.2"),
        (no_error, "unexplained_torque_n_m"),
        (no_coulomb, "friction"),
        (unknown_law, "friction"),
        (unknown_key, "weight"),
        (newer, "format 99"),
    ],
)
def test_a_broken_file_is_refused(written, loaded, change, told):
    """The sentence names the file, the key, and the cure."""
    edited(written, change)
    with pytest.raises(SettingsError, match=rf"identified\.toml: .*{told}.*identify.* again"):
        read_identified(written, loaded)


@pytest.mark.parametrize(
    ("text", "told"),
    [("a = ", "is not TOML"), ("", "is empty"), ("a = 1", "is TOML, not the file"), ("\xff", "is not TOML")],
)
def test_what_is_no_such_file_is_refused(written, loaded, text, told):
    written.write_text(text, encoding="latin-1")
    with pytest.raises(SettingsError, match=told):
        read_identified(written, loaded)


def test_a_missing_file_is_refused(tmp_path, loaded):
    with pytest.raises(SettingsError, match="run `cylforce identify` first"):
        read_identified(tmp_path / "absent.toml", loaded)


def test_a_cut_file_is_refused_wherever_it_ends(written, loaded):
    """A file that lost its end is never taken for a whole one."""
    whole = written.read_bytes()
    for end in range(0, len(whole) - 2, len(whole) // 60):
        written.write_bytes(whole[:end])
        with pytest.raises(SettingsError):
            read_identified(written, loaded)


def test_the_first_law_of_friction_is_always_coulomb(tmp_path, loaded):
    """Without it a weight at rest would have too small a standard error."""
    path = tmp_path / "machine.toml"
    line = next(line for line in loaded.text.splitlines() if line.startswith("effects = "))
    for laws in ("[]", '["viscous"]'):
        path.write_text(loaded.text.replace(line, f"effects = {laws}"))
        with pytest.raises(SettingsError, match=r"friction\.effects lack 'coulomb'"):
            load(path)
    path.write_text(loaded.text.replace(line, 'effects = ["viscous", "coulomb"]'))
    assert load(path).service.effects == ("coulomb", "viscous")
    assert identified(load(path), seconds=40.0).friction[0] == "coulomb"
