"""Slope of the ground along which the teeth are dragged, from the path of the teeth in contact."""

from math import atan, atan2, exp, hypot, pi, radians, sqrt

EVERY_M = 0.05  # m between two points of the course; chosen
POINTS = 6  # of a straight piece, 0.25 m long; chosen
LARGEST_BEND = 0.003  # m: least rms distance from a line of a piece that is not straight; chosen
TURN = radians(6.0)  # by which the slope must change; an arc of 3 m turns by 4.8 degrees over such pieces; chosen


Course = tuple[tuple[float, float], ...]  # points x, z [m]
NO_COURSE: Course = ()  # before the first point


def kink(course: Course, place: complex) -> tuple[Course, float | None]:
    """Return the course of the teeth with the present place, and the confidence that the ground's slope has changed.

    A place is added after EVERY_M [m]. The slopes of the last two pieces of the course, of POINTS points each, are
    compared. The confidence (0 to 1) is None where they agree, where one of them is not straight, and while the course
    is shorter. After a change of the slope the course continues with the second piece alone.

    course: so far; at most the points of two pieces, which have one point in common
    place:  of the teeth, x + i z [m]
    """
    x, z = place.real, place.imag
    if course and hypot(x - course[-1][0], z - course[-1][1]) < EVERY_M:
        return course, None
    points = (*course, (x, z))[-2 * POINTS + 1 :]
    if len(points) < 2 * POINTS - 1:
        return points, None
    (slope_before, bend_before), (slope_after, bend_after) = line(points[:POINTS]), line(points[POINTS - 1 :])
    bend = max(bend_before, bend_after)
    turn = abs((slope_after - slope_before + pi / 2.0) % pi - pi / 2.0)
    if bend >= LARGEST_BEND or turn < TURN:
        return points, None
    # standard error of the turn [rad], by the scatter about both lines
    error = sqrt(2.0) * atan(max(bend, 1e-4) / (EVERY_M * POINTS / sqrt(12.0)) / sqrt(POINTS))
    return points[POINTS - 1 :], min(1.0, 1.0 - 0.5 * exp(-((turn - TURN / 2.0) / error)))


def line(points: Course) -> tuple[float, float]:
    """Return the inclination [rad] of the line through points, and their rms distance from it [m].

    The line lies in the direction of largest variance; the distance is the square root of the smaller variance."""
    count = len(points)
    middle_x, middle_z = sum(x for x, _ in points) / count, sum(z for _, z in points) / count
    xx = sum((x - middle_x) ** 2 for x, _ in points)
    zz = sum((z - middle_z) ** 2 for _, z in points)
    xz = sum((x - middle_x) * (z - middle_z) for x, z in points)
    least = (xx + zz) / 2.0 - hypot((xx - zz) / 2.0, xz)
    return 0.5 * atan2(2.0 * xz, xx - zz), sqrt(max(least, 0.0) / count)
