"""A camera behind plane interfaces, against closed forms of optics and catalogued indices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight.camera.refraction import moved_rigidly, planes_of, way_through_any
from lightflight.camera.rigid import rotation_from_vector
from lightflight.camera.stand_in import stand_in_of
from lightflight.errors import GeometryError
from lightflight.materials import MATERIALS, Material

GLASS, WATER = Material(1.5195, 1.5489), Material(1.3354, 1.3570)
BARE = lf.Camera.facing_plane(distance_mm=535.0)
TANK = replace(
    BARE, interfaces=lf.window((0, 0, 335.0), (0, 0, 1), thickness_mm=10.0, glass=GLASS,
                               beyond=WATER),
)  # fmt: skip
TILTED = replace(
    BARE, interfaces=lf.window((0, 0, 335.0), (0.2, -0.1, 1), thickness_mm=10.0, glass=GLASS,
                               beyond=WATER),
)  # fmt: skip
BLOCKS = replace(
    TILTED,
    interfaces=(*TILTED.interfaces, lf.Interface((0, 0, 300.0), (0.0, 0.3, -1.0), GLASS)),
    distortion=np.array([-0.2, 0.05, 1e-3, -1e-3]),
)
SEEN = pytest.mark.parametrize(
    "camera", [TANK, TILTED, BLOCKS], ids=["tank", "tilted", "three planes and a lens"]
)


def points_behind(camera: lf.Camera, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Pixels (32, 32), and points that they see, 50 to 300 mm behind the last interface."""
    row, col = np.indices(camera.shape).astype(float)
    origins, rays, optical = camera.lines_of_sight(row, col)
    depth = np.random.default_rng(seed).uniform(50.0, 300.0, row.shape)
    return row, col, origins + depth[..., None] * rays, optical, depth


@SEEN
def test_the_way_there_is_the_way_back(camera):
    """Point to pixel by Fermat, pixel to point by Snell: to 1e-9 px and 1e-9 mm."""
    row, col, points, optical, depth = points_behind(camera)
    seen = camera.pixels_from_points(points)
    np.testing.assert_allclose(seen, (row, col), rtol=0, atol=1e-9)
    index = camera.interfaces[-1].beyond.group_index
    way = camera.way_back(points)
    np.testing.assert_allclose(way.optical_mm, optical + index * depth, rtol=0, atol=1e-9)
    directions = camera.sight_directions(points)
    np.testing.assert_allclose(directions, camera.lines_of_sight(row, col)[1], atol=1e-12)


@SEEN
def test_derivatives_against_central_differences(camera):
    _, _, points, _, _ = points_behind(camera)
    by_point, plane = camera.pixel_jacobian(points), camera.plane_and_slopes(points)[1]
    way, step = camera.way_back(points), 1e-4
    for axis in range(3):
        ahead, back = points + step * np.eye(3)[axis], points - step * np.eye(3)[axis]
        for seen, own in (
            (camera.pixels_from_points, by_point), (camera.normalized_from_points, plane),
        ):  # fmt: skip
            change = np.subtract(seen(ahead), seen(back)) / (2 * step)
            np.testing.assert_allclose(np.moveaxis(change, 0, -1), own[..., axis], atol=1e-8)
        change = (camera.way_back(ahead).optical_mm - camera.way_back(back).optical_mm) / (2 * step)
        np.testing.assert_allclose(change, way.optical_by_point[..., axis], atol=1e-7)


@SEEN
def test_speeds_are_slopes_along_a_way(camera):
    points = points_behind(camera)[2]
    along = np.random.default_rng(4).normal(size=points.shape)
    for speeds, slopes in (
        (camera.pixels_and_speeds, camera.pixels_and_slopes),
        (camera.plane_and_speeds, camera.plane_and_slopes),
    ):
        place, run = speeds(points, along)
        there, by_point = slopes(points)
        np.testing.assert_allclose(np.stack(place, -1), there, rtol=0, atol=1e-12)
        expected = np.einsum("...ij,...j->...i", by_point, along)
        np.testing.assert_allclose(np.stack(run, -1), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("camera", [TANK, TILTED], ids=["tank", "tilted"])
def test_parallel_planes_in_one_unknown_are_planes_in_any(camera):
    """The fast path against the plain one, off the axis, on it and near grazing."""
    planes = planes_of(camera.interfaces, camera.center_mm)
    normal = planes[1][0]
    media = (camera.stands_in, *(face.beyond for face in camera.interfaces))
    phase, group = ([getattr(m, f"{w}_index") for m in media] for w in ("phase", "group"))
    _, _, points, _, _ = points_behind(camera)
    points = np.concatenate((
        points.reshape(-1, 3), camera.center_mm + normal * [[300.0], [500.0]],
        camera.center_mm + 400.0 * normal + np.cross(normal, [0, 1.0, 0]) * [[2e3], [2e4]],
    ))  # fmt: skip
    fast = camera.way_back(points)
    plain = way_through_any(points, camera.center_mm, planes, np.array(phase), np.array(group))
    for name, tolerance in (
        ("first_mm", 1e-9), ("last_mm", 1e-9), ("optical_mm", 1e-9), ("first_by_point", 1e-11),
        ("optical_by_point", 1e-11),
    ):  # fmt: skip
        own, other = getattr(fast, name), getattr(plain, name)
        np.testing.assert_allclose(own, other, rtol=1e-11, atol=tolerance, err_msg=name)


def test_a_plate_shifts_a_ray_sideways():
    """t sin(a) (1 - cos(a) / sqrt(n^2 - sin^2 a)), and turns it not at all."""
    air = BARE.stands_in
    camera = replace(
        BARE, interfaces=lf.window((0, 0, 300.0), (0, 0, 1), thickness_mm=20.0, glass=GLASS)
    )
    row, col = np.indices(camera.shape).astype(float)
    rays = camera.rays_from_pixels(row, col)
    origins, through, _ = camera.lines_of_sight(row, col)
    np.testing.assert_allclose(through, rays, atol=1e-13)
    sine = np.linalg.norm(np.cross(rays, [0, 0, 1.0]), axis=-1)
    cosine, n = np.sqrt(1 - sine**2), GLASS.phase_index / air.phase_index
    expected = 20.0 * sine * (1 - cosine / np.sqrt(n**2 - sine**2))
    shift = np.linalg.norm(np.cross(rays, origins - camera.center_mm), axis=-1)
    np.testing.assert_allclose(shift, expected, atol=1e-12)


def test_water_looks_three_quarters_deep_near_the_axis():
    """A point h behind the surface is seen where one h n_front / n_water behind it would be."""
    camera = replace(BARE, interfaces=(lf.Interface((0, 0, 300.0), (0, 0, 1), WATER),))
    depth = 200.0
    row, col = camera.pixels_from_points((0.01, 0.0, 300.0 - depth))
    apparent = depth * BARE.stands_in.phase_index / WATER.phase_index
    expected = BARE.pixels_from_points((0.01, 0.0, 300.0 - apparent))
    np.testing.assert_allclose((row, col), expected, atol=1e-9)


@SEEN
def test_light_bends_by_the_phase_index_and_counts_the_group_index(camera):
    """Snell at the first plane by phase; other group indices leave the picture and move times."""
    row, col, points, _, _ = points_behind(camera)
    slower = tuple(
        replace(face, beyond=replace(face.beyond, group_index=face.beyond.group_index + 0.1))
        for face in camera.interfaces
    )
    other = replace(camera, interfaces=slower)
    np.testing.assert_array_equal(
        other.pixels_from_points(points), camera.pixels_from_points(points)
    )
    first, last = camera.way_back(points), other.way_back(points)
    behind = np.linalg.norm(points - first.first_mm, axis=-1)
    assert (last.optical_mm - first.optical_mm > 0.0999 * behind).all()
    ray = camera.rays_from_pixels(row, col)
    normal = np.asarray(camera.interfaces[0].normal)
    one = replace(camera, interfaces=camera.interfaces[:1])
    _, bent, _ = one.lines_of_sight(row, col)
    before, after = (np.linalg.norm(np.cross(r, normal), axis=-1) for r in (ray, bent))
    n = [BARE.stands_in.phase_index, camera.interfaces[0].beyond.phase_index]
    np.testing.assert_allclose(n[0] * before, n[1] * after, atol=1e-13)


def test_equal_indices_bend_nothing():
    same = Material(1.2, 1.2)
    faces = lf.window((0, 0, 335.0), (0.2, 0, 1), thickness_mm=10.0, glass=same, beyond=same)
    camera = replace(BARE, interfaces=faces, stands_in=same)
    _, _, points, _, _ = points_behind(camera)
    expected = BARE.pixels_from_points(points)
    np.testing.assert_allclose(camera.pixels_from_points(points), expected, atol=1e-10)
    distance = np.linalg.norm(points - BARE.center_mm, axis=-1)
    np.testing.assert_allclose(camera.way_back(points).optical_mm, 1.2 * distance, rtol=1e-13)


def test_camera_and_window_that_move_together_see_the_same_from_there():
    turn, shift = np.array([0.02, -0.03, 0.01]), np.array([3.0, -2.0, 5.0])
    moved = TILTED.perturbed(np.concatenate((turn, shift)))
    _, _, points, _, _ = points_behind(TILTED)
    rotation = rotation_from_vector(turn)
    there = TILTED.center_mm + (points - TILTED.center_mm) @ rotation.T + shift
    np.testing.assert_allclose(
        moved.pixels_from_points(there), TILTED.pixels_from_points(points), atol=1e-9
    )
    same = moved_rigidly(TILTED.interfaces, np.eye(3), TILTED.center_mm, np.zeros(3))
    for one, other in zip(same, TILTED.interfaces, strict=True):
        np.testing.assert_allclose(one.point_mm, other.point_mm, atol=1e-12)


def test_a_stored_camera_keeps_what_it_looks_through():
    camera = replace(BLOCKS, stands_in=Material(1.1, 1.2))
    again = lf.Camera.from_arrays(camera.to_arrays())
    _, _, points, _, _ = points_behind(camera)
    np.testing.assert_array_equal(
        again.pixels_from_points(points), camera.pixels_from_points(points)
    )
    np.testing.assert_array_equal(again.way_back(points).optical_mm,
                                  camera.way_back(points).optical_mm)  # fmt: skip
    assert "interfaces" not in BARE.to_arrays()


@pytest.mark.parametrize("camera", [TANK, TILTED], ids=["tank", "tilted"])
def test_a_stand_in_sees_nearly_the_same(camera):
    """Good enough to start from: a third of a pixel and 5 ps over 200 mm of depth."""
    row, col, points, _, _ = points_behind(camera)
    index = WATER.group_index
    plain, more = stand_in_of(camera, index)
    assert not plain.interfaces
    np.testing.assert_allclose(plain.pixels_from_points(points), (row, col), atol=0.3)
    late = plain.return_times_ps(points, return_group_index=index) + more / 0.299792458
    np.testing.assert_allclose(
        late, camera.return_times_ps(points, return_group_index=index), atol=5.0
    )
    assert stand_in_of(BARE, index) == (BARE, 0.0)


def test_points_before_the_window_and_reflected_rays_are_not_seen():
    row, _ = TANK.pixels_from_points([(0, 0, 400.0), (0, 0, 330.0), (0, 0, 100.0)])
    np.testing.assert_array_equal(np.isnan(row), [True, True, False])
    assert not TANK.sees((0, 0, 400.0))
    # From glass out into air, beyond 41 degrees nothing leaves.
    camera = replace(
        lf.Camera.facing_plane(distance_mm=100.0, field_of_view_mm=(400.0, 400.0)),
        interfaces=(lf.Interface((0, 0, 80.0), (0, 0, 1), lf.Camera.facing_plane().stands_in),),
        stands_in=GLASS,
    )
    rays = camera.rays_from_pixels(*np.indices(camera.shape))
    sine = np.linalg.norm(np.cross(rays, [0, 0, 1.0]), axis=-1)
    lost = np.isnan(camera.lines_of_sight(*np.indices(camera.shape))[0][..., 0])
    np.testing.assert_array_equal(lost, sine * GLASS.phase_index > 1.00027)
    hist = lf.Histograms(np.zeros((32, 32, 64), int), bin_width_ps=55.0)
    with pytest.raises(GeometryError, match="totally reflected"):
        lf.reconstruct(hist, camera=camera, source=lf.Source((0, 0, 0)))


# Catalogued: SCHOTT (n_d, n_e of N-BK7), Malitson's table (silica, n_d), Daimon and Masumura's
# table (water, 20.0 deg C), Ciddor's (air, n_d).
@pytest.mark.parametrize(
    ("name", "wavelength_nm", "index", "tolerance"),
    [
        ("BK7", 587.5618, 1.51680, 1e-5), ("BK7", 546.074, 1.51872, 1e-5),
        ("fused silica", 587.5618, 1.458463, 2e-6), ("fused silica", 404.6561, 1.469617, 2e-6),
        ("water", 589.3, 1.33336, 5e-5), ("air", 587.5618, 1.00027716, 1e-7),
    ],
)  # fmt: skip
def test_named_materials_have_their_catalogued_index(name, wavelength_nm, index, tolerance):
    assert Material.named(name, wavelength_nm=wavelength_nm).phase_index == pytest.approx(
        index, abs=tolerance
    )


@pytest.mark.parametrize("name", MATERIALS)
def test_the_group_index_is_the_slope_of_the_wavenumbers(name):
    """n_g = d(n k) / dk, and above n where dispersion is normal."""
    found = Material.named(name, wavelength_nm=532.0)
    k = 2 * np.pi / 532.0 * np.array([1 - 1e-4, 1 + 1e-4])
    n = [Material.named(name, wavelength_nm=2 * np.pi / one).phase_index for one in k]
    assert found.group_index == pytest.approx(np.diff(n * k)[0] / np.diff(k)[0], abs=1e-7)
    assert found.group_index > found.phase_index


def test_what_no_window_is_is_refused_in_a_sentence():
    face = lf.Interface((0, 0, 300.0), (0, 0, 1), WATER)
    behind, farther = replace(face, point_mm=(0, 0, 600.0)), replace(face, point_mm=(0, 0, 200.0))
    with pytest.raises(GeometryError, match="does not stand before the camera"):
        replace(BARE, interfaces=(behind,))
    with pytest.raises(GeometryError, match="does not stand before the camera"):
        replace(BARE, interfaces=(replace(face, normal=(1, 0, 0)),))
    with pytest.raises(GeometryError, match="list them in order"):
        replace(BARE, interfaces=(farther, face))
    with pytest.raises(GeometryError, match="normal of an interface is zero"):
        lf.Interface((0, 0, 1), (0, 0, 0), WATER)
    with pytest.raises(ValueError, match="must be a Material"):
        lf.Interface((0, 0, 1), (0, 0, 1), 1.33)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="phase_index must lie between 1 and 10"):
        Material(0.9, 1.3)
    with pytest.raises(ValueError, match="measured"):
        Material.named("water", wavelength_nm=1500.0)
    with pytest.raises(ValueError, match="material must be one of"):
        Material.named("jelly", wavelength_nm=532.0)


def test_a_medium_that_is_not_behind_the_window_is_refused():
    """Water told as air, or the phase index given for the group index."""
    hist = lf.Histograms(np.zeros((32, 32, 64), int), bin_width_ps=55.0)
    for medium in (lf.Medium(), lf.Medium(WATER.phase_index, WATER.phase_index)):
        with pytest.raises(ValueError, match="behind the last interface light flies"):
            lf.reconstruct(hist, camera=TANK, source=lf.Source((0, 0, 0)), medium=medium)
        with pytest.raises(ValueError, match="behind the last interface light flies"):
            lf.Scene([(0, 0, 0), (100, 0, 0)], camera=TANK, medium=medium)
    with pytest.raises(ValueError, match="knows one medium"):
        lf.reconstruct(hist, camera=TANK, source=lf.Source((0, 0, 0)), method="paper")
