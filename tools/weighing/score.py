"""From booked and true weights to figures."""

from collections.abc import Mapping

import numpy as np

from cylforce.signals.estimate import Array

INTERVAL = 1.96  # standard errors to either side of a 95 % interval
CURVE = (1.0, 0.98, 0.95, 0.9, 0.8, 0.5)  # shares of the buckets that are kept, most certain ones first
DIVISIONS = (100, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 3000)


def figures(machines: Mapping[str, Array], rated: float) -> dict[str, object]:
    """All keys, errors as shares of the `rated` payload [kg]."""
    rows = np.concatenate(list(machines.values()))
    gross, error = gross_errors(rows)
    known = np.isfinite(gross)
    left = (rows[:, 6] - (rows[:, 0] - rows[:, 1]))[known]
    size = np.abs(gross[known]) / rated
    return {
        "buckets": len(rows),
        "p95": float(np.percentile(size, 95)),
        "p997": float(np.percentile(size, 99.7)),
        "rms": float(np.sqrt(np.mean(size**2))),
        "bias": float(np.mean(gross[known]) / rated),
        "availability": float(np.mean(known)),
        "class_y_b_n": class_y_b(rows[known, 0], gross[known], rated),
        "coverage": inside(gross, error),
        "coverage_worst": min(inside(*gross_errors(each)) for each in machines.values()),
        "truck_p95": float(np.percentile(np.abs(left), 95) / rated),
        "truck_coverage": inside(left, rows[known, 7]),
        "curve": curve(size, error[known]),
        "machines": {name: one(each, rated) for name, each in machines.items()},
    }


def gross_errors(rows: Array) -> tuple[Array, Array]:
    """Error of the gross weight and the standard error that was told (B,) [kg]."""
    return rows[:, 2] - rows[:, 0], rows[:, 3]


def inside(error: Array, told: Array) -> float:
    """Share of the bookings whose 95 % interval holds the truth."""
    known = np.isfinite(error)
    return float(np.mean(np.abs(error[known]) <= INTERVAL * told[known])) if known.any() else 0.0


def one(rows: Array, rated: float) -> dict[str, float]:
    """A machine's own figures."""
    gross, told = gross_errors(rows)
    known = np.isfinite(gross)
    size = np.abs(gross[known]) / rated
    return {
        "buckets": len(rows),
        "booked": int(known.sum()),
        "p95": float(np.percentile(size, 95)) if known.any() else float("nan"),
        "bias": float(np.mean(gross[known]) / rated) if known.any() else float("nan"),
        "told": float(np.mean(told[known]) / rated) if known.any() else float("nan"),
        "coverage": inside(gross, told),
    }


def class_y_b(load: Array, error: Array, rated: float) -> int:
    """Largest number n of scale divisions d = rated / n for which every error stays within the limits of OIML R 51,
    class Y(b), initial verification: 1 d up to 50 d, 1.5 d up to 200 d, 2 d beyond; 0 where none does."""
    best = 0
    for n in DIVISIONS:
        d = rated / n
        limit = d * np.select([load <= 50 * d, load <= 200 * d], [1.0, 1.5], 2.0)
        best = n if np.all(np.abs(error) <= limit) else best
    return best


def curve(size: Array, told: Array) -> list[dict[str, float]]:
    """The 95th percentile of the errors against the share that is refused, the least certain first."""
    order = np.argsort(told, kind="stable")
    kept = [(share, size[order][: max(int(share * len(size)), 1)]) for share in CURVE]
    return [{"refused": round(1.0 - share, 2), "p95": float(np.percentile(part, 95))} for share, part in kept]
