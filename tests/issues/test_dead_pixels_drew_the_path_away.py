"""Three in ten pixels died after the calibration: taken for darkness, they moved a path by 2 mm."""

from dataclasses import replace

import numpy as np
import pytest

import lightflight as lf
from lightflight import flags
from tests.labs import three_legs


@pytest.fixture(scope="module")
def recorded():
    lab = three_legs()
    hist, rng = lab.recording(4, 20_000.0), np.random.default_rng(4)
    lamp = rng.poisson(1.0, hist.counts.shape).astype(hist.counts.dtype)
    dead = rng.random(hist.shape) < 0.3
    return lab, replace(hist, counts=np.where(dead[..., np.newaxis], 0, hist.counts + lamp)), dead


def test_the_path_is_as_if_they_were_masked(recorded):
    lab, hist, dead = recorded
    told = {"camera": lab.camera, "source": lab.known, "timing": lab.timing}
    path = lf.reconstruct(hist, **told)
    masked = lf.reconstruct(hist, exclude_mask=dead, **told)
    assert path.verdict.level == "trust"
    np.testing.assert_allclose(path.vertices_mm, masked.vertices_mm, atol=1e-6)


def test_they_are_told(recorded):
    lab, hist, dead = recorded
    found = lf.find_arrivals(hist, timing=lab.timing)
    told = np.zeros(hist.shape, dtype=bool)
    told[found.row, found.col] = (found.flags & np.uint32(flags.DEAD)) != 0
    np.testing.assert_array_equal(told, dead)


def test_darkness_is_not_death(rng):
    """Few counts: pixels without any are as they should be."""
    counts = rng.poisson(0.02, (32, 32, 200)).astype(np.uint32)
    counts[10, :, 100:103] += 50
    found = lf.find_arrivals(lf.Histograms(counts, bin_width_ps=50.0), timing=None)
    assert (counts.sum(axis=2) == 0).sum() > 5
    assert not ((found.flags & np.uint32(flags.DEAD)) != 0).any()
