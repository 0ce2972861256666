"""Columns of errors of sensors and of drawings, of which only what changes is computed, are those of the plain central
difference of what the whole model leaves."""

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.effects.fault import Alteration, Distortion
from cylforce.effects.library import proposals
from cylforce.estimation.model import FRICTION, Model
from cylforce.estimation.regressor import FilteredRegressor, Regressor
from cylforce.mechanics.installation import Filters
from cylforce.signals.kinds import Kind, Signal
from machines import excavator, stick_and_bucket

SECONDS, BEGINS = 8.0, 100.0
FILTERS = Filters(100.0, 5.0, 2.0, 2.0, 0.002)
TYPICAL = {Kind.HEAD_PRESSURE: (9e6, 4e6), Kind.ROD_PRESSURE: (3e6, 1e6), Kind.PITCH: (0.02, 0.02)}
TYPICAL |= {Kind.ROLL: (0.01, 0.02), Kind.SLEW_RATE: (0.1, 0.4)}


def inclined():
    """Stick and bucket whose sensors tell the stick's inclination and the bucket cylinder's length."""
    machine = stick_and_bucket()
    others = {
        "stick_angle": Signal("stick_slope", Kind.LINK_INCLINATION, 0, -3.2, 3.2, 0.01, radians(0.01)),
        "bucket_angle": Signal("bucket_length", Kind.CYLINDER_LENGTH, 1, 0.5, 4.0, 0.01, 1e-4),
    }
    return replace(machine, signals=tuple(others.get(s.name, s) for s in machine.signals))


def readings(machine):
    """Smooth samples (T, S) within the range of every sensor; they need not be those of any motion."""
    rng, t = np.random.default_rng(5), np.arange(SECONDS * FILTERS.rate_hz) / FILTERS.rate_hz
    middle = np.array([(link.angle_low + link.angle_high) / 2.0 for link in machine.links])
    theta = middle + np.stack([0.3 * np.sin((0.9 + 0.4 * j) * t + j) for j in range(machine.size)], axis=-1)
    columns = []
    for s in machine.signals:
        if s.kind is Kind.CYLINDER_LENGTH:
            columns.append(machine.geometry(theta).length[:, s.index])
        elif s.kind is Kind.LINK_INCLINATION:
            columns.append(theta[:, : s.index + 1].sum(axis=1))
        elif s.kind is Kind.JOINT_ANGLE:
            columns.append(theta[:, s.index])
        else:
            offset, swing = TYPICAL[s.kind]
            columns.append(offset + swing * np.sin(rng.uniform(0.5, 3.0) * t + rng.uniform(0.0, 6.0)))
    return np.stack(columns, axis=-1)


def left(viewer, values, tares, machine):
    """What the whole model of a machine leaves of samples."""
    model = replace(viewer.slow, machine=machine)
    f, moved = model.filters, model.channels.run(viewer.thinned(values))
    regressor = Regressor(machine, model.empty.effects)
    rows = FilteredRegressor(regressor, 1.0 / f.rate_hz, f.regressor_hz, f.smoothing_hz).run(moved.motion)
    return rows.torque - rows.columns @ tares


def plain(viewer, effect, where, values, tares):
    """The column (T', R) by the central difference of two full evaluations; None where there is none."""
    step, machine = np.sqrt(effect.about.low * effect.about.high), viewer.model.machine
    if isinstance(effect, Distortion):
        t = BEGINS + np.arange(len(values)) / FILTERS.rate_hz
        both = [effect.distorted(viewer.weighed, values, t, where, s * step) for s in (1.0, -1.0)]
        more, less = (left(viewer, each, tares, machine) for each in both)
    else:
        less, more = (left(viewer, values, tares, effect.altered(machine, where, s * step)) for s in (1.0, -1.0))
    return (more - less) / (2.0 * step)


@pytest.mark.parametrize("made", [excavator, stick_and_bucket, inclined])
def test_columns_are_those_of_the_plain_central_difference(made):
    machine = made()
    model = Model(machine, FILTERS, FRICTION)
    tares = model.prior.mean + 0.3 * np.sqrt(np.diag(model.prior.covariance))
    viewer, values = Viewer(model, tares), readings(machine)
    wanted = [p for p in proposals(machine) if isinstance(p.group[0], Distortion | Alteration)]
    found = viewer.rows(Recorded("made", values, 0.0, BEGINS), wanted).effects
    expected = [plain(viewer, e, p.where, values, tares) for p in wanted for e in p.group]
    shown = [np.nan_to_num(c[viewer.slow.settle_steps :]) for c in expected]
    assert found.shape[-1] == len(expected) > 20
    assert sum(bool(np.any(c)) for c in shown) > 20
    for k, column in enumerate(shown):
        np.testing.assert_allclose(found[..., k], column, rtol=0.0, atol=1e-9 * np.max(np.abs(column)))
