"""`cylforce gap` at its first use: with identified.toml and no reference, with the machine file alone, and with the
recording of a simulation of one's own as reference."""

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from cylforce.diagnosis.columns.problem import Identified, Problem, looked_at
from cylforce.diagnosis.inference.asking import Asking, identified_floor, noisy
from cylforce.diagnosis.inference.search import asked
from cylforce.effects.imposed import imposed
from cylforce.effects.library import LIBRARY
from cylforce.files.tables import Table, write_table
from cylforce.programs.common.gap_question import Question
from cylforce.programs.gap import Diagnosed, diagnose
from cylforce.programs.gap_output import Outputs, write_all
from cylforce.programs.identify import How, run_identify
from cylforce.programs.wording.plain import plain
from cylforce.settings.machine_file import load
from cylforce.simulation import scenario
from cylforce.simulation.sensing import run, sensors
from gap_scene import MACHINE, as_it_was, recordings
from scenarios import CONFIG, SEED, truth_of

SMALL = load(CONFIG / "excavator_stick_bucket.toml")
LAWS = tuple(group for group in LIBRARY if group[0].about.name == "coulomb_friction")
UNEXPLAINED = np.array([200.0, 90.0, 40.0])  # N m
FAULT = imposed(MACHINE, "coulomb_friction", "stick", 2000.0)
OFFSET = imposed(SMALL.service.machine, "angle_offset", "stick_angle", 0.02)


def asking(effects=(), *, identified: bool = True) -> Asking:
    """The machine without references: its field, and the accuracy that an identification stated."""
    viewer = as_it_was().viewer
    wanted, known = asked(MACHINE, LAWS), 0.01 * np.sqrt(np.diag(viewer.model.prior.covariance))
    accuracy = Identified(correlated(known), UNEXPLAINED)
    problem = Problem(
        *(viewer.model, known, wanted, (), looked_at(viewer, recordings(1, effects)[:1], wanted), viewer.tares),
        identified=accuracy if identified else None,
    )
    floor, rng = identified_floor(viewer, problem, accuracy, np.random.default_rng(1)), np.random.default_rng(1)
    return Asking(viewer, problem, floor, noisy(viewer, problem, floor, rng))


def correlated(errors):
    """Covariance of parameters whose errors nearly cancel, two by two."""
    same = np.eye(len(errors))
    for k in range(0, len(errors) - 1, 2):
        same[k, k + 1] = same[k + 1, k] = -0.999
    return same * np.outer(errors, errors)


def test_the_floor_of_an_identified_machine_is_what_its_identification_left_whatever_the_fault():
    """The floor was what all columns left of the faulty recording, from 0.3 to 0.7 of that."""
    healthy, faulty = asking(), asking((FAULT,))
    for floor in (healthy.floor, faulty.floor):
        np.testing.assert_allclose(floor.rms, UNEXPLAINED)
    np.testing.assert_allclose(faulty.floor.white, healthy.floor.white, rtol=0.1)


def test_without_references_the_sensors_noise_is_taken_off_the_field_if_the_floor_is_known():
    """Errors in variables: the noise that a column shares with the residual."""
    for identified in (True, False):
        shared = asking(identified=identified).noisy.faulty[0].products
        assert bool(np.any(shared[..., -1] > 0.0)) is identified


def test_parameters_are_as_sure_together_as_the_identification_says():
    """Taken one by one their errors left the torques 30 noise floors uncertain, and a gap of ten was none."""
    question = asking()
    count, spread = len(question.viewer.tares), question.scene.spread
    covariance = question.machine({}).covariance[:count, :count] * np.outer(spread[:count], spread[:count])
    np.testing.assert_allclose(covariance, question.problem.identified.covariance)
    alone = replace(question, problem=replace(question.problem, identified=None))
    errors = np.sqrt(np.diag(alone.machine({}).covariance))[:count] * spread[:count]
    np.testing.assert_allclose(errors, question.problem.known)


def recorded(path, motion, *effects, seed=SEED, seconds=60.0):
    """A table of empty moves of a machine with two joints; `seed`: which machine of the type it is."""
    service = SMALL.service
    truth = truth_of(SMALL, seed)._replace(effects=effects)
    scene = scenario.moves(service.machine, np.random.default_rng((SEED, motion)), seconds)
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng((SEED, motion, 2))
    records = run(service.machine, truth, made, [scene], dt=1.0 / service.filters.rate_hz, rng=rng)
    values = np.concatenate([record.values for record in records])
    names = tuple(s.name for s in service.machine.signals)
    write_table(path, Table(np.arange(len(values)) / service.filters.rate_hz, values, names))
    return path


@pytest.fixture(scope="module")
def identified(tmp_path_factory):
    """The machine's identified.toml."""
    folder = tmp_path_factory.mktemp("first_use")
    path = folder / "identified.toml"
    run_identify(SMALL, [recorded(folder / "identify.csv", 1, seconds=120.0)], path, How(refuse=False))
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
    field = recorded(identified.parent / "field.csv", 7, OFFSET)
    found = diagnose(SMALL, Question((field,)))
    first, said = found.answer["identify_first"], words(found)
    assert said.startswith("Identify the machine first: nobody has identified this machine.")
    assert first["share"] > 0.5
    assert first["after_nm"] < first["before_nm"]
    assert "than before" not in said
    assert "cylforce identify" in found.answer["next_experiment"][0]


def test_references_of_a_simulation_with_other_parameters_are_answered_with_these(identified):
    """Seven causes were named; fitting the parameters anew leaves less than they, and was said in the JSON only."""
    own = recorded(identified.parent / "simulated.csv", 2, seed=SEED + 1, seconds=120.0)
    field = recorded(identified.parent / "healthy.csv", 7)
    found = diagnose(SMALL, Question((field,), (own,)))
    assert (found.answer["verdict"], found.answer["effects"]) == ("not_observable", [])
    assert found.answer["identify_first"]["share"] > 0.5
    assert words(found).startswith("Identify the machine first: the model's masses and friction are not this machine's")


def test_a_machine_that_was_identified_is_not_sent_to_be_identified(identified):
    """References with other parameters, and identified.toml: its parameters are this machine's, as they are."""
    own = recorded(identified.parent / "simulated.csv", 2, seed=SEED + 1, seconds=120.0)
    field = recorded(identified.parent / "healthy.csv", 7)
    found = diagnose(SMALL, Question((field,), (own,), identified=identified))
    assert "identify_first" not in found.answer
