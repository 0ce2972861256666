"""The simulated machine: motion, soil, forces, sensors and their bus frames.

Work here on scenarios and on simulated sensors. It uses the same effects as the estimator: results on it show that the
programs work, not how accurate the method is on a real machine.
"""
