"""One machine identified and its work weighed by the service: what was booked beside what is true."""

from typing import NamedTuple

import numpy as np

from cylforce.commissioning.identification import identify
from cylforce.estimation.model import Model, Tares
from cylforce.programs.common.readings import calibrated, recorded_segments
from cylforce.programs.replay import replay_through
from cylforce.service.core import Core
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array, Booking

from .bucket import Work

NOTHING = (float("nan"),) * 6


class Variant(NamedTuple):
    """The service as it is, or without some of its parts: friction laws, adaptation."""

    without: tuple[str, ...] = ()
    adapt: bool = True


WHOLE = Variant()


def weighed(work: Work, variant: Variant = WHOLE) -> Array:
    """(B, 8) of every bucket: true gross and carry-back; booked gross, carry-back and what left, each with its standard
    error [kg]; NaN where nothing was booked."""
    loaded = load(work.folder / "machine.toml")
    core = Core(loaded.service._replace(adapt=variant.adapt), tares(work, loaded, variant))
    recording = work.folder / f"{work.work}.parquet"
    booked = replay_through(core, loaded, recording, lambda _: None).bookings
    rows = []
    for bucket in work.buckets:
        own = [b for b in booked if bucket.dumps - 0.5 <= b.t_us * 1e-6 < bucket.digs]
        rows.append((bucket.gross, bucket.carry_back, *(_said(own[-1]) if own else NOTHING)))
    return np.array(rows)


def tares(work: Work, loaded: Loaded, variant: Variant) -> Tares:
    """Identified from the empty machine, with the known lift where there is one."""
    service = loaded.service
    laws = tuple(law for law in service.effects if law not in variant.without)
    segments = [s for name in work.empty for s in recorded_segments(loaded, work.folder / f"{name}.parquet")]
    found = identify(Model(service.machine, service.filters, laws), segments, refuse=False)
    if work.lift is None:
        return found.tares
    return calibrated(loaded, found, work.folder / f"{work.lift[0]}.parquet", work.lift[1]).tares


def _said(b: Booking) -> tuple[float, ...]:
    return (b.mass, b.standard_error, b.carry_back, b.carry_back_error, b.dumped, b.dumped_error)
