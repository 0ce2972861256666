"""Geometry and motion of the machine: links, linkages, cylinder lengths and levers, joint torques, working ranges.

Work here to add a linkage or a sensor arrangement. Every function is pure and broadcasts over leading axes. The physics
is in mechanics/README.md.
"""
