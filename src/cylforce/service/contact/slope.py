"""The slope of the ground along which the teeth are dragged, from the path of the teeth while they are in contact."""

from math import atan, pi, radians, sqrt

import numpy as np

from cylforce.signals.estimate import Array

EVERY_M = 0.05  # m between two points of the course; chosen
POINTS = 6  # of a straight piece, 0.25 m long; chosen
LARGEST_BEND = 0.003  # m: rms distance from a line from which on a piece is not straight; chosen
TURN = radians(6.0)  # by which the slope must change; an arc of 3 m turns by 4.8 degrees over such pieces; chosen


NO_COURSE = np.zeros((0, 2))  # points (K, 2) [m] of a course that has not begun


def kink(course: Array, place: complex) -> tuple[Array, float | None]:
    """The course, points (K, 2) [m], at most those of two pieces, with the present place [m]; and the confidence with
    which the slope has changed between its last two straight pieces; None: it has not."""
    here = np.array([place.real, place.imag])
    if len(course) and float(np.hypot(*(here - course[-1]))) < EVERY_M:
        return course, None
    points = np.concatenate([course, here[None]])[-2 * POINTS + 1 :]
    if len(points) < 2 * POINTS - 1:
        return points, None
    before, after = line(points[:POINTS]), line(points[POINTS - 1 :])
    straight = max(before[1], after[1]) < LARGEST_BEND
    turn = abs((after[0] - before[0] + pi / 2.0) % pi - pi / 2.0)
    if not straight or turn < TURN:
        return points, None
    error = sqrt(2.0) * atan(max(before[1], after[1], 1e-4) / (EVERY_M * POINTS / sqrt(12.0)) / sqrt(POINTS))
    return points[POINTS - 1 :], float(min(1.0, 1.0 - 0.5 * np.exp(-((turn - TURN / 2.0) / error))))


def line(points: Array) -> tuple[float, float]:
    """Inclination [rad] of the line through points (K, 2), and their rms distance from it [m]."""
    around = points - points.mean(axis=0)
    _, size, axes = np.linalg.svd(around, full_matrices=False)
    return float(np.arctan2(axes[0, 1], axes[0, 0])), float(size[1] / sqrt(len(points)))
