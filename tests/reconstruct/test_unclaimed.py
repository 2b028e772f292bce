"""Legs that the search in the picture leaves out, told by light that no other leg explains."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import lightflight as lf
from benchmarks.check_blind_scenes import (
    PHOTONS,
    Case,
    Outcome,
    calibration,
    drawn_case,
    judged,
)
from lightflight.reconstruct.ways import joint as api
from lightflight.simulate.presets import ideal, paper_scene
from tests.oracles.brute_force import expected_counts


@cache
def recorded(seed: int) -> tuple[Case, np.ndarray]:
    """A scene of up to six legs and what the brute-force oracle counts of it."""
    case = drawn_case(seed, most_legs=6)
    mean = expected_counts(case.scene, brightest=PHOTONS)
    return case, np.random.default_rng([seed, 99]).poisson(mean)


def verdict_on(seed: int) -> Outcome:
    """How `joint` does on it."""
    case, counts = recorded(seed)
    scene = case.scene
    source = lf.Source(scene.vertices[0], emission_time_ps=scene.emission_time, pulse_fwhm_ps=68.0)
    return judged(case, counts, source, calibration(scene.clock, scene.tail), "joint", PHOTONS)


# A last leg of 6 px behind a corner in the picture; one of 7 px that the next runs back along; one
# of 7 px whose neighbour took its light for its own end.
@pytest.mark.long
@pytest.mark.usefixtures("unexamined")
@pytest.mark.parametrize("seed", [8130, 8184, 8303])
def test_short_legs_are_found_by_their_light(seed):
    assert verdict_on(seed).failure == ""


@pytest.mark.long
@pytest.mark.usefixtures("unexamined")
def test_without_a_second_look_a_leg_is_missed(monkeypatch):
    """The scenes above are hard indeed: what they test is the second look."""
    monkeypatch.setattr(api, "with_unclaimed_legs", lambda _found, _legs, fit, _setting: fit)
    assert verdict_on(8130).failure.startswith("legs")


@pytest.mark.filterwarnings("ignore:the recording contradicts")  # the screw does
@pytest.mark.filterwarnings("ignore:check this path")
@pytest.mark.parametrize(
    "code", [60, *(pytest.param(code, marks=pytest.mark.long) for code in (140, 230))]
)
def test_a_shiny_screw_is_no_leg(code):
    """Light beside the path that no flight can join: 12 pixels that flash at one time."""
    scene = paper_scene(detector=ideal(psf_std_px=0.35))
    hist = lf.simulate(scene, photons_per_pixel=2000.0, seed=4, threads=1)
    counts = np.array(hist.counts)
    rng = np.random.default_rng(code)
    flash = rng.normal(code, 1.5, (4, 3, 400)).round().astype(int)
    for (row, col), codes in zip(np.ndindex(4, 3), flash.reshape(-1, 400), strict=True):
        counts[4 + row, 3 + col] += np.bincount(codes, minlength=hist.n_codes).astype(counts.dtype)
    disturbed = replace(hist, counts=counts)
    path = lf.reconstruct(
        disturbed,
        camera=scene.camera,
        source=scene.source,
        timing=lf.TimingCalibration.nominal(hist),
    )
    assert path.n_legs == 3
    assert lf.path_error(path, hist.truth, scene.camera)[0] < 1.0
