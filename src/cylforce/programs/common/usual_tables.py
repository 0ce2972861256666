"""Tables and keys of usual.toml."""

from typing import Annotated

from pydantic import AllowInfNan, BaseModel, ConfigDict, Field

Finite = Annotated[float, AllowInfNan(False)]
Positive = Annotated[float, AllowInfNan(False), Field(gt=0.0)]


class _UsualTable(BaseModel):
    """A table of the file; unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class UsualMade(_UsualTable):
    """Origin of the file."""

    format: int
    date: str
    cylforce: str
    recordings: tuple[str, ...]


class UsualQuantity(_UsualTable):
    """One quantity: mean over machines, and standard deviations, in `unit`."""

    name: str
    unit: str
    mean: Finite
    between_machines: Positive
    between_days: Positive
    within_a_day: Positive


class UsualType(_UsualTable):
    """One type of machine, by the name in its machine file; from so many machines, recordings and minutes. Machines
    that changed are `left_out` from their change on."""

    machine: str
    machines: int
    recordings: int
    minutes: int
    left_out: tuple[str, ...] = ()
    quantities: tuple[UsualQuantity, ...]


class UsualFile(_UsualTable):
    """The whole file."""

    made: UsualMade
    types: tuple[UsualType, ...]
