"""Haze in a recording: its strengths, and the path beside it, without bias and with honest errors.

Recordings of the oracle: one leg, source and emission time told as exact, 40,000 photons in the
brightest pixel, a fifth of the light late by 500 ps.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from lightflight.errors import LightflightWarning
from lightflight.reconstruct.model.light import LATE_PS
from lightflight.reconstruct.model.setting import Setting
from lightflight.reconstruct.sightings import sighting_from_histograms
from lightflight.reconstruct.ways.joint import fit_of_request
from lightflight.reconstruct.ways.request import Request
from tests.oracles.worlds.border import record, what_the_user_tells
from tests.oracles.worlds.random_worlds import random_world

HAZE, WAIT_PS, N = 0.2, 500.0, 4


def fitted(seed: int):
    """The joint fit of a recording of one leg in haze, and its world."""
    world = random_world(seed, 1).but(haze=HAZE, haze_ps=WAIT_PS)
    told = what_the_user_tells(world)
    setting = Setting(told["camera"], told["source"], told["medium"], (), ())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LightflightWarning)
        seen = sighting_from_histograms(
            record(world, seed), setting, timing=told["timing"], background=None,
            exclude_mask=None, least_squares=False,
        )  # fmt: skip
        return fit_of_request(Request([seen], setting, told["timing"], None, None)), world


def off_and_covariance(fit, world):
    """Error (2,) of where the leg ends, square to it, in mm, and its stated covariance."""
    truth = np.diff(world.vertices, axis=0)[0]
    frame = np.linalg.svd(truth[np.newaxis])[2][1:]
    step = np.diff(fit.solution.state.vertices_mm, axis=0)[0]
    # The path ends where the view does: its direction is carried on to the world's vertex.
    longer = float(truth @ truth / (step @ truth))
    n_free = fit.freedom.basis.shape[1]
    moved = frame @ fit.freedom.basis[3:6]
    covariance = longer**2 * moved @ fit.solution.covariance[:n_free, :n_free] @ moved.T
    return frame @ (longer * step - truth), covariance


@pytest.fixture(scope="module")
def recovered():
    return [fitted(seed) for seed in range(600, 600 + N)]


def test_strengths_have_no_bias_and_honest_errors(recovered):
    """Four recordings, 3 strengths each; false alarm 1e-4 for either claim."""
    truth = np.where(np.array(LATE_PS) == WAIT_PS, HAZE, 0.0)
    pulls = []
    for fit, _ in recovered:
        found = fit.strengths[0]
        root = np.linalg.cholesky(found.covariance[:3, :3])
        pulls.append(np.linalg.solve(root, found.value[:3] - truth))
        # One part in two hundred of the light is told, or the claim below is an easy one.
        assert np.sqrt(found.covariance[1, 1]) < 5e-3
    z = np.array(pulls)
    assert (np.abs(z.mean(axis=0)) * np.sqrt(N) < 4.2).all()
    # Chi-square of 12 numbers: between 1.26 and 40.9 but once in 10,000.
    assert 0.32 < np.sqrt(np.mean(z**2)) < 1.85


def test_the_path_has_no_bias_and_honest_errors(recovered):
    """Four recordings, 2 numbers each; false alarm 1e-4 for either claim. Before: pulls of 9."""
    pulls, off = [], []
    for fit, world in recovered:
        error, covariance = off_and_covariance(fit, world)
        pulls.append(np.linalg.solve(np.linalg.cholesky(covariance), error))
        off.append(np.linalg.norm(error))
    z = np.array(pulls)
    assert (np.abs(z.mean(axis=0)) * np.sqrt(N) < 4.1).all()
    # Chi-square of 8 numbers: between 0.39 and 33.5 but once in 10,000.
    assert 0.22 < np.sqrt(np.mean(z**2)) < 2.05
    # Spread: without a place for haze, 5 mm.
    assert np.sqrt(np.mean(np.square(off))) < 0.15
