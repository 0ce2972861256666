"""What was learnt from labelled cases, by `tools/accuracy decisions --air --write`: data."""

from cylforce.diagnosis.posterior import Outcomes

CALIBRATION: Outcomes | None = None
