"""Intervals of shares."""

from math import sqrt

NORMAL = 1.96  # standard deviations, of which 95 % of a normal distribution is within


def wilson(hits: int, cases: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share; 0 to 1 of nothing (Wilson 1927)."""
    if not cases:
        return 0.0, 1.0
    share, squared = hits / cases, NORMAL**2 / cases
    middle = share + squared / 2.0
    half = NORMAL * sqrt(share * (1.0 - share) / cases + squared / (4.0 * cases))
    return max(0.0, (middle - half) / (1.0 + squared)), min(1.0, (middle + half) / (1.0 + squared))
