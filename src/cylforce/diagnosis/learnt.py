"""What was learnt from labelled cases, by `tools/accuracy decisions --air --write`: data."""

from cylforce.diagnosis.posterior import Calibration, Logistic

CALIBRATION: Calibration | None = Calibration(
    Logistic(
        (4.8698, 1.2791, 0.8076, 1.2658, 0.6438, 1.6577),
        (3.7216, 0.9226, 0.4316, 1.9151, 0.4789, 1.7062),
        (0.4488, 0.5109, -0.3037, -1.1201, -0.308, 0.3498, 0.9636),
    ),
    0.007943,
)
