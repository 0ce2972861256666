"""What was learnt from machines in order and from labelled cases, by `tools/accuracy decisions --write`: data."""

from cylforce.diagnosis.posterior import Logistic

EVERYDAY: dict[str, float] = {  # everyday difference by effect, of its least plausible size
    "angle_offset": 0.223,
    "angle_scale": 0.0981,
    "asymmetric_friction": 0.281,
    "backlash": 0.185,
    "boom_motion": 0.2,
    "clock_fault": 0.9,
    "compliance": 0.109,
    "coulomb_friction": 0.2,
    "end_cushion": 0.245,
    "extra_mass": 0.199,
    "first_moment_change": 0.197,
    "friction_level_change": 0.2,
    "friction_temperature_drift": 0.2,
    "hose_spring": 0.201,
    "linkage_geometry": 1,
    "load_dependent_friction": 0.24,
    "mud": 0.046,
    "presliding_hysteresis": 1,
    "pressure_drift": 0.2,
    "pressure_gain": 1,
    "pressure_offset": 0.637,
    "pressure_sensor_hysteresis": 0.771,
    "return_line_loss": 0.2,
    "sensor_delay": 0.315,
    "stribeck": 1,
    "tilt_ignored": 0.265,
    "unknown": 0.325,
    "viscous_friction": 0.2,
}
CALIBRATION: Logistic | None = None
