"""The data sheet as a machine file: all that an estimator may see of a machine."""

from dataclasses import replace

from .datasheet import EXCAVATOR, JOINTS, Cylinder, Link, Point, Sheet, Tolerances
from .sensors import ANGLES, DEGREE

NODES = {
    **{f"{joint}_pressure": 33 + k for k, joint in enumerate(JOINTS)},
    **{f"{joint}_angle": 17 + k for k, joint in enumerate(JOINTS)},
    "chassis_tilt": 48,
    "slew_gyro": 49,
}
PROFILE = {"pressure": 404, "angle": 406, "tilt": 410, "gyro": 404, "imu": 0}
BAR = 1e5
# Fields of each node's TPDO1: signal, value of a digit and of zero in SI, bytes, signed
Field = tuple[str, float, float, int, bool]
PDOS: dict[str, tuple[Field, ...]] = {
    **{
        f"{joint}_pressure": tuple((f"{joint}_{side}_pressure", 0.02 * BAR, 0.0, 2, True) for side in ("head", "rod"))
        for joint in JOINTS
    },
    **{name: ((name, 0.01 * DEGREE, -180.0 * DEGREE, 4, False),) for name in ANGLES},
    "chassis_tilt": tuple((name, 0.01 * DEGREE, 0.0, 2, True) for name in ("pitch", "roll")),
    "slew_gyro": (("slew_rate", 0.01 * DEGREE, 0.0, 2, True),),
}
STATED_MASS, STATED_CENTRE, STATED_INERTIA = 10, 0.1, 25  # a little wider than what machines have


def machine_file(name: str, sheet: Sheet = EXCAVATOR) -> str:
    """A machine file (TOML) with the sheet's nominal values and tolerances."""
    parts = [_head(name, sheet)]
    parts += [link_table(joint, sheet.links[joint], sheet.tolerances) for joint in JOINTS]
    parts.append(f"[tool]\npoint_m = {xz(sheet.tool)}\n")
    parts += [_cylinder(joint, sheet.cylinders[joint], sheet) for joint in JOINTS]
    parts += [node_table(node, number) for node, number in NODES.items()]
    parts += [pressure_table(joint, side, k) for joint in JOINTS for k, side in enumerate(("head", "rod"), 1)]
    parts += [angle_table(joint, sheet.links[joint]) for joint in JOINTS]
    parts += [tilt_table("pitch", "6010h"), tilt_table("roll", "6020h"), SLEW, PUBLICATION]
    return "\n".join(parts)


TWO_LINKS = ("stick", "bucket")
BOOM_TILT = 48
TWO_LINK_SIGNALS = (
    *(f"{joint}_{side}_pressure" for joint in TWO_LINKS for side in ("head", "rod")),
    *(f"{joint}_angle" for joint in TWO_LINKS),
    *("pitch", "roll"),
)


def two_link_file(name: str, sheet: Sheet = EXCAVATOR) -> str:
    """A machine file of stick and bucket alone: the boom is the chassis, its frame's origin the stick pin, and the tilt
    sensor sits on it."""
    nodes = {f"{joint}_{kind}": NODES[f"{joint}_{kind}"] for kind in ("pressure", "angle") for joint in TWO_LINKS}
    on_boom = sheet.cylinders["stick"]
    x, z = on_boom.foot[0] - sheet.links["boom"].length, on_boom.foot[1]
    parts = [_head(name, sheet)]
    parts += [link_table(joint, sheet.links[joint], sheet.tolerances) for joint in TWO_LINKS]
    parts.append(f"[tool]\npoint_m = {xz(sheet.tool)}\n")
    parts.append(_cylinder("stick", replace(on_boom, foot=(x, z)), sheet, "chassis"))
    parts.append(_cylinder("bucket", sheet.cylinders["bucket"], sheet))
    parts += [node_table(node, number) for node, number in (nodes | {"boom_tilt": BOOM_TILT}).items()]
    parts += [pressure_table(joint, side, k) for joint in TWO_LINKS for k, side in enumerate(("head", "rod"), 1)]
    parts += [angle_table(joint, sheet.links[joint]) for joint in TWO_LINKS]
    parts += [
        tilt_table("pitch", "6010h", "boom_tilt", 75),
        tilt_table("roll", "6020h", "boom_tilt"),
        "[health]\nmax_tilt_deg = 70\n",
    ]
    return "\n".join([*parts, PUBLICATION])


def xz(point: Point) -> str:
    """A point's two numbers."""
    return f"[{point[0]:g}, {point[1]:g}]"


def _head(name: str, sheet: Sheet) -> str:
    return (
        "# Data sheet of a machine that tools/reference_machine has simulated: nominal values and tolerances.\n"
        "# Pressure transmitters of class 0.5 % of 400 bar, angles to 0.05 degrees.\n\n"
        f'[machine]\nname = "{name}"\nrated_payload_kg = {sheet.rated_payload:g}\n'
        f"payload_reach_m = {sheet.payload_reach:g}\nslew_axis_m = {sheet.slew_axis:g}\n"
    )


def link_table(joint: str, link: Link, tolerances: Tolerances) -> str:
    """A link's table; the bucket has no length."""
    length = "" if joint == "bucket" else f"length_m = {link.length:g}\n"
    near = f"mass_percent = {STATED_MASS}, centre_m = {STATED_CENTRE}, inertia_percent = {STATED_INERTIA}"
    if length:
        near += f", length_m = {tolerances.length:g}"
    return (
        f'[[links]]\nname = "{joint}"\n{length}mass_kg = {link.mass:g}\ncentre_m = {xz(link.centre)}\n'
        f"inertia_kg_m2 = {link.inertia:g}\nangle_range_deg = {list(link.range_deg)}\ntolerance = {{ {near} }}\n"
    )


def _cylinder(joint: str, cylinder: Cylinder, sheet: Sheet, inner: str = "") -> str:
    head = cylinder_head(joint, cylinder, sheet.tolerances)
    if joint == "bucket":
        bars = sheet.bars
        return head + (
            f'kind = "four_bar"\nfoot = {{ body = "stick", at_m = {xz(cylinder.foot)} }}\n'
            f'rocker_pin = {{ body = "stick", at_m = {xz(bars.rocker_pin)} }}\n'
            f'link_pin = {{ body = "bucket", at_m = {xz(bars.link_pin)} }}\n'
            f'rocker_m = {bars.rocker:g}\nlink_m = {bars.link:g}\nside = "left"\n'
        )
    inner = inner or {"boom": "chassis", "stick": "boom"}[joint]
    return head + (
        f'kind = "triangle"\nfoot = {{ body = "{inner}", at_m = {xz(cylinder.foot)} }}\n'
        f'eye = {{ body = "{joint}", at_m = {xz(cylinder.eye)} }}\n'
    )


def cylinder_head(name: str, cylinder: Cylinder, tolerances: Tolerances) -> str:
    """A cylinder's table up to its linkage."""
    near = f"bore_mm = {tolerances.bore * 1e3:g}, pins_m = {tolerances.pins:g}"
    return (
        f'[[cylinders]]\nname = "{name}"\ncount = {cylinder.count}\nbore_mm = {cylinder.bore * 1e3:g}\n'
        f"rod_mm = {cylinder.rod * 1e3:g}\nlength_range_m = {list(cylinder.lengths)}\ntolerance = {{ {near} }}\n"
        "[cylinders.linkage]\n"
    )


def node_table(node: str, number: int) -> str:
    """A node's table."""
    profile = PROFILE[node.rsplit("_", 1)[1]]
    return (
        f'[[nodes]]\nname = "{node}"\nnode_id = {number}\nprofile = {profile}\n'
        f"identity = {{ serial = {1000 + number} }}\n"
    )


def pressure_table(joint: str, side: str, sub: int) -> str:
    """A pressure sensor's table."""
    return (
        f'[[sensors]]\nname = "{joint}_{side}_pressure"\nkind = "{side}_pressure"\nat = "{joint}"\n'
        f'node = "{joint}_pressure"\nobject = "7130h:{sub}"\ntype = "i16"\nscale_bar = 0.02\nrange_bar = [-5, 400]\n'
        "standard_error_bar = 0.1\n"
    )


def angle_table(joint: str, link: Link) -> str:
    """A joint angle's table."""
    low, high = link.range_deg
    return (
        f'[[sensors]]\nname = "{joint}_angle"\nkind = "joint_angle"\nat = "{joint}"\nnode = "{joint}_angle"\n'
        'object = "6004h"\ntype = "u32"\nscale_deg = 0.01\noffset_deg = -180\n'
        f"range_deg = [{low - 5:g}, {high + 5:g}]\nstandard_error_deg = 0.01\n"
    )


def tilt_table(name: str, address: str, node: str = "chassis_tilt", largest: int = 45) -> str:
    """A tilt sensor's table, for one axis."""
    return (
        f'[[sensors]]\nname = "{name}"\nkind = "{name}"\nnode = "{node}"\nobject = "{address}"\ntype = "i16"\n'
        f"scale_deg = 0.01\nrange_deg = [{-largest}, {largest}]\nstandard_error_deg = 0.02\n"
    )


SLEW = """[[sensors]]
name = "slew_rate"
kind = "slew_rate"
node = "slew_gyro"
object = "7130h:1"
type = "i16"
scale_deg_s = 0.01
range_deg_s = [-150, 150]
standard_error_deg_s = 0.05
"""
PUBLICATION = """[publication]
node_id = 64
period_ms = 50
rated_force_n = 300_000
"""
