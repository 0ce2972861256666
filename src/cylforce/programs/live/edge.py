"""Supervision at the edge of the bus, apart from the step.

It covers the filter of frames, the bus's own faults, and nodes that are alive but no longer send their PDOs.
"""

from collections.abc import Callable, Iterator

from cylforce.can.bus import Bus
from cylforce.canopen.bus_health import BusHealth, Tally
from cylforce.canopen.node import Node
from cylforce.canopen.startup import Outcome, Stage
from cylforce.mechanics.installation import Service
from cylforce.programs.live.wanted import wanted
from cylforce.signals.events import ERROR, Frame

SILENT_US = 1_000_000  # without a PDO of an operational node, after which the node is set up again; chosen
LONGEST_US = 30_000_000  # between two such attempts; doubled from SILENT_US on


class Edge:
    """Supervision of one bus.

    `begin(node_id)` configures a sensor again; `tell(words)` is called for each emergency of the bus.
    """

    def __init__(
        self, service: Service, bus: Bus, node: Node, begin: Callable[[int], None], tell: Callable[[str], None]
    ) -> None:
        self._service, self._bus, self._node, self._begin = service, bus, node, begin
        self.health = BusHealth(node.emergencies, tell)
        self._heard_us = {pdo.can_id: 0 for sensor in service.nodes for pdo in sensor.pdos}
        self._again_us: dict[int, tuple[int, int]] = {}  # per node: when, and how long to wait after that
        self._subscribed: frozenset[int] = frozenset()

    def on_frame(self, frame: Frame) -> None:
        """Register a frame, before the node receives it."""
        if frame.can_id in self._heard_us:
            self._heard_us[frame.can_id] = frame.t_us
        elif frame.can_id & ERROR:
            self.health.on_frame(frame)

    def look(self, t_us: int) -> None:
        """Check the bus's own counts, at each tick."""
        counters = self._bus.counters
        self.health.update(Tally(self._bus.overflow(), counters.dropped, counters.reopened), t_us)

    def filter(self, subscribed: frozenset[int]) -> None:
        """Set the bus's filter for the frames that are needed, if they changed.

        subscribed: identifiers that the node needs
        """
        if subscribed != self._subscribed or not self._subscribed:
            self._bus.accept(wanted(self._service, subscribed))
            self._subscribed = subscribed

    def wake(self, outcomes: dict[int, Outcome], t_us: int) -> None:
        """Configure nodes again that are operational and send nothing, at doubling intervals."""
        for node_id in self._asleep(outcomes, t_us):
            due_us, wait_us = self._again_us.setdefault(node_id, (t_us + SILENT_US, SILENT_US))
            if t_us >= due_us:
                self._again_us[node_id] = t_us + wait_us, min(2 * wait_us, LONGEST_US)
                self._begin(node_id)

    def _asleep(self, outcomes: dict[int, Outcome], t_us: int) -> Iterator[int]:
        for sensor in self._service.nodes:
            outcome = outcomes.get(sensor.node_id)
            if outcome is None or outcome.stage is not Stage.OPERATIONAL:
                continue
            if all(self._sends(pdo.can_id, pdo.period_s, t_us) for pdo in sensor.pdos):
                self._again_us.pop(sensor.node_id, None)
            else:
                yield sensor.node_id

    def _sends(self, can_id: int, period_s: float, t_us: int) -> bool:
        return t_us - self._heard_us[can_id] <= max(SILENT_US, 1e7 * period_s)
