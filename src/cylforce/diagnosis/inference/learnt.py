"""What was learnt from labelled cases, by `tools/accuracy decisions --air --write`: data."""

from cylforce.diagnosis.inference.posterior import Outcomes

CALIBRATION: Outcomes | None = Outcomes(
    (7.184, 6.147, 1.68, 0.404, 0.482),
    (5.005, 8.327, 0.947, 0.648, 0.405),
    (
        (0.155, -1.031, -0.786, -0.654, 0.465, -0.699),
        (0.277, 0.564, 0.814, -0.132, 0.096, 0.872),
        (-0.005, 0.038, -0.052, 0.954, -0.557, 0.045),
        (-0.427, 0.429, 0.024, -0.168, -0.004, -0.218),
    ),
    0.1,
)
