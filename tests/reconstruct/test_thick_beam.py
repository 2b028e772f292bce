"""Footprints on a thick beam: against its own bundle of thin ones, and against the lens alone."""

import numpy as np
import pytest

import lightflight as lf
from lightflight.reconstruct.model.footing import Corners, footing
from lightflight.reconstruct.model.state import PathState
from lightflight.reconstruct.model.thick_beam import (
    Slant,
    clear_of_corners_px,
    share_beyond_lens,
    slant_of_leg,
    thick_footing,
)

SPOT_PX, SLOPE = 0.6, 14.0
ACROSS = np.array([-0.9, -0.4, 0.0, 0.4, 0.9])
CAMERA = lf.Camera.facing_plane(center_mm=(187.5, 37.5), distance_mm=535.0)
TURN = PathState(np.array([[10.0, -60, -30], [190, 40, 30], [300, 90, -40]]), 0.0)


def cut_at(after, before=-np.inf):
    n = len(ACROSS)
    return Corners(np.full(n, before), np.full(n, after), np.zeros((n, 1)), np.zeros((n, 1)))


def moments(corners, slant, share, *, deep=None, log_slope=0.0, curvature=0.0, across=ACROSS):
    n = len(ACROSS)
    return thick_footing(
        np.full(n, log_slope), np.full(n, SLOPE), np.full(n, curvature), corners, slant,
        spot_px=np.full(n, SPOT_PX), across_px=across, share=share, deep=deep,
    )  # fmt: skip


def parts(found):
    return found.log_share, found.offset_ps, found.variance_ps2


@pytest.mark.parametrize(("share", "flat"), [(0.2, None), (0.6, None), (0.6, 0.1), (0.9, None)])
@pytest.mark.parametrize(("lean", "deep"), [(0.0, 0.2), (0.9, 0.4), (-0.5, 2.0), (0.2, -2.5)])
@pytest.mark.parametrize("after", [-0.8, 0.1, 1.0])
def test_it_is_a_bundle_of_thin_beams(share, flat, lean, deep, after):
    """Every ray of the beam, round or flat in depth, is cut by itself: the sum over draws of rays.

    At one seed, 60 means, shares and variances each within five of their own errors and 0.01 ps.
    """
    rng = np.random.default_rng(5)
    n, v = 400_000, SPOT_PX**2
    xi = np.sqrt((1 - share) * v) * rng.normal(size=n)
    c = np.sqrt((share if flat is None else flat) * v) * rng.normal(size=n)
    slant = Slant((0.0, lean), (0.0, deep), (0.0, 0.0))
    found = moments(cut_at(after), slant, share, deep=flat).feet
    for k, y in enumerate(ACROSS):
        a = share * y + np.sqrt(share * (1 - share) * v) * rng.normal(size=n)
        kept = xi - lean * a - deep * c < after
        if kept.sum() < 4000:
            continue
        late = SLOPE * (xi - c)[kept]
        error = late.std() / np.sqrt(kept.sum())
        chance = np.sqrt((1 - kept.mean()) / kept.sum())
        assert abs(found.log_share.value[k] - np.log(kept.mean())) < 5 * chance + 1e-3
        assert abs(found.offset_ps.value[k] - late.mean()) < 5 * error + 1e-2
        assert found.variance_ps2.value[k] == pytest.approx(
            late.var(), rel=5 * np.sqrt(3 / kept.sum())
        )


@pytest.mark.parametrize("share", [-0.2, 0.3, 0.9])
def test_a_cut_as_the_lens_blurs_is_the_lens(share):
    """Deep 1 and lean 0: the place ahead and the depth count alike, as a round spot's.

    Of less than no beam moments go on by their differences, 1e-6 of a share away.
    """
    found = moments(cut_at(0.3), Slant((0.0, 0.0), (1.0, 1.0), (0.0, 0.0)), share, curvature=1.5)
    n = len(ACROSS)
    round_ = footing(np.zeros(n), np.full(n, SLOPE), np.full(n, 1.5), cut_at(0.3), spot_px=SPOT_PX)
    exact = 1e-9 if share > 0.0 else 1e-7
    for ours, theirs in zip(parts(found.feet), parts(round_), strict=True):
        np.testing.assert_allclose(ours.value, theirs.value, rtol=exact, atol=exact)


def test_none_of_the_spot_is_the_lens():
    """Beside a mirror that leans, too."""
    slant = Slant((0.4, -0.8), (2.0, -1.5), (0.3, 0.3))
    found = moments(cut_at(0.3), slant, 0.0, log_slope=0.2, curvature=1.5)
    n = len(ACROSS)
    round_ = footing(
        np.full(n, 0.2), np.full(n, SLOPE), np.full(n, 1.5), cut_at(0.3), spot_px=SPOT_PX
    )
    for ours, theirs in zip(parts(found.feet), parts(round_), strict=True):
        np.testing.assert_allclose(ours.value, theirs.value, rtol=1e-9, atol=1e-9)


def test_away_from_corners_uneven_light_moves_by_what_of_the_spot_lies_along():
    """Slope of the light times the covariance of time and place along the leg."""
    share, cos = 0.6, 0.25
    slant = Slant((0.4, -0.8), (2.0, -1.5), (cos, cos))
    found = moments(cut_at(np.inf), slant, share, log_slope=0.2)
    expected = 0.2 * SLOPE * SPOT_PX**2 * (1 - share - share * cos)
    np.testing.assert_allclose(found.feet.offset_ps.value, expected, rtol=2e-3)
    np.testing.assert_allclose(found.feet.log_share.value, 0.0, atol=1e-3)
    np.testing.assert_allclose(found.feet.variance_ps2.value, (SLOPE * SPOT_PX) ** 2, rtol=3e-3)


@pytest.mark.parametrize(("share", "deep"), [(-0.1, -0.1), (0.5, 0.5), (0.8, 0.8), (0.8, 0.2)])
def test_derivatives_are_differences(share, deep):
    slant = Slant((0.0, 0.7), (0.0, 1.8), (0.1, 0.1))
    step = 1e-5

    def at(share, deep, across=ACROSS):
        return moments(
            cut_at(0.4), slant, share, deep=deep, log_slope=0.1, curvature=1.0, across=across
        )

    found = at(share, deep)
    for by, up, down in (
        (found.by_share, at(share + step, deep), at(share - step, deep)),
        (found.by_deep, at(share, deep + step), at(share, deep - step)),
        (found.by_across, at(share, deep, ACROSS + step), at(share, deep, ACROSS - step)),
    ):
        for k in range(3):
            rise = (parts(up.feet)[k].value - parts(down.feet)[k].value) / (2 * step)
            # One-sided.
            np.testing.assert_allclose(by[k], rise, atol=1e-5 + 1e-3 * np.abs(rise).max())


@pytest.mark.parametrize(("leg", "end"), [(0, 1), (1, 0)])
def test_a_slant_is_where_rays_meet_the_mirror(leg, end):
    """Rays beside the flight, met with the plane that turns it, projected by the camera."""
    corner, slant = TURN.vertices_mm[1], slant_of_leg(TURN, leg, CAMERA)
    flights = [np.diff(TURN.vertices_mm[k : k + 2], axis=0)[0] for k in (0, 1)]
    into, out = (each / np.linalg.norm(each) for each in flights)
    flight, normal = (into, out)[leg], out - into
    to_eye = np.array([187.5, 37.5, 535.0]) - corner
    to_eye /= np.linalg.norm(to_eye)
    right = np.cross(flight, to_eye)
    right /= np.linalg.norm(right)
    towards = to_eye - (to_eye @ flight) * flight
    towards /= np.linalg.norm(towards)

    def place(point):
        row, col = CAMERA.pixels_from_points(point)
        return np.array([row, col])

    step = 1e-3
    ahead = place(corner + step * flight) - place(corner)
    per_mm = np.linalg.norm(ahead) / step
    ahead /= np.linalg.norm(ahead)
    # A pixel of depth is as many mm as one across.
    across = np.linalg.norm(place(corner + step * right) - place(corner)) / step
    for direction, told in ((right, slant.leans[end]), (towards, slant.deepens[end])):
        ray = corner + step * direction
        met = ray - ((ray - corner) @ normal) / (normal @ flight) * flight
        along = (place(met) - place(corner)) @ ahead
        assert along / (across * step) == pytest.approx(told, abs=2e-3)
    assert slant.towards[end] == pytest.approx(flight @ to_eye)
    assert per_mm > 0.0


def test_grazing_mirrors_keep_pulses_far_from_corners():
    """Of a sharp turn no farther than ever; of half of a short leg at most; of a lens never."""
    sharp = PathState(np.array([[60.0, 40, 0], [190, 40, 0], [190, 120, 0]]), 0.0)
    grazing = PathState(np.array([[60.0, 40, 0], [190, 40, 0], [300, 40, -75]]), 0.0)
    short = PathState(np.array([[174.0, 40, 0], [190, 40, 0], [300, 40, -75]]), 0.0)

    def clear(state, spot, share):
        return clear_of_corners_px(state, 0, CAMERA, spot, share=share)[1]

    assert clear(sharp, 0.4, 0.5) == pytest.approx(1.5)
    assert clear(grazing, 0.4, 0.5) > 2.5
    assert clear(grazing, 0.4, share_beyond_lens(0.4)) == pytest.approx(1.5)
    assert clear(grazing, 0.6, share_beyond_lens(0.6)) > 3.0
    assert clear(short, 1.0, 0.5) == pytest.approx(1.5)
    # A curve that was found as legs, seen through a soft lens.
    slight = PathState(np.array([[60.0, 40, 0], [190, 40, 0], [300, 60, -30]]), 0.0)
    assert clear(slight, 0.85, share_beyond_lens(0.85)) == pytest.approx(1.5)
