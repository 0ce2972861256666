"""The published values: one table, from which PDOs, EDS and DBC are made. The node is a measuring device by CiA 404."""

from math import pi

from cylforce.signals.codec import encode
from cylforce.signals.estimate import Estimate, Quantity
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
BOOKED_COUNT, BOOKED = "booked_count", "booked_payload"

_KG, _N, _DEG = 0.1, 10.0, 0.01 * DEGREE  # resolution of the published integers, in SI
_LARGEST_ERROR = 65534 * _KG  # kg, the largest that an UNSIGNED16 carries; a weight that uncertain is no weight


def publication(node_id: int, period_s: float, rated_payload: float, rated_force: float) -> tuple[Pdo, ...]:
    """TPDO 1 to 4 of our node, sent every `period_s` [s]; `rated_payload` [kg] and `rated_force` [N] give the ranges. A
    quality byte is status (bits 0-1) + 4 * reason (bits 2-7)."""
    kg = (-0.5 * rated_payload, 2.0 * rated_payload)
    newton = (-rated_force, rated_force)
    table = (
        (
            Field(GROSS, 0x9130, 1, "i", _KG, 0.0, "kg", *kg),
            Field(NET, 0x9140, 1, "i", _KG, 0.0, "kg", *kg),
        ),
        (
            Field(FORCE_X, 0x7130, 2, "h", _N, 0.0, "N", *newton),
            Field(FORCE_Z, 0x7130, 3, "h", _N, 0.0, "N", *newton),
            Field(MAGNITUDE, 0x7130, 5, "h", _N, 0.0, "N", 0.0, rated_force),
            Field(DIRECTION, 0x7130, 4, "h", _DEG, 0.0, "rad", -pi, pi),
        ),
        (
            Field(GROSS_ERROR, 0x2130, 1, "H", _KG, 0.0, "kg", 0.0, min(rated_payload, _LARGEST_ERROR)),
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
    )
    return tuple(
        Pdo(0x100 * k + 0x80 + node_id, node_id, k, False, 0, period_s, fields) for k, fields in enumerate(table, 1)
    )


def published(estimate: Estimate) -> dict[str, float]:
    """SI values of an estimate by name, NaN where there is none; a standard error is at least one step of its published
    integer, so that it is never sent as zero."""
    force, booking = estimate.force, estimate.booking
    return {
        GROSS: estimate.gross.value,
        NET: estimate.net.value,
        FORCE_X: force.x.value,
        FORCE_Z: force.z.value,
        MAGNITUDE: force.magnitude.value,
        DIRECTION: force.direction.value,
        GROSS_ERROR: max(estimate.gross.standard_error, _KG),
        X_ERROR: max(force.x.standard_error, _N),
        Z_ERROR: max(force.z.standard_error, _N),
        DIRECTION_ERROR: max(force.direction.standard_error, _DEG),
        PAYLOAD_QUALITY: float(quality(estimate.gross)),
        FORCE_QUALITY: float(max((quality(q) for q in force.quantities), key=lambda byte: byte & 3)),
        BOOKED_COUNT: float(booking.number % 65535) if booking else 0.0,
        BOOKED: booking.mass if booking else float("nan"),
    }


def quality(q: Quantity) -> int:
    """The quality byte: status in bits 0-1, reason in bits 2-7."""
    return int(q.status) | int(q.reason) << 2


def frames(table: tuple[Pdo, ...], estimate: Estimate) -> tuple[tuple[int, bytes], ...]:
    """(TPDO number, data) of all TPDOs in `table` for an estimate."""
    values = published(estimate)
    return tuple((pdo.number, encode(pdo, values)) for pdo in table)
