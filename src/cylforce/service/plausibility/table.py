"""Table of the detectors. One line adds a detector.

Of several suspicions of one level the first one is reported. First come the detectors that need the readings of one
sensor alone, then those that compare a reading with the motion, last the statistics over many rows: so the most
specific one is reported."""

from cylforce.service.plausibility.detector import Detector
from cylforce.service.plausibility.detectors.angle_step import AngleStep
from cylforce.service.plausibility.detectors.constant_error import ConstantError
from cylforce.service.plausibility.detectors.driven_tool import DrivenTool
from cylforce.service.plausibility.detectors.empty_bucket import EmptyBucket
from cylforce.service.plausibility.detectors.fallen import BelowVacuum, BurstHose
from cylforce.service.plausibility.detectors.frozen_pressure import FrozenPressure
from cylforce.service.plausibility.detectors.lost_noise import LostNoise
from cylforce.service.plausibility.detectors.pressure_step import PressureStep
from cylforce.service.plausibility.detectors.swept_tool import SweptTool

DETECTORS: tuple[type[Detector], ...] = (
    BelowVacuum,
    BurstHose,
    AngleStep,
    PressureStep,
    DrivenTool,
    FrozenPressure,
    LostNoise,
    ConstantError,
    SweptTool,
    EmptyBucket,
)
