"""Published values: one table, from which PDOs, EDS and DBC are made. The node is a CiA 404 measuring device."""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import accumulate, pairwise
from math import lcm, nan, pi, sin, sqrt, tan
from operator import attrgetter
from struct import Struct
from typing import Any, NamedTuple

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.mechanics.installation import Filters
from cylforce.service.contact.lateness import force_delay_s, wait_s
from cylforce.signals.codec import Layout, layout, packed
from cylforce.signals.contact import ContactEvent, EventKind
from cylforce.signals.estimate import Estimate, Quantity
from cylforce.signals.identifiers import RPDOS, TPDOS
from cylforce.signals.layout import Field, Pdo
from cylforce.signals.units import DEGREE

GROSS, NET = "payload_gross", "payload_net"
FORCE_X, FORCE_Z, MAGNITUDE, DIRECTION = "force_x", "force_z", "force_magnitude", "force_direction"
GROSS_ERROR, MAGNITUDE_ERROR = "payload_standard_error", "force_magnitude_standard_error"
X_ERROR, Z_ERROR, DIRECTION_ERROR = (
    "force_x_standard_error",
    "force_z_standard_error",
    "force_direction_standard_error",
)
PAYLOAD_QUALITY, FORCE_QUALITY = "payload_quality", "force_quality"
FORCES = FORCE_X, FORCE_Z, MAGNITUDE, DIRECTION
SOIL = SOIL_X, SOIL_Z, SOIL_MAGNITUDE, SOIL_DIRECTION = "soil_x", "soil_z", "soil_magnitude", "soil_direction"
SOIL_X_ERROR, SOIL_Z_ERROR = "soil_x_standard_error", "soil_z_standard_error"
OF_FORCE = {"force": FORCES, "soil": SOIL}
PARTS = ("x", "z", "magnitude", "direction")
QUALITY = {name: f"{name}_quality" for name in (*FORCES, *SOIL)}
EVENT_COUNT, EVENT_KIND, EVENT_CONFIDENCE = "event_count", "event_kind", "event_confidence"
EVENT_X, EVENT_Z, EVENT_AGE = "event_x", "event_z", "event_age"
BOOKED_COUNT, BOOKED = "booked_count", "booked_payload"

_KG, _N, _DEG = 0.1, 10.0, 0.01 * DEGREE  # resolution of the published integers, in SI
_CM, _MS, _PERCENT = 0.01, 1e-3, 0.01
# PLACES: attribute path of each quantity in an estimate. ERRORS: the quantity of each standard error, and its least
# value: one step of the published integer, so that none is ever sent as zero
PLACES = {name: f"{of}.{part}" for of, whole in OF_FORCE.items() for name, part in zip(whole, PARTS, strict=True)}
PLACES |= {GROSS: "gross", NET: "net"}
OF_QUALITY = {PAYLOAD_QUALITY: "gross"} | {name: PLACES[of] for of, name in QUALITY.items()}
ERRORS = {GROSS_ERROR: (GROSS, _KG), DIRECTION_ERROR: (DIRECTION, _DEG), X_ERROR: (FORCE_X, _N)}
ERRORS |= {Z_ERROR: (FORCE_Z, _N), SOIL_X_ERROR: (SOIL_X, _N), SOIL_Z_ERROR: (SOIL_Z, _N)}
OF_VALUE = {name: f"{place}.value" for name, place in PLACES.items()}
OF_ERROR = {name: f"{PLACES[of]}.standard_error" for name, (of, _) in ERRORS.items()}
_FAR, _OLD = 327.67, 4294967.294  # m and s, the largest that an INTEGER16 and an UNSIGNED32 carry
BASES = *TPDOS, *RPDOS  # of the identifiers of TPDO 1 to 8, to which the node id is added
FAST = (2, 5)  # TPDOs of the forces, which are sent more often than the others
_LARGEST_ERROR = 65534 * _KG  # kg, the largest that an UNSIGNED16 carries; no weight with a larger error is valid


def publication(
    node_id: int,
    period_s: float,
    rated_payload: float,
    rated_force: float,
    force_period_s: float | None = None,
    filters: Filters | None = None,
) -> tuple[Pdo, ...]:
    """Return TPDO 1 to 8 of our node.

    A quality byte is status (bits 0-1) + 4 * reason (bits 2-7).

    node_id:        of our node
    period_s:       of the TPDOs [s]
    rated_payload:  determines the range of weights [kg]
    rated_force:    determines the range of forces [N]
    force_period_s: of the forces' TPDOs, at most `period_s` [s]; None: `period_s`
    filters:        where given, each field's note has its bandwidth and delay
    """
    kg = (-0.5 * rated_payload, 2.0 * rated_payload)
    largest = min(rated_payload, _LARGEST_ERROR)
    table = (
        (Field(GROSS, 0x9130, 1, "i", _KG, 0.0, "kg", *kg), Field(NET, 0x9140, 1, "i", _KG, 0.0, "kg", *kg)),
        _force(FORCES, (2, 3, 5, 4), rated_force),
        (
            Field(GROSS_ERROR, 0x2130, 1, "H", _KG, 0.0, "kg", 0.0, largest),
            Field(X_ERROR, 0x2130, 2, "H", _N, 0.0, "N", 0.0, rated_force),
            Field(Z_ERROR, 0x2130, 3, "H", _N, 0.0, "N", 0.0, rated_force),
            Field(DIRECTION_ERROR, 0x2130, 4, "H", _DEG, 0.0, "rad", 0.0, pi),
        ),
        (
            Field(PAYLOAD_QUALITY, 0x2150, 1, "B", 1.0, 0.0, "1", 0.0, 255.0),
            Field(FORCE_QUALITY, 0x2150, 2, "B", 1.0, 0.0, "1", 0.0, 255.0),
            Field(BOOKED_COUNT, 0x2160, 1, "H", 1.0, 0.0, "1", 0.0, 65534.0),
            Field(BOOKED, 0x2160, 2, "i", _KG, 0.0, "kg", *kg),
        ),
        _force(SOIL, (6, 7, 9, 8), rated_force),
        tuple(Field(QUALITY[n], 0x2150, k, "B", 1.0, 0.0, "1", 0.0, 255.0) for k, n in enumerate(QUALITY, 3)),
        _event(),
        (
            Field(EVENT_AGE, 0x2180, 6, "I", _MS, 0.0, "s", 0.0, _OLD),
            Field(SOIL_X_ERROR, 0x2130, 6, "H", _N, 0.0, "N", 0.0, rated_force),
            Field(SOIL_Z_ERROR, 0x2130, 7, "H", _N, 0.0, "N", 0.0, rated_force),
        ),
    )
    often = period_s if force_period_s is None else min(force_period_s, period_s)
    return tuple(
        _pdo(k, node_id, often if k in FAST else period_s, fields, filters) for k, fields in enumerate(table, 1)
    )


def _pdo(number: int, node_id: int, period_s: float, fields: tuple[Field, ...], filters: Filters | None) -> Pdo:
    if filters is not None:
        fields = tuple(replace(field, note=timing(str(field.signal), filters, period_s)) for field in fields)
    return Pdo(cob_id(number, node_id), node_id, number, False, 0, period_s, fields)


def timing(signal: str, filters: Filters, period_s: float) -> str:
    """Return bandwidth and delay of a published value in words.

    signal:   name of the value
    filters:  of the machine file
    period_s: of the value's TPDO [s]
    """
    if signal in (*FORCES, *SOIL):
        band = bandwidth_hz(filters.force_hz, period_s, 1.0 / filters.rate_hz)
        return f"-3 dB at {band:.3g} Hz, delay {1e3 * force_delay_s(filters, period_s):.0f} ms"
    if signal in (GROSS, NET):
        return "mean over the lift, shown 1.0 s after it began"
    return f"no filter, delay {1e3 * wait_s(filters, period_s):.0f} ms"


def bandwidth_hz(cutoff_hz: float, period_s: float, step_s: float) -> float:
    """Return the -3 dB frequency [Hz] of a second-order Butterworth low-pass and the hold between two publications.

    cutoff_hz: corner of the low-pass [Hz]
    period_s:  time between two publications [s]
    step_s:    fixed step of the low-pass [s]
    """
    low, high = 0.0, cutoff_hz
    for _ in range(40):
        middle = (low + high) / 2.0
        held = sin(pi * middle * period_s) / (pi * middle * period_s)
        gain = held / sqrt(1.0 + (tan(pi * middle * step_s) / tan(pi * cutoff_hz * step_s)) ** 4)
        low, high = (middle, high) if gain > 0.5**0.5 else (low, middle)
    return low


def cob_id(number: int, node_id: int) -> int:
    """Return the identifier of one of our TPDOs. Raises ValueError for a TPDO that has none.

    TPDO 1 to 4 have those of CiA 301. TPDO 5 to 8 use those of RPDOs, of which our node has none."""
    if not 1 <= number <= len(BASES):
        raise ValueError(
            f"TPDO {number} has no identifier, only TPDO 1 to {len(BASES)} have one: map its values into one of those"
        )
    return BASES[number - 1] + node_id


def _force(names: tuple[str, str, str, str], channels: tuple[int, int, int, int], rated: float) -> tuple[Field, ...]:
    """Return the fields x, z, magnitude and direction of a force.

    names:    of the fields
    channels: sub-indices of the fields
    rated:    rated force [N]
    """
    low, unit, scale = (-rated, -rated, 0.0, -pi), ("N", "N", "N", "rad"), (_N, _N, _N, _DEG)
    return tuple(
        Field(names[k], 0x7130, channels[k], "h", scale[k], 0.0, unit[k], low[k], pi if k == 3 else rated)
        for k in range(4)
    )


def _event() -> tuple[Field, ...]:
    """Return the fields of the last event at the teeth."""
    return (
        Field(EVENT_COUNT, 0x2180, 1, "H", 1.0, 0.0, "1", 0.0, 65534.0),
        Field(EVENT_KIND, 0x2180, 2, "B", 1.0, 0.0, "1", 0.0, 254.0),
        Field(EVENT_CONFIDENCE, 0x2180, 3, "B", _PERCENT, 0.0, "1", 0.0, 1.0),
        Field(EVENT_X, 0x2180, 4, "h", _CM, 0.0, "m", -_FAR, _FAR),
        Field(EVENT_Z, 0x2180, 5, "h", _CM, 0.0, "m", -_FAR, _FAR),
    )


def published(estimate: Estimate) -> dict[str, float]:
    """Return the SI values of an estimate by name, NaN where there is none."""
    return {name: value(estimate) for name, value in VALUES.items()}


Value = Callable[[Estimate], float]


def _value(path: str) -> Value:
    return attrgetter(path)


def _error(path: str, least: float) -> Value:
    of = _value(path)
    return lambda estimate: max(of(estimate), least)


def _quality(path: str) -> Value:
    of: Callable[[Estimate], Quantity] = attrgetter(path)
    return lambda estimate: float(quality(of(estimate)))


def _last_event(e: Estimate) -> ContactEvent:
    """Return the last event; before the first one, an event with number and kind 0 and NaN elsewhere."""
    return e.events[-1] if e.events else _NO_EVENT


_NO_EVENT = ContactEvent(0, 0, EventKind.NONE, nan, nan, nan)
VALUES: dict[str, Value] = {
    **{name: _value(path) for name, path in OF_VALUE.items()},
    **{name: _error(path, ERRORS[name][1]) for name, path in OF_ERROR.items()},
    **{name: _quality(path) for name, path in OF_QUALITY.items()},
    FORCE_QUALITY: lambda e: float(max((quality(q) for q in e.force.quantities[:3]), key=lambda byte: byte & 3)),
    BOOKED_COUNT: lambda e: float(e.booking.number % 65535) if e.booking else 0.0,
    BOOKED: lambda e: e.booking.mass if e.booking else nan,
    EVENT_COUNT: lambda e: float(_last_event(e).number % 65535),
    EVENT_KIND: lambda e: float(_last_event(e).kind),
    EVENT_CONFIDENCE: lambda e: _last_event(e).confidence,
    EVENT_X: lambda e: _last_event(e).x,
    EVENT_Z: lambda e: _last_event(e).z,
    EVENT_AGE: lambda e: 1e-6 * (e.t_us - e.events[-1].t_us) if e.events else nan,
}


def quality(q: Quantity) -> int:
    """Return the quality byte: status in bits 0-1, reason in bits 2-7."""
    return q.status | q.reason << 2


def timetable(table: tuple[Pdo, ...], rate_hz: float) -> tuple[tuple[int, ...], ...]:
    """Return the numbers of the TPDOs that are sent at each step, for a cycle of steps.

    At step k the TPDOs of entry k modulo the length of the cycle are sent.

    table:   TPDOs with their periods
    rate_hz: steps per second [Hz]
    """
    every = {pdo.number: max(1, round(pdo.period_s * rate_hz)) for pdo in table}
    return tuple(tuple(n for n, each in every.items() if k % each == 0) for k in range(lcm(*every.values())))


class Encoder(NamedTuple):
    """Encoder of TPDOs that are sent together.

    places:   number of each TPDO, and its place in the data
    layouts:  of the TPDOs
    values:   function that returns the values of all fields of an estimate [SI]
    quantise: the kernel's function that rounds values to integers
    limits:   smallest and largest value, step, and integer for "no value" of each field; empty: `quantise` does not
              support all fields
    room:     zeros of the number of fields
    pack:     function that packs the integers
    """

    places: tuple[tuple[int, slice], ...]
    layouts: tuple[Layout, ...]
    values: Callable[[Estimate], Sequence[float]]
    quantise: Callable[[int, Numbers, Numbers, Counts], None]
    limits: Numbers
    room: Counts
    pack: Callable[..., bytes]

    def data(self, estimate: Estimate) -> list[tuple[int, bytes]]:
        """Return (number, bytes) of each TPDO for an estimate."""
        places, layouts, values, quantise, limits, room, pack = self
        given = values(estimate)
        if not limits:
            parts = iter(given)
            each = [packed(of, [next(parts) for _ in of.fields]) for of in layouts]
            return [(number, data) for (number, _), data in zip(places, each, strict=True)]
        found = room[:]
        quantise(len(found), limits, array("d", given), found)
        whole = pack(*found)
        return [(number, whole[place]) for number, place in places]


def encoder(table: tuple[Pdo, ...]) -> Encoder:
    """Return the encoder of the TPDOs in `table`."""
    layouts = tuple(layout(pdo) for pdo in table)
    fields = [field for of in layouts for field in of.fields]
    known = all(field.fits for field in fields)
    limits = numbers(x for f in fields if known for x in (f.low, f.high, f.scale, f.missing))
    values = _values([str(f.signal) for pdo in table for f in pdo.fields])
    ends = [0, *accumulate(of.struct.size for of in layouts)]
    places = tuple((pdo.number, slice(*cut)) for pdo, cut in zip(table, pairwise(ends), strict=True))
    whole = Struct("<" + "".join(of.struct.format.removeprefix("<") for of in layouts))
    return Encoder(places, layouts, values, choice.chosen().quantise, limits, counts([0] * len(fields)), whole.pack)


class Encoders:
    """Encoders of our TPDOs.

    together: function that returns the cached encoder of PDOs that are sent together, by their numbers
    """

    def __init__(self, pdos: tuple[Pdo, ...]) -> None:
        numbered = {pdo.number: pdo for pdo in pdos}
        self.together = lru_cache(maxsize=64)(lambda wanted: encoder(tuple(numbered[number] for number in wanted)))

    def due(self, estimate: Estimate, numbers: tuple[int, ...]) -> list[tuple[int, bytes]]:
        """Return (number, data) of the PDOs with these numbers; no others are encoded."""
        return self.together(numbers).data(estimate) if numbers else []

    def data(self, estimate: Estimate, number: int) -> bytes:
        """Return the data of one PDO."""
        return next(data for _, data in self.due(estimate, (number,)))


def _values(names: Sequence[str]) -> Callable[[Estimate], Sequence[float]]:
    """Return a function that returns the values of these names; values of one kind are read by one attrgetter."""
    alike = [[name for name in names if name in of] for of in (OF_VALUE, OF_ERROR, OF_QUALITY)]
    if len(alike[0]) == len(names):
        return _look([OF_VALUE[name] for name in names])
    plain, errors, qualities = (
        _look([of[name] for name in some]) for some, of in zip(alike, (OF_VALUE, OF_ERROR, OF_QUALITY), strict=True)
    )
    order = [name for some in alike for name in some]
    others = [name for name in names if name not in order]
    rest, least = [VALUES[name] for name in others], [ERRORS[name][1] for name in alike[1]]
    places = [(order + others).index(name) for name in names]

    def values(estimate: Estimate) -> list[float]:
        found: list[float] = [*plain(estimate), *map(max, errors(estimate), least)]
        found += map(quality, qualities(estimate))
        found += [value(estimate) for value in rest]
        return [found[place] for place in places]

    return values


def _look(paths: Sequence[str]) -> Callable[[Estimate], Sequence[Any]]:
    """Return a function that returns the attributes of an estimate at these paths."""
    if len(paths) > 1:
        return attrgetter(*paths)
    each = [attrgetter(path) for path in paths]
    return lambda estimate: [get(estimate) for get in each]


def frames(table: tuple[Pdo, ...], estimate: Estimate) -> tuple[tuple[int, bytes], ...]:
    """Return (TPDO number, data) of all TPDOs in `table` for an estimate."""
    return tuple(encoder(table).data(estimate))
