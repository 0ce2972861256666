"""A torque at one joint, for some seconds at a time, of which nothing is known: no effect of the library, but what a
force at the teeth or a turning house must be better than before it is believed. Two sizes at any instant follow one
joint's torque as well as one does."""

from dataclasses import dataclass

from cylforce.core.gap.library import Group
from cylforce.machine.candidate import SHAPES, TORQUES, About, Course, Place

NAME = "unknown"


@dataclass(frozen=True, slots=True)
class UnknownTorque:
    """A torque at one joint, for some seconds at a time."""

    @property
    def about(self) -> About:
        """What it says of itself."""
        return About(
            NAME,
            "N m",
            100.0,
            1e6,
            Place.LINK,
            "for some seconds at a time, at one joint",
            "the same moves again: does it come back with posture, speed, load or time?",
            axes=SHAPES,
        )

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns whose sizes change."""
        return TORQUES

    @property
    def course(self) -> Course:
        """How they change."""
        return Course.WINDOWS


UNKNOWN: tuple[Group, ...] = ((UnknownTorque(),),)
