"""Paths with bent legs as users get them: places, directions, errors, files and what draws them."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError, LimitError
from lightflight.path.bends import Bend, BentCourse
from lightflight.path.on_bends import drawn, whole_covariance
from lightflight.path.tables import Goodness
from lightflight.path.trace import trace_from_path
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS as C

GOODNESS = Goodness(1.0, 1, 1, 0, 1.0, 0.0, True)


def bent_path(seed: int = 0) -> lf.LightPath:
    """Two legs, the first bent by two shapes, with a covariance of everything."""
    rng = np.random.default_rng([seed, 21])
    vertices = np.array([[0.0, 0.0, 0.0], [375.0, 25.0, 50.0], [0.0, 50.0, 10.0]])
    along = vertices[1] / np.linalg.norm(vertices[1])
    axes = np.linalg.svd(along[np.newaxis])[2][1:]
    bend = Bend(0, axes, np.array([[12.0, 2.0], [-8.0, 1.0]]))
    length = BentCourse(vertices[0], vertices[1], bend).ways_mm(np.ones(1))[0]
    lengths = np.array([length, np.linalg.norm(vertices[2] - vertices[1])])
    times = 1000.0 + np.append(0.0, np.cumsum(lengths)) * 1.00027 / C
    root = rng.normal(0.0, 0.1, (16, 16))
    whole = root @ root.T
    return lf.LightPath(
        vertices,
        times,
        whole[:12, :12],
        camera=lf.Camera.facing_plane(center_mm=(187.5, 37.5)),
        source=lf.Source(),
        goodness=GOODNESS,
        bends=(bend,),
        bend_covariance=whole[:, 12:],
    )


def moved(path: lf.LightPath, step: np.ndarray) -> lf.LightPath:
    """The path after a step of all numbers of `whole_covariance`."""
    table = np.column_stack((path.vertices_mm, path.vertex_times_ps)) + step[:12].reshape(3, 4)
    bends = (path.bends[0].moved(step[12:]),)
    return replace(path, vertices_mm=table[:, :3], vertex_times_ps=table[:, 3], bends=bends)


def test_the_pulse_runs_evenly_along_the_curve():
    path = bent_path()
    times = np.linspace(path.vertex_times_ps[0], path.vertex_times_ps[1], 20_001)
    steps = np.linalg.norm(np.diff(path.position_at(times), axis=0), axis=1)
    np.testing.assert_allclose(steps / np.diff(times), C / 1.00027, rtol=1e-6)


def test_directions_are_those_of_the_curve():
    path = bent_path()
    times = np.linspace(path.vertex_times_ps[0], path.vertex_times_ps[1], 12)[1:-1]
    steps = path.position_at(times + 1e-3) - path.position_at(times - 1e-3)
    steps /= np.linalg.norm(steps, axis=1)[:, np.newaxis]
    np.testing.assert_allclose(path.direction_at(times), steps, atol=1e-7)
    first = path.legs[0]
    np.testing.assert_allclose(first.direction, path.direction_at(times[:1] * 0 + 1000.0)[0])
    chord = np.diff(path.vertices_mm, axis=0)[0]
    assert np.degrees(np.arccos(first.direction @ chord / np.linalg.norm(chord))) > 5.0
    assert first.angle_deg == pytest.approx(np.degrees(np.arcsin(first.direction[2])))
    assert first.length_mm > np.linalg.norm(chord)


def test_covariance_of_places_is_that_of_finite_steps():
    path = bent_path()
    times = np.linspace(path.vertex_times_ps[0], path.vertex_times_ps[-1], 9)[1:-1]
    h, whole = 1e-4, whole_covariance(path)
    ahead, behind = (
        np.array([moved(path, sign * h * one).position_at(times) for one in np.eye(16)])
        for sign in (1, -1)
    )
    by = (ahead - behind) / (2 * h)
    expected = np.einsum("pni,pq,qnj->nij", by, whole, by)
    np.testing.assert_allclose(path.position_covariance_at(times), expected, rtol=1e-5, atol=1e-9)
    angles = [moved(path, h * s * one).legs[0].angle_deg for one in np.eye(16) for s in (1, -1)]
    slopes = -np.diff(np.reshape(angles, (16, 2)), axis=1)[:, 0] / (2 * h)
    assert path.legs[0].angle_std_deg == pytest.approx(np.sqrt(slopes @ whole @ slopes), rel=1e-5)


def test_what_is_drawn_follows_the_curve():
    path = bent_path()
    trace = trace_from_path(path)
    own = trace.leg == 0
    np.testing.assert_allclose(
        trace.points_mm[own][1:-1], path.position_at(trace.event_time_ps[own])[1:-1], atol=1e-9
    )
    h, at = 1e-4, int(np.flatnonzero(own)[20])

    def place(step):
        other = trace_from_path(moved(path, step))
        return np.append(other.points_mm[at], other.event_time_ps[at])

    by = np.array([(place(h * one) - place(-h * one)) / (2 * h) for one in np.eye(16)])
    expected = by.T @ whole_covariance(path) @ by
    np.testing.assert_allclose(trace.covariance[at], expected, rtol=1e-5, atol=1e-9)
    places, _, leg = drawn(path)
    assert len(places) == 66
    assert set(leg) == {0, 1}
    assert lf.path_error(path, path, path.camera).position_rms_mm < 1e-9
    straight = replace(path, bends=(), bend_covariance=None)
    assert drawn(straight)[0] is straight.vertices_mm
    assert lf.path_error(straight, path, path.camera).position_rms_mm > 5.0
    sampled = path.sample(50)
    np.testing.assert_allclose(sampled["x_mm"], path.position_at(sampled["event_time_ps"])[:, 0])


def test_a_bent_path_is_a_file_of_schema_three(tmp_path):
    path = bent_path()
    file = tmp_path / "path.h5"
    path.save(file)
    with h5py.File(file) as kept:
        assert kept.attrs["schema_version"] == 3
    again = lf.LightPath.load(file)
    times = np.linspace(path.vertex_times_ps[0], path.vertex_times_ps[-1], 7)
    assert np.array_equal(again.position_at(times), path.position_at(times))
    stds = (one.position_covariance_at(times) for one in (again, path))
    assert np.array_equal(*stds)
    straight = replace(path, bends=(), bend_covariance=None)
    straight.save(file)
    with h5py.File(file) as kept:
        assert kept.attrs["schema_version"] == 1
    assert lf.LightPath.load(file).bends == ()


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"leg": 2}, ValueError),
        ({"leg": -1}, ValueError),
        ({"axes": np.zeros((2, 3))}, ValueError),
        ({"axes": np.full((2, 3), np.nan)}, ValueError),
        ({"coefficients_mm": np.array([[np.nan], [0.0]])}, ValueError),
        ({"coefficients_mm": np.zeros((2, 0))}, ValueError),
        ({"coefficients_mm": np.zeros((3, 2))}, ValueError),
        ({"coefficients_mm": np.zeros((2, 9))}, LimitError),
        ({"coefficients_mm": np.full((2, 1), 1e9)}, LimitError),
    ],
)
def test_what_is_no_bend_is_refused(change, error):
    path = bent_path()
    with pytest.raises(error):
        replace(path, bends=(replace(path.bends[0], **change),), bend_covariance=None)


def test_a_path_has_branches_or_bends_and_never_both():
    path = bent_path()
    more = {
        "vertices_mm": np.vstack((path.vertices_mm, [[700.0, 30.0, 60.0]])),
        "vertex_times_ps": np.append(path.vertex_times_ps, path.vertex_times_ps[1] + 1100.0),
        "covariance": np.eye(16),
        "bend_covariance": None,
    }
    assert len(replace(path, **more, bends=(), forks=((2, 1),)).branches) == 2
    both = r"^a path with branches has straight legs: give forks or bends, not both$"
    with pytest.raises(ValueError, match=both):
        replace(path, **more, forks=((2, 1),))


@pytest.mark.parametrize("what", ["bends_orders", "bends_axes", "bends_coefficients_mm"])
def test_a_damaged_file_of_bends_is_refused(tmp_path, what):
    file = tmp_path / "path.h5"
    bent_path().save(file)
    with h5py.File(file, "a") as kept:
        values = kept[what][()]
        del kept[what]
        kept[what] = values.ravel()[:1] * 3
    with pytest.raises(FileFormatError):
        lf.LightPath.load(file)


def test_its_card_draws_the_curve():
    """It was drawn along the chord."""
    path = bent_path()
    straight = replace(path, bends=(), bend_covariance=None)
    along_curve, along_chord = (one._repr_html_() for one in (path, straight))
    assert along_curve.count(",") > along_chord.count(",") + 2 * 60
