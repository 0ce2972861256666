"""What was learnt from labelled cases, by `tools/accuracy decisions --write`: data."""

from cylforce.diagnosis.inference.posterior import Outcomes

CALIBRATION: Outcomes | None = Outcomes(
    (7.67, 5.591, 1.711, 0.47, 0.61, 1.056),
    (4.874, 8.93, 0.946, 0.767, 0.686, 0.168),
    (
        (0.078, -0.925, -0.615, -0.877, 0.539, -0.122, -0.484),
        (0.158, 0.781, 0.571, -0.336, 0.003, 0.318, 1.073),
        (-0.112, -0.439, 0.575, 0.615, 0.102, 0.148, 0.041),
        (-0.124, 0.583, -0.531, 0.598, -0.644, -0.344, -0.629),
    ),
    0.1585,
)

# Of thirty foreign recordings of work alone (`--reference-machines 0 --random-machines 0`).
AT_WORK: Outcomes | None = Outcomes(
    (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (1.0, 1.0, 1.0, 1.0, 1.0, 1.0),
    (
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.363),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.082),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.526),
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.082),
    ),
    0.2512,
)
