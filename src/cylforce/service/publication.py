"""PDOs of our node and their bytes, from the table of published values. The node is a CiA 404 measuring device."""

from array import array
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import accumulate, pairwise
from math import lcm, pi, sin, sqrt, tan
from operator import attrgetter
from struct import Struct
from typing import Any, NamedTuple

from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Counts, Numbers
from cylforce.estimation.residual import MIN_SECONDS
from cylforce.mechanics.installation import Filters
from cylforce.service.contact.lateness import force_delay_s, wait_s
from cylforce.service.published_values import TABLE, Latency, PublishedValue, Rated
from cylforce.signals.codec import Layout, layout, packed
from cylforce.signals.estimate import Estimate
from cylforce.signals.identifiers import RPDOS, TPDOS
from cylforce.signals.layout import Field, Pdo

BASES = *TPDOS, *RPDOS  # of the identifiers of our TPDOs, by their number, to which the node id is added
FAST = (2, 5)  # TPDOs of the forces, which are sent more often than the others
PUBLISHED = {value.name: value for values in TABLE for value in values}


def publication(
    node_id: int,
    period_s: float,
    rated_payload: float,
    rated_force: float,
    force_period_s: float | None = None,
    filters: Filters | None = None,
) -> tuple[Pdo, ...]:
    """Return the layouts of our node's TPDOs: which published value each of their bytes carries, and how often.

    A quality byte is status (bits 0-1) + 4 * reason (bits 2-7).

    node_id:        of our node
    period_s:       of the TPDOs [s]
    rated_payload:  determines the range of weights [kg]
    rated_force:    determines the range of forces [N]
    force_period_s: of the forces' TPDOs, at most `period_s` [s]; None: `period_s`
    filters:        where given, each field's note has its bandwidth and delay
    """
    rated = Rated(payload=rated_payload, force=rated_force)
    often = period_s if force_period_s is None else min(force_period_s, period_s)
    pdos = list[Pdo]()
    for number, values in enumerate(TABLE, 1):
        period = often if number in FAST else period_s
        fields = tuple(
            _field(value, rated, "" if filters is None else timing(value, filters, period)) for value in values
        )
        pdos.append(Pdo(cob_id(number, node_id), node_id, number, False, 0, period, fields))
    return tuple(pdos)


def _field(value: PublishedValue, rated: Rated, note: str) -> Field:
    """Return the field of a PDO that carries a published value: its object, type, resolution and range.

    rated: rated payload [kg] and force [N], which determine the range
    note:  bandwidth and delay of the value, in words
    """
    low, high = value.limits(rated)
    return Field(
        signal=value.name,
        index=value.index,
        sub=value.sub,
        code=value.code,
        scale=value.resolution.size,
        offset=0.0,
        unit=value.resolution.unit,
        low=low,
        high=high,
        note=note,
    )


def timing(value: PublishedValue, filters: Filters, period_s: float) -> str:
    """Return bandwidth and delay of a published value in words.

    value:    of the table
    filters:  of the machine file
    period_s: of the value's TPDO [s]
    """
    if value.latency is Latency.LOW_PASS:
        band = bandwidth_hz(filters.force_hz, period_s, 1.0 / filters.rate_hz)
        return f"-3 dB at {band:.3g} Hz, delay {1e3 * force_delay_s(filters, period_s):.0f} ms"
    if value.latency is Latency.LIFT:
        return f"mean over the lift, shown {MIN_SECONDS} s after it began"
    return f"updated at every step, delay {1e3 * wait_s(filters, period_s):.0f} ms"


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
    """Return the CAN identifier of one of our TPDOs. Raises ValueError for a TPDO that has none.

    number:  of the TPDO, from 1 on
    node_id: of our node

    The first four have those of CiA 301 for TPDOs. The others use those of RPDOs, of which our node has none."""
    if not 1 <= number <= len(BASES):
        raise ValueError(
            f"TPDO {number} has no identifier, only TPDO 1 to {len(BASES)} have one: map its values into one of those"
        )
    return BASES[number - 1] + node_id


def published(estimate: Estimate) -> dict[str, float]:
    """Return the SI values of an estimate by name, NaN where there is none."""
    return dict(zip(PUBLISHED, _READ_ALL(estimate), strict=True))


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
        """Return (number, data) of each TPDO for an estimate: its values rounded to the integers on the bus, as bytes.

        The fields are those of the encoder; `limits` is empty where the kernel cannot round them, so that each TPDO is
        packed by itself."""
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
    """Return the encoder that turns an estimate into the data of the TPDOs in `table`, which are sent together."""
    layouts = tuple(layout(pdo) for pdo in table)
    fields = [field for of in layouts for field in of.fields]
    known = all(field.fits for field in fields)
    limits = numbers(x for f in fields if known for x in (f.low, f.high, f.scale, f.missing))
    values = _reader([PUBLISHED[str(f.signal)] for pdo in table for f in pdo.fields])
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


def _reader(values: Sequence[PublishedValue]) -> Callable[[Estimate], Sequence[float]]:
    """Return a function that reads these published values [SI] from an estimate, in this order.

    One attrgetter reads all attributes, because that is faster than one for each. Attributes that are no plain numbers
    are converted after that."""
    read = _attributes([value.path for value in values])
    conversions = [(place, value.convert) for place, value in enumerate(values) if value.convert is not None]
    if not conversions:
        return read

    def converted(estimate: Estimate) -> list[float]:
        """Return the values [SI] in the order of `values`; an attribute that is no plain number is converted."""
        found = list(read(estimate))
        for place, convert in conversions:
            found[place] = convert(found[place])
        return found

    return converted


def _attributes(paths: Sequence[str]) -> Callable[[Estimate], Sequence[Any]]:
    """Return a function that reads the attributes at these dotted paths, such as "force.x.value", from an estimate.

    It returns a sequence for a single path, too."""
    if len(paths) > 1:
        return attrgetter(*paths)
    each = [attrgetter(path) for path in paths]
    return lambda estimate: [get(estimate) for get in each]


_READ_ALL = _reader(tuple(PUBLISHED.values()))


def frames(table: tuple[Pdo, ...], estimate: Estimate) -> tuple[tuple[int, bytes], ...]:
    """Return (TPDO number, data) of all TPDOs in `table` for an estimate."""
    return tuple(encoder(table).data(estimate))
