"""Geometry and motion of the machine: links, linkages, cylinder lengths and levers, joint torques, working ranges.

Work here to add a linkage or a sensor arrangement. Everything is pure and broadcasts over leading axes; the physics is
in mechanics/README.md.
"""
