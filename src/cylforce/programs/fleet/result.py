"""What a run of `cylforce fleet` found."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cylforce.fleet.changes import MachineChange
from cylforce.programs.fleet.analysis import Analysis
from cylforce.programs.fleet.gathering import Gathered


class FleetChange(NamedTuple):
    """A change of a machine, with its dates and in words."""

    machine: str
    altered: MachineChange
    date: str
    before: str
    words: str


class FleetResult(NamedTuple):
    """All that came out; `rows`: the table; `notes`: sentences about the whole."""

    gathered: Sequence[Gathered]
    analysis: Analysis
    changes: tuple[FleetChange, ...]
    rows: Sequence[Mapping[str, Any]]
    notes: tuple[str, ...]
