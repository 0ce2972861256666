"""The arm as a MuJoCo model: links, and on request barrels, rods, rocker and link as bodies in closed loops.

World axes are the undercarriage's: x forward, y left, z up from the boom pin's height; a slope tilts gravity. The first
four joints are slew, boom, stick and bucket; angles turn x (forward) towards z (up), hence the axis -y.
"""

from math import asin, atan2, cos, sin

import mujoco
import numpy as np
from numpy.typing import NDArray

from .datasheet import JOINTS, Point
from .specimen import Bar, Body, Specimen

GRAVITY = 9.80665
HOUSE = 'mass="9000" pos="-0.9 0 -0.2" diaginertia="9000 12000 14000"'
STIFF = 'solref="0.002 1" solimp="0.9999 0.9999 0.001"'
DRY = 'solreffriction="0.002 1" solimpfriction="0.9999 0.9999 0.001"'

# a skew body, so that MuJoCo does not take its centre for the bucket's own frame; `Arm.load` gives it its mass
PAYLOAD = (
    '<body name="payload"><inertial mass="1e-6" pos=".6 .01 .1" fullinertia="3e-6 2e-6 2e-6 2e-7 1e-7 3e-7"/></body>'
)


def up_vector(pitch: float, roll: float, slew: float = 0.0) -> tuple[float, float, float]:
    """The vertical in the axes of a house that has turned by `slew` on a slope; pitch: nose up, at slew zero [rad]."""
    x, y, z = cos(roll) * sin(pitch), sin(roll), cos(roll) * cos(pitch)
    return cos(slew) * x + sin(slew) * y, -sin(slew) * x + cos(slew) * y, z


def tilt(pitch: float, roll: float, slew: float) -> tuple[float, float]:
    """What a tilt sensor on the house calls pitch and roll [rad]."""
    x, y, z = up_vector(pitch, roll, slew)
    return atan2(x, z), asin(y)


def mjcf(specimen: Specimen, time_step: float) -> str:
    """The model as MuJoCo's XML."""
    s = specimen
    loops = bool(s.bars)
    boom_pin, stick_pin = (s.slew_axis, 0.0), (s.lengths["boom"], 0.0)
    bucket = _link(
        "bucket", s.bodies["bucket"], (s.lengths["stick"], 0.0), PAYLOAD, {"link_pin": s.bucket_bars.link_pin}
    )
    inner = bucket + (_rocker(s) + _telescope(s, "bucket", (0.0, 0.0)) if loops else "")
    stick = _link("stick", s.bodies["stick"], stick_pin, inner, {"stick_eye": s.cylinders["stick"].eye})
    inner = stick + (_telescope(s, "stick", (0.0, 0.0)) if loops else "")
    boom = _link("boom", s.bodies["boom"], boom_pin, inner, {"boom_eye": s.cylinders["boom"].eye})
    inner = boom + (_telescope(s, "boom", boom_pin) if loops else "")
    pairs = (
        ("boom_end", "boom_eye"),
        ("stick_end", "stick_eye"),
        ("bucket_end", "rocker_end"),
        ("link_end", "link_pin"),
    )
    closed = "".join(joined(a, b) for a, b in pairs) if loops else ""
    return f"""<mujoco><compiler angle="radian"/>
<option timestep="{time_step}" jacobian="dense" tolerance="1e-12" iterations="30">
<flag contact="disable" eulerdamp="disable"/></option>
<worldbody><body name="house"><joint name="slew" axis="0 0 1"/><inertial {HOUSE}/>{inner}</body></worldbody>
<equality>{closed}</equality></mujoco>"""


def site(name: str, at: Point) -> str:
    """A named place on a body."""
    return f'<site name="{name}" pos="{at[0]!r} 0 {at[1]!r}"/>'


def joined(one: str, other: str) -> str:
    """A pin that holds two places together."""
    return f'<connect site1="{one}" site2="{other}" {STIFF}/>'


def _link(name: str, body: Body, pin: Point, inner: str, sites: dict[str, Point]) -> str:
    b = body
    moments = f"{b.yy + b.zz!r} {b.xx + b.zz!r} {b.xx + b.yy!r} 0 {-b.xz!r} 0"
    return (
        f'<body name="{name}" pos="{pin[0]!r} 0 {pin[1]!r}"><joint name="{name}" axis="0 -1 0" {DRY}/>'
        f'<inertial mass="{b.mass!r}" pos="{b.centre[0]!r} 0 {b.centre[1]!r}" fullinertia="{moments}"/>'
        + "".join(site(*each) for each in sites.items())
        + f"{inner}</body>"
    )


def inertial(bar: Bar, sign: float = 1.0) -> str:
    """A bar's mass, along x from its pin."""
    moments = f"{0.05 * bar.inertia!r} {bar.inertia!r} {bar.inertia!r}"
    return f'<inertial mass="{bar.mass!r}" pos="{sign * bar.centre!r} 0 0" diaginertia="{moments}"/>'


def _telescope(s: Specimen, joint: str, origin: Point) -> str:
    """Barrel on its foot, and in it the rod, whose eye is the rod body's origin."""
    foot = s.cylinders[joint].foot
    return (
        f'<body name="{joint}_barrel" pos="{origin[0] + foot[0]!r} 0 {origin[1] + foot[1]!r}">'
        f'<joint name="{joint}_barrel" axis="0 -1 0"/>{inertial(s.bars[joint + "_barrel"])}'
        f'<body name="{joint}_rod"><joint name="{joint}_rod" type="slide" axis="1 0 0"/>'
        f"{inertial(s.bars[joint + '_rod'], -1.0)}{site(joint + '_end', (0.0, 0.0))}</body></body>"
    )


def _rocker(s: Specimen) -> str:
    four = s.bucket_bars
    x, z = four.rocker_pin
    return (
        f'<body name="rocker" pos="{x!r} 0 {z!r}"><joint name="rocker" axis="0 -1 0"/>'
        f"{inertial(s.bars['rocker'])}{site('rocker_end', (four.rocker, 0.0))}"
        f'<body name="link" pos="{four.rocker!r} 0 0"><joint name="link" axis="0 -1 0"/>'
        f"{inertial(s.bars['link'])}{site('link_end', (four.link, 0.0))}</body></body>"
    )


class Arm:
    """The model and its state. Angles are (boom, stick, bucket) from one link to the next [rad]."""

    def __init__(self, specimen: Specimen, time_step: float = 1e-3, pitch: float = 0.0, roll: float = 0.0) -> None:
        self.specimen = specimen
        self.model = mujoco.MjModel.from_xml_string(mjcf(specimen, time_step))
        self.data = mujoco.MjData(self.model)
        self.model.opt.gravity[:] = [-GRAVITY * part for part in up_vector(pitch, roll)]
        self.linkages = [specimen.linkage(joint) for joint in JOINTS]
        self._bars = specimen.bucket_linkage()
        self._payload = self.model.body("payload").id
        self._loaded = (0.0, 0.0, 0.0, 0.0)
        self._closing = {j: int(self.model.joint(j).qposadr[0]) for j in self._closing_joints()}

    def _closing_joints(self) -> list[str]:
        if not self.specimen.bars:
            return []
        return [f"{j}_{part}" for j in JOINTS for part in ("barrel", "rod")] + ["rocker", "link"]

    def place(self, slew: float, angles: "NDArray[np.float64] | tuple[float, ...]") -> None:
        """A pose at rest, all loops closed."""
        self.data.qpos[:4] = (slew, *angles)
        self.data.qvel[:] = 0.0
        for name, (value, _) in self._closures(angles).items():
            self.data.qpos[self._closing[name]] = value

    def drive(self, slew_rate: float, rates: "NDArray[np.float64] | tuple[float, ...]") -> None:
        """Rates at the present pose, the same in all loops."""
        self.data.qvel[:4] = (slew_rate, *rates)
        joints = dict(zip(JOINTS, rates, strict=True))
        for name, (_, slope) in self._closures(tuple(self.data.qpos[1:4])).items():
            self.data.qvel[self._closing[name]] = slope * joints[OWNER[name]]

    def _closures(self, angles: "NDArray[np.float64] | tuple[float, ...]") -> dict[str, tuple[float, float]]:
        """Each loop joint's coordinate and its derivative by the angle of the joint that moves it."""
        if not self._closing:
            return {}
        found = {}
        for name, angle, linkage in zip(JOINTS, angles, self.linkages, strict=True):
            found[f"{name}_barrel"] = linkage.axis(float(angle))
            found[f"{name}_rod"] = linkage.span(float(angle))
        rocker, link = self._bars.rocker(float(angles[2])), self._bars.link(float(angles[2]))
        return found | {"rocker": rocker, "link": (link[0] - rocker[0], link[1] - rocker[1])}

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


OWNER = {f"{j}_{part}": j for j in JOINTS for part in ("barrel", "rod")} | {"rocker": "bucket", "link": "bucket"}
