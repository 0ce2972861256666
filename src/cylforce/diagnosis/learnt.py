"""What was learnt from machines in order and from labelled cases, by `tools/accuracy decisions --write`: data."""

from cylforce.diagnosis.posterior import Logistic

EVERYDAY: dict[str, float] = {}  # everyday difference by effect, of its least plausible size
CALIBRATION: Logistic | None = None
