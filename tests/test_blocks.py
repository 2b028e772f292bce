"""Blocks of glass: Snell's law at both faces, closed forms, derivatives, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import lightflight as lf
from lightflight.blocks import places_on_faces
from lightflight.units import SPEED_OF_LIGHT_MM_PER_PS as C
from tests.oracles.refracted import AIR, BK7, Plane, shot

GLASS = lf.Material(*BK7)


def block(**changes: object) -> lf.Block:
    told = {"center_mm": (100.0, 5.0, -3.0), "normal": (-2.0, 0.3, 0.1), "thickness_mm": 20.0,
            "diameter_mm": 50.0, "glass": GLASS}  # fmt: skip
    return lf.Block(**told | changes)


TWO = (block(), block(center_mm=(180.0, 0.0, 4.0), normal=(1.0, 0.1, -0.6), thickness_mm=7.0))


def faces_of(one: lf.Block, ahead: np.ndarray) -> tuple[Plane, Plane]:
    """As the oracle tells them: first face, then the other."""
    normal = np.asarray(one.normal) / np.linalg.norm(one.normal)
    normal *= np.sign(normal @ ahead)
    half = 0.5 * one.thickness_mm * normal
    middle = np.asarray(one.center_mm)
    return Plane(middle - half, normal, *BK7), Plane(middle + half, normal, AIR, AIR)


def test_light_takes_the_way_of_a_ray_that_is_shot():
    """Two blocks, tilted differently, in rays of an oracle that bends them face by face."""
    rng = np.random.default_rng(3)
    start = np.array([0.0, 0.0, 0.0])
    for ahead in np.array([300.0, 0.0, 0.0]) + rng.normal(0.0, 25.0, (20, 3)):
        planes = [plane for one in TWO for plane in faces_of(one, ahead)]
        hits, last = shot(start, ahead[None], planes)
        end = hits[-1, 0] + 150.0 * last[0]
        found = places_on_faces(start, end, TWO).points_mm
        np.testing.assert_allclose(found, hits[1:, 0], atol=1e-9)


def test_light_leaves_as_it_came_moved_aside_by_the_closed_form():
    """By d sin(a - b) / cos b, a outside and b inside the glass."""
    start, end = np.array([-40.0, 30.0, 10.0]), np.array([260.0, -20.0, 25.0])
    one = block()
    points = places_on_faces(start, end, (one,)).points_mm
    before, after = points[0] - start, end - points[1]
    ahead = before / np.linalg.norm(before)
    np.testing.assert_allclose(after / np.linalg.norm(after), ahead, atol=1e-12)
    outside = math.acos(abs(ahead @ one.unit_normal))
    inside = math.asin(AIR * math.sin(outside) / BK7[0])
    aside = end - start - ((end - start) @ ahead) * ahead
    expected = 20.0 * math.sin(outside - inside) / math.cos(inside)
    assert np.linalg.norm(aside) == pytest.approx(expected, abs=1e-11)


def test_square_to_the_faces_nothing_is_bent_and_light_is_late_by_the_closed_form():
    """By d (n_group - n_air) / c: the phase index has no say."""
    ahead = np.array([3.0, 1.0, -2.0]) / math.sqrt(14.0)
    one = block(center_mm=150.0 * ahead, normal=-ahead, glass=lf.Material(2.0, 1.6))
    points = places_on_faces(np.zeros(3), 300.0 * ahead, (one,)).points_mm
    np.testing.assert_allclose(points, [140.0 * ahead, 160.0 * ahead], atol=1e-12)
    camera = lf.Camera.facing_plane(center_mm=(150.0, 0.0))
    scene = lf.Scene([np.zeros(3), 300.0 * ahead], camera=camera, medium=lf.Medium(blocks=(one,)))
    plain = lf.Scene([np.zeros(3), 300.0 * ahead], camera=camera)
    late = scene.vertex_times_ps - plain.vertex_times_ps
    np.testing.assert_allclose(late, [0.0, 20.0 * (1.6 - AIR) / C], atol=1e-9)


def test_how_places_follow_the_ends_is_exact():
    start, end = np.array([0.0, 1.0, 2.0]), np.array([330.0, -40.0, 30.0])
    exact = places_on_faces(start, end, TWO).by_ends
    h = 1e-3

    def at(step: np.ndarray) -> np.ndarray:
        return places_on_faces(start + step[:3], end + step[3:], TWO).points_mm

    for k, one in enumerate(h * np.eye(6)):
        # Fifth order: what is left is rounding.
        near, far = at(one) - at(-one), at(2 * one) - at(-2 * one)
        np.testing.assert_allclose(exact[:, :, k], (8 * near - far) / (12 * h), atol=1e-10)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"thickness_mm": 0.0}, "thickness_mm must be positive"),
        ({"thickness_mm": -3.0}, "thickness_mm must be positive"),
        ({"diameter_mm": float("nan")}, "diameter_mm must be positive"),
        ({"normal": (0.0, 0.0, 0.0)}, "not all zero"),
        ({"center_mm": (1.0, 2.0)}, "center_mm must be three"),
        ({"glass": 1.52}, "phase index and a group index"),
        ({"around": "water"}, "phase index and a group index"),
    ],
)
def test_what_is_no_block_is_refused_in_a_sentence(changes, says):
    with pytest.raises(ValueError, match=says) as refused:
        block(**changes)
    assert "\n" not in str(refused.value)


def test_an_index_below_one_is_refused():
    with pytest.raises(ValueError, match="group_index must lie between 1 and 10"):
        block(glass=lf.Material(1.5, 0.9))


def test_a_block_stands_in_the_medium_of_the_path():
    """In water the light is bent by less; who forgets that is asked."""
    water = lf.Material.named("water", wavelength_nm=532.0)
    with pytest.raises(ValueError, match="say what it stands in"):
        lf.Medium(water.group_index, blocks=(block(),))
    medium = lf.Medium(water.group_index, blocks=block(around=water))
    assert medium.blocks == (block(around=water),)
    with pytest.raises(ValueError, match="blocks must be a list"):
        lf.Medium(blocks=("glass",))
    with pytest.raises(ValueError, match="told twice"):
        lf.Medium(blocks=(block(), block()))
