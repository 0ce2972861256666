"""A machine on the bus whose operator does what the commissioning says, and knows nothing but its sentences."""

import re
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.commissioning.strokes import clear_range
from cylforce.files.candump import Sent
from cylforce.files.logreader import read_events
from cylforce.programs.common.play import Play
from cylforce.programs.identify import How, run_identify
from cylforce.settings.identified import read_identified
from cylforce.settings.machine_file import load
from cylforce.simulation.sensing import run, sensors
from obedient import to_pose
from operated import operated
from scenarios import CONFIG, carried, scene, truth_of

NAME = "excavator_stick_bucket.toml"
SEED = 21
KNOWN_KG = 2000.0
QUICKLY = {  # half the frames, and strokes of a third: what is to be done then takes 100 s
    "rate_hz = 100": "rate_hz = 50",
    "[-150, -35]": "[-115, -75]",
    "[-138, 24]": "[-90, -20]",
    "rated_payload_kg = 1500": "rated_payload_kg = 4000",
}
SEES_S = 3.0  # the guidance sees a stroke when its filters have settled
MOVE = re.compile(r"move the (\w+) \w+: its cylinder \w+ from (.+?) to (.+?), in about (\d+) s(?:; (.*))?$")
TO = re.compile(r"the (\w+)'s cylinder to (the inner end|the outer end|\d+ %)")
WAIT = re.compile(r"the (\w+)'s at (the inner end|the outer end|\d+ %)")


class Operator:
    """Reads sentences, moves cylinders; its scenes are asked for one ahead."""

    def __init__(self, loaded):
        self.loaded, self.machine = loaded, loaded.service.machine
        self.says, self.pose = "", clear_range(self.machine).mean(axis=1)

    def hear(self, line):
        self.says = line.partition(": ")[2]

    def scenes(self):
        while True:
            found = MOVE.search(self.says)
            if found is not None:
                yield from self.stroke(*found.groups())
            elif "all joints at once" in self.says:
                yield self.go(dict(TO.findall(self.says)), SEES_S)
            elif "clear of the ground and move" in self.says:
                yield from self.lift()
            yield scene(self.pose, (), SEES_S)
            yield scene(self.pose, (), 0.1)

    def stroke(self, name, begin, end, seconds, others):
        at = {**dict(WAIT.findall(others or "")), name: begin}
        for places, least in ((at, 0.0), ({**at, name: end}, float(seconds))):
            yield self.go(places, least)

    def go(self, places, least):
        target = np.array([self.angle(j, places.get(link.name)) for j, link in enumerate(self.machine.links)])
        begin, self.pose = self.pose, target
        return to_pose(self.machine, begin, target, least, None)

    def angle(self, j, place):
        """The joint's angle with its cylinder there; where it is, when nothing is said."""
        if place is None:
            return self.pose[j]
        share = {"the inner end": 0.0, "the outer end": 1.0}.get(place) if "end" in place else int(place[:-2]) / 100
        c = next(c for c, cylinder in enumerate(self.machine.cylinders) if cylinder.name == self.machine.links[j].name)
        theta = np.tile(self.pose, (400, 1))
        theta[:, j] = np.linspace(*clear_range(self.machine)[j], 400)
        length = self.machine.geometry(theta).length[:, c]
        cylinder = self.machine.cylinders[c]
        wanted = cylinder.length_low + share * (cylinder.length_high - cylinder.length_low)
        return theta[np.argmin(np.abs(length - wanted)), j]

    def lift(self):
        for weight in (carried(KNOWN_KG), None):
            for part in (0.7, 0.5):
                target = clear_range(self.machine) @ [1.0 - part, part]
                yield to_pose(self.machine, self.pose, target, 4.0, weight)
                self.pose = target

    def play(self):
        service = self.loaded.service
        made, rng = sensors(self.machine, service.nodes), np.random.default_rng((SEED, 2))
        truth, dt = truth_of(self.loaded, SEED), 1.0 / service.filters.rate_hz
        records = run(self.machine, truth, made, self.scenes(), dt=dt, rng=rng)
        return Play(self.loaded, SEED, truth, made, {}, records)


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """The commissioning to its end, everything that it left."""
    folder = tmp_path_factory.mktemp("commission")
    output, path, text = folder / "identified.toml", folder / "machine.toml", (CONFIG / NAME).read_text()
    for there, instead in QUICKLY.items():
        assert there in text
        text = text.replace(there, instead)
    path.write_text(text)
    loaded = load(path)
    operator = Operator(loaded)
    words = ("commission", path, "-o", output, "--known-kg", KNOWN_KG)
    ended = operated(words, operator.play(), operator.hear)
    return SimpleNamespace(loaded=loaded, output=output, ended=ended)


def test_it_ends_by_itself_with_tares_and_a_scale(done):
    assert done.ended.code == 0, done.ended.errors
    tares = read_identified(done.output, done.loaded)
    assert tares.identified
    assert 0.0 < tares.scale_error < 0.03
    assert abs(tares.scale - 1.0) < 3.0 * tares.scale_error
    assert any("enough: the machine may rest" in line for line in done.ended.lines)


def test_it_told_one_sentence_after_the_other(done):
    said = [line for line in done.ended.lines if " of motion, " in line]
    assert len(said) > 5
    assert all(a.partition(": ")[2] != b.partition(": ")[2] for a, b in pairwise(said))
    minutes, seconds = re.match(r"(\d+):(\d\d) of motion", said[-1]).groups()
    assert 60 * int(minutes) + int(seconds) < 300


def test_it_never_commanded_anything(done):
    """Beside NMT, SYNC, SDO to the sensors and our heartbeat nothing of ours is on the bus: no PDO."""
    events = read_events(done.output.with_suffix(".log"), 10_000)[1]
    ours = {e.can_id for e in events if isinstance(e, Sent)}
    sensors = {node.node_id for node in done.loaded.service.nodes}
    node = done.loaded.service.node_id
    assert ours <= {0x000, 0x080, 0x080 + node, 0x700 + node, *(0x600 + n for n in sensors)}


def test_what_it_wrote_is_what_identify_finds_in_its_logs(done, tmp_path):
    log = done.output.with_suffix(".log")
    how = How(lift=log.with_name(f"{log.stem}.lift.log"), known_kg=KNOWN_KG)
    found = run_identify(done.loaded, [log], tmp_path / "again.toml", how)
    np.testing.assert_allclose(read_identified(done.output, done.loaded).values, found.tares.values, rtol=1e-9)
