"""Is this the tool that was chosen? An empty machine with another tool seems to carry a load that never leaves it, or
one lighter than nothing.

A weight from which the load rises is that of the empty tool, unless a part of a load was put back: of two settled
weights the lower one, when it is the first one or was reached from above. It clears itself when the tool is seen empty.
While it is off zero, nothing is booked, for the bucket is never seen empty."""

from typing import NamedTuple


class ToolCheck(NamedTuple):
    """State: the last settled `mass` [kg] (None: none yet), whether it is the lowest since the last rise, and by how
    much the empty tool is `off` zero [kg] (None: it is not, or not known)."""

    mass: float | None = None
    lowest: bool = True
    off: float | None = None


NOT_CHECKED = ToolCheck()


def checked(check: ToolCheck, mass: float, limit: float, *, empty: bool, impossible: bool) -> ToolCheck:
    """The state after one more settled weight: `mass` [kg]; `limit` [kg] from which on a difference counts; whether it
    is that of an `empty` tool, or of no load that can hang (lighter than nothing, or moments without a mass)."""
    before = check.mass
    if empty:
        return ToolCheck(mass)
    if impossible:
        return ToolCheck(mass, True, mass)
    if before is None or mass < before - limit:
        return check._replace(mass=mass, lowest=True)
    if mass <= before + limit:
        return check
    return ToolCheck(mass, False, before if check.lowest and before > limit else check.off)
