"""Chains of legs through glass: vertices on faces, their times, and files that keep them."""

from __future__ import annotations

from dataclasses import replace

import h5py
import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import FileFormatError, GeometryError
from lightflight.files import store
from lightflight.path.glass import (
    glass_of,
    late_jacobian,
    late_ps,
    on_faces,
    refuse_other_crossings,
    seat_map,
    seated,
    with_faces,
)
from lightflight.path.tables import Goodness
from lightflight.path.tree import corners_of
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS as C
from tests.oracles.refracted import AIR, BK7, block_vertices_mm, block_world
from tests.oracles.refracted_border import block_told, camera_told

GLASS = lf.Material(*BK7)
BLOCKS = (
    lf.Block((100.0, 4.0, 2.0), (1.0, 0.2, 0.0), thickness_mm=12.0, diameter_mm=30.0, glass=GLASS),
    lf.Block((200.0, 8.0, 4.0), (1.0, 0.0, 0.4), thickness_mm=20.0, diameter_mm=30.0, glass=GLASS),
)
CHAIN = np.array([[0.0, 0.0, 0.0], [375.0, 15.0, 7.5], [0.0, 80.0, 0.0]])


def path_through_glass() -> lf.LightPath:
    scene = block_world(tilt_deg=25.0)
    return lf.LightPath(
        scene.vertices_mm, scene.vertex_times_ps, 0.01 * np.eye(16), camera=camera_told(scene),
        source=lf.Source((0, 0, 0)), medium=lf.Medium(blocks=(block_told(25.0),)),
        goodness=Goodness(1.0, 1, 1, 0, 1.0, 0.0, True),
    )  # fmt: skip


def test_a_leg_through_two_blocks_is_five_and_the_next_is_whole():
    found = with_faces(CHAIN, BLOCKS)
    assert found.vertices_mm.shape == (7, 3)
    assert [leg for leg, _ in found.glass] == [1, 3]
    assert found.of_leg.tolist() == [0, 0, 0, 0, 0, 1]
    assert on_faces(found.glass) == (1, 2, 3, 4)
    assert glass_of(found.vertices_mm, BLOCKS) == found.glass
    again = with_faces(found.vertices_mm, BLOCKS)
    np.testing.assert_array_equal(again.vertices_mm, found.vertices_mm)
    assert again.glass == found.glass


def test_vertices_on_faces_follow_the_free_ones():
    """`seated` puts them back, and `seat_map` is its derivative."""
    faced = with_faces(CHAIN, BLOCKS)
    rng = np.random.default_rng(5)
    off = faced.vertices_mm.copy()
    off[1:5] += rng.normal(0.0, 0.3, (4, 3))
    np.testing.assert_allclose(seated(off, faced.glass), faced.vertices_mm, atol=1e-11)
    step = 1e-4 * rng.normal(0.0, 1.0, (7, 3))
    moved = seated(off + step, faced.glass) - seated(off - step, faced.glass)
    map_ = seat_map(faced.vertices_mm, faced.glass)
    np.testing.assert_allclose(moved.ravel(), 2.0 * map_ @ step.ravel(), atol=1e-10)


def test_light_is_late_behind_each_block():
    faced = with_faces(CHAIN, BLOCKS)
    late = late_ps(faced.vertices_mm, faced.glass, AIR)
    ways = np.linalg.norm(np.diff(faced.vertices_mm, axis=0), axis=1)[[1, 3]]
    each = ways * (BK7[1] - AIR) / C
    np.testing.assert_allclose(late, [0, 0, each[0], each[0], *[each.sum()] * 3], atol=1e-12)
    slopes = late_jacobian(faced.vertices_mm, faced.glass, AIR)
    step = np.random.default_rng(6).normal(0.0, 1e-4, (7, 3))
    change = late_ps(faced.vertices_mm + step, faced.glass, AIR) - late_ps(
        faced.vertices_mm - step, faced.glass, AIR
    )
    np.testing.assert_allclose(change, 2.0 * slopes @ step.ravel(), atol=1e-12)


def test_glass_that_is_entered_and_never_left_is_refused():
    ends_in_it = np.array([[0.0, 0.0, 0.0], [101.0, 4.0, 2.0]])
    with pytest.raises(GeometryError, match=r"vertex 1.* which light enters and never leaves"):
        with_faces(ends_in_it, BLOCKS)


def test_glass_that_no_light_crosses_is_refused():
    vertices = with_faces(CHAIN[:2] + np.array([0.0, 40.0, 0.0]), BLOCKS).vertices_mm
    assert len(vertices) == 2
    with pytest.raises(GeometryError, match="does not cross the block of 12 mm of glass"):
        refuse_other_crossings(vertices, BLOCKS)


def test_a_face_that_is_met_beyond_its_rim_is_refused():
    vertices = with_faces(CHAIN[:2], BLOCKS).vertices_mm
    refuse_other_crossings(vertices, BLOCKS)
    narrow = tuple(replace(block, diameter_mm=4.0) for block in BLOCKS)
    with pytest.raises(GeometryError, match="mm from its axis and the face is 4 mm wide"):
        refuse_other_crossings(with_faces(CHAIN[:2], narrow).vertices_mm, narrow)


def test_positions_follow_the_broken_line():
    path, scene = path_through_glass(), block_world(tilt_deg=25.0)
    assert path.legs_in_glass == (1,)
    assert "three legs, 1 of them in glass" in str(path)
    ends = scene.vertex_times_ps
    middle = path.position_at([(ends[1] + ends[2]) / 2])[0]
    np.testing.assert_allclose(middle, block_vertices_mm(25.0)[1:3].mean(axis=0), atol=1e-9)
    speed = np.linalg.norm(np.diff(path.position_at([ends[1] + 1.0, ends[1] + 2.0]), axis=0))
    assert speed == pytest.approx(C / BK7[1], rel=1e-12)
    # A face is no mirror: none is drawn there.
    assert corners_of(path) == ()


def test_a_path_through_glass_is_a_file_of_schema_four(tmp_path, monkeypatch):
    path = path_through_glass()
    path.save(tmp_path / "glass.h5")
    with h5py.File(tmp_path / "glass.h5") as kept:
        assert kept.attrs["schema_version"] == 4
    again = lf.LightPath.load(tmp_path / "glass.h5")
    assert again.medium == path.medium
    assert again.legs_in_glass == (1,)
    np.testing.assert_array_equal(again.vertices_mm, path.vertices_mm)
    replace(path, medium=lf.Medium()).save(tmp_path / "plain.h5")
    with h5py.File(tmp_path / "plain.h5") as kept:
        assert kept.attrs["schema_version"] == 1
    monkeypatch.setitem(store.NEWEST_SCHEMA, "path", 3)
    with pytest.raises(FileFormatError, match="newer lightflight"):
        lf.LightPath.load(tmp_path / "glass.h5")
