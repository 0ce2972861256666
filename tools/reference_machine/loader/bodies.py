"""The loader as a MuJoCo model: base, arm, bucket, barrels, rods, crank and link as bodies in two closed loops.

World axes: x forward, y left, z up; a slope tilts gravity. The base slides along x and turns about its wheels as it is
told (an armature stands for the mass that nothing can disturb). Angles turn x towards z, hence the axis -y.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from reference_machine.arm import DRY, GRAVITY, PAYLOAD, inertial, joined, site, up_vector
from reference_machine.datasheet import Point

from .sheet import JOINTS
from .specimen import Specimen
from .zbar import Lift, Zbar

Array = NDArray[np.float64]
HEAVY = 1e9  # kg, kg m^2: armature of the base's joints; the arm's forces move it by less than 1e-3 m/s^2
HOLD, DAMP = 100.0, 20.0  # 1/s^2, 1/s: how it is brought back
JOINT_NAMES = ("drive", "rock", *JOINTS, "lift_barrel", "lift_rod", "tilt_barrel", "tilt_rod", "crank", "link")


def mjcf(specimen: Specimen, time_step: float) -> str:
    """The model as MuJoCo's XML."""
    s, bars = specimen, specimen.zbar
    tip = (s.lengths["arm"], 0.0)
    bucket = _part("bucket", s, tip, site("link_pin", bars.link_pin) + PAYLOAD)
    crank = (
        f'<body name="crank" pos="{bars.crank_pin[0]!r} 0 {bars.crank_pin[1]!r}"><joint name="crank" axis="0 -1 0"/>'
        f"{inertial(s.bars['crank'])}{site('tilt_eye', bars.eye)}"
        f'<body name="link" pos="{bars.crank!r} 0 0"><joint name="link" axis="0 -1 0"/>'
        f"{inertial(s.bars['link'])}{site('link_end', (bars.link, 0.0))}</body></body>"
    )
    arm = _part("arm", s, (0.0, 0.0), site("lift_eye", s.cylinders["lift"].eye) + crank + bucket)
    rods = "".join(_telescope(s, name) for name in s.cylinders)
    pairs = (("lift_end", "lift_eye"), ("tilt_end", "tilt_eye"), ("link_end", "link_pin"))
    x, z = s.sheet.wheels
    return f"""<mujoco><compiler angle="radian"/>
<option timestep="{time_step}" jacobian="dense" tolerance="1e-12" iterations="30">
<flag contact="disable" eulerdamp="disable"/></option>
<worldbody><body name="base"><joint name="drive" type="slide" axis="1 0 0" armature="{HEAVY}"/>
<joint name="rock" axis="0 -1 0" pos="{x} 0 {z}" armature="{HEAVY}"/>
<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>{arm}{rods}</body></worldbody>
<equality>{"".join(joined(a, b) for a, b in pairs)}</equality></mujoco>"""


def _part(name: str, s: Specimen, pin: Point, inner: str) -> str:
    b = s.bodies[name]
    moments = f"{b.yy + b.zz!r} {b.xx + b.zz!r} {b.xx + b.yy!r} 0 {-b.xz!r} 0"
    return (
        f'<body name="{name}" pos="{pin[0]!r} 0 {pin[1]!r}"><joint name="{name}" axis="0 -1 0"/>'
        f'<inertial mass="{b.mass!r}" pos="{b.centre[0]!r} 0 {b.centre[1]!r}" fullinertia="{moments}"/>{inner}</body>'
    )


def _telescope(s: Specimen, name: str) -> str:
    """Barrel on its foot, and in it the rod, whose eye is the rod body's origin; dry friction acts on the rod."""
    foot = s.cylinders[name].foot
    return (
        f'<body name="{name}_barrel" pos="{foot[0]!r} 0 {foot[1]!r}">'
        f'<joint name="{name}_barrel" axis="0 -1 0"/>{inertial(s.bars[name + "_barrel"])}'
        f'<body name="{name}_rod"><joint name="{name}_rod" type="slide" axis="1 0 0" {DRY}/>'
        f"{inertial(s.bars[name + '_rod'], -1.0)}{site(name + '_end', (0.0, 0.0))}</body></body>"
    )


class Bodies:
    """The model and its state. Angles are (arm, bucket): arm from the base, bucket from the arm [rad]."""

    def __init__(self, specimen: Specimen, time_step: float = 1e-3, pitch: float = 0.0, roll: float = 0.0) -> None:
        self.model = mujoco.MjModel.from_xml_string(mjcf(specimen, time_step))
        self.data = mujoco.MjData(self.model)
        self.model.opt.gravity[:] = [-GRAVITY * part for part in up_vector(pitch, roll)]
        self.lift, self.zbar = Lift(specimen), Zbar(specimen)
        self._at = {name: int(self.model.joint(name).qposadr[0]) for name in JOINT_NAMES}
        self._payload = self.model.body("payload").id
        self._loaded = (0.0, 0.0, 0.0, 0.0)
        self.joints = [self._at[name] for name in JOINTS]
        self.rods = [self._at[f"{name}_rod"] for name in specimen.cylinders]

    def place(self, arm: float, bucket: float) -> None:
        """A pose at rest, all loops closed."""
        closed = self.zbar.closed(arm, bucket)
        found = {
            "drive": 0.0,
            "rock": 0.0,
            "arm": arm,
            "bucket": bucket,
            "lift_barrel": self.lift.axis(arm)[0],
            "lift_rod": self.lift.span(arm)[0],
            "tilt_barrel": float(np.angle(closed.line)),
            "tilt_rod": abs(closed.line),
            "crank": closed.crank - arm,
            "link": closed.link - closed.crank,
        }
        for name, value in found.items():
            self.data.qpos[self._at[name]] = value
        self.data.qvel[:] = 0.0

    def carry(self, drive: tuple[float, float], rock: tuple[float, float, float]) -> None:
        """The base's motion from now on: speed and acceleration along x; angle, rate and acceleration of rocking."""
        data = self.data
        k, r = self._at["drive"], self._at["rock"]
        data.qfrc_applied[k] = HEAVY * (drive[1] + DAMP * (drive[0] - data.qvel[k]))
        asked = rock[2] + HOLD * (rock[0] - data.qpos[r]) + DAMP * (rock[1] - data.qvel[r])
        data.qfrc_applied[r] = HEAVY * asked

    def base(self) -> tuple[float, float, float, float]:
        """What the base does: acceleration along x, angle, rate and acceleration of rocking."""
        data, k, r = self.data, self._at["drive"], self._at["rock"]
        return float(data.qacc[k]), float(data.qpos[r]), float(data.qvel[r]), float(data.qacc[r])

    def load(self, mass: float, x: float, z: float, gyration: float) -> None:
        """A payload that the bucket carries: mass [kg], centre in the bucket's frame [m], radius of gyration [m]."""
        wanted = (mass, x, z, gyration)
        if wanted == self._loaded:
            return
        self._loaded = wanted
        kilograms = max(mass, 1e-6)
        self.model.body_mass[self._payload] = kilograms
        self.model.body_ipos[self._payload] = (x, 0.0, z)
        self.model.body_inertia[self._payload] = kilograms * max(gyration, 0.01) ** 2

    def step(self) -> None:
        """One time step."""
        mujoco.mj_step(self.model, self.data)

    def forward(self) -> None:
        """Accelerations at the present state."""
        mujoco.mj_forward(self.model, self.data)
