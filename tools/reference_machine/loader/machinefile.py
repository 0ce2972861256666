"""The loader's data sheet as a machine file: all that an estimator may see of it."""

from reference_machine.machinefile import (
    BAR,
    PUBLICATION,
    Field,
    angle_table,
    cylinder_head,
    link_table,
    node_table,
    pressure_table,
    tilt_table,
    xz,
)
from reference_machine.sensors import DEGREE

from .sheet import CYLINDERS, JOINTS, LOADER, LoaderSheet

NODES = {"lift_pressure": 33, "tilt_pressure": 34, "arm_angle": 17, "bucket_angle": 18, "chassis_tilt": 48}
PDOS: dict[str, tuple[Field, ...]] = {
    **{
        f"{name}_pressure": tuple((f"{name}_{side}_pressure", 0.02 * BAR, 0.0, 2, True) for side in ("head", "rod"))
        for name in CYLINDERS
    },
    **{f"{joint}_angle": ((f"{joint}_angle", 0.01 * DEGREE, -180.0 * DEGREE, 4, False),) for joint in JOINTS},
    "chassis_tilt": tuple((name, 0.01 * DEGREE, 0.0, 2, True) for name in ("pitch", "roll")),
}
INERTIAL = {"pitch_rate": "rate", "forward_acceleration": "acceleration", "upward_acceleration": "acceleration"}
INERTIAL_NODES = NODES | {"chassis_imu": 49}
INERTIAL_PDOS: dict[str, tuple[Field, ...]] = PDOS | {
    "chassis_imu": tuple((n, 0.01 * DEGREE if kind == "rate" else 0.01, 0.0, 2, True) for n, kind in INERTIAL.items())
}


def machine_file(name: str, sheet: LoaderSheet = LOADER, *, inertial: bool = False) -> str:
    """A machine file (TOML) with the sheet's nominal values and tolerances; `inertial`: with the base's inertial
    sensor."""
    head = (
        "# Data sheet of a wheel loader that tools/reference_machine has simulated: nominal values and tolerances.\n"
        f'[machine]\nname = "{name}"\nrated_payload_kg = {sheet.rated_payload:g}\n'
        f"payload_reach_m = {sheet.payload_reach:g}\n"
        f"{f'inertial_sensor_m = {xz(sheet.inertial)}' if inertial else ''}\n"
    )
    parts = [head, *(link_table(joint, sheet.links[joint], sheet.tolerances) for joint in JOINTS)]
    parts += [f"[tool]\npoint_m = {xz(sheet.tool)}\n", _lift(sheet), _tilt(sheet)]
    parts += [node_table(node, number) for node, number in (INERTIAL_NODES if inertial else NODES).items()]
    parts += [pressure_table(name, side, k) for name in CYLINDERS for k, side in enumerate(("head", "rod"), 1)]
    parts += [angle_table(joint, sheet.links[joint]) for joint in JOINTS]
    parts += [tilt_table("pitch", "6010h"), tilt_table("roll", "6020h")]
    parts += [_inertial(signal, k) for k, signal in enumerate(INERTIAL, 1)] if inertial else []
    parts.append(PUBLICATION)
    return "\n".join(parts)


def _inertial(name: str, sub: int) -> str:
    unit, most, error = ("deg_s", 150, 0.05) if INERTIAL[name] == "rate" else ("m_s2", 40, 0.02)
    return (
        f'[[sensors]]\nname = "{name}"\nkind = "{name}"\nnode = "chassis_imu"\nobject = "7130h:{sub}"\ntype = "i16"\n'
        f"scale_{unit} = 0.01\nrange_{unit} = [{-most}, {most}]\nstandard_error_{unit} = {error}\n"
    )


def _lift(sheet: LoaderSheet) -> str:
    cylinder = sheet.cylinders["lift"]
    return cylinder_head("lift", cylinder, sheet.tolerances) + (
        f'kind = "triangle"\nfoot = {{ body = "chassis", at_m = {xz(cylinder.foot)} }}\n'
        f'eye = {{ body = "arm", at_m = {xz(cylinder.eye)} }}\n'
    )


def _tilt(sheet: LoaderSheet) -> str:
    cylinder, bars = sheet.cylinders["tilt"], sheet.bars
    return cylinder_head("tilt", cylinder, sheet.tolerances) + (
        f'kind = "four_bar"\nfoot = {{ body = "chassis", at_m = {xz(cylinder.foot)} }}\n'
        f'rocker_pin = {{ body = "arm", at_m = {xz(bars.crank_pin)} }}\n'
        f'link_pin = {{ body = "bucket", at_m = {xz(bars.link_pin)} }}\n'
        f'rocker_m = {bars.crank:g}\nlink_m = {bars.link:g}\nside = "right"\neye_m = {xz(bars.eye)}\n'
    )
