"""Errors of the modelled geometry: pins, play, elastic links, a moving base. Work here to add such an error."""
