"""Motions of the catalogue as tables, and tables as scenes of the simulated machine."""

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from cylforce.files.atomic import RecordingError
from cylforce.files.motion_table import MotionTable, read_motion
from cylforce.mechanics.machine import Machine
from cylforce.programs.experiments.catalogue import RecommendedMotion
from cylforce.signals.estimate import Array
from cylforce.simulation.soil import carried
from cylforce.simulation.trajectory import JointCourse, Phase, Scene, follow

TABLE_HZ = 20.0  # rows a second of a table; convention: between them a stroke is smooth
FASTEST_PLAYED = 1.0  # m/s; physics: no construction machine's cylinder moves faster
ROUNDING = 1e-6  # rad and m, by which a written angle may be rounded


def table_of(motion: RecommendedMotion) -> MotionTable:
    """Return a motion as a table; its conditions are comments."""
    count = int(motion.scene.duration * TABLE_HZ) + 1
    t = np.arange(count) / TABLE_HZ
    course = follow(motion.scene, t)
    load, slope, temperature = motion.conditions
    comments = (motion.words, f"load: {load}", f"ground: {slope}", f"temperature: {temperature}")
    return MotionTable(t, course.theta, course.turn, (), (*comments, "angles of joints against the link before [rad]"))


def read_scene(path: Path, machine: Machine, load_kg: float = 0.0) -> Scene:
    """Return the motion of a file as a scene, with a load in the bucket. Raises RecordingError with file and line."""
    table = read_motion(path, [link.name for link in machine.links])
    _check_range(path, machine, table)
    _check_speed(path, machine, table)
    joints = tuple(_course(table.t_s, angle) for angle in table.angles.T)
    dig = carried(load_kg, (0.65 * machine.payload_reach, 0.1 * machine.payload_reach)) if load_kg else None
    return Scene(float(table.t_s[-1]), joints, _course(table.t_s, table.slew), ((0.0, Phase.AIR),), dig)


def _course(t: Array, angle: Array) -> JointCourse:
    """Return the course of an angle (T,) that begins and ends at rest."""
    return JointCourse(float(angle[0]), (), CubicSpline(t, angle - angle[0], bc_type="clamped"))


def _check_range(path: Path, machine: Machine, table: MotionTable) -> None:
    for j, link in enumerate(machine.links):
        angle = table.angles[:, j]
        outside = np.flatnonzero((angle < link.angle_low - ROUNDING) | (angle > link.angle_high + ROUNDING))
        if outside.size:
            row = int(outside[0])
            raise RecordingError(
                f"{path}:{table.lines[row]}: {link.name} at {angle[row]:.3f} rad is outside of its range "
                f"({link.angle_low:.3f} to {link.angle_high:.3f} rad, see the machine file): keep it within"
            )
    length = machine.geometry(table.angles).length
    for c, cylinder in enumerate(machine.cylinders):
        low, high = cylinder.length_low - ROUNDING, cylinder.length_high + ROUNDING
        outside = np.flatnonzero((length[:, c] < low) | (length[:, c] > high))
        if outside.size:
            row = int(outside[0])
            raise RecordingError(
                f"{path}:{table.lines[row]}: the {cylinder.name} cylinder would be {length[row, c]:.3f} m long, "
                f"outside of its stroke ({cylinder.length_low:.3f} to {cylinder.length_high:.3f} m): move less"
            )


def _check_speed(path: Path, machine: Machine, table: MotionTable) -> None:
    length = machine.geometry(table.angles).length
    speed = np.abs(np.diff(length, axis=0)) / np.diff(table.t_s)[:, None]
    fast = np.flatnonzero(np.max(speed, axis=1, initial=0.0) > FASTEST_PLAYED)
    if fast.size:
        row = int(fast[0])
        cylinder = machine.cylinders[int(np.argmax(speed[row]))]
        raise RecordingError(
            f"{path}:{table.lines[row + 1]}: the {cylinder.name} cylinder would move at {np.max(speed[row]):.2f} m/s, "
            f"faster than {FASTEST_PLAYED:g} m/s: give the motion more time"
        )
