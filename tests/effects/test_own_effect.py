"""The effect of one's own in the chapter on effects: the very example is run, and finds the effect that it adds."""

import re
from pathlib import Path

import numpy as np

from cylforce.effects.imposed import imposed
from cylforce.files.tables import Table, write_table
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth

ROOT = Path(__file__).resolve().parents[2]
LOAD, SIZE = 1000.0, 0.03


def example() -> str:
    """The code of that section."""
    section = (ROOT / "src/cylforce/effects/README.md").read_text().partition("## An effect of your own")[2]
    return re.search(r"```python\n(.*?)```", section, re.DOTALL)[1]


def recordings(kind, service, seed, effects=()):
    """Two tables, of the empty and of the loaded machine, from one run."""
    machine, dt = service.machine, 1.0 / service.filters.rate_hz
    truth = draw_truth(machine, np.random.default_rng(5), 0.1)._replace(effects=effects)
    scenes = [moves(machine, np.random.default_rng((seed, k)), 40.0, payload=kg) for k, kg in enumerate((0.0, LOAD))]
    records = run(machine, truth, sensors(machine, service.nodes), scenes, dt=dt, rng=np.random.default_rng((seed, 9)))
    for record, what in zip(records, ("empty", "loaded"), strict=True):
        write_table(Path(f"{kind}_{what}.csv"), Table(record.t, record.values, tuple(s.name for s in machine.signals)))


def test_an_effect_of_ones_own_is_found_as_the_chapter_says(tmp_path, monkeypatch):
    """The stick's head pressure reads 3 % of the bucket's as well."""
    (tmp_path / "config").symlink_to(ROOT / "config")
    monkeypatch.chdir(tmp_path)
    service = load(Path("config/excavator_20t.toml")).service
    names: dict = {"__name__": "example"}
    definition, question, rest = example().partition("question = ")
    exec(definition, names)
    own = (names["CrossTalk"](),)
    effect = imposed(service.machine, "cross_talk", "stick_head_pressure", SIZE, library=(own,))
    recordings("reference", service, 1)
    recordings("field", service, 2, (effect,))
    exec(question + rest, names)
    first = names["found"].answer["effects"][0]
    size = first["parameters"]["size"]
    assert (first["name"], first["at"]) == ("cross_talk", "stick_head_pressure")
    assert abs(size["value"] - SIZE) < 0.15 * SIZE
