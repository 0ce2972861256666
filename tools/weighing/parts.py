"""Of what the standard error of each booked weight consists, beside the true error: how wide the part of errors of
signals that nobody notices is, and how wide it would be if it were counted in other ways."""

from collections.abc import Mapping
from dataclasses import astuple, fields
from typing import NamedTuple

import numpy as np
from rich.table import Table

from cylforce.files.candump import Sent
from cylforce.files.logreader import with_ticks
from cylforce.files.recording import open_pieces, sensor_frames
from cylforce.service.adaptation import DriftKnowledge, KnownDrift
from cylforce.service.booking import Bookings, ProbableErrors, Variances, Weighed
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Array

from .bucket import Work
from .score import INTERVAL
from .trial import WHOLE, tares

WAYS = ("without", "whole", "evidence", "largest")


class Parts(NamedTuple):
    """Of B bookings of one machine, as shares of its rated payload: true error (B,); variances (B, 5) in the order of
    `Variances`; what undetected errors of signals add by each of WAYS (B, 4): nothing; the errors that explain the
    torques best, each by itself, in squares; as far as there is evidence that a signal is off (as the service does); of
    that the largest one alone."""

    error: Array
    told: Array
    ways: Array

    def share(self, way: str) -> float:
        """How many of the 95 % intervals would hold."""
        wide = INTERVAL * np.sqrt(self.told[:, :-1].sum(axis=1) + self.ways[:, WAYS.index(way)])
        return float(np.mean(np.abs(self.error) <= wide))

    def width(self, way: str) -> float:
        """The standard error, root of the mean square."""
        return float(np.sqrt(np.mean(self.told[:, :-1].sum(axis=1) + self.ways[:, WAYS.index(way)])))


def parts(work: Work) -> Parts:
    """Of one machine that is weighed by the service."""
    loaded = load(work.folder / "machine.toml")
    core, rated = Core(loaded.service, tares(work, loaded, WHOLE)), loaded.service.machine.rated_payload
    path = work.folder / f"{work.work}.parquet"
    frames = sensor_frames(open_pieces(path, loaded.service, loaded.columns, report=lambda _: None), loaded.service)
    booked: dict[int, tuple[float, float, Variances, tuple[float, ...]]] = {}
    service = WeighingService.start(core)
    for event in with_ticks(frames, core.period_us, lambda _: None):
        if isinstance(event, Sent):
            continue
        bookings = service.bookings
        before, probable = bookings.booking, bookings.probable
        drift = KnownDrift(service.drift.values, service.drift.covariance)
        service.on_event(event)
        if bookings.booking is not before:
            booked.update(_booked(core, drift, probable, bookings))
    rows = []
    for bucket in work.buckets:
        own = [b for b in booked.values() if bucket.dumps - 0.5 <= b[0] < bucket.digs]
        rows += [(own[-1][1] - bucket.gross, own[-1][2:])] if own else []
    told = np.array([astuple(row[1][0]) for row in rows]) / rated**2
    return Parts(np.array([row[0] for row in rows]) / rated, told, np.array([row[1][1] for row in rows]) / rated**2)


def _booked(
    core: Core, drift: DriftKnowledge, probable: ProbableErrors | None, bookings: Bookings
) -> dict[int, tuple[float, float, Variances, tuple[float, ...]]]:
    """Time [s], mass [kg], variances [kg^2] and those of WAYS of the booking that was made, or became more precise, by
    its number; nothing where there is none."""
    booking, lifted = bookings.booking, bookings.dumped
    if booking is None or lifted is None or probable is None:
        return {}
    tares = core.tares._replace(scale_error=core.tares.reported_scale_error)
    found = core.bookings.variances(lifted, drift, tares, probable.expected)
    return {booking.number: (1e-6 * booking.t_us, booking.mass, found, _ways(core, drift, lifted, probable))}


def _ways(core: Core, drift: DriftKnowledge, lifted: Weighed, probable: ProbableErrors) -> tuple[float, ...]:
    whole, counted = (
        core.bookings.variances(lifted, drift, core.tares, sizes).undetected
        for sizes in (probable.sizes, probable.expected)
    )
    slopes = np.zeros_like(probable.sizes) if lifted.slopes is None else lifted.slopes
    return 0.0, whole, counted, float(((slopes * probable.expected) ** 2).max())


def table(found: Mapping[str, Parts]) -> Table:
    """One row for each machine."""
    shown = Table(title="parts of the weight's standard error (root of the mean square), % of rated payload")
    for column in ("machine", "buckets", "bias", "scatter", *(part.name for part in fields(Variances)), *WAYS):
        shown.add_column(column, justify="left" if column == "machine" else "right")
    for name, each in found.items():
        parted = np.sqrt(each.told.mean(axis=0))
        numbers = (f"{100 * x:.2f}" for x in (each.error.mean(), each.error.std(), *parted))
        ways = (f"{100 * each.width(way):.2f} / {100 * each.share(way):.0f}" for way in WAYS)
        shown.add_row(name, str(len(each.error)), *numbers, *ways)
    return shown
