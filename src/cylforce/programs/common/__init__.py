"""Functions shared by several commands: reading machine and recordings, playing, progress, scores. It has no
command.
"""
