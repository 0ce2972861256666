"""The running service as a pure function of events: frames to samples, weighing, force, adaptation, publication.

Work here to change what the service computes or publishes from tick to tick; `step.step` is the entry. No clock, no
socket, no file: live operation and replay call the same function.
"""
