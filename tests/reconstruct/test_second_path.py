"""The light of a mirrored path: where it falls, when, and how it follows the mirror."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.stats import exponnorm, norm

from lightflight.reconstruct.model.cells import Cells, lag_edges
from lightflight.reconstruct.model.counted import lit_pixels
from lightflight.reconstruct.model.expected_counts import Pulses
from lightflight.reconstruct.model.pulse_shape import shape_of
from lightflight.reconstruct.model.second_path import (
    Mirror,
    Places,
    SecondPath,
    glow,
    return_ps_per_mm,
)
from lightflight.reconstruct.model.strength import knots_over, strength_as_seen
from lightflight.timing.clock.response import Response
from tests.oracles.worlds.border import camera_record
from tests.oracles.worlds.light import mirrored, stations
from tests.oracles.worlds.random_worlds import random_world

INDEX = 1.00027


@pytest.fixture(scope="module")
def world():
    plain = random_world(288, 1)
    depth = ((plain.vertices - plain.view.centre) @ plain.view.axes[2]).max()
    return plain.but(wall=1.0, wall_depth_mm=float(depth) + 40.0)


@pytest.fixture(scope="module")
def second(world):
    beam = stations(world, stride=0.5)
    way2 = np.sum((beam.place - world.view.centre) ** 2, axis=1)
    # Photons per area of one px^2; a pixel of area one on the line has them all.
    leg, beyond = np.zeros(len(way2), dtype=int), np.zeros(len(way2), dtype=bool)
    places = Places(
        beam.place, leg, beyond, beam.event_ps,
        beam.light * way2, world.spot_std_px, world.std_ps, return_ps_per_mm(INDEX),
    )  # fmt: skip
    forward = world.view.axes[2]
    mirror = Mirror(forward, world.wall_depth_mm + float(world.view.centre @ forward), np.ones(1))
    return SecondPath(mirror, places, camera_record(world.view))


def test_images_of_places_are_the_oracles(world, second):
    image = second.mirror.image_of(second.places.points_mm)
    np.testing.assert_allclose(image, mirrored(world, stations(world, stride=0.5)).place, atol=1e-9)


def test_light_falls_where_and_when_the_oracle_has_it(world, second):
    """Sums over all places by hand: photons, mean time and spread of it in every pixel."""
    rows, cols = (each.ravel() for each in np.indices(world.view.shape))
    shown = glow(second.mirror, second.places, second.camera).at(rows, cols)
    beam = mirrored(world, stations(world, stride=0.5))
    row, col = world.view.image(beam.place)
    away = np.subtract.outer(rows, row) ** 2 + np.subtract.outer(cols, col) ** 2
    spot = world.spot_std_px
    weight = beam.light * np.exp(-0.5 * away / spot**2) / (2.0 * np.pi * spot**2)
    photons = weight.sum(axis=1)
    lit = photons > 1e-2 * photons.max()
    assert lit.sum() > 30
    np.testing.assert_allclose(shown.photons[lit, 0], photons[lit], rtol=1e-3)
    mean = weight[lit] @ beam.arrival_ps / photons[lit]
    np.testing.assert_allclose(shown.arrival_ps[lit, 0], mean, atol=0.1)
    late = beam.arrival_ps - mean[:, np.newaxis]
    spread = np.sqrt(np.sum(weight[lit] * late**2, axis=1) / photons[lit] + world.std_ps**2)
    np.testing.assert_allclose(shown.std_ps[lit, 0], spread, rtol=1e-3)


def test_images_keep_the_tail_of_the_response(world, second):
    """A quarter of every pulse late by 200 ps: sums over all places by hand, cell by cell."""
    core, wait, late = 70.0, 200.0, 0.25
    response = Response.with_tail(std_ps=core, tail_ps=wait, tail_share=late)
    tailed = replace(second.places, std_ps=response.std_ps, shape=shape_of(response))
    rows, cols = (each.ravel() for each in np.indices(world.view.shape))
    shown = glow(second.mirror, tailed, second.camera).at(rows, cols)
    lit = np.flatnonzero(shown.photons[:, 0] > 0.1 * shown.photons.max())
    rows, cols, reference = rows[lit], cols[lit], shown.arrival_ps[lit, 0]
    edges = np.tile(np.linspace(-400.0, 1600.0, 41), (len(lit), 1))
    everywhere = np.ones((len(lit), 40))
    cells = Cells(edges, everywhere, everywhere > 0.0, 0.0 * everywhere, everywhere)
    path = replace(second, places=tailed)
    light, _, by = path.light(cells, rows, cols, reference)
    beam = mirrored(world, stations(world, stride=0.5))
    row, col = world.view.image(beam.place)
    away = np.subtract.outer(rows, row) ** 2 + np.subtract.outer(cols, col) ** 2
    weight = beam.light * np.exp(-0.5 * away / world.spot_std_px**2)
    weight /= 2.0 * np.pi * world.spot_std_px**2
    # The place of the response is its mean.
    start = reference[:, np.newaxis] + edges + late * wait
    for pixel in range(0, len(lit), max(len(lit) // 12, 1)):
        z = start[pixel, :, np.newaxis] - beam.arrival_ps
        come = (1.0 - late) * norm.cdf(z / core) + late * exponnorm.cdf(z / core, wait / core)
        expected = np.diff(come @ weight[pixel])
        np.testing.assert_allclose(light[pixel], expected, atol=4e-3 * expected.sum())
        # What comes after half a nanosecond is the tail's: a Gaussian has none of it there.
        tail = edges[pixel, :-1] > 500.0
        assert light[pixel, tail].sum() == pytest.approx(expected[tail].sum(), rel=0.02)
    for k, size in enumerate((1e-3, 1e-3, 0.1, 0.01)):
        step = np.zeros(4)
        step[k] = size
        ahead, back = (path.moved(s).light(cells, rows, cols, reference)[0] for s in (step, -step))
        slope = (ahead - back) / (2.0 * size)
        np.testing.assert_allclose(by[:, :, k], slope, atol=5e-3 * np.abs(slope).max())


def test_counts_follow_the_mirror_as_told(second):
    """Cells and codes hold the same light; derivatives are those of a step each way."""
    rows, cols = np.arange(6, 26), np.full(20, 15)
    shown = glow(second.mirror, second.places, second.camera).at(rows, cols)
    reference = shown.arrival_ps[:, 0] - 100.0
    edges = np.tile(lag_edges(70.0, 56.0, 1.3, 50_000.0), (20, 1))
    everywhere = np.ones((20, edges.shape[1] - 1))
    cells = Cells(edges, everywhere, everywhere > 0.0, 0.0 * everywhere, everywhere)
    light, _, by = second.light(cells, rows, cols, reference)
    low, up = (edges[:, part] + reference[:, np.newaxis] for part in (slice(-1), slice(1, None)))
    np.testing.assert_allclose(light, second.counts(rows, cols, (low, up), 0.0), atol=1e-6)
    assert light.sum() == pytest.approx(shown.photons.sum(), rel=1e-3)
    for k, size in enumerate((1e-3, 1e-3, 0.1, 0.01)):
        step = np.zeros(4)
        step[k] = size
        ahead, back = (
            second.moved(s).light(cells, rows, cols, reference)[0] for s in (step, -step)
        )
        slope = (ahead - back) / (2.0 * size)
        np.testing.assert_allclose(by[:, :, k], slope, atol=2e-3 * np.abs(slope).max())


def test_repeats_share_the_mirror(second):
    rows = cols = np.arange(5)
    one, half = (s.counts(rows, cols, (np.zeros((5, 1)), np.full((5, 1), 5e4)), 0.0)
                 for s in (second, second.times(0.5)))  # fmt: skip
    np.testing.assert_allclose(half, 0.5 * one)


def test_what_flies_beyond_the_mirror_has_no_image(second):
    """As in the search for it: the plane through the middle of the leg leaves half of the light."""
    normal = second.mirror.normal
    places = second.places
    depth = places.points_mm @ normal
    assert np.ptp(depth) > 1.0
    cut = Mirror(normal, float(np.median(depth)), np.ones(1))
    before = depth < cut.distance_mm
    alone = Places(
        places.points_mm[before], places.leg[before], places.beyond[before],
        places.event_ps[before], places.light[before],
        places.spot_px, places.std_ps, places.return_ps_per_mm,
    )  # fmt: skip
    shown, expected = (glow(cut, one, second.camera) for one in (places, alone))
    assert expected.photons.sum() > 0.0
    np.testing.assert_allclose(shown.photons, expected.photons, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("bright", [0.0, 1.0, 2.0])
def test_images_of_what_nobody_saw_are_as_bright_as_their_pixels_say(bright):
    """Noiseless counts: told as it is the image moves no time, told as certain it moves it."""
    edges = lag_edges(70.0, 56.0, 1.3, 50_000.0)[np.newaxis]
    everywhere = np.ones((1, edges.shape[1] - 1))
    pulse, image = (
        photons * np.diff(norm.cdf(edges, late, 70.0))
        for late, photons in ((0.0, 1e5), (150.0, 1e4))
    )
    counts = pulse + bright * image + 1e-3 * np.diff(edges)
    cells = Cells(edges, counts, everywhere > 0.0, 0.0 * everywhere, everywhere)
    expected = Pulses(np.zeros((1, 1)), np.full((1, 1), 70.0))
    own = lit_pixels(cells, expected, other=image, beyond=image)
    told = lit_pixels(cells, expected, other=image)
    assert abs(own.late_ps[0, 0]) < 0.05
    assert abs(told.late_ps[0, 0]) > 4.0 * abs(bright - 1.0)
    # What is not known has its price: the time is known worse for it.
    if bright == 1.0:
        assert own.inverse[0, 1, 1] > 1.02 * told.inverse[0, 1, 1]


def test_light_that_the_picture_does_not_show_is_that_of_its_edge():
    """A spline runs off where no pixel holds it: as far as the last one it is believed, or as far
    as it knows itself."""
    knots = knots_over(0.0, 30.0)
    coefficients, variance = np.zeros((2, len(knots) - 4))
    coefficients[-1] = 5.0
    spline, places, most = BSpline(knots, coefficients, 3), np.array([-9.0, 15.0, 40.0]), np.inf
    strength, beyond = strength_as_seen(spline, np.diag(variance), most, places)
    np.testing.assert_allclose(strength[:2], 1.0, rtol=1e-9)
    assert strength[2] < np.exp(2.0)
    np.testing.assert_array_equal(beyond, [True, False, True])
    coefficients[-2], variance[-2:] = 30.0, 100.0
    strength, _ = strength_as_seen(spline, np.diag(variance), most, places)
    assert strength[2] < np.exp(4.0)
    # Sure of itself, but brighter than any pixel.
    strength, _ = strength_as_seen(spline, np.zeros((len(knots) - 4,) * 2), 1.0, places)
    assert strength[2] < np.exp(2.0)
