"""What the service loads on a controller: not what only identification, reports and diagnosis need."""

import json
import subprocess
import sys

import pytest

from scenarios import EXCAVATOR

MOST_MB = 80.0  # of the daemon's memory: the goal of the project
HEAVY = {"scipy", "matplotlib", "jinja2", "pyarrow", "paho", "starlette", "cylforce.commissioning.identification"}
SERVICE = """
import json, sys
from pathlib import Path
from cylforce.service.service import WeighingService
from cylforce.files.logreader import with_ticks
from cylforce.programs.common.machine_file import load_machine
from cylforce.programs.common.readings import header_of, make_core
from cylforce.programs.run import Daemon
from cylforce.signals.codec import encode
from cylforce.signals.events import Frame
loaded = load_machine(Path(sys.argv[1]))
core = make_core(loaded, None)
header_of(loaded, None, "socketcan:can0")
weighing, service = WeighingService.start(core), loaded.service
values = {s.name: (s.low + s.high) / 2.0 for s in service.machine.signals}
frames = [Frame(t_us, p.can_id, encode(p, values)) for t_us in range(10_000, 3_000_000, 10_000)
          for n in service.nodes for p in n.pdos]
for event in with_ticks(iter(frames), core.period_us):
    weighing.on_event(event)
kb = next(line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
print(json.dumps([int(kb) / 1024, weighing.pipeline.state is not None, sorted(sys.modules)]))
"""

ASKED = """
import sys
from cylforce.programs.cli import main
try:
    main()
except SystemExit:
    print(*sys.modules)
"""


@pytest.fixture(scope="module")
def service():
    run = [sys.executable, "-c", SERVICE, str(EXCAVATOR)]
    return json.loads(subprocess.run(run, capture_output=True, text=True, check=True).stdout)


def test_the_service_loads_nothing_that_it_does_not_need(service):
    """Three seconds of ticks through what `run` imports, on which the filters have settled."""
    _, measuring, modules = service
    assert measuring
    assert not HEAVY & set(modules)


def test_the_service_fits_into_a_controllers_memory(service):
    """Its largest resident memory, with the bus, log and records that it would use."""
    assert service[0] < MOST_MB


@pytest.mark.parametrize("asked", ["--version", "--help"])
def test_a_question_loads_no_library(asked):
    run = [sys.executable, "-c", ASKED, asked]
    loaded = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()[-1].split()
    assert "typer" in loaded
    assert not {"numpy", "scipy", "matplotlib", "rich", "pydantic", "structlog", "can", "canopen"} & set(loaded)
