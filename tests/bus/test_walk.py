"""README's walk of one frame: a live step on a real bus makes the very calls that are written there, in that order."""

import ast
import asyncio
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

import cylforce
from cylforce.can.opening import open_bus
from cylforce.programs.run import Daemon
from cylforce.service import service as service_file
from cylforce.service.core import Core
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.events import Frame
from scenarios import EXCAVATOR, identified

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path(cylforce.__file__).parent
MOST = 24  # hops: one screen
SELDOM = "not at every tick"


def chapter():
    return (ROOT / "README.md").read_text().partition("## The walk of one frame")[2].partition("\n## ")[0]


def walks():
    """The chains of calls, one list of names a chain."""
    code = re.search(r"```\n(.*?)```", chapter(), re.DOTALL)[1]
    return [re.findall(r"([\w.]+)\(\)", chain) for chain in code.split("\n\n")]


def functions():
    """The code object of every function named, from the file beside its name in the table."""
    found = {}
    for names, path in re.findall(r"^\| (`[^|]+) \| `([\w/.]+)` \|", chapter(), re.MULTILINE):
        for name in re.findall(r"`([\w.]+)\(\)`", names):
            thing = import_module(".".join(("cylforce", *Path(path).with_suffix("").parts)))
            for part in name.split("."):
                thing = getattr(thing, part)
            found[name] = thing.__code__
    return found


def seldom():
    """Names of the calls that do not happen at every tick."""
    rows = re.findall(rf"^\| (`[^|]+) \| `[^|]+` \| {SELDOM}", chapter(), re.MULTILINE)
    return {name for row in rows for name in re.findall(r"`([\w.]+)\(\)`", row)}


def updated():
    """Names of all `update` methods that the service calls, by the types of its fields."""
    (service,) = (n for n in ast.walk(ast.parse(Path(service_file.__file__).read_text())) if is_service(n))
    types = {n.target.id: ast.unparse(n.annotation) for n in service.body if isinstance(n, ast.AnnAssign)}
    calls = [n.func.value for n in ast.walk(service) if isinstance(n, ast.Call) and is_update(n.func)]
    return {f"{types[ast.unparse(owner).removeprefix('self.')]}.update" for owner in calls}


def is_service(node):
    return isinstance(node, ast.ClassDef) and node.name == "WeighingService"


def is_update(function):
    return isinstance(function, ast.Attribute) and function.attr == "update"


def test_every_call_is_listed_with_its_file_and_they_are_few():
    listed = functions()
    named = {name for chain in walks() for name in chain}
    assert named | seldom() == set(listed)
    assert not named & seldom()
    assert len(listed) <= MOST


def test_everything_that_the_service_updates_is_in_the_walk():
    assert updated() == {name for name in functions() if name.endswith(".update")}


class Trace:
    """Calls of the listed functions while it is on: (name, name of the nearest caller in the sources)."""

    def __init__(self, listed):
        self.names = {code: name for name, code in listed.items()}
        self.calls = []

    def __call__(self, frame, event, argument):
        if event == "call" and frame.f_code in self.names:
            caller = frame.f_back
            while caller is not None and not Path(caller.f_code.co_filename).is_relative_to(SOURCE):
                caller = caller.f_back
            self.calls.append((self.names[frame.f_code], caller and self.names.get(caller.f_code)))

    def passages(self, first, last):
        """The calls from each `first` to the next `last`, both included."""
        found, begun = [], None
        for name, caller in self.calls:
            if name == first:
                begun = []
            if begun is not None:
                begun.append((name, caller))
                if name == last:
                    found.append(begun)
                    begun = None
        return found


async def live(loaded, trace, seconds):
    """The daemon on vcan0, beside it sensors that answer every SYNC with a posture at rest."""
    core = Core(loaded.service, identified(loaded))
    bus, sensors = open_bus("socketcan:vcan0"), open_bus("socketcan:vcan0")
    middle = {f"{link.name}_angle": (link.angle_low + link.angle_high) / 2 for link in core.service.machine.links}
    frames = [
        (pdo.can_id, encode(pdo, {f.signal: middle.get(f.signal, 0.0) for f in pdo.fields if f.signal}))
        for node in core.service.nodes
        for pdo in node.pdos
    ]

    def answer(frame: Frame):
        if frame.can_id == 0x80:
            for can_id, data in frames:
                sensors.send(can_id, data)

    loop = asyncio.get_running_loop()
    daemon = Daemon(loaded, core, bus, None, NOTHING_KEPT)
    sensors.attach(loop, answer)
    daemon.start(loop)
    daemon.node.change_state(5)
    sys.setprofile(trace)
    try:
        await asyncio.sleep(seconds)
    finally:
        sys.setprofile(None)
        await daemon.stop(loop)
        sensors.close()


@pytest.fixture(scope="module")
def trace():
    found = Trace(functions())
    asyncio.run(live(load(EXCAVATOR), found, 4.0))
    return found


def test_a_live_step_makes_the_calls_of_the_walk_in_that_order(trace):
    arriving, *concluding = walks()
    assert any([n for n, _ in passage] == arriving for passage in trace.passages(arriving[0], arriving[-1]))
    whole = [name for chain in concluding for name in chain]
    whole = [name for k, name in enumerate(whole) if k == 0 or name != whole[0]]  # a chain begins where one began
    ticks = [[n for n, _ in passage] for passage in trace.passages(whole[0], whole[-1])]
    assert whole in ticks


def test_no_hop_is_missing(trace):
    """Whatever is listed is called by what is listed; only the loop calls those that begin."""
    callers = {}
    for name, caller in trace.calls:
        callers.setdefault(name, set()).add(caller)
    entries = {chain[0] for chain in walks()} | seldom()
    for name, by in callers.items():
        assert name in entries or by & set(functions()), f"{name} is called by none of the list"
    assert set(functions()) - seldom() <= set(callers)
