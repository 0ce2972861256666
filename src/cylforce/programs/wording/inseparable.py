"""One name for causes that no motion separates, and the check by hand that does."""

from collections.abc import Iterable, Sequence

from cylforce.diagnosis.search import NO_GAP, Key
from cylforce.effects.library import Proposal
from cylforce.mechanics.machine import Machine
from cylforce.programs.wording.fault_words import fault


def joint_name(machine: Machine, causes: Sequence[Key]) -> str:
    """Return one name for causes that no motion separates; empty for none."""
    return " or ".join(fault(machine, name, at) for name, at in causes)


def checks_by_hand(causes: Iterable[Key], proposals: Iterable[Proposal]) -> tuple[str, ...]:
    """Return what to check by hand, each check once."""
    about = {(p.name, p.at): p.about for p in proposals}
    return tuple(dict.fromkeys(about[key].confirm for key in causes if key != NO_GAP and key in about))
