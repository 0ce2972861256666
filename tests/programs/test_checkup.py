"""`cylforce checkup`: it goes on until it is decided, and says what no motion decides."""

import json
from functools import cached_property
from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.imposed import imposed
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.pressure_gain import PressureGain
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.files.atomic import RecordingError
from cylforce.files.tables import Table, write_table
from cylforce.programs.checkup import (
    Checked,
    CheckupOutputs,
    CheckupStep,
    End,
    check_recordings_of,
    concluded,
    run_checkup,
    sentences_of,
)
from cylforce.programs.common.gap_question import Question
from cylforce.programs.experiments.catalogue import checkup
from cylforce.programs.experiments.motions import read_scene
from cylforce.programs.gap import Diagnosed
from cylforce.programs.gap_output import write_next_motion
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import cycles, moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth
from scenarios import CONFIG

LOADED = load(CONFIG / "excavator_20t.toml")
SERVICE = LOADED.service
MACHINE = SERVICE.machine
LIBRARY = (
    (CoulombFriction(),),
    (PressureOffset(),),
    (PressureGain(),),
    (AngleOffset(),),
    (ExtraMass(),),
    (FirstMomentChange(),),
)
STEADY = {"first": ("moves", 1), "second": ("moves", 2)}


class Rig:
    """Records one simulated machine into files."""

    def __init__(self, folder):
        self.folder = folder
        self.references = tuple(self.record(name, scene, seed) for name, (scene, seed) in STEADY.items())

    @cached_property
    def healthy(self):
        """A recording of the machine without an effect."""
        return self.record("healthy", "moves", 4)

    def record(self, name, scene, seed, *effects):
        truth = draw_truth(MACHINE, np.random.default_rng(0), 0.1)._replace(effects=effects)
        if scene == "moves":
            scenes = [moves(MACHINE, np.random.default_rng((seed, 1)), 70.0)]
        elif scene == "work":
            scenes = list(cycles(MACHINE, np.random.default_rng((seed, 1)), 5, swing=True))
        else:
            scenes = [checkup(MACHINE)[("together", "stairs").index(scene)].scene]
        made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((seed, 2))
        records = list(run(MACHINE, truth, made, scenes, dt=1.0 / SERVICE.filters.rate_hz, rng=rng))
        return self.written(name, np.concatenate([r.t for r in records]), np.concatenate([r.values for r in records]))

    def still(self, name, offsets):
        """Ten seconds without pressure."""
        rng, made = np.random.default_rng(5), sensors(MACHINE, SERVICE.nodes)
        t = np.arange(0.0, 10.0, 1.0 / SERVICE.filters.rate_hz)
        values = made.noise * rng.standard_normal((len(t), len(MACHINE.signals)))
        for k, signal in enumerate(MACHINE.signals):
            values[:, k] += offsets.get(signal.name, 0.0)
        return self.written(name, t, values)

    def written(self, name, t, values):
        path = self.folder / f"{name}.parquet"
        write_table(path, Table(t, values, tuple(s.name for s in MACHINE.signals)))
        return path

    def checked(self, *field, still=None, shown=lambda _: None):
        question = Question(field, self.references, still=still)
        return check_recordings_of(LOADED, question, LIBRARY, show=shown)


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    return Rig(tmp_path_factory.mktemp("rig"))


def test_a_clear_fault_is_decided_by_the_first_recording(rig):
    field = rig.record("rubbing", "moves", 3, imposed(MACHINE, "coulomb_friction", "stick", 6000.0))
    shown = []
    found = rig.checked(field, field.with_name("never_read.parquet"), shown=shown.append)
    assert found.end is End.CERTAIN
    assert len(found.steps) == len(shown) == 1
    assert found.steps[0].causes[0][0] == ("coulomb_friction", "stick")
    assert found.next is None
    assert not found.by_hand


def test_zeros_read_without_pressure_are_part_of_the_question(rig):
    offset = imposed(MACHINE, "pressure_offset", "stick_head_pressure", 0.8e5)
    found = rig.checked(rig.record("off", "moves", 5, offset), still=rig.still("still", {"stick_head_pressure": 0.8e5}))
    zeros = found.found.diagnosis.evidence.found.question.zeros
    means = {MACHINE.signals[k].name: zero.mean for k, zero in zeros.items()}
    assert means["stick_head_pressure"] == pytest.approx(0.8e5, abs=0.05e5)
    assert means["stick_rod_pressure"] == pytest.approx(0.0, abs=0.05e5)
    assert found.end is End.CERTAIN
    assert found.steps[0].causes[0][0] == ("pressure_offset", "stick_head_pressure")
    assert not found.still_next


def test_a_working_machine_is_asked_to_stop_and_gets_a_motion_in_the_air(rig, tmp_path):
    """Either the recording decides although the machine digs, or the first advice is to stop."""
    found = rig.checked(rig.record("work", "work", 6, imposed(MACHINE, "coulomb_friction", "stick", 4000.0)))
    assert found.end in (End.CERTAIN, End.OPEN)
    if found.end is End.OPEN:
        assert found.next.words == checkup(MACHINE)[0].words
        assert found.found.plan.stop_first == ("stop working" in " ".join(sentences_of(MACHINE, found)))
        path = tmp_path / "next.csv"
        if found.found.plan.stop_first:
            write_next_motion(path, found.found, MACHINE)
            assert read_scene(path, MACHINE).duration == pytest.approx(120.0, abs=0.1)


def test_a_motion_that_would_not_help_is_not_written(tmp_path):
    with pytest.raises(RecordingError, match="is not written: no motion of the catalogue"):
        write_next_motion(tmp_path / "next.csv", Diagnosed({"verdict": "no_gap"}), MACHINE)


def test_a_healthy_machine_ends_the_check_up_and_the_answer_is_written_as_json(rig, tmp_path):
    field = rig.healthy
    console = Console(file=StringIO(), width=200)
    out = tmp_path / "answer.json"
    found = run_checkup(LOADED, Question((field,), rig.references), CheckupOutputs(out), console)
    assert found.end is End.HEALTHY
    assert "no fault" in sentences_of(MACHINE, found)[0]
    written = json.loads(out.read_text())
    assert written["end"] == "healthy"
    assert [step["recording"] for step in written["steps"]] == [field.name]
    assert written["joint_name"] is None


def test_where_references_do_not_suffice_the_check_up_says_why_and_what_to_record():
    step = CheckupStep("field", "not_observable", ())
    found = Diagnosed({"verdict": "not_observable", "reason": "they differ from each other"})
    ended = Checked((step,), End.REFERENCES, (), (), False, None, found)
    assert sentences_of(MACHINE, ended) == [
        "the references do not suffice: record the machine in order in this very motion, as a reference",
        "they differ from each other",
    ]


def test_references_that_tell_nothing_end_the_check_up_before_anything_is_recorded_in_vain(rig):
    """Two more motions were recorded, each with the same answer."""
    why = "the references cannot be explained"
    found = Diagnosed({"verdict": "not_observable", "effects": [], "reason": why}, poor_references=True)
    _, ended = concluded(MACHINE, Question((rig.healthy,), rig.references), found)
    assert ended.end is End.REFERENCES
    assert ended.next is None
    assert sentences_of(MACHINE, ended) == ["the references do not suffice", why]


def test_a_still_recording_that_is_too_short_is_refused(rig):
    path = rig.written("short", np.arange(0.0, 1.0, 0.01), np.zeros((100, len(MACHINE.signals))))
    with pytest.raises(RecordingError, match=r"short\.parquet: has 1 s of samples: record 10 s without pressure"):
        rig.checked(rig.healthy, still=path)


def test_no_recording_is_refused():
    with pytest.raises(RecordingError, match="no recording to check"):
        check_recordings_of(LOADED, Question(()), LIBRARY)
