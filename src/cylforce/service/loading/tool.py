"""Is this the tool that was chosen? An empty machine with another tool seems to carry a load that never leaves it, or
one lighter than nothing.

A weight from which the load rises may be that of an empty tool off zero. It is suspected at the first rise when the
tool has not been seen empty since the start: the bucket may also have held a load. A second rise is that of a load
that grows, so that the suspicion ends. A tool that returns to the weight from which its load rose is off zero: loads
differ, the tool does not. The check clears itself when the tool is seen empty. While it is off zero, nothing is booked,
for the bucket is never seen empty."""

from typing import NamedTuple


class ToolCheck(NamedTuple):
    """State of the check.

    mass:       last settled weight [kg], None: none yet
    off:        by how much the empty tool is off zero [kg], None: it is not, or not known
    base:       lowest weight from which the load has risen since the tool was seen empty [kg], None: none
    seen_empty: whether the tool has been seen empty since the start
    confirmed:  whether the tool has returned to `base`, or had a weight that no load has
    """

    mass: float | None = None
    off: float | None = None
    base: float | None = None
    seen_empty: bool = False
    confirmed: bool = False


NOT_CHECKED = ToolCheck()


def checked(check: ToolCheck, mass: float, limit: float, *, empty: bool, impossible: bool) -> ToolCheck:
    """Return the state after one more settled weight.

    mass:       the weight [kg]
    limit:      difference from which on two weights differ [kg]
    empty:      whether it is that of an empty tool
    impossible: whether no load can have it: lighter than nothing, or moments without a mass
    """
    before = check.mass
    if empty:
        return ToolCheck(mass, seen_empty=True)
    if impossible:
        return ToolCheck(mass, off=mass, base=mass, seen_empty=check.seen_empty, confirmed=True)
    if before is None:
        return check._replace(mass=mass)
    if mass < before - limit:
        again = check.base is not None and abs(mass - check.base) <= limit
        return check._replace(mass=mass, confirmed=check.confirmed or again)
    if mass <= before + limit:
        return check
    return _risen(check, before, limit)._replace(mass=mass)


def _risen(check: ToolCheck, before: float, limit: float) -> ToolCheck:
    """Return the state after the load has risen from the weight `before` [kg]."""
    if check.confirmed:
        return check._replace(off=check.base)
    if before <= limit:
        return check
    if check.base is None:
        return check._replace(off=None if check.seen_empty else before, base=before)
    return check._replace(off=None, base=min(check.base, before))
