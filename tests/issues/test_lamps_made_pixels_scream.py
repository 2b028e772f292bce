"""Pixels that a lamp makes fire in most frames, like all others, were called screaming."""

import numpy as np

import lightflight as lf
from lightflight.recording.description import describe_recording


def test_pixels_under_a_lamp_do_not_scream(rng):
    """A code density at 60 % occupancy: half of the quiet pixels lie above, screaming ones far."""
    n_frames, shape = 20_000, (10, 10)
    n_photons = rng.binomial(n_frames, 0.6, shape)
    n_photons[2, 3] = n_photons[7, 1] = 0.9 * n_frames
    counts = np.zeros((*shape, 51), dtype=np.uint32)
    counts[..., 1:] = rng.multinomial(n_photons, np.full(50, 1 / 50))
    counts[..., 0] = n_frames - n_photons
    hist = lf.Histograms(
        counts, bin_width_ps=55.0, n_frames=n_frames, periods_per_frame=4000, no_photon_code=0
    )
    assert (n_photons > 0.6 * n_frames).sum() > 30
    assert describe_recording(hist).n_screaming == 2
