"""Simple scales on the same recordings. When the bucket hangs freely they take from the truth, which no scale knows."""

from collections.abc import Callable

import numpy as np

from cylforce.commissioning.identification import identify
from cylforce.estimation.model import Model
from cylforce.programs.common.readings import recorded_segments
from cylforce.settings.machine_file import Loaded, load
from cylforce.signals.estimate import Array

from .bucket import Work

SETTLED_S = 1.0  # after the bucket is free or empty, before the scale looks
PARABOLA = 2


def quasi_static(work: Work) -> Array:
    """Two or three torques at rest: gravity and dry friction identified, accelerations and slewing taken for zero; the
    mean over the lift. Columns as `trial.weighed`."""
    loaded = load(work.folder / "machine.toml")
    service = loaded.service
    segments = [s for name in work.empty for s in _samples(work, loaded, name)]
    found = identify(Model(service.machine, service.filters, ("coulomb",)), segments, refuse=False)
    model, tares = found.model, found.tares
    (values,) = _samples(work, loaded, work.work)
    moving = model.channels.run(values).motion
    still = moving._replace(qd=np.zeros_like(moving.qd), slew=np.zeros_like(moving.slew))
    rows = model.filtered.run(still)
    columns = rows.columns[..., : len(model.parameters)]
    left = rows.torque - columns @ tares.values
    load_columns = (columns @ model.load)[..., :3]
    rate = service.filters.rate_hz
    return _table(work, lambda a, b: _mass(load_columns, left, tares.row_error, slice(int(a * rate), int(b * rate))))


def _mass(columns: Array, left: Array, error: Array, span: slice) -> float:
    rows = (columns[span] / error[:, None]).reshape(-1, 3)
    return float(np.linalg.lstsq(rows, (left[span] / error).ravel(), rcond=None)[0][0])


def parabola(work: Work) -> Array:
    """A loader's scale: the torque of the first joint as a parabola of its angle, once of the empty machine and once of
    a known load, and between both in proportion. The known load is the recording's own first bucket."""
    loaded = load(work.folder / "machine.toml")
    model = Model(loaded.service.machine, loaded.service.filters, ("coulomb",))
    (values,) = _samples(work, loaded, work.work)
    rate = loaded.service.filters.rate_hz
    moving = model.channels.run(values).motion
    torque = model.filtered.run(moving).torque[:, 0]
    angle = moving.q[:, 0]
    first = work.buckets[0]

    def fitted(a: float, b: float) -> Array:
        span = slice(int(a * rate), int(b * rate))
        return np.polyfit(angle[span], torque[span], PARABOLA)

    empty = fitted(first.empty + SETTLED_S, min(first.digs, first.empty + 4.0))
    full = fitted(first.free + SETTLED_S, first.dumps)

    def mass(a: float, b: float) -> float:
        span = slice(int(a * rate), int(b * rate))
        low, high = np.polyval(empty, angle[span]), np.polyval(full, angle[span])
        return float(first.gross * np.median((torque[span] - low) / (high - low)))

    return _table(work, mass)


def _table(work: Work, mass: Callable[[float, float], float]) -> Array:
    """Weights of all lifts and returns; no standard errors."""
    rows = []
    for b in work.buckets:
        gross = mass(b.free + SETTLED_S, b.dumps)
        back = mass(b.empty + SETTLED_S, min(b.digs - 1.0, b.empty + 4.0))
        rows.append((b.gross, b.carry_back, gross, 0.0, back, 0.0, gross - back, 0.0))
    return np.array(rows)


def _samples(work: Work, loaded: Loaded, name: str) -> list[Array]:
    return list(recorded_segments(loaded, work.folder / f"{name}.parquet"))
