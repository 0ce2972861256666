"""Running service as an object that depends on events only: samples, weighing, force, adaptation, publication.

Work here to change the quantities that the service computes or publishes at a tick. `service.WeighingService` is the
entry. It uses no clock, socket or file: live operation and replay call the same methods.
"""
