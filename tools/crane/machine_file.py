"""The machine file of the HMF 2020-K4 loader crane, as text."""

from string import Template

from cylforce.mechanics.linkages import FourBar
from cylforce.signals.units import DEGREE

from .geometry import Crane, Lump, total

HEAD = Template("""\
# Written by tools/hmf_crane from the crane's own parameters. Not to be passed on.

[machine]
name = "HMF 2020-K4"
rated_payload_kg = 1000

""")
LINK = Template("""\
[[links]]
name = "$name"
length_m = $length
mass_kg = $mass
centre_m = [$x, $z]
inertia_kg_m2 = $inertia
angle_range_deg = [$low, $high]
# The CAD model is lighter than the machine.
tolerance = { mass_percent = 60, centre_m = 0.3, inertia_percent = 100 }

""")
CYLINDER = Template("""\
[[cylinders]]
name = "$name"
bore_mm = $bore
rod_mm = $rod
length_range_m = [$retracted, $extended]
[cylinders.linkage]
kind = "dogbone"
foot = { body = "$inner", at_m = $foot }
inner_pin = { body = "$inner", at_m = $inner_pin }
outer_pin = { body = "$outer", at_m = $outer_pin }
inner_m = $inner_length
outer_m = $outer_length
side = "right"

""")
# Digits fine enough for the bus to carry the recording as it is written: a machine would have coarser ones.
NODES = Template("""\
[[nodes]]
name = "${name}_pressure"
node_id = $pressure_node
profile = 404

[[nodes]]
name = "${name}_length"
node_id = $length_node
profile = 406

[[sensors]]
name = "${name}_head_pressure"
kind = "head_pressure"
at = "$name"
node = "${name}_pressure"
object = "9130h:1"
type = "i32"
scale_bar = 1e-6
range_bar = [-5, 400]
standard_error_bar = 0.05

[[sensors]]
name = "${name}_rod_pressure"
kind = "rod_pressure"
at = "$name"
node = "${name}_pressure"
object = "9130h:2"
type = "i32"
scale_bar = 1e-6
range_bar = [-5, 400]
standard_error_bar = 0.05

[[sensors]]
name = "${name}_length"
kind = "cylinder_length"
at = "$name"
node = "${name}_length"
object = "6004h"
type = "u32"
scale_m = 1e-8
range_m = [$low, $high]
standard_error_m = 1e-4

""")
TAIL = Template("""\
# The empty crane is to be read as it was identified, not as it has been learned to be empty.
[friction]
adapt = false

[filter]
rate_hz = 100
channel_hz = 2
regressor_hz = 2
smoothing_hz = 2
direction_speed_m_s = 0.0005 # the crane moves at a few millimetres per second

[table]
time = { column = "t", scale_s = 1 }
[table.signals]
boom_head_pressure = { column = "MainPaCyl", scale_bar = 1 }
boom_rod_pressure = { column = "MainPbDCV", scale_bar = 1 }
boom_length = { column = "MainPistonPosition", scale_m = 1, offset_m = $boom }
jib_head_pressure = { column = "JibPaCyl", scale_bar = 1 }
jib_rod_pressure = { column = "JibPbCyl", scale_bar = 1 }
jib_length = { column = "JibPistonPosition", scale_m = 1, offset_m = $jib }
""")
NAMES = ("boom", "jib")
SLACK = 0.005  # m: half of the slack of the joints' ranges


def text(found: Crane) -> str:
    """The machine file."""
    links = "".join(link(found, k) for k in (0, 1))
    tool = f"[tool]\npoint_m = {pair(found.tool)}\n\n"
    cylinders = "".join(cylinder(found, k) for k in (0, 1))
    nodes = "".join(sensors(found, k) for k in (0, 1))
    boom, jib = found.retracted
    return HEAD.substitute() + links + tool + cylinders + nodes + TAIL.substitute(boom=number(boom), jib=number(jib))


def link(found: Crane, k: int) -> str:
    """[[links]]"""
    lump: Lump = total(found.lumps[k])
    low, high = found.angles[k]
    return LINK.substitute(
        name=NAMES[k],
        length=number((found.length, abs(found.tool))[k]),
        mass=number(lump.mass),
        x=number(lump.at.real),
        z=number(lump.at.imag),
        inertia=number(lump.inertia),
        low=number(low / DEGREE),
        high=number(high / DEGREE),
    )


def cylinder(found: Crane, k: int) -> str:
    """[[cylinders]]"""
    linkage: FourBar = found.linkages[k]
    bodies = ("chassis", *NAMES)
    return CYLINDER.substitute(
        name=NAMES[k],
        bore=number(found.bores[k]),
        rod=number(found.rods[k]),
        retracted=number(found.retracted[k]),
        extended=number(found.retracted[k] + found.strokes[k]),
        inner=bodies[k],
        outer=bodies[k + 1],
        foot=pair(linkage.foot[1]),
        inner_pin=pair(linkage.rocker_pin[1]),
        outer_pin=pair(linkage.link_pin[1]),
        inner_length=number(linkage.rocker_length),
        outer_length=number(linkage.link_length),
    )


def sensors(found: Crane, k: int) -> str:
    """[[nodes]] and [[sensors]]"""
    low, high = found.retracted[k] - SLACK, found.retracted[k] + found.strokes[k] + SLACK
    return NODES.substitute(name=NAMES[k], pressure_node=33 + k, length_node=17 + k, low=number(low), high=number(high))


def pair(point: complex) -> str:
    """[x, z]"""
    return f"[{number(point.real)}, {number(point.imag)}]"


def number(value: float) -> str:
    """Twelve digits: no measured dimension has more."""
    return f"{value:.12g}"
