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
from cylforce.mechanics.installation import SensorNode, Service
from cylforce.programs.live.station import Station
from cylforce.service import commands
from cylforce.service.assembler import assembler
from cylforce.service.commands import Answer
from cylforce.service.loading.truck import NOT_NOW
from cylforce.service.samples import is_whole, missing_rows
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array, Reason, Sample
from cylforce.signals.events import Frame

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


class Taker:
    """Collects the samples of a station's events in rows.

    sample:   the last one; None: none yet
    rows:     samples (S,) that were not passed on yet, NaN where one is incomplete
    whole_us: time of the last complete sample [us]
    moved_us: time of the last motion [us]
    """

    def __init__(self, service: Service) -> None:
        self._service, self._inputs = service, assembler(service)
        self._missing = np.full(len(service.machine.signals), np.nan)
        self.sample: Sample | None = None
        self.rows: list[Array] = []
        self.whole_us = self.moved_us = 0

    def on_frame(self, frame: Frame) -> Answer | None:
        """Add a frame to the sample, and return the answer to a command: zero and tare are refused without weighing."""
        booted = commands.booted(frame)
        if booted is not None:
            self._inputs.restart(booted)
            return None
        self._inputs.receive((frame,))
        if commands.read(frame, self._service.node_id) is None:
            return None
        return Answer(NOT_NOW, "refused: nothing is weighed during commissioning")

    def on_tick(self, t_us: int) -> None:
        """Append a row with the present sample; nothing is published."""
        period_us = round(1e6 / self._service.filters.rate_hz)
        if self.sample is None:
            self.whole_us = self.moved_us = t_us
        else:
            self.rows += [self._missing] * missing_rows(t_us - self.sample.t_us, period_us)
        self.sample = self._inputs.sample(t_us)
        whole = is_whole(self.sample)
        self.rows.append(self.sample.values if whole else self._missing)
        if whole:
            self.whole_us = t_us


class Collector(Station):
    """Station that passes samples from the bus to the guidance, in a thread so that no tick is delayed.

    taker:     receiver of the samples
    guide:     that advises which joint to move next
    collected: last result of the guidance
    pending:   next result, while the guidance computes it; None: it does not
    """

    def __init__(self, loaded: Loaded, guide: Guide, bus: Bus, log: LogWriter | None) -> None:
        self.taker = Taker(loaded.service)
        super().__init__(loaded.service, self.taker, bus, log)
        self.service, self.guide = loaded.service, guide
        self.collected: Collected = guide.begin()
        self._moved_s = 0.0
        self._pool = ThreadPoolExecutor(1, "guidance")
        self.pending: Future[Collected] | None = None

    def think(self) -> None:
        """Take the guidance's last result and pass it the samples since then. Raises the guidance's errors."""
        if self.pending is not None:
            if not self.pending.done():
                return
            self.collected, self.pending = self.pending.result(), None
        if self.collected.moved_s != self._moved_s and self.taker.sample is not None:
            self._moved_s, self.taker.moved_us = self.collected.moved_s, self.taker.sample.t_us
        if len(self.taker.rows) >= THOUGHT_S * self.service.filters.rate_hz:
            rows, self.taker.rows = np.array(self.taker.rows), []
            longest = int(self.service.health.hold_s * self.service.filters.rate_hz)
            self.pending = self._pool.submit(self.guide.absorb, self.collected, rows, longest)

    def view(self) -> View:
        """Return the present view."""
        advice, now_us = self.guide.advice(self.collected), 0 if self.taker.sample is None else self.taker.sample.t_us
        deaf_s, still_s = (1e-6 * (now_us - since) for since in (self.taker.whole_us, self.taker.moved_us))
        return View(advice, self._here(), deaf_s, still_s, self._trouble(deaf_s, still_s, advice))

    def close(self) -> None:
        """Stop the guidance's thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _here(self) -> Array:
        size = self.service.machine.size
        if self.taker.sample is None or not is_whole(self.taker.sample):
            return np.full(size, np.nan)
        return np.asarray(self.guide.model.channels.read(self.taker.sample.values)[:size])

    def _trouble(self, deaf_s: float, still_s: float, advice: Advice) -> str | None:
        if self.log is not None and self.log.failure:
            return self.log.failure
        if deaf_s > PATIENCE_S:
            return self._missing_sensors()
        if still_s > STILL_S and not advice.done and advice.refusal is None:
            return f"nothing has moved for {still_s:.0f} s: {advice.instruction}"
        return None

    def _missing_sensors(self) -> str:
        sample = self.taker.sample
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
