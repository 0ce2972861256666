"""Published values: one declaration each. PDOs, EDS, DBC, encoders and the columns of `replay -o` are made from them.

To add a value, add a `PublishedValue` to a TPDO of `TABLE` with bytes to spare (8 are the most), and its row to the
table in README.md. Its object needs a name in `canopen.dictionary.object_dictionary` if its index is a new one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, auto
from math import nan, pi
from typing import Any, NamedTuple

from cylforce.signals.contact import ContactEvent
from cylforce.signals.estimate import Booking, Quantity
from cylforce.signals.units import DEGREE

# Names that other files use
GROSS, NET, GROSS_ERROR, PAYLOAD_QUALITY = "payload_gross", "payload_net", "payload_standard_error", "payload_quality"
FORCES = FORCE_X, FORCE_Z, MAGNITUDE, DIRECTION = "force_x", "force_z", "force_magnitude", "force_direction"
SOIL = SOIL_X, SOIL_Z, SOIL_MAGNITUDE, SOIL_DIRECTION = "soil_x", "soil_z", "soil_magnitude", "soil_direction"
X_ERROR, Z_ERROR = "force_x_standard_error", "force_z_standard_error"
SOIL_X_ERROR, SOIL_Z_ERROR = "soil_x_standard_error", "soil_z_standard_error"
FORCE_QUALITY, EVENT_KIND = "force_quality", "event_kind"
QUALITY = {name: f"{name}_quality" for name in (*FORCES, *SOIL)}  # name of each force's own quality

INT8, INT16, INT32 = "b", "h", "i"  # `struct` codes
UINT8, UINT16, UINT32 = "B", "H", "I"


class Resolution(NamedTuple):
    """Resolution of a published integer.

    size: value of one step [SI]
    unit: SI unit
    """

    size: float
    unit: str


KG, N, ANGLE = Resolution(0.1, "kg"), Resolution(10.0, "N"), Resolution(0.01 * DEGREE, "rad")
CM, MS, PERCENT, COUNT = Resolution(0.01, "m"), Resolution(1e-3, "s"), Resolution(0.01, "1"), Resolution(1.0, "1")


class Rated(NamedTuple):
    """Rated values of a machine, which determine the ranges of published values.

    payload: [kg]
    force:   [N]
    """

    payload: float
    force: float


Range = Callable[[Rated], tuple[float, float]]  # the range outside which "no value" is published [SI]
LARGEST_U16 = 65534  # the largest number that an UNSIGNED16 carries: 65535 means "no value"


def fixed(low: float, high: float) -> Range:
    """Return a range that is the same for every machine."""
    return lambda _rated: (low, high)


def weight(rated: Rated) -> tuple[float, float]:
    """Return the range of a weight [kg]."""
    return -0.5 * rated.payload, 2.0 * rated.payload


def weight_error(rated: Rated) -> tuple[float, float]:
    """Return the range of a weight's standard error [kg]: at most what an UNSIGNED16 carries."""
    return 0.0, min(rated.payload, LARGEST_U16 * KG.size)


def component(rated: Rated) -> tuple[float, float]:
    """Return the range of a force's component [N]."""
    return -rated.force, rated.force


def size(rated: Rated) -> tuple[float, float]:
    """Return the range of a force's magnitude or standard error [N]."""
    return 0.0, rated.force


BYTE = fixed(0.0, 255.0)
KIND = fixed(0.0, 254.0)
NUMBER = fixed(0.0, LARGEST_U16)
DISTANCE = fixed(-327.67, 327.67)  # m, what an INTEGER16 of 1 cm carries
AGE = fixed(0.0, 4294967.294)  # s, what an UNSIGNED32 of 1 ms carries


class Latency(Enum):
    """What delays a published value after the physical event.

    LOW_PASS: the low-pass of the forces
    LIFT:     the mean over the lift
    STEP:     only the wait for the next step and for the PDO
    """

    LOW_PASS = auto()
    LIFT = auto()
    STEP = auto()


@dataclass(frozen=True, slots=True)
class PublishedValue:
    """A published value.

    name:       name in the DBC, the object dictionary and tables
    index, sub: address of its object
    code:       `struct` code of its type
    resolution: of the published integer
    limits:     function that returns, of a machine's rated values, the range outside which "no value" is sent [SI]
    path:       dotted path of the attribute of an estimate that it is read from
    convert:    function that returns the value [SI] from that attribute; None: the attribute is the value
    latency:    what delays it after the physical event
    """

    name: str
    index: int
    sub: int
    code: str
    resolution: Resolution
    limits: Range
    path: str
    convert: Callable[[Any], float] | None = None
    latency: Latency = Latency.STEP


def quality(q: Quantity) -> int:
    """Return the quality byte: status in bits 0-1, reason in bits 2-7."""
    return q.status | q.reason << 2


def quality_byte(q: Quantity) -> float:
    """Return the quality byte as a published value."""
    return float(quality(q))


def worst_quality(quantities: tuple[Quantity, ...]) -> float:
    """Return the quality byte with the worst status among x, z and magnitude of a force.

    The larger of two statuses is the worse; of equal ones the first quantity's byte, with its reason, is returned.
    Without contact there is no direction, so that its quality does not count.

    quantities: of a force: x, z, magnitude, direction
    """
    return float(max(map(quality, quantities[:3]), key=lambda byte: byte & 3))


def at_least(step: Resolution) -> Callable[[float], float]:
    """Return a function that raises a standard error to one step, so that none is published as zero."""
    return lambda error: max(error, step.size)


def booked_count(booking: Booking | None) -> float:
    """Return the number of bookings, from 0 again after the largest UNSIGNED16."""
    return float(booking.number % (LARGEST_U16 + 1)) if booking else 0.0


def booked_payload(booking: Booking | None) -> float:
    """Return the weight booked last [kg]; NaN before the first one."""
    return booking.mass if booking else nan


def event_count(event: ContactEvent) -> float:
    """Return the number of events, from 0 again after the largest UNSIGNED16."""
    return float(event.number % (LARGEST_U16 + 1))


# The values of each TPDO, from TPDO 1 on, in the order of their bytes
TABLE: tuple[tuple[PublishedValue, ...], ...] = (
    (
        PublishedValue(GROSS, 0x9130, 1, INT32, KG, weight, "gross.value", latency=Latency.LIFT),
        PublishedValue(NET, 0x9140, 1, INT32, KG, weight, "net.value", latency=Latency.LIFT),
    ),
    (
        PublishedValue(FORCE_X, 0x7130, 2, INT16, N, component, "force.x.value", latency=Latency.LOW_PASS),
        PublishedValue(FORCE_Z, 0x7130, 3, INT16, N, component, "force.z.value", latency=Latency.LOW_PASS),
        PublishedValue(MAGNITUDE, 0x7130, 5, INT16, N, size, "force.magnitude.value", latency=Latency.LOW_PASS),
        PublishedValue(
            DIRECTION, 0x7130, 4, INT16, ANGLE, fixed(-pi, pi), "force.direction.value", latency=Latency.LOW_PASS
        ),
    ),
    (
        PublishedValue(GROSS_ERROR, 0x2130, 1, UINT16, KG, weight_error, "gross.standard_error", at_least(KG)),
        PublishedValue(X_ERROR, 0x2130, 2, UINT16, N, size, "force.x.standard_error", at_least(N)),
        PublishedValue(Z_ERROR, 0x2130, 3, UINT16, N, size, "force.z.standard_error", at_least(N)),
        PublishedValue(
            "force_direction_standard_error",
            0x2130,
            4,
            UINT16,
            ANGLE,
            fixed(0.0, pi),
            "force.direction.standard_error",
            at_least(ANGLE),
        ),
    ),
    (
        PublishedValue(PAYLOAD_QUALITY, 0x2150, 1, UINT8, COUNT, BYTE, "gross", quality_byte),
        PublishedValue(FORCE_QUALITY, 0x2150, 2, UINT8, COUNT, BYTE, "force.quantities", worst_quality),
        PublishedValue("booked_count", 0x2160, 1, UINT16, COUNT, NUMBER, "booking", booked_count),
        PublishedValue("booked_payload", 0x2160, 2, INT32, KG, weight, "booking", booked_payload),
    ),
    (
        PublishedValue(SOIL_X, 0x7130, 6, INT16, N, component, "soil.x.value", latency=Latency.LOW_PASS),
        PublishedValue(SOIL_Z, 0x7130, 7, INT16, N, component, "soil.z.value", latency=Latency.LOW_PASS),
        PublishedValue(SOIL_MAGNITUDE, 0x7130, 9, INT16, N, size, "soil.magnitude.value", latency=Latency.LOW_PASS),
        PublishedValue(
            SOIL_DIRECTION, 0x7130, 8, INT16, ANGLE, fixed(-pi, pi), "soil.direction.value", latency=Latency.LOW_PASS
        ),
    ),
    (
        PublishedValue(QUALITY[FORCE_X], 0x2150, 3, UINT8, COUNT, BYTE, "force.x", quality_byte),
        PublishedValue(QUALITY[FORCE_Z], 0x2150, 4, UINT8, COUNT, BYTE, "force.z", quality_byte),
        PublishedValue(QUALITY[MAGNITUDE], 0x2150, 5, UINT8, COUNT, BYTE, "force.magnitude", quality_byte),
        PublishedValue(QUALITY[DIRECTION], 0x2150, 6, UINT8, COUNT, BYTE, "force.direction", quality_byte),
        PublishedValue(QUALITY[SOIL_X], 0x2150, 7, UINT8, COUNT, BYTE, "soil.x", quality_byte),
        PublishedValue(QUALITY[SOIL_Z], 0x2150, 8, UINT8, COUNT, BYTE, "soil.z", quality_byte),
        PublishedValue(QUALITY[SOIL_MAGNITUDE], 0x2150, 9, UINT8, COUNT, BYTE, "soil.magnitude", quality_byte),
        PublishedValue(QUALITY[SOIL_DIRECTION], 0x2150, 10, UINT8, COUNT, BYTE, "soil.direction", quality_byte),
    ),
    (
        PublishedValue("event_count", 0x2180, 1, UINT16, COUNT, NUMBER, "last_event", event_count),
        PublishedValue(EVENT_KIND, 0x2180, 2, UINT8, COUNT, KIND, "last_event.kind", float),
        PublishedValue("event_confidence", 0x2180, 3, UINT8, PERCENT, fixed(0.0, 1.0), "last_event.confidence"),
        PublishedValue("event_x", 0x2180, 4, INT16, CM, DISTANCE, "last_event.x"),
        PublishedValue("event_z", 0x2180, 5, INT16, CM, DISTANCE, "last_event.z"),
    ),
    (
        PublishedValue("event_age", 0x2180, 6, UINT32, MS, AGE, "event_age_s"),
        PublishedValue(SOIL_X_ERROR, 0x2130, 6, UINT16, N, size, "soil.x.standard_error", at_least(N)),
        PublishedValue(SOIL_Z_ERROR, 0x2130, 7, UINT16, N, size, "soil.z.standard_error", at_least(N)),
    ),
)
