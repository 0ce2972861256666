"""Every effect of the library, as it is put into the reference machine."""

from collections.abc import Callable

from . import mechanics, rubbing, sensing
from .fault import Draw, Fault, Scene

Make = Callable[[Draw, Scene], Fault]
KNOWN: dict[str, Make] = {
    "stribeck": rubbing.stribeck,
    "load_dependent_friction": rubbing.load_dependent,
    "asymmetric_friction": rubbing.asymmetric,
    "friction_temperature_drift": rubbing.temperature_drift,
    "presliding_hysteresis": rubbing.presliding,
    "friction_level_change": rubbing.level_change,
    "coulomb_friction": rubbing.coulomb_change,
    "viscous_friction": rubbing.viscous_change,
    "pressure_offset": sensing.pressure_offset,
    "pressure_gain": sensing.pressure_gain,
    "pressure_drift": sensing.pressure_drift,
    "angle_offset": sensing.angle_offset,
    "angle_scale": sensing.angle_scale,
    "sensor_delay": sensing.sensor_delay,
    "tilt_ignored": sensing.tilt_ignored,
    "slew_centrifugal": sensing.slew_ignored,
    "return_line_loss": sensing.line_loss,
    "linkage_geometry": mechanics.linkage_geometry,
    "extra_mass": mechanics.extra_mass,
    "first_moment_change": mechanics.first_moment,
    "soil_contact": mechanics.soil_contact,
    "payload_shift": mechanics.payload_shift,
    "payload_spill": mechanics.payload_spill,
    "compliance": sensing.compliance,
    "backlash": sensing.backlash,
    "clock_fault": sensing.clock_fault,
}
BOOM_MOTION = "boom_motion"  # only on a system of stick and bucket
TWO_LINKS: dict[str, Make] = {BOOM_MOTION: mechanics.boom_motion}
CANDIDATES = 9 * 3 + 3 * 6 + 2 * 3 + 9 + 3 * 3 + 2 * 3 + 4 + 3  # effects with their places, on three links
CLUTTER = (8, 20)  # fewest and most
CLUTTER_SHARE = (0.02, 0.08)  # of a typical size
NO_CLUTTER = ("slew_centrifugal", "clock_fault")  # 5 % of them is no smaller kind of the same


def clutter(draw: Draw, scene: Scene, besides: tuple[str, ...]) -> list[Fault]:
    """Several other effects, each at the same few percent of a typical size."""
    names = [name for name in KNOWN if name not in (*besides, *NO_CLUTTER)]
    small, count = Draw(draw.rng, draw.shape(*CLUTTER_SHARE)), int(draw.rng.integers(CLUTTER[0], CLUTTER[1] + 1))
    return [KNOWN[str(name)](small, scene) for name in draw.rng.choice(names, count, replace=False)]
