"""`info --plot` answers: was there light, and when?"""

from __future__ import annotations

import numpy as np
import pytest

import lightflight as lf
from lightflight.recording.description import codes_of_pulses
from lightflight.view.figures.recording import draw_counts, recording_figure


def histograms(light: float, *, scream: int = 0, seed: int = 1) -> lf.Histograms:
    """32 x 32 pixels of 1,024 codes, even background, light at codes 600 to 640 of one row."""
    rng = np.random.default_rng(seed)
    widths = 1.0 + 0.1 * np.cos(np.arange(1024))  # codes are unequally wide
    rate = np.broadcast_to(12.0 * widths, (32, 32, 1024)).copy()
    rate[..., 900:] = 0.0
    for col in range(32):
        rate[16, col, 600 + col : 606 + col] += light
    counts = rng.poisson(rate)
    counts[..., 8] += 10  # the first live code holds what came before it
    counts.reshape(-1, 1024)[rng.permutation(1024)[:scream]] += 2_000
    return lf.Histograms(counts, bin_width_ps=55.0, laser_period_ps=50_000.0, n_frames=10**6)


@pytest.mark.parametrize("scream", [0, 73])
def test_light_is_found_where_it_is(scream):
    found = codes_of_pulses(histograms(2_000.0, scream=scream))
    assert found is not None
    assert 590 <= found[0] <= 604
    assert 632 <= found[1] <= 645


@pytest.mark.parametrize("seed", range(20))
def test_without_light_none_is_told(seed):
    """A hundredth of the pixels by chance: never, by the limits of `_pulse_pixels`."""
    assert codes_of_pulses(histograms(0.0, scream=50, seed=seed)) is None


@pytest.mark.parametrize("light", [0.0, 2_000.0])
def test_the_answer_is_the_heading(light):
    figure = recording_figure(histograms(light), title="a.h5")
    said = figure.get_suptitle()
    assert said.startswith("a.h5: ")
    assert ("no pulse in it" in said) == (light == 0.0)


def test_screaming_pixels_are_crossed_out_and_do_not_set_the_scale():
    ax = draw_counts(histograms(2_000.0, scream=73))
    (crosses,) = (line for line in ax.lines if line.get_marker() == "x")
    assert 60 <= np.size(crosses.get_xdata()) <= 73
    assert np.max(ax.images[0].norm.vmax) < 100_000


@pytest.mark.parametrize("counts", [np.zeros((3, 3, 64), int), np.full((1, 1, 4), 7)])
def test_odd_recordings_have_a_figure(counts):
    recording_figure(lf.Histograms(counts)).canvas.draw()
