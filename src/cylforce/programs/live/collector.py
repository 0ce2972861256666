"""Station of `cylforce commission`: it takes samples like the daemon and passes them to the guidance.

It sends only the frames that the sensors need to send their values.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np

from cylforce.can.bus import Bus
from cylforce.canopen.startup import Stage
from cylforce.commissioning.guidance import Advice, Collected, Guide
from cylforce.files.logfile import LogWriter
from cylforce.mechanics.installation import SensorNode
from cylforce.programs.live.station import Station
from cylforce.service import commands
from cylforce.service.assembler import Assembler
from cylforce.service.loading.truck import NOT_NOW
from cylforce.service.samples import is_whole, skipped
from cylforce.service.state import NOTHING, Output
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array, Reason, Sample
from cylforce.signals.events import Event, Frame, Tick

PATIENCE_S = 3.0  # without a complete sample, after which the picture reports it
STILL_S = 30.0  # without motion, after which the picture reports it
THOUGHT_S = 0.5  # of samples that are passed to the guidance at once


class View(NamedTuple):
    """State of the guidance for the screen.

    advice:  the advice
    here:    (N,) present joint angles [rad]; NaN where unknown
    deaf_s:  time since the last complete sample [s]
    still_s: time since the last motion [s]
    trouble: sentence on an obstacle; None without one
    """

    advice: Advice
    here: Array
    deaf_s: float
    still_s: float
    trouble: str | None

    @property
    def instruction(self) -> str:
        """The sentence to show: the trouble, or the advice."""
        return self.trouble or self.advice.instruction


class Collector(Station[None]):
    """Station that passes samples from the bus to the guidance, in a thread so that no tick is delayed."""

    def __init__(self, loaded: Loaded, guide: Guide, bus: Bus, log: LogWriter | None) -> None:
        super().__init__(loaded.service, self._collect, None, bus, log)
        self.service, self.guide = loaded.service, guide
        self.collected: Collected = guide.begin()
        self._assembler = Assembler(self.service)
        self._inputs = self._assembler.begin()
        self._sample: Sample | None = None
        self._rows: list[Array] = []
        self._missing = np.full(len(self.service.machine.signals), np.nan)
        self._still = self._assembler.still
        self._began_us = self._whole_us = self._moved_us = 0
        self._moved_s = 0.0
        self._pool = ThreadPoolExecutor(1, "guidance")
        self._thought: Future[Collected] | None = None

    def _collect(self, _: None, event: Event) -> tuple[None, Output]:
        """Process an event; the station keeps its state itself."""
        if isinstance(event, Frame):
            return None, Output(self.received(event), words="refused: nothing is weighed during commissioning")
        self.ticked(event)
        return None, NOTHING

    def received(self, frame: Frame) -> int | None:
        """Add a frame to the sample, and return the verdict on a command: zero and tare are refused without
        weighing.
        """
        booted = commands.booted(frame)
        if booted is not None:
            self._inputs = self._assembler.restart(self._inputs, booted)
            return None
        self._inputs = self._assembler.receive(self._inputs, (frame,), self._still)
        return NOT_NOW if commands.read(frame, self.service.node_id) else None

    def ticked(self, tick: Tick) -> None:
        """Append a row with the present sample."""
        period_us = round(1e6 / self.service.filters.rate_hz)
        if self._sample is None:
            self._whole_us = self._moved_us = tick.t_us
        else:
            self._rows += [self._missing] * skipped(tick.t_us - self._sample.t_us, period_us)
        self._sample = self._assembler.sample(self._inputs, tick.t_us)
        whole = is_whole(self._sample)
        self._rows.append(self._sample.values if whole else self._missing)
        if whole:
            self._whole_us = tick.t_us

    def think(self) -> None:
        """Take the guidance's last result and pass it the samples since then. Raises the guidance's errors."""
        if self._thought is not None:
            if not self._thought.done():
                return
            self.collected, self._thought = self._thought.result(), None
        if self.collected.moved_s != self._moved_s and self._sample is not None:
            self._moved_s, self._moved_us = self.collected.moved_s, self._sample.t_us
        if len(self._rows) >= THOUGHT_S * self.service.filters.rate_hz:
            rows, self._rows = np.array(self._rows), []
            longest = int(self.service.health.hold_s * self.service.filters.rate_hz)
            self._thought = self._pool.submit(self.guide.absorb, self.collected, rows, longest)

    def view(self) -> View:
        """Return the present view."""
        advice, now_us = self.guide.advice(self.collected), 0 if self._sample is None else self._sample.t_us
        deaf_s, still_s = (1e-6 * (now_us - since) for since in (self._whole_us, self._moved_us))
        return View(advice, self._here(), deaf_s, still_s, self._trouble(deaf_s, still_s, advice))

    def close(self) -> None:
        """Stop the guidance's thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _here(self) -> Array:
        size = self.service.machine.size
        if self._sample is None or not is_whole(self._sample):
            return np.full(size, np.nan)
        return np.asarray(self.guide.model.channels.read(self._sample.values)[:size])

    def _trouble(self, deaf_s: float, still_s: float, advice: Advice) -> str | None:
        if self.log is not None and self.log.failure:
            return self.log.failure
        if deaf_s > PATIENCE_S:
            return self._missing_sensors()
        if still_s > STILL_S and not advice.done and advice.refusal is None:
            return f"nothing has moved for {still_s:.0f} s: {advice.instruction}"
        return None

    def _missing_sensors(self) -> str:
        sample = self._sample
        assert sample is not None  # noqa: S101  # there is no trouble before the first tick
        names = [s.name for s in self.service.machine.signals]
        bad: dict[str, Reason] = {n: r for n, r in zip(names, sample.reasons, strict=True) if r is not Reason.NONE}
        if not bad and sample.late is not Reason.NONE:
            return f"sensors come late ({_words(sample.late)}): check the bus load and the sensors' periods"
        nodes = [text for node in self.service.nodes if (text := self._missing_of(node, bad))]
        return f"nothing can be measured: {'; '.join(nodes)}"

    def _missing_of(self, node: SensorNode, bad: dict[str, Reason]) -> str | None:
        """Return a sentence on the missing values of a node, with the cure; None without any."""
        lost = [f.signal for pdo in node.pdos for f in pdo.fields if f.signal in bad]
        if not lost:
            return None
        outcome, who = self.outcomes.get(node.node_id), f"{', '.join(map(str, lost))} (node {node.node_id})"
        if outcome is not None and outcome.stage in (Stage.REFUSED, Stage.FAILED):
            return f"{who}: {outcome.reason}"
        reasons = {bad[str(name)] for name in lost}
        if reasons <= {Reason.SIGNAL_MISSING, Reason.SIGNAL_STALE, Reason.NOT_OPERATIONAL}:
            return f"{who} silent, check its power, cable, bit rate and node number"
        return f"{who} {', '.join(sorted(_words(r) for r in reasons))}"


def _words(reason: Reason) -> str:
    return reason.name.lower().replace("_", " ")
