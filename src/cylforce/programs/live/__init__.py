"""Live operation: the simulated bus, the player of recordings, the collector and the operator's live picture.

Work here on code that runs while a machine moves.
"""
