"""Errors of sensors (offset, scale, drift, delay), one file each. Work here to add an error of a measured value."""
