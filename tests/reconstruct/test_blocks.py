"""Beams through blocks of glass that were told, against an oracle that shoots its rays itself.

Full tables are `benchmarks/refraction.py --told-block`; here a sample, at seeds fixed before
looking.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2, norm

import lightflight as lf
from lightflight.errors import GeometryError, SuspectDataWarning
from lightflight.reconstruct.model.geometry import PathState, arrival_jacobian, vertex_time_jacobian
from lightflight.reconstruct.model.glass import looks_at_blocks, through_blocks
from lightflight.simulate.light import expected_light, segments_from_scene
from lightflight.simulate.presets import ideal, paper_scene
from tests.oracles.refracted import (
    AIR,
    BK7,
    block_world,
    expected_counts,
    positions_at,
    stations,
)
from tests.oracles.refracted_border import (
    block_told,
    camera_told,
    histograms,
    what_the_user_tells,
)
from tests.oracles.refracted_bound import block_freedoms, bound

FALSE_ALARM = 1e-5
"""Chance that a right estimator fails one of the three things that are asked of each of the two
tilts: 6e-5 over all."""
SEEDS = range(60, 64)


def told(scene: Any, hist: lf.Histograms, *blocks: lf.Block) -> dict[str, Any]:
    call = what_the_user_tells(scene, hist)
    return call | {"medium": replace(call["medium"], blocks=blocks)}


def quiet(hist: lf.Histograms, **call: Any) -> lf.LightPath:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SuspectDataWarning)
        return lf.reconstruct(hist, **call)


def whitened_off(path: lf.LightPath, scene: Any) -> np.ndarray:
    """(2,) where the pulse is 100 ps before its exit from view, off the truth across the beam."""
    late = np.array([path.vertex_times_ps[-1] - 100.0])
    ahead = np.diff(scene.vertices_mm[-2:], axis=0)[0]
    across = np.linalg.svd(ahead[np.newaxis])[2][1:]
    off = across @ (path.position_at(late) - positions_at(scene, late))[0]
    stated = across @ path.position_covariance_at(late)[0] @ across.T
    return np.asarray(np.linalg.solve(np.linalg.cholesky(stated), off))


@pytest.mark.parametrize("tilt_deg", [pytest.param(0.0, marks=pytest.mark.long), 25.0])
def test_a_told_block_is_as_good_as_its_bound(tilt_deg):
    """Four recordings of each, every other one with light in the glass.

    Bias (of two directions), spread by the stated errors, and these over the bound, which rests on
    the pixels that look at the glass as well (1.2 at most).
    """
    offs = []
    for seed in SEEDS:
        scene = block_world(float(seed % 2), tilt_deg)
        hist = histograms(scene, seed)
        path = quiet(hist, **told(scene, hist, block_told(tilt_deg)))
        assert path.n_legs == 3
        assert path.legs_in_glass == (1,)
        # `block` would be silent, `contradicted` a false alarm of a millionth.
        assert path.verdict.level != "contradicted"
        offs.append(whitened_off(path, scene))
    off = np.array(offs)
    n = off.size
    assert np.abs(off.mean(axis=0)).max() < norm.isf(FALSE_ALARM / 4) / np.sqrt(len(off))
    low, high = chi2.interval(1.0 - FALSE_ALARM, n)
    assert low < np.sum(off**2) < high
    least = bound(block_world(0.0, tilt_deg), vertices=(), also=block_freedoms(tilt_deg))
    times = path.sample(400)["event_time_ps"][path.sample(400)["in_view"]]
    stated = np.trace(path.position_covariance_at(times), axis1=1, axis2=2).mean()
    assert np.sqrt(stated) < 1.2 * least.position_rms_mm


def test_a_block_told_too_thin_is_named_block(as_found):
    """By 8 mm, 14 ps: of one direction and silent at a millionth."""
    scene = block_world(0.0)
    hist = histograms(scene, 80)
    path = quiet(hist, **told(scene, hist, block_told(thickness_mm=12.0)))
    assert path.verdict.level == "contradicted"
    assert path.verdict.findings[0].name == "block"


@pytest.mark.parametrize("method", [pytest.param("joint", marks=pytest.mark.long), "photon"])
def test_nothing_known_of_the_source(method):
    scene = block_world(0.0, 25.0)
    hist = histograms(scene, 81)
    call = told(scene, hist, block_told(25.0)) | {"source": lf.Source(), "n_legs": 1}
    path = lf.reconstruct(hist, method=method, **call)
    assert path.legs_in_glass == (1,)
    assert path.verdict.level == "trust"
    # Six stated errors of a gauge-free direction: false alarm 2e-8.
    assert np.abs(whitened_off(path, scene)).max() < 6.0


def test_glass_between_the_source_and_the_picture_is_counted_too():
    """No picture shows the faces: leg 1 is dark, and what is seen is late and moved aside."""
    vertices = np.array([[-120.0, 0.0, 0.0], [375.0, 40.0, 30.0]])
    block = lf.Block((20.0, 11.5, 8.5), (1.0, 0.1, 0.5), thickness_mm=20.0, diameter_mm=60.0,
                     glass=lf.Material(*BK7))  # fmt: skip
    scene = replace(
        paper_scene(ideal(psf_std_px=0.35, active_width_px=0.12)),
        vertices_mm=vertices, medium=lf.Medium(blocks=block),
    )  # fmt: skip
    hist = lf.simulate(scene, photons_per_pixel=40_000.0, seed=82)
    call = {"camera": scene.camera, "timing": lf.TimingCalibration.nominal(hist),
            "source": lf.Source(tuple(vertices[0]), emission_time_ps=2000.0)}  # fmt: skip
    path = lf.reconstruct(hist, medium=scene.medium, **call)
    assert path.legs_in_glass == (1,)
    error = lf.path_error(path, hist.truth, scene.camera).position_rms_mm
    assert error < 5.0 * lf.bounds(scene, source=call["source"]).position_rms_mm
    untold = quiet(hist, **call)
    assert lf.path_error(untold, hist.truth, scene.camera).position_rms_mm > 1.0


def test_one_of_three_legs_crosses_a_block_and_two_blocks_stand_in_one():
    scene = paper_scene(ideal(psf_std_px=0.35, active_width_px=0.12))
    first, second = np.asarray(scene.vertices_mm)[:2], np.asarray(scene.vertices_mm)[1:3]
    glass = lf.Material(*BK7)
    blocks = (
        lf.Block(0.5 * first.sum(axis=0), (1.0, 0.1, 0.3), thickness_mm=10.0, diameter_mm=12.0,
                 glass=glass),
        lf.Block(second[0] + 0.35 * np.diff(second, axis=0)[0], (1.0, -0.2, 0.0), thickness_mm=8.0,
                 diameter_mm=12.0, glass=glass),
        lf.Block(second[0] + 0.65 * np.diff(second, axis=0)[0], (1.0, 0.0, 0.0), thickness_mm=8.0,
                 diameter_mm=12.0, glass=glass),
    )  # fmt: skip
    scene = replace(scene, medium=lf.Medium(blocks=blocks))
    assert scene.n_legs == 3
    assert scene.n_pieces == 9
    hist = lf.simulate(scene, photons_per_pixel=40_000.0, seed=83)
    path = lf.reconstruct(
        hist, camera=scene.camera, source=lf.Source((0, 0, 0), emission_time_ps=2000.0),
        medium=scene.medium, timing=lf.TimingCalibration.nominal(hist), n_legs=3,
    )  # fmt: skip
    assert path.legs_in_glass == (1, 4, 6)
    assert path.verdict.level != "contradicted"
    least = lf.bounds(scene, source=path.source).position_rms_mm
    assert lf.path_error(path, hist.truth, scene.camera).position_rms_mm < 3.0 * least
    # And the same from the path that was found, with a mirror measured, which counts no faces.
    again = lf.reconstruct(
        hist, camera=scene.camera, source=path.source, medium=scene.medium,
        timing=lf.TimingCalibration.nominal(hist), start=path,
        waypoints=[(2, np.asarray(scene.vertices_mm)[2], 1e-3)],
    )  # fmt: skip
    assert again.legs_in_glass == (1, 4, 6)
    np.testing.assert_allclose(again.vertices_mm, path.vertices_mm, atol=0.2)
    assert path.vertex_std[8, :3].max() > 0.005
    assert again.vertex_std[8, :3].max() <= 1.001e-3


def test_times_follow_the_free_vertices_exactly():
    """Central differences of moves that put faces' vertices back, against the derivatives."""
    scene = block_world(0.0, 25.0)
    camera, medium = camera_told(scene), lf.Medium(blocks=block_told(25.0))
    state = PathState(scene.vertices_mm[[0, 3]], 2000.0)
    state = through_blocks(state, medium.blocks, (camera,))
    np.testing.assert_allclose(state.vertices_mm, scene.vertices_mm, atol=1e-9)
    np.testing.assert_allclose(state.vertex_times_ps(medium), scene.vertex_times_ps, atol=1e-8)
    rows, cols = np.array([17.0, 18.0, 16.0, 15.0]), np.array([3.0, 10.0, 22.0, 29.0])
    legs = np.array([0, 0, 2, 2])
    # Pixels on the legs: the foot of any other slides to first order only.
    share = np.array([0.4, 0.7, 0.3, 0.6])
    rows, cols = camera.pixels_from_points(state.points_mm(legs, share))

    def times(where: PathState) -> np.ndarray:
        found = arrival_jacobian(
            where, camera=camera, medium=medium, legs=legs, rows=rows, cols=cols
        )
        return np.concatenate((found[0].arrival_ps, where.vertex_times_ps(medium)))

    _, slopes = arrival_jacobian(
        state, camera=camera, medium=medium, legs=legs, rows=rows, cols=cols
    )
    of_times = vertex_time_jacobian(state, medium).reshape(-1, 4, state.size)[:, 3]
    exact = np.concatenate((slopes, of_times)) @ state.free_moves
    for k in (0, 1, 2, 9, 10, 11, 12):
        step = 1e-4 * np.eye(state.size)[k]
        change = (times(state.moved(step)) - times(state.moved(-step))) / 2e-4
        np.testing.assert_allclose(change, exact[:, k], atol=2e-5)
    assert not exact[:, 3:9].any()


def test_the_twin_draws_what_the_oracle_expects():
    """Photons and mean arrival of every pixel, tilted block, none from within the glass."""
    oracle = block_world(0.0, 25.0)
    scene = lf.Scene(
        oracle.vertices_mm[[0, 3]], camera=camera_told(oracle),
        medium=lf.Medium(blocks=block_told(25.0)),
        source=lf.Source(oracle.vertices_mm[0], emission_time_ps=2000.0),
        detector=ideal(psf_std_px=oracle.spot_std_px, active_width_px=oracle.active_side_px),
    )  # fmt: skip
    np.testing.assert_allclose(scene.flown_mm, oracle.vertices_mm, atol=1e-9)
    drawn = expected_light(scene, segments_from_scene(scene), np.ones(scene.shape))
    counts = expected_counts(replace(oracle, background_per_ps=0.0))
    light = counts.sum(axis=2)
    bright = light > 100.0
    share = drawn.counts.sum(axis=0)[bright] / light[bright]
    np.testing.assert_allclose(share / share.mean(), 1.0, atol=2e-3)
    when = counts @ (55.0 * (np.arange(counts.shape[2]) + 0.5)) / np.maximum(light, 1e-9)
    mean = np.nansum(drawn.counts * np.nan_to_num(drawn.mean_arrival_ps), axis=0)
    mean /= np.maximum(drawn.counts.sum(axis=0), 1e-300)
    np.testing.assert_allclose(mean[bright], when[bright], atol=0.05)
    assert stations(oracle).light.sum() > 0.0


def test_pixels_that_look_at_the_glass_take_no_part():
    scene = block_world(1.0)
    hist = histograms(scene, 84)
    path = quiet(hist, **told(scene, hist, block_told()))
    hidden = looks_at_blocks(camera_told(scene), (block_told(),))
    assert 20 < hidden.sum() < 100
    assert not hidden[path.residuals["row"], path.residuals["col"]].any()
    assert set(path.residuals["leg"]) == {0, 2}
    # One direction from an exact source: errors grow with the way, across faces as elsewhere.
    grown = path.vertex_std[1:3, 2] / path.vertex_std[3, 2]
    ways = np.linalg.norm(path.vertices_mm, axis=1)
    np.testing.assert_allclose(grown, ways[1:3] / ways[3], rtol=0.1)


def test_what_cannot_be_is_refused_in_a_sentence():
    scene = block_world(0.0)
    hist = histograms(scene, 85)
    beside = block_told(center_mm=(187.5, 90.0, 15.0))
    with pytest.raises(GeometryError, match="does not cross the block of 20 mm of glass"):
        quiet(hist, **told(scene, hist, beside))
    with pytest.raises(ValueError, match="method='paper' knows one medium, and a block"):
        quiet(hist, method="paper", **told(scene, hist, block_told()))
    within = told(scene, hist, block_told())
    within["start"] = np.array([scene.vertices_mm[0], scene.vertices_mm[1:3].mean(axis=0)])
    with pytest.raises(GeometryError, match="which light enters and never leaves"):
        quiet(hist, **within)
    with pytest.raises(ValueError, match="can neither fork nor be polarised"):
        lf.Scene(
            [(0, 0, 0), (375, 40, 30), (0, 60, 0), (0, 0, 90)], forks=((2, 1),),
            camera=camera_told(scene), medium=lf.Medium(AIR, AIR, blocks=block_told()),
        )  # fmt: skip
