"""What is believed of what was found."""

from cylforce.diagnosis.answer.calibration import Outcomes, calibrated
from cylforce.diagnosis.answer.learnt import AT_WORK, CALIBRATION
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.posterior import NOTHING, Belief, believed
from cylforce.diagnosis.numbers import GAP


def taught(
    found: Found, by: Outcomes | None = CALIBRATION, at_work: Outcomes | None = AT_WORK, surely: bool = False
) -> Belief:
    """The probabilities, as labelled cases teach them where there are references, as theirs had; `surely`: there is a
    gap."""
    told = believed(found.asked)
    by = (at_work if found.working else by) if found.question.problem.clean else None
    told = calibrated(told, by) if by else told
    if surely or (not found.working and found.asked.beyond >= GAP):  # nothing everyday is so large
        told = told.but(NOTHING)
    return told.instead(found.asked.incident) if found.asked.incident else told


def decided(found: Found) -> Found:
    """What was found, with what happens at moments as the only cause where beside it nothing is likelier."""
    if found.otherwise is None or taught(found).first != found.asked.incident:
        return found
    return found.otherwise()
