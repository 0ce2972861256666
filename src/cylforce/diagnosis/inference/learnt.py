"""What was learnt from labelled cases, by `tools/accuracy decisions --air --write`: data."""

from cylforce.diagnosis.inference.posterior import Outcomes

CALIBRATION: Outcomes | None = Outcomes(
    (7.531, 6.634, 1.697, 0.412, 0.464, 0.968),
    (4.921, 8.241, 0.963, 0.746, 0.425, 0.326),
    (
        (0.007, -0.533, -1.111, -0.578, 0.132, -0.69, -0.562),
        (0.18, 0.413, 1.0, -0.36, 0.244, 0.686, 0.571),
        (-0.028, -0.228, 0.09, 0.853, -0.28, 0.307, -0.137),
        (-0.159, 0.348, 0.021, 0.085, -0.096, -0.303, 0.129),
    ),
    0.01995,
)
