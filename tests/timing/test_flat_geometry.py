"""Flats: light from a screen, and beams that are tilted."""

import numpy as np
import pytest

import lightflight as lf
from lightflight.errors import GeometryError
from lightflight.timing.calibrate.chain import calibrate_timing
from lightflight.timing.flat_geometry import fit_tilt, flat_arrival_from_screen_ps, tilt_ps
from tests.clock_fakes import fake_clock

C = 0.299792458


def test_screen_in_the_reference_plane():
    camera = lf.Camera.facing_plane((32, 32))
    arrival = flat_arrival_from_screen_ps(
        camera, source_mm=(0.0, 0.0, 400.0), screen_point_mm=(7.0, 8.0, 0.0),
        screen_normal=(0.0, 0.0, -2.0), medium=lf.Medium(1.0, 1.0),
    )  # fmt: skip
    # pixels see points a fixed pitch apart on z = 0
    pitch = 245.0 / 32
    x = (np.arange(32) - 15.5) * pitch
    points = np.stack(np.broadcast_arrays(x[None], -x[:, None], 0.0), axis=-1)
    out = np.linalg.norm(points - [0.0, 0.0, 400.0], axis=-1)
    back = np.linalg.norm(points - [0.0, 0.0, 535.0], axis=-1)
    np.testing.assert_allclose(arrival, (out + back) / C, atol=1e-6)


def test_screen_beside_the_view_is_refused():
    camera = lf.Camera.facing_plane((4, 4))
    with pytest.raises(GeometryError, match="16 pixels do not look at the screen") as caught:
        flat_arrival_from_screen_ps(
            camera, source_mm=(0, 0, 0), screen_point_mm=(0, 0, 700), screen_normal=(0, 0, 1)
        )
    assert caught.value.offenders.all()
    with pytest.raises(ValueError, match="screen_normal must not be zero"):
        flat_arrival_from_screen_ps(
            camera, source_mm=(0, 0, 0), screen_point_mm=(0, 0, 0), screen_normal=(0, 0, 0)
        )
    with pytest.raises(ValueError, match="source_mm must be three finite numbers"):
        flat_arrival_from_screen_ps(
            camera, source_mm=(0, 0), screen_point_mm=(0, 0, 0), screen_normal=(0, 0, 1)
        )


def test_tilt_and_its_errors(rng):
    row, col = np.meshgrid(np.linspace(-0.5, 0.5, 20), np.linspace(-0.5, 0.5, 30), indexing="ij")
    pulls = []
    for _ in range(300):
        true = rng.normal(0.0, 5.0, 2)
        skew = rng.normal(0.0, 40.0, (20, 30)) + true[0] * row + true[1] * col
        skew[3, 4] = np.nan
        tilt = fit_tilt(skew, 5.0)
        pulls.append((np.array(tilt.across_ps) - true) / tilt.across_std_ps)
    # 600 pulls: width known to 2.9 %
    assert np.std(pulls) == pytest.approx(1.0, abs=0.13)
    np.testing.assert_allclose(tilt.modes_ps[..., 0], row * tilt.across_std_ps[0])
    np.testing.assert_allclose(
        tilt_ps(tilt, (20, 30)), row * tilt.across_ps[0] + col * tilt.across_ps[1]
    )


def test_tilt_of_one_row_is_no_error():
    tilt = fit_tilt(np.zeros((1, 8)), 3.0)
    assert tilt.across_ps == (0.0, 0.0)
    assert tilt.across_std_ps[0] == pytest.approx(3.0)
    assert not tilt.modes_ps[..., 0].any()


def test_tilted_beam_in_a_calibration(rng):
    clock = fake_clock(rng, (12, 12), skew_ps=3.0)
    beam = 60.0 * np.linspace(-0.5, 0.5, 12)[:, None] + np.zeros((12, 12))
    timing = calibrate_timing(
        clock.uniform(rng, 1e6), flat=clock.pulse(rng, 2000.0 + beam.ravel(), 1e5),
        flat_arrival_ps=2000.0, dead_codes="absorbed", flat_tilt_std_ps=50.0,
    )  # fmt: skip
    error = timing.skew_ps.ravel() - clock.skew_ps
    assert error.std() < 2.0  # 18 with the tilt left in
    rows, cols = (grid.ravel() for grid in np.indices((12, 12)))
    _, modes, names = timing.arrival_errors_ps(rows, cols, np.full(144, 2000.0))
    assert names == ("flat tilt, rows", "flat tilt, columns")
    np.testing.assert_allclose(modes, timing.flat_modes_ps.reshape(144, 2))
    assert 0.1 < modes[:, 0].max() < 1.0
