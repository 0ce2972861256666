"""What the service remembers from event to event, and what an event brings."""

from typing import NamedTuple

from cylforce.estimation.kernel.restricted import Numbers
from cylforce.mechanics.installation import STANDARD
from cylforce.service.adaptation import Drift
from cylforce.service.booking import Weighed
from cylforce.service.contact.interaction import Interaction
from cylforce.service.contact.rocking import STILL, Rocking
from cylforce.service.loading.cycle import NO_CYCLE, Cycle
from cylforce.service.loading.truck import NO_TRUCK, Truck
from cylforce.service.pipeline import Pipe
from cylforce.service.plausibility.monitor import Watch
from cylforce.service.publication import Encoders
from cylforce.service.recognition import Recognition
from cylforce.service.senders.inputs import Inputs
from cylforce.service.weighing import Weighing
from cylforce.signals.estimate import Booking, Estimate
from cylforce.signals.events import Frame


class Scale(NamedTuple):
    """The operator's zero and tare [kg]."""

    zero: float = 0.0
    tare: float = 0.0


NO_SCALE = Scale()


class Memory(NamedTuple):
    """What a restart does not change: zero and tare, the truck that is being loaded, the last booking, the name of the
    tool; the weight of a bucket that hangs and is not booked yet; or the mass [kg] of one that hung so long ago that it
    may have been emptied (0: none); whether the parameters are `unconfirmed`: sealed on another controller, so that
    they may be another machine's."""

    scale: Scale = NO_SCALE
    truck: Truck = NO_TRUCK
    booking: Booking | None = None
    tool: str = STANDARD
    hanging: Weighed | None = None
    lost: float = 0.0
    unconfirmed: bool = False

    def emptied(self) -> "Memory":
        """The bucket that hung may have been emptied since, and filled again."""
        return self if self.hanging is None else self._replace(hanging=None, lost=self.hanging.mass)


NOTHING_KEPT = Memory()


class State(NamedTuple):
    """Everything that the service remembers from event to event: the sensors' last values, filters (None: not
    started), weighing, drift, zero and tare, time of the last processed sample [us], last estimate; per signal whether
    it should change (1) because the machine moves; whose machine it is; contact with the ground; whether the sensors
    agree; the truck that is being loaded; the working cycle so far, and the one that the last booking ended; whether
    NMT has stopped our node; the name of the tool; the torque that the empty machine does not explain, of each
    measured joint [N m] (none: not measured); how the base moves; frames that are judged at the next tick, all at
    once."""

    inputs: Inputs
    pipe: Pipe | None
    weighing: Weighing
    drift: Drift
    scale: Scale
    sampled_us: int
    estimate: Estimate
    moving: Numbers
    recognition: Recognition
    interaction: Interaction
    watch: Watch
    truck: Truck
    cycle: Cycle = NO_CYCLE
    ended: Cycle = NO_CYCLE
    stopped: bool = False
    tool: str = STANDARD
    unexplained: tuple[float, ...] = ()
    rocking: Rocking = STILL
    frames: tuple[Frame, ...] = ()

    @property
    def memory(self) -> Memory:
        """What a restart does not change."""
        books = self.weighing.books
        known = Memory(self.scale, self.truck, books.booking, self.tool, books.candidate)
        return known._replace(unconfirmed=books.unconfirmed)


NO_ENCODERS = Encoders(())


class Output(NamedTuple):
    """What an event brought: `verdict` on a command (None: no command; 0: done; else an SDO abort code),
    its `words`, what was decided and why; `estimate` and the `table` of the PDOs that carry it, which encodes them."""

    verdict: int | None = None
    estimate: Estimate | None = None
    table: Encoders = NO_ENCODERS
    words: str = ""

    @property
    def frames(self) -> tuple[tuple[int, bytes], ...]:
        """(Number, data) of all PDOs, sent as they are."""
        return tuple(self.due(tuple(pdo.number for pdo in self.table.pdos)))

    def data(self, number: int) -> bytes | None:
        """The bytes of one of them; None where there is no estimate."""
        return next((data for _, data in self.due((number,))), None)

    def due(self, numbers: tuple[int, ...]) -> list[tuple[int, bytes]]:
        """Those of these numbers: what is not sent is not encoded."""
        _, estimate, table, _ = self
        return [] if estimate is None or not numbers else table.of(numbers).data(estimate)


NOTHING = Output()
