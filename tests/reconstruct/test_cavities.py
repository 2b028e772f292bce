"""Light to and fro between two mirrors: passes found untold, their times within stated errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

import lightflight as lf
from lightflight.reconstruct.model.cells import lag_edges
from lightflight.reconstruct.other_light.around import Seen, lags_about_legs
from tests.oracles.cavity import Cavity, cavity
from tests.oracles.refracted_border import camera_told

FINE = lag_edges(64.0, 0.8 * 64.0, 1.3, 50_000.0)


def path_of(world: Cavity, seed: int) -> lf.LightPath:
    """Reconstructed with source and clock told, and not how many legs there are."""
    scene = world.scene
    hist = lf.Histograms(
        world.recording(seed), bin_width_ps=scene.clock.width, laser_period_ps=scene.clock.period
    )
    source = lf.Source(tuple(scene.vertices_mm[0]), emission_time_ps=scene.emission_time_ps)
    timing = lf.TimingCalibration.nominal(hist)
    return lf.reconstruct(hist, camera=camera_told(scene), source=source, timing=timing)


@pytest.mark.usefixtures("nothing_twice")
@pytest.mark.parametrize(
    ("passes", "walk_mm", "seed"),
    [(12, 9.0, 3), pytest.param(6, 0.5, 1, marks=pytest.mark.long)],
    ids=["side by side", "retraced"],
)
def test_passes_are_found_and_their_times_lie_within_the_errors(passes, walk_mm, seed):
    """One recording each, 4,000 photons in the first pass's brightest pixel.

    Times of the 5 or 11 corners are held against their covariance, together, by what chi-square
    exceeds in 1e-4 of recordings. The mean round trip: 4 errors, 6e-5.
    """
    world = cavity(seed, passes=passes, walk_mm=walk_mm)
    path = path_of(world, seed)
    assert path.n_legs == passes
    assert path.verdict.level != "contradicted"
    off = (path.vertex_times_ps - world.scene.vertex_times_ps)[1:-1]
    own = 4 * np.arange(1, passes) + 3
    covariance = path.covariance[np.ix_(own, own)]
    assert off @ np.linalg.solve(covariance, off) < chi2.isf(1e-4, len(off))
    trip = path.round_trip
    assert abs(trip.time_ps - world.round_trips_ps.mean()) < 4.0 * trip.time_std_ps
    assert abs(trip.distance_mm - world.distance_mm) < 4.0 * trip.distance_std_mm
    # A tenth of a code's 55 ps over some 700 pulses: errors that were lost would be far from this.
    assert 0.05 < trip.time_std_ps < 0.5


def seen_with(arrival_ps: list[list[float]]) -> Seen:
    """Pixels that legs light at these times; NaN: no further leg."""
    arrival = np.array(arrival_ps)
    leg = np.where(np.isfinite(arrival), np.arange(arrival.shape[1]), -1)
    at = np.arange(len(arrival))
    return Seen(
        at,
        at,
        leg,
        arrival,
        np.full_like(arrival, 64.0),
        *np.zeros((4, *arrival.shape)),
        *np.ones((2, *arrival.shape)),
    )


def test_cells_are_fine_about_every_leg_of_a_crowded_pixel():
    """Five legs in one pixel, one in the other; about each no cell is wider than one of the core's
    and all lags lie in one period."""
    nan = float("nan")
    times = [[9_000.0, 2_000.0, 4_500.0, 16_000.0, 40_000.0], [7_000.0, nan, nan, nan, nan]]
    lags = lags_about_legs(seen_with(times), FINE, 64.0)
    assert np.ptp(lags, axis=1) == pytest.approx([50_000.0, 50_000.0])
    for own, edges in zip(times, lags, strict=True):
        for late in np.array(own)[np.isfinite(own)] - own[0]:
            about = edges[np.abs(edges - late) < 4.0 * 64.0 + 1.0]
            assert np.diff(about).max() < 0.81 * 64.0
            assert np.ptp(about) == pytest.approx(8.0 * 64.0, rel=1e-6)


def test_cells_of_pixels_that_one_leg_lights_are_those_of_the_nearest():
    seen = seen_with([[9_000.0, float("nan")]])
    np.testing.assert_array_equal(lags_about_legs(seen, FINE, 64.0), FINE)
