"""What is shown while the tool is another one than was chosen: nothing that is OK, and why."""

import pytest

from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Reason, Status
from cylforce.signals.events import Tick
from scenarios import EXCAVATOR, fed, identified, played, scene

OFF_KG = 200.0  # of the empty tool
STROKES = [(0, 1.5, 4.5, 0.4), (1, 1.5, 4.5, -0.4)]


def off(service):
    """A copy of a service that has seen the empty tool off zero."""
    other = service.copied()
    other.tool_check.empty_weight = OFF_KG
    return other


@pytest.fixture(scope="module")
def work():
    """Each tick of a lift of 300 kg: what is said, and what if the tool is another one."""
    loaded = load(EXCAVATOR)
    core, found = Core(loaded.service, identified(loaded)), []
    state = WeighingService.start(core)
    for event in played(loaded, [scene((0.3, -1.2, -0.9), STROKES, 4.5, 300.0)]):
        other = off(state) if isinstance(event, Tick) else None
        out = fed(state, event)
        if other is not None:
            found.append((out.estimate, fed(other, event).estimate))
    return found


def test_with_another_tool_nothing_is_ok(work):
    shown = [(good, bad) for good, bad in work if good.gross.status is Status.OK]
    assert len(shown) > 20
    for good, bad in shown:
        assert (bad.gross.value, bad.force.x.value) == pytest.approx((good.gross.value, good.force.x.value))
        assert (bad.gross.status, bad.gross.reason) == (Status.DEGRADED, Reason.OTHER_TOOL)
        assert (bad.force.x.status, bad.force.x.reason) == (Status.DEGRADED, Reason.OTHER_TOOL)


def test_what_is_no_load_because_of_the_tool_is_told_so(work):
    """Anything else is told as it is."""
    none = [bad.gross for good, bad in work if good.gross.reason is Reason.NOT_A_LOAD]
    assert none
    assert {(q.status, q.reason) for q in none} == {(Status.INVALID, Reason.OTHER_TOOL)}
    others = [(good.gross, bad.gross) for good, bad in work if good.gross.reason is Reason.STARTING]
    assert others
    assert {bad.reason for _, bad in others} == {Reason.STARTING}
