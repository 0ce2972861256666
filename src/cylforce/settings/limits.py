"""Limits of single values in a machine file: an impossible value is refused, an unusual one gets a warning.

A hard limit (`gt`, `ge`, `lt`, `le`) lies beyond anything that is built, so that only an error of unit or sign crosses
it. The typical range is that of construction machines, from mini excavators of 0.8 t to machines of 100 t and loader
cranes. Where no standard is named, a limit is the rounded extreme of such machines' data sheets.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, get_args

from pydantic import BaseModel, Field, GetJsonSchemaHandler
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from cylforce.settings.error import FaultError, Key, unit_of

HUGE = 1e12  # beyond this nothing is a measurement, and squares overflow


@dataclass(frozen=True, slots=True)
class Typical:
    """The range of a value that machines have, both ends included.

    low: least typical value, in the unit of the key
    high: largest typical value, in the unit of the key
    """

    low: float
    high: float

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: GetJsonSchemaHandler) -> JsonSchemaValue:
        """Add the range as "x-typical": editors ignore it, the table of keys in config/README.md shows it."""
        return {**handler(core), "x-typical": [self.low, self.high]}


Positive = Annotated[float, Field(gt=0, lt=HUGE)]
Number = Annotated[float, Field(gt=-HUGE, lt=HUGE)]

# ISO 3320 has bores from 8 to 500 mm and rods from 4 to 360 mm; machines with an arm begin at bores of about 30 mm
# (excavators of 0.8 t). A value in metres or inches falls below.
Bore = Annotated[float, Field(ge=8, le=600), Typical(25, 400)]
Rod = Annotated[float, Field(ge=4, le=500), Typical(12, 300)]
# Buckets of 0.8 t excavators weigh about 12 kg, booms of 100 t machines about 12 t. A boom in tonnes falls below 1.
Mass = Annotated[float, Field(gt=1, lt=200_000), Typical(8, 30_000)]
# The heaviest lift of a mobile machine with such an arm is below 100 t, the smallest bucket holds about 15 kg.
Payload = Annotated[float, Field(gt=1, lt=200_000), Typical(10, 100_000)]
# From the stick of a micro excavator to one section of a long-reach boom. In millimetres it is far beyond.
Length = Annotated[float, Field(ge=0.05, le=30), Typical(0.1, 20)]
# A coordinate of a pin or centre lies on its link, so it is no longer than that.
Coordinate = Annotated[float, Field(ge=-30, le=30), Typical(-20, 20)]
# Bars of bucket linkages: the longest dipper links of 100 t machines are about 1.5 m.
Bar = Annotated[float, Field(ge=0.02, le=10), Typical(0.05, 3)]
# Half a metre is the barrel of a 0.8 t excavator, 6 m the boom cylinder of a machine of 300 t.
CylinderLength = Annotated[float, Field(ge=0.05, le=20), Typical(0.2, 10)]
# m l^2 of the largest mass and length above is of no use as a limit: `plausibility` compares with the link's own.
Inertia = Annotated[float, Field(gt=0, lt=HUGE)]
# A joint that a cylinder moves turns less than once; its zero may lie anywhere, so angles may be as large as a turn.
Angle = Annotated[float, Field(ge=-360, le=360), Typical(-270, 270)]
# The boom foot lies within the undercarriage's length of the slew axis: 3 m on machines of 100 t.
Offset = Annotated[float, Field(ge=-10, le=10), Typical(-3, 3)]
# On the ground it is 9.764 m/s^2 on a high mountain near the equator to 9.834 at a pole; mines are no deeper than 4 km,
# roads no higher than 6 km.
Gravity = Annotated[float, Field(ge=9.76, le=9.84)]
Latitude = Annotated[float, Field(ge=-90, le=90)]
Height = Annotated[float, Field(ge=-4500, le=9000), Typical(-500, 5500)]
Reach = Annotated[float, Field(gt=0, le=20), Typical(0.1, 6)]
# Return lines of mobile hydraulics stay below 30 bar, hoses of the return line are rated for about 100.
ReturnPressure = Annotated[float, Field(ge=0, le=500), Typical(0, 50)]

# Half-widths. A maker's mass is right to some per cent; 0 says "exact": a recording then corrects nothing.
MassTolerance = Annotated[float, Field(ge=0, le=100), Typical(0.5, 60)]
InertiaTolerance = Annotated[float, Field(ge=0, le=300), Typical(1, 100)]
CentreTolerance = Annotated[float, Field(ge=0, le=5), Typical(0.001, 1)]
LengthTolerance = Annotated[float, Field(ge=0, le=1), Typical(0, 0.1)]
# Honed tubes are of class H8 (120 mm: 0.054 mm); a bore that was guessed from the machine's size is off by 10 mm.
BoreTolerance = Annotated[float, Field(ge=0, le=50), Typical(0, 10)]
# A tape finds a pin to about 3 mm, a pin that is worn out has 2 mm of play.
PinTolerance = Annotated[float, Field(ge=0, le=0.5), Typical(0, 0.05)]

# Above 20 Hz a low-pass lets pump ripple pass, below 0.2 Hz it removes the digging force.
Cutoff = Annotated[float, Field(gt=0, lt=HUGE), Typical(0.2, 30)]
# Cylinders move at up to 0.6 m/s; speeds are measured to about 1 mm/s.
SlowSpeed = Annotated[float, Field(gt=0, le=1), Typical(0.0001, 0.02)]
Milliseconds = Annotated[float, Field(gt=0, le=60_000), Typical(10, 2000)]
# Breakout forces of machines of 100 t are about 600 kN.
Force = Annotated[float, Field(gt=1, lt=HUGE), Typical(1000, 3_000_000)]


def unusual(table: BaseModel, key: Key = ()) -> Iterator[FaultError]:
    """Yield a warning for every value outside its typical range in a table and in all tables within it.

    key: key of the table in the file
    """
    for name, field in type(table).model_fields.items():
        direct = [part for part in field.metadata if isinstance(part, Typical)]
        typical = direct[0] if direct else _typical_within(field.annotation)
        yield from _unusual_value(getattr(table, name), typical, (*key, name))


def _unusual_value(value: object, typical: Typical | None, key: Key) -> Iterator[FaultError]:
    """Yield warnings of a number outside its typical range, or of the numbers in a tuple or table.

    typical: range of a number; None: any; a table has ranges of its own
    key: key of the value in the file
    """
    if isinstance(value, BaseModel):
        yield from unusual(value, key)
    elif isinstance(value, tuple):
        for k, part in enumerate(value):
            yield from _unusual_value(part, typical, (*key, k) if isinstance(part, BaseModel) else key)
    elif typical and isinstance(value, int | float) and not typical.low <= value <= typical.high:
        limits = f"machines have {typical.low:g} to {typical.high:g}"
        yield FaultError(key, f"is {value:g}, {limits}: check the value{unit_of(key)}")


def _typical_within(hint: object) -> Typical | None:
    """Return the typical range in a type hint such as `tuple[Length, Length] | None`; None: there is none."""
    if isinstance(hint, Typical):
        return hint
    return next((typical for part in get_args(hint) if (typical := _typical_within(part))), None)
