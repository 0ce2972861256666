"""What was learnt from labelled cases, by `tools/accuracy decisions --air --write`: data."""

from cylforce.diagnosis.inference.posterior import Outcomes

CALIBRATION: Outcomes | None = Outcomes(
    (7.057, 6.052, 1.551, 1.716, 2.258),
    (5.059, 8.444, 6.135, 0.999, 1.705),
    (
        (0.298, -1.253, 0.14, -0.982, -0.871, -0.84),
        (0.182, 0.905, 0.393, 1.111, -0.177, 0.757),
        (-0.234, 0.207, -0.571, 0.379, 0.495, 0.316),
        (-0.247, 0.141, 0.038, -0.508, 0.553, -0.233),
    ),
    0.0631,
)
