"""The service over work in order, with its state every few seconds: where scenarios begin."""

from typing import NamedTuple

import numpy as np

from cylforce.service.service import WeighingService

from .runs import Course, followed
from .works import Case, events

EVERY_S = 5.0


class Order(NamedTuple):
    """What is said in order, and the service as it was at the beginning of each of its parts of EVERY_S."""

    course: Course
    states: list[WeighingService]

    def before(self, begin: float) -> tuple[WeighingService, int]:
        """The last one before a time [s] after the start, and how many parts are before it."""
        k = min(int(begin / EVERY_S), len(self.states) - 1)
        return self.states[k], k


def in_order(case: Case) -> Order:
    """The service over a case without a fault."""
    size, rows = round(EVERY_S * case.rate_hz), len(case.table.values)
    service, states, parts = WeighingService.start(case.core), list[WeighingService](), list[Course]()
    for first in range(0, rows, size):
        states.append(service)
        part = followed(case.core, events(case, case.table.values, slice(first, min(first + size, rows))), service)
        service = part.service
        parts.append(part)
    return Order(_joined(parts), states)


def _joined(parts: list[Course]) -> Course:
    times, values, errors, ok = (np.concatenate([part[k] for part in parts]) for k in range(4))
    bookings = {b.number: b for part in parts for b in part.bookings}
    said = [entry for part in parts for entry in part.suspicions]
    return Course(times, values, errors, ok, said, list(bookings.values()), parts[-1].service)
