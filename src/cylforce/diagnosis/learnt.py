"""What was learnt from labelled cases, by `tools/accuracy decisions --air --write`: data."""

from cylforce.diagnosis.posterior import Calibration, Logistic

CALIBRATION: Calibration | None = Calibration(
    Logistic(
        (5.3642, 1.2099, 0.7796, 1.3192, 0.6301, 1.5149),
        (3.846, 0.9379, 0.5174, 1.9396, 0.4828, 1.6613),
        (0.5125, 0.3316, 0.2157, -0.9673, -0.0608, 0.5565, 0.8625),
    ),
    0.05,
)
