"""The check-up on a bus: it guides an operator through its motions, records them, and ends when it is decided."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.effects.imposed import imposed
from cylforce.files.logreader import read_events
from cylforce.files.tables import Table, write_table
from cylforce.programs.common.play import Play
from cylforce.programs.experiments.catalogue import checkup
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth
from operated import operated
from scenarios import CONFIG, scene

FAULT = ("coulomb_friction", "stick", 5000.0)  # N: several times what a healthy seal rubs
REST_S = 1.0  # between what the operator is asked for


class Operator:
    """Reads sentences, stands still or moves; a machine that stands has no pressure."""

    def __init__(self, loaded):
        self.loaded, self.machine, self.says = loaded, loaded.service.machine, ""
        together = checkup(self.machine)[0].scene
        self.pose = [joint.begin for joint in together.joints]

    def hear(self, line):
        self.says = line.rpartition(": ")[2]

    def scenes(self):
        motions = {motion.words: motion.scene for motion in checkup(self.machine)}
        while True:
            yield motions.get(self.says) or scene(self.pose, (), REST_S)

    def play(self):
        service = self.loaded.service
        made, truth = sensors(self.machine, service.nodes), truth_of(self.machine, imposed(self.machine, *FAULT))
        dt, pressures = 1.0 / service.filters.rate_hz, ["pressure" in s.name for s in self.machine.signals]

        def records():
            rng = np.random.default_rng(4)
            for record in run(self.machine, truth, made, self.scenes(), dt=dt, rng=rng):
                if len(record.t) * dt <= 2.0 * REST_S:
                    record.values[:, pressures] = 1e3 * rng.standard_normal((len(record.t), sum(pressures)))
                yield record

        return Play(self.loaded, 4, truth, made, {}, records())


def truth_of(machine, *effects):
    return draw_truth(machine, np.random.default_rng(0), 0.1)._replace(effects=effects)


def recorded(loaded, path, seed):
    """A recording of the healthy machine."""
    service, rng = loaded.service, np.random.default_rng((seed, 2))
    made, scene = sensors(service.machine, service.nodes), moves(service.machine, np.random.default_rng(seed), 70.0)
    dt = 1.0 / service.filters.rate_hz
    records = list(run(service.machine, truth_of(service.machine), made, [scene], dt=dt, rng=rng))
    t, values = (np.concatenate([getattr(r, name) for r in records]) for name in ("t", "values"))
    write_table(path, Table(t, values, tuple(s.name for s in service.machine.signals)))
    return path


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The check-up to its end, everything that it left."""
    folder = tmp_path_factory.mktemp("checkup")
    path, text = folder / "machine.toml", (CONFIG / "excavator_stick_bucket.toml").read_text()
    often = "rate_hz = 100"
    assert often in text
    path.write_text(text.replace(often, "rate_hz = 50"))  # half the frames
    loaded = load(path)
    references = [recorded(loaded, folder / f"reference_{k}.parquet", k) for k in (1, 2)]
    operator = Operator(loaded)
    words = ["checkup", path, "--folder", folder / "steps", "--json", folder / "checkup.json"]
    words += [word for reference in references for word in ("--reference", reference)]
    ended = operated(words, operator.play(), operator.hear)
    return SimpleNamespace(loaded=loaded, folder=folder, ended=ended)


def test_it_ends_with_the_cause_that_the_machine_has(done):
    assert done.ended.code == 0, done.ended.errors
    found = json.loads((done.folder / "checkup.json").read_text())
    assert found["end"] == "certain", done.ended.lines
    assert (found["answer"]["effects"][0]["name"], found["answer"]["effects"][0]["at"]) == FAULT[:2]


def test_it_asks_for_one_step_after_the_other(done):
    text = "\n".join(done.ended.lines)
    assert text.index("stop the engine") < text.index("move all joints at once")


def test_every_step_is_kept_as_a_recording(done):
    steps = sorted(path.name for path in (done.folder / "steps").iterdir())
    assert steps == ["1.log", "still.log"]
    events = [list(read_events(done.folder / "steps" / name, 10_000)[1]) for name in steps]
    assert all(len(each) > 1000 for each in events)
