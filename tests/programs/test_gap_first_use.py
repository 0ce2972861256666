"""`cylforce gap` at its first use: with identified.toml and no reference, with the machine file alone, and with the
recording of a simulation of one's own as reference."""

import tomllib

import numpy as np
import pytest

from cylforce.diagnosis.model import HealthyMachine
from cylforce.diagnosis.model import identified as from_identification
from cylforce.diagnosis.regressors import Regressors
from cylforce.effects.imposed import imposed
from cylforce.effects.library import LIBRARY
from cylforce.estimation.model import FRICTION, Model
from cylforce.files.atomic import RecordingError
from cylforce.files.tables import Table, write_table
from cylforce.programs.common.gap_machine import lasting_proposals
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.machine_statistics import read_statistics, statistics_path
from cylforce.programs.gap import Diagnosed, diagnose
from cylforce.programs.gap_output import Outputs, write_all
from cylforce.programs.identify import How, run_identify, run_statistics
from cylforce.programs.wording.plain import plain
from cylforce.readings.recording import Recording
from cylforce.settings.identified import read_identified
from cylforce.settings.machine_file import load
from cylforce.simulation import scenario
from cylforce.simulation.sensing import run, sensors
from scenarios import CONFIG, SEED, truth_of

SMALL = load(CONFIG / "excavator_stick_bucket.toml")
UNEXPLAINED = np.array([90.0, 40.0])  # N m
HOW = How(refuse=False)
OFFSET = imposed(SMALL.service.machine, "angle_offset", "stick_angle", 0.02)


@pytest.fixture(scope="module")
def fields():
    """A healthy and a faulty field of the small machine, as samples."""
    return [Recording(str(fault), samples(7, *fault)) for fault in ((), (OFFSET,))]


def machine_of(field: Recording, covariance=None) -> HealthyMachine:
    """The small machine by an identification alone."""
    model = Model(SMALL.service.machine, SMALL.service.filters, FRICTION)
    known = 1e-4 * model.prior.covariance if covariance is None else covariance
    noise = np.array([s.standard_error for s in model.machine.signals])
    rng = np.random.default_rng(1)
    return from_identification(Regressors(model, model.prior.mean), (), known, UNEXPLAINED, [field], noise, rng)


def test_the_floor_of_an_identified_machine_is_what_its_identification_left_whatever_the_fault(fields):
    """The floor was what all columns left of the faulty recording, from 0.3 to 0.7 of that."""
    healthy, faulty = (machine_of(field).floor for field in fields)
    for floor in (healthy, faulty):
        np.testing.assert_allclose(floor.rms, UNEXPLAINED)
    np.testing.assert_allclose(faulty.white, healthy.white, rtol=0.1)


def test_parameters_are_as_sure_together_as_the_identification_says(fields):
    """Taken one by one their errors left the torques 30 noise floors uncertain, and a gap of ten was none."""
    model = Model(SMALL.service.machine, SMALL.service.filters, FRICTION)
    covariance = correlated(0.01 * np.sqrt(np.diag(model.prior.covariance)))
    machine = machine_of(fields[0], covariance)
    count, unit = len(covariance), machine.layout.unit
    found = machine.machine.covariance[:count, :count] * np.outer(unit[:count], unit[:count])
    np.testing.assert_allclose(found, covariance)


def correlated(errors):
    """Covariance of parameters whose errors nearly cancel, two by two."""
    same = np.eye(len(errors))
    for k in range(0, len(errors) - 1, 2):
        same[k, k + 1] = same[k + 1, k] = -0.999
    return same * np.outer(errors, errors)


def samples(motion, *effects, seed=SEED, seconds=60.0):
    """Samples of empty moves of a machine; `seed`: which machine of the type it is."""
    service = SMALL.service
    truth = truth_of(SMALL, seed)._replace(effects=effects)
    scene = scenario.moves(service.machine, np.random.default_rng((SEED, motion)), seconds)
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng((SEED, motion, 2))
    records = run(service.machine, truth, made, [scene], dt=1.0 / service.filters.rate_hz, rng=rng)
    return np.concatenate([record.values for record in records])


def recorded(path, motion, *effects, seed=SEED, seconds=60.0):
    """A table of these."""
    service, values = SMALL.service, samples(motion, *effects, seed=seed, seconds=seconds)
    names = tuple(s.name for s in service.machine.signals)
    write_table(path, Table(np.arange(len(values)) / service.filters.rate_hz, values, names))
    return path


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The machine's identified.toml, without statistics."""
    folder = tmp_path_factory.mktemp("first_use")
    path = folder / "identified.toml"
    run_identify(SMALL, [recorded(folder / "identify.csv", 1, seconds=120.0)], path, HOW)
    return path


@pytest.fixture(scope="module")
def with_statistics(identified):
    """The same with the statistics beside it, in a folder of its own."""
    path = identified.parent / "known" / "identified.toml"
    path.parent.mkdir()
    path.write_bytes(identified.read_bytes())
    run_statistics(SMALL, [identified.parent / "identify.csv"], path, HOW)
    return path


def words(found: Diagnosed) -> str:
    """The answer as the terminal says it."""
    said = plain(SMALL.service.machine, found.answer)
    return " ".join([said.headline, *(line for point in said.points for line in point.lines)])


def test_a_healthy_machine_with_its_identification_alone_is_not_alarmed(identified):
    field = recorded(identified.parent / "healthy.csv", 7)
    found = diagnose(SMALL, Question((field,), identified=identified))
    assert (found.answer["verdict"], found.answer["effects"]) == ("no_gap", [])


def test_a_fault_is_named_with_its_identification_alone_and_written_as_it_is_named(identified, tmp_path):
    """The same causes in answer and patch, simulated with nothing beside them."""
    field = recorded(identified.parent / "field.csv", 7, OFFSET)
    found = diagnose(SMALL, Question((field,), identified=identified))
    named = [(effect["name"], effect["at"]) for effect in found.answer["effects"]]
    assert named == [("angle_offset", "stick_angle")]
    assert [(c["name"], c["at"]) for c in found.answer["gap"]["simulated"]] == named
    write_all(found, None, Outputs(None, tmp_path / "patch.toml", None, None))
    blocks = tomllib.loads((tmp_path / "patch.toml").read_text())["effects"]
    assert [(block["name"], block["at"]) for block in blocks] == named


def test_the_machine_file_alone_says_identify_first_and_what_a_refit_removes(identified):
    """No effect can be distinguished from the parameters that nobody knows."""
    field = recorded(identified.parent / "field.csv", 7, OFFSET)
    found = diagnose(SMALL, Question((field,)))
    first, said = found.answer["identify_first"], words(found)
    assert (found.answer["verdict"], found.answer["effects"]) == ("not_observable", [])
    assert said.startswith("Identify the machine first: nobody has identified this machine.")
    assert first["share"] > 0.5
    assert first["after_nm"] < first["before_nm"]
    remains = max(joint["refit"] for joint in found.answer["gap"]["joints"].values())
    assert all(parameter["torque"] > remains for parameter in first["parameters"])
    assert "than before" not in said
    assert "cylforce identify" in found.answer["next_experiment"][0]


def test_a_simulation_with_other_parameters_is_answered_with_these(identified):
    """Seven causes were named; fitting the parameters anew leaves less than they, and was said in the JSON only."""
    own = recorded(identified.parent / "simulated.csv", 2, seed=SEED + 1, seconds=120.0)
    field = recorded(identified.parent / "healthy.csv", 7)
    found = diagnose(SMALL, Question((field,), simulation=(own,)))
    assert (found.answer["verdict"], found.answer["effects"]) == ("not_observable", [])
    assert found.answer["compared_with"] == "simulation"
    assert not {"probabilities", "set", "evidence"} & set(found.answer)  # "no gap" beside this residual would be wrong
    assert found.answer["identify_first"]["share"] > 0.5
    said = words(found)
    assert said.startswith("Identify the machine first: the simulation's masses and friction are not this machine's")
    assert "before" not in said


def test_one_wrong_mass_of_a_simulation_is_no_fault_of_the_machine(identified):
    """A single effect closes the gap, but a simulation is no earlier state of the machine."""
    own = recorded(identified.parent / "same.csv", 2, seconds=120.0)
    heavier = imposed(SMALL.service.machine, "extra_mass", "bucket", (60.0, 0.0, 0.0, 0.0))
    found = diagnose(SMALL, Question((recorded(identified.parent / "heavier.csv", 7, heavier),), simulation=(own,)))
    assert "identify_first" in found.answer
    assert "extra_mass" not in {effect["name"] for effect in found.answer["effects"]}


def test_beside_a_simulation_with_other_parameters_no_effect_of_masses_or_friction_is_named(identified):
    """Four to eight effects were named with a hidden one: errors of the simulation's masses and friction."""
    own = recorded(identified.parent / "simulated.csv", 2, seed=SEED + 1, seconds=120.0)
    field = recorded(identified.parent / "field.csv", 7, OFFSET)
    found = diagnose(SMALL, Question((field,), simulation=(own,)))
    assert found.answer["identify_first"]["share"] > 0.5
    named = {effect["name"] for effect in found.answer["effects"]}
    assert not named & {p.name for p in lasting_proposals(SMALL, LIBRARY) if p.of_parameters}


def test_references_of_another_machine_are_no_earlier_state_of_this_one(identified):
    other = recorded(identified.parent / "simulated.csv", 2, seed=SEED + 1, seconds=120.0)
    field = recorded(identified.parent / "healthy.csv", 7)
    found = diagnose(SMALL, Question((field,), (other,)))
    assert (found.answer["verdict"], found.answer["effects"]) == ("not_observable", [])
    assert found.answer["identify_first"]["share"] > 0.5


@pytest.mark.parametrize(("name", "at", "size"), [
    ("extra_mass", "bucket", (90.0, 0.0, 0.0, 0.0)),
    ("asymmetric_friction", "stick", (1800.0,)),
])  # fmt: skip
def test_a_change_of_this_machine_is_no_other_machine(tmp_path, name, at, size):
    """Free parameters explain it, too, at the cost of their number."""
    reference = recorded(tmp_path / "reference.csv", 2, seconds=120.0)
    field = recorded(tmp_path / "field.csv", 7, imposed(SMALL.service.machine, name, at, size))
    found = diagnose(SMALL, Question((field,), (reference,)))
    assert "identify_first" not in found.answer
    assert [(effect["name"], effect["at"]) for effect in found.answer["effects"]] == [(name, at)]


def test_a_machine_that_was_identified_is_not_sent_to_be_identified(identified):
    """References with other parameters, and identified.toml: its parameters are this machine's, as they are."""
    own = recorded(identified.parent / "simulated.csv", 2, seed=SEED + 1, seconds=120.0)
    field = recorded(identified.parent / "healthy.csv", 7)
    found = diagnose(SMALL, Question((field,), (own,), identified=identified))
    assert "identify_first" not in found.answer


def test_references_and_a_simulation_together_are_refused(identified):
    field, own = (identified.parent / name for name in ("healthy.csv", "simulated.csv"))
    with pytest.raises(RecordingError, match="leave out --simulation"):
        diagnose(SMALL, Question((field,), (own,), simulation=(own,)))


def test_statistics_of_an_identification_compare_with_its_recordings(with_statistics):
    """As if they were given as references."""
    field = recorded(with_statistics.parent / "field.csv", 7, OFFSET)
    found = diagnose(SMALL, Question((field,), identified=with_statistics))
    assert found.answer["compared_with"] == "references"
    assert [(e["name"], e["at"]) for e in found.answer["effects"]] == [("angle_offset", "stick_angle")]
    assert not any("statistics" in text for text in found.answer["warnings"])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: path.unlink(), "is missing"),
        (lambda path: path.write_bytes(path.read_bytes()[:1000]), "or broken"),
        (lambda path: path.write_bytes(b""), "or broken"),
    ],
)
def test_statistics_that_do_not_fit_are_not_used_and_the_reason_is_given(with_statistics, tmp_path, spoil, said):
    path = statistics_path(with_statistics)
    other = tmp_path / path.name
    other.write_bytes(path.read_bytes())
    spoil(other)
    tares, each = read_identified(with_statistics, SMALL), lasting_proposals(SMALL, LIBRARY)
    found, reason = read_statistics(other, SMALL, tares, each)
    assert found is None
    assert said in reason
    assert "cylforce identify" in reason


def test_statistics_of_another_machine_identification_or_library_are_not_used(with_statistics):
    path, tares = statistics_path(with_statistics), read_identified(with_statistics, SMALL)
    each = lasting_proposals(SMALL, LIBRARY)
    assert read_statistics(path, SMALL, tares, each)[0] is not None
    for loaded, identified_again, library in (
        (SMALL._replace(sha256="other"), tares, each),
        (SMALL, tares._replace(values=tares.values * 1.001), each),
        (SMALL, tares, each[1:]),
    ):
        found, reason = read_statistics(path, loaded, identified_again, library)
        assert found is None
        assert "identify again" in reason
