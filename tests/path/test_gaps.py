"""path.gaps: a stretch that no picture showed, in closed form, and what is NaN there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from tests.path_fakes import make_path, random_covariance

C = 0.299792458
CAMERA = lf.Camera.facing_plane((32, 32), center_mm=(150.0, 20.0))
ROOF_MM = [(0.0, 0.0, 0.0), (450.0, 0.0, 0.0), (450.0, 40.0, 0.0), (-60.0, 40.0, 0.0)]


def roof(**changes):
    vertices = np.array(ROOF_MM)
    return make_path(vertices, camera=CAMERA, **({"unseen_legs": (1,)} | changes))


def edge_x_mm(path, leg):
    """Where the right edge of the picture cuts a leg that flies along x at z = 0."""
    x = np.linspace(100.0, 450.0, 350_001)
    points = np.column_stack((x, np.full_like(x, path.vertices_mm[leg, 1]), np.zeros_like(x)))
    return float(x[CAMERA.sees(points)].max())


def test_the_delay_runs_from_edge_to_edge():
    path = roof()
    (gap,) = path.gaps
    edges = edge_x_mm(path, 0), edge_x_mm(path, 2)
    way = (450.0 - edges[0]) + 40.0 + (450.0 - edges[1])
    assert gap.after_leg == 0
    # A leg of 500 mm is cut in 2,000 places, the light found to one of them at either edge.
    assert gap.delay_ps == pytest.approx(way * path.medium.path_group_index / C, abs=1.8)
    assert gap.length_mm == pytest.approx(way, abs=0.5)
    assert gap.shortest_mm == pytest.approx(np.hypot(40.0, edges[0] - edges[1]), abs=0.3)
    np.testing.assert_allclose(gap.last_seen_mm, [edges[0], 0.0, 0.0], atol=0.3)
    assert gap.farthest_mm == pytest.approx(0.5 * (gap.length_mm + gap.shortest_mm))


def test_no_mirror_lies_farther_than_told():
    """A mirror at the far end of the family: its light returns straight to the other edge."""
    (gap,) = roof().gaps
    beyond = gap.last_seen_mm + gap.farthest_mm * np.array([1.0, 0.0, 0.0])
    assert gap.farthest_mm + np.linalg.norm(gap.seen_again_mm - beyond) >= gap.length_mm


def test_the_error_of_the_delay_is_that_of_drawn_paths():
    """400 paths drawn from the covariance: their scatter errs by 3.5 %, and 18 % are allowed."""
    covariance = random_covariance(np.random.default_rng(3), 4, scale=0.3)
    path = roof(covariance=covariance)
    rng = np.random.default_rng(4)
    value = np.column_stack((path.vertices_mm, path.vertex_times_ps)).ravel()
    drawn = []
    for one in rng.multivariate_normal(value, covariance, size=400).reshape(-1, 4, 4):
        moved = replace(path, vertices_mm=one[:, :3], vertex_times_ps=one[:, 3])
        drawn.append(moved.gaps[0].delay_ps)
    assert path.gaps[0].delay_std_ps == pytest.approx(np.std(drawn), rel=0.18)


def test_nothing_is_told_of_where_the_light_was():
    path = roof(covariance=np.eye(16))
    times = path.vertex_times_ps
    middle = 0.5 * (times[1] + times[2])
    assert np.isnan(path.position_at([middle])).all()
    assert np.isnan(path.position_covariance_at([middle])).all()
    assert np.isfinite(path.position_at([0.5 * (times[0] + times[1])])).all()
    table = path.sample(400)
    unseen = table["leg"] == 1
    assert unseen.any()
    assert not table["in_view"][unseen].any()
    for name in table.dtype.names:
        if name not in ("leg", "event_time_ps", "in_view"):
            assert np.isnan(table[name][unseen]).all(), name
            assert np.isfinite(table[name][~unseen]).all(), name
    assert [leg.seen for leg in path.legs] == [True, False, True]
    assert np.isnan([path.legs[1].angle_deg, path.legs[1].angle_std_deg]).all()
    assert np.isnan(path.legs[1].direction).all()
    assert "not seen" in repr(path.legs[1])


def test_a_path_whose_legs_were_all_seen_has_no_gap():
    path = make_path()
    assert path.unseen_legs == ()
    assert path.gaps == ()


@pytest.mark.parametrize("legs", [(0,), (2,), (3,), (-1,), 1, ("a",)])
def test_an_unseen_leg_lies_between_two_that_are_seen(legs):
    with pytest.raises(ValueError, match="unseen_legs must lie each between two legs of the 3"):
        roof(unseen_legs=legs)


def test_two_unseen_legs_do_not_follow_each_other():
    vertices = np.array([*ROOF_MM, (-60.0, 90.0, 0.0)])
    with pytest.raises(ValueError, match="between two legs of the 4 that are seen"):
        make_path(vertices, camera=CAMERA, unseen_legs=(1, 2))


def test_the_file_keeps_it(tmp_path):
    path = roof()
    path.save(tmp_path / "path.h5")
    back = lf.LightPath.load(tmp_path / "path.h5")
    assert back.unseen_legs == (1,)
    assert back.gaps[0].delay_ps == path.gaps[0].delay_ps


def test_a_file_with_an_impossible_one_is_told_as_damaged(tmp_path):
    from lightflight.errors import FileFormatError
    from lightflight.files.store import load_record, save_record

    roof().save(tmp_path / "path.h5")
    arrays, attributes = load_record(tmp_path / "path.h5", kind="path")
    for wrong in ([7], ["1"], 1, [0.5]):
        attributes["unseen_legs"] = wrong
        save_record(tmp_path / "x.h5", kind="path", arrays=arrays, attributes=attributes, schema=2)
        with pytest.raises(FileFormatError, match="unseen_legs"):
            lf.LightPath.load(tmp_path / "x.h5")


def test_a_mirror_that_slides_along_its_leg_costs_the_flight_nothing():
    """One mirror out by s, the other in, s drawn with 60 mm: they are open, the flight is not."""
    index = lf.Medium().path_group_index / C
    slide = np.zeros(16)
    slide[[4, 7]] = 1.0, index
    slide[[8, 11]] = -1.0, index
    path = roof(covariance=60.0**2 * np.outer(slide, slide))
    assert path.vertex_std[1, 0] == pytest.approx(60.0)
    table = path.sample(300)
    seen = table["leg"] != 1
    assert table["event_time_std_ps"][seen].max() < 1e-3
    from lightflight.path.trace import trace_from_path

    trace = trace_from_path(path)
    std = np.sqrt(np.maximum(np.diagonal(trace.covariance, axis1=1, axis2=2), 0.0))
    assert std[trace.leg != 1].max() < 1e-3
    assert path.gaps[0].delay_std_ps < 1e-3
