"""Recordings as the diagnosis takes them."""

from cylforce.readings.recording import Recording

__all__ = ["Recording"]
