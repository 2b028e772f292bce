"""The pf32 preset against the code-density recording of a real PF32."""

from __future__ import annotations

import numpy as np
import pytest

from lightflight import Camera
from lightflight.simulate import Scene, pf32, simulate


@pytest.fixture(scope="module")
def real(data_dir):
    file = data_dir / "pf32-codedensity-20mhz" / "pf32_codedensity_20mhz.npz"
    if not file.is_file():
        pytest.skip(f"no code-density recording at {file}")
    with np.load(file) as archive:
        return archive["hist"].astype(np.int64)


@pytest.fixture(scope="module")
def twin():
    camera = Camera.facing_plane((32, 32))
    scene = Scene([(-200, 0, 0), (200, 0, 0)], camera=camera, detector=pf32(seed=0))
    # the real one: 50,000 frames, an occupancy of 15 %
    hist = simulate(scene, kind="code_density", photons_per_pixel=7300.0, n_frames=50_000)
    return hist.counts.astype(np.int64)


def profile(cube):
    """Counts of the quiet pixels per code, in units of the plateau."""
    quiet = cube[..., 0] > 0.7 * cube.sum(axis=2)
    total = cube[quiet].sum(axis=0).astype(float)
    return total / total[104:800].mean()


def phase_profile(cube):
    one = profile(cube)
    return np.array([one[104 + k : 800 : 8].mean() for k in range(8)])


def test_codes_are_as_wide_as_the_real_ones(real, twin):
    np.testing.assert_allclose(phase_profile(twin), phase_profile(real), atol=0.012)
    first = slice(8, 11)
    np.testing.assert_allclose(profile(twin)[first], profile(real)[first], atol=0.06)
    assert profile(real)[1:8].max() < 0.01
    assert profile(twin)[1:8].max() == 0


def test_period_ends_where_the_real_one_does_and_as_softly(real, twin):
    ends, spreads = [], []
    for cube in (real, twin):
        tail = profile(cube)[880:960]
        tail = tail / np.tile(phase_profile(cube), 10)
        fall = -np.diff(np.convolve(tail, np.ones(8) / 8, mode="valid"))
        code = 884.0 + np.arange(len(fall))
        end = np.average(code, weights=np.maximum(fall, 0))
        ends.append(end)
        spreads.append(np.sqrt(np.average((code - end) ** 2, weights=np.maximum(fall, 0))))
    assert ends[1] == pytest.approx(ends[0], abs=1.5)
    assert spreads[1] == pytest.approx(spreads[0], rel=0.25)


def test_as_many_pixels_scream_as_in_the_real_one(real, twin):
    for cube in (real, twin):
        occupancy = cube[..., 1:].sum(axis=2) / 50_000
        assert np.count_nonzero(occupancy > 0.6) == 73
    screaming = [np.sort((c[..., 1:].sum(axis=2) / 50_000).ravel())[-73:] for c in (real, twin)]
    assert np.median(screaming[1]) == pytest.approx(np.median(screaming[0]), abs=0.05)


def test_pixels_differ_in_their_eight_phases_as_the_real_ones(real, twin):
    # covariance between even and odd groups of eight codes: Poisson noise drops out
    spreads = []
    for cube in (real, twin):
        quiet = cube[..., 0] > 0.7 * cube.sum(axis=2)
        groups = cube[quiet][:, 104:792].reshape(-1, 86, 8)
        halves = []
        for part in (groups[:, 0::2], groups[:, 1::2]):
            counts = part.sum(axis=1).astype(float)
            share = counts / counts.mean(axis=1, keepdims=True)
            halves.append(share - share.mean(axis=0))
        spreads.append(np.sqrt((halves[0] * halves[1]).mean()))
    # 891 pixels x 8 phases, 350 counts in each half: 0.0006 standard error
    assert spreads[0] == pytest.approx(0.030, abs=0.002)
    assert spreads[1] == pytest.approx(spreads[0], abs=0.004)
