"""Part of a force that a mass in the bucket explains."""

from cylforce.signals.units import STANDARD_GRAVITY

HEAVIEST = 2.0  # times the rated payload: largest mass in the bucket; chosen


def hanging_weight(x: float, z: float, xx: float, xz: float, rated_payload: float) -> float:
    """Return the weight w [N] downwards, of a mass of 0 to HEAVIEST rated payloads, that explains most of a force.

    w minimises (f + w e)' C^-1 (f + w e), with e the unit vector upwards.

    x, z:          the force f, forwards and upwards [N]
    xx, xz:        elements of its covariance C [N^2]
    rated_payload: [kg]
    """
    return min(max((xz * x - xx * z) / xx, 0.0), HEAVIEST * rated_payload * STANDARD_GRAVITY)
