"""Plausibility between sensors: the monitor runs the table of detectors, and combines their reports.

The report of the highest level becomes the suspicion; of several such reports, the most specific one."""

from dataclasses import dataclass
from typing import Self, TypeVar, cast

from cylforce.service.plausibility.blocks import EVERY, BlockGatherer
from cylforce.service.plausibility.detector import Detector, Features, Interruption, MonitoredMachine
from cylforce.service.plausibility.detectors.constant_error import VOTES
from cylforce.service.plausibility.detectors.swept_tool import SweptTool
from cylforce.service.plausibility.pressure_groups import PressureGroups
from cylforce.service.plausibility.sample import MonitorSample
from cylforce.service.plausibility.suspicion import NOTHING_SUSPECTED, Level, SensorSuspicion
from cylforce.service.plausibility.table import DETECTORS
from cylforce.service.plausibility.undetected import UndetectedErrors
from cylforce.service.snapshot import Estimator

D = TypeVar("D", bound=Detector)
Reports = tuple[SensorSuspicion, ...]


@dataclass(slots=True)
class Monitor(Estimator):
    """Monitor of one machine's signals.

    machine:    constants
    groups:     statistics of the pressures
    blocks:     seconds of motion
    undetected: probable undetected biases
    detectors:  by the names of their classes, in the order of the table
    reports:    of the detectors at the last step
    suspicion:  present result of the monitor
    evidence:   whether a detector has evidence, but too little for a suspicion
    in_air:     number of seconds in a row that a load explained, since a signal was rejected
    """

    machine: MonitoredMachine
    groups: PressureGroups
    blocks: BlockGatherer
    undetected: UndetectedErrors
    detectors: dict[str, Detector]
    reports: Reports = ()
    suspicion: SensorSuspicion = NOTHING_SUSPECTED
    evidence: bool = False
    in_air: int = 0

    @classmethod
    def start(cls, machine: MonitoredMachine) -> Self:
        """Return a monitor of a machine's signals before any sample: each detector of the table, no suspicion."""
        made = cls(
            machine,
            groups=PressureGroups.start(machine.groups),
            blocks=BlockGatherer.start(machine.blocks),
            undetected=UndetectedErrors.start(machine.blocks),
            detectors={kind.__name__: kind.start(machine) for kind in DETECTORS},
        )
        made.reports = made._reports()
        return made

    def detector(self, kind: type[D]) -> D:
        """Return the detector of a class of the table."""
        return cast(D, self.detectors[kind.__name__])

    @property
    def unsure(self) -> bool:
        """Return whether bookings wait.

        They wait for evidence that is too little for a suspicion, or for the next motion in the air to decide."""
        return self.evidence or self.suspicion.waits

    @property
    def slews_fast(self) -> bool:
        """Return whether the house slews too fast for contact of the tool with the ground."""
        return self.detector(SweptTool).fast

    def keep_rejection(self, other: "Monitor") -> None:
        """Take over a suspicion that `stays` from a monitor with other tares."""
        if other.suspicion.stays:
            self.suspicion = other.suspicion

    def interrupt(self, *, frozen: bool = False, out_of_range: tuple[int, ...] = ()) -> None:
        """Discard unfinished groups and blocks, because the measurement stopped; the suspicion stays.

        frozen:       whether a signal was frozen
        out_of_range: numbers of the signals outside their range; they are suspected when they return
        """
        why = Interruption(frozen and self.suspicion.level is Level.FINE, out_of_range)
        self.groups.interrupt()
        self.blocks.interrupt()
        self.undetected.end_lift()
        for detector in self.detectors.values():
            detector.interrupt(why)
        self._look_for_evidence()
        self.reports = self._reports()

    def update(self, now: MonitorSample) -> None:
        """Update all detectors with one step of the service, and combine their reports into the suspicion.

        now: values of the signals and results of the step
        """
        self.groups.update(now.values, now.instant.speed)
        features = Features(now, self.groups, self.blocks)
        detectors = self.detectors.values()
        for detector in detectors:
            detector.on_step(features)
        sampled = now.pipeline.steps % EVERY == 0
        if sampled:
            self._sample(features)
        reports = self._reports()
        if reports != self.reports or (sampled and self._suspects(reports)):
            self.suspicion = self.combined(reports)
        self.reports = reports

    def _sample(self, features: Features) -> None:
        """Update blocks of motion, probable undetected errors and the detectors with every EVERY-th step.

        features: of the step
        """
        now, blocks = features.now, self.blocks
        channels = now.pipeline.middle
        blocks.update(now.instant, channels, now.drift)
        self.undetected.update(blocks, channels, now.forces.resultant, now.lift.taken, now.drift)
        if blocks.block is not None:
            rejected = self.suspicion.level is Level.REJECTED
            self.in_air = self.in_air + 1 if blocks.explained and rejected else 0
        for detector in self.detectors.values():
            detector.on_sample(features)
        self._look_for_evidence()

    def _look_for_evidence(self) -> None:
        self.evidence = any(detector.unsure for detector in self.detectors.values())

    def _reports(self) -> Reports:
        return tuple([detector.report for detector in self.detectors.values()])

    def _suspects(self, reports: Reports) -> bool:
        """Return whether there is a suspicion or a report."""
        return self.suspicion.level is not Level.FINE or any(report.level for report in reports)

    def combined(self, reports: Reports) -> SensorSuspicion:
        """Return the monitor's suspicion from the detectors' reports: that of the highest level; of several, the first.

        A latched suspicion stays. A suspicion that `stays` ends after VOTES seconds in the air that a load explains, or
        is replaced by a reported rejection."""
        if self.suspicion.latched:
            return self.suspicion
        surest = max(reports, key=lambda report: report.level, default=NOTHING_SUSPECTED)
        if self.suspicion.stays and surest.level is not Level.REJECTED and self.in_air < VOTES:
            return self.suspicion
        return surest
