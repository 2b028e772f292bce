"""The page: parallel projection, tubes, boxes."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.view import style
from lightflight.view.projection import draw_box, ribbon_from_rings
from lightflight.view.viewpoint import PhotoView, Viewpoint
from tests.view import fakes


def test_from_the_front_the_page_shows_x_and_y() -> None:
    front = Viewpoint(azimuth_deg=0.0, elevation_deg=0.0)
    np.testing.assert_allclose(front.project([3.0, 4.0, 99.0]), [3.0, 4.0], atol=1e-12)


@pytest.mark.parametrize(("azimuth", "elevation"), [(-24, 22), (40, 60), (170, -30)])
def test_page_axes_are_a_rotation(azimuth: float, elevation: float) -> None:
    view = Viewpoint(azimuth, elevation)
    frame = np.vstack((view.page_axes, view.towards_viewer))
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame) == pytest.approx(1.0)
    assert view.page_axes[1, 1] > 0  # world y is up on the page


def test_a_round_tube_is_as_wide_on_the_page_as_in_space() -> None:
    turn = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    circle = np.stack((np.zeros_like(turn), np.cos(turn), np.sin(turn)), axis=1) * 2.5
    rings = np.array([[0.0, 0, 0], [10, 0, 0], [40, 0, 0]])[:, None, :] + circle
    outline = ribbon_from_rings(rings, Viewpoint(-24, 22))
    assert outline is not None
    width = np.linalg.norm(outline[:3] - outline[3:][::-1], axis=1)
    np.testing.assert_allclose(width, 5.0, rtol=1e-3)


def test_tubes_without_errors_or_seen_end_on_have_no_ribbon() -> None:
    rings = np.zeros((4, 8, 3))
    assert ribbon_from_rings(rings * np.nan, Viewpoint()) is None
    rings[:, :, 2] = np.arange(4)[:, None]
    assert ribbon_from_rings(rings, Viewpoint(0.0, 0.0)) is None


def test_the_box_fits_its_axes_and_is_to_scale() -> None:
    figure = style.new_figure(120, 60)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    box = np.array([[-10.0, -5, 0], [400, 90, 60]])
    draw_box(ax, Viewpoint(), box)
    corners = np.array(np.meshgrid(*box.T, indexing="ij")).reshape(3, -1).T
    x, y = Viewpoint().project(corners).T
    assert ax.get_xlim()[0] < x.min() < x.max() < ax.get_xlim()[1]
    assert ax.get_ylim()[0] < y.min() < y.max() < ax.get_ylim()[1]
    figure.canvas.draw()
    scale = ax.transData.transform([[0.0, 0.0], [100.0, 0.0], [0.0, 100.0]])
    assert scale[1, 0] - scale[0, 0] == pytest.approx(scale[2, 1] - scale[0, 1])


def test_tick_labels_know_no_minus_zero() -> None:
    figure = style.new_figure(120, 60)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw_box(ax, Viewpoint(), np.array([[-10.0, -5, -8], [400, 90, 60]]))
    words = [text.get_text() for text in ax.texts]
    assert "0" in words
    assert "\u22120" not in words


def test_a_photo_is_its_own_projection() -> None:
    camera = fakes.paper_camera()
    point = np.array([200.0, 30.0, 20.0])
    row, col = camera.pixels_from_points(point)
    np.testing.assert_allclose(PhotoView(camera).project(point), [col, row])
