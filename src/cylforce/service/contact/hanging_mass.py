"""The part of a force that a mass in the bucket explains."""

from cylforce.signals.units import STANDARD_GRAVITY

HEAVIEST = 2.0  # times the rated payload: largest mass in the bucket; chosen


def hanging_weight(x: float, z: float, xx: float, xz: float, rated_payload: float) -> float:
    """The weight w [N] downwards, of a mass of 0 to HEAVIEST rated payloads, that explains most of a force x, z [N]:
    it minimises (f + w z)' C^-1 (f + w z), C the covariance of the force, of which xx and xz [N^2] matter."""
    return min(max((xz * x - xx * z) / xx, 0.0), HEAVIEST * rated_payload * STANDARD_GRAVITY)
