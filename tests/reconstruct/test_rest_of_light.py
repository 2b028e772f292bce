"""The rest of the light along a leg: slopes of what a spline leaves out, and their errors.

The light is points and waves of which the picture as seen is known in closed form; nothing is taken
from the package but the two functions asked.
"""

from __future__ import annotations

import numpy as np
import pytest

from lightflight.reconstruct.fit.rest_of_light import Rest, rest_of_light, slopes_of_rest

_SPOT_PX = 0.38
_PHOTONS = 30_000.0
_ALIKE_PX = 1.0


def drawn(seed, *, n_grains=2, wave=0.0):
    """Places, what photons show of the rest, its noise and its true slopes, at three rows' pixels.

    Grains ten times as bright as the light of a pixel, and waves of 9 px.
    """
    rng = np.random.default_rng([seed, 71])
    places = np.sort((np.arange(32) + np.array([[-0.1], [0.0], [0.1]])).ravel())
    grains = rng.uniform(3.0, 29.0, n_grains)
    bright = 10.0 * np.sqrt(2.0 * np.pi) * _SPOT_PX * rng.uniform(0.2, 1.0, n_grains)
    off = places[:, np.newaxis] - grains
    shown = bright * np.exp(-0.5 * (off / _SPOT_PX) ** 2)
    phase = 2.0 * np.pi * places / 9.0
    light = np.exp(wave * np.sin(phase)) + shown.sum(axis=1)
    steep = wave * np.cos(phase) * 2.0 * np.pi / 9.0 * np.exp(wave * np.sin(phase))
    slope = (steep - (shown * off).sum(axis=1) / _SPOT_PX**2) / light
    photons = rng.poisson(_PHOTONS * light)
    rest = np.log(photons / _PHOTONS)
    return places, rest - np.average(rest, weights=photons), 1.0 / photons, slope


def found_in(places, rest, noise):
    return rest_of_light(places, rest, noise, alike_px=_ALIKE_PX, spot_px=_SPOT_PX)


@pytest.mark.parametrize("patches", [(), ((2.3, 0.6),), ((2.3, 0.6), (4.1, 1.2))])
def test_slopes_are_those_of_the_covariance(patches):
    rest, step = Rest(0.1, 1.0, patches, 0.6), 1e-4
    one, other = np.linspace(0.0, 5.0, 7), np.linspace(0.3, 4.4, 5)
    by_first = rest.covariance(one + step, other) - rest.covariance(one - step, other)
    assert rest.of_slope(one, other) == pytest.approx(by_first / (2 * step), abs=1e-7)
    by_both = rest.of_slope(one, one + step) - rest.of_slope(one, one - step)
    assert rest.of_slopes(one) == pytest.approx(by_both / (2 * step), abs=1e-6)


def test_even_light_has_no_patch():
    """40 legs of even light and unequal pixels: a patch costs as much as to have looked for one, so
    one leg in some twenty has one by chance, and six by less than 1e-4."""
    rng = np.random.default_rng(5)
    patched = 0
    for seed in range(40):
        places, rest, noise, _ = drawn(seed, n_grains=0)
        found = found_in(places, rest + 0.03 * rng.normal(size=len(rest)), noise)
        patched += found is not None and bool(found[0].patches)
    assert patched < 6


@pytest.mark.parametrize(("n_grains", "wave"), [(2, 0.0), (2, 0.1), (0, 0.2)])
def test_errors_of_slopes_are_those_stated(n_grains, wave):
    """Rms pull of slopes where the rest is steep (0.1 a pixel and more), 40 legs."""
    pulls, before, after = [], [], []
    for seed in range(40):
        places, rest, noise, slope = drawn(seed, n_grains=n_grains, wave=wave)
        found = found_in(places, rest, noise)
        assert found is not None
        model, factor = found
        mean, columns = slopes_of_rest(model, factor, rest, places, places)
        std = np.sqrt((columns**2).sum(axis=1))
        steep = np.abs(slope) > 0.1
        pulls.append(((mean - slope) / std)[steep])
        before.append(slope[steep])
        after.append((mean - slope)[steep])
    rms = [float(np.sqrt(np.mean(np.concatenate(each) ** 2))) for each in (pulls, before, after)]
    # 1.2 and 0.04 of what they were with grains, 0.74 and 0.1 with waves alone.
    assert 0.5 < rms[0] < 1.5
    assert rms[2] < 0.15 * rms[1]
