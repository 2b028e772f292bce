"""Without a laser period, fits of pulses that reach beyond one end of the codes never settled.

A fit looks at a window that must hold all of its pulses; where nothing folds there is nothing
beyond the first code, yet the window was moved there sixty times. A flat with a tail took a minute
to end in "time_ps must be finite and ascend".
"""

import numpy as np
import pytest

import lightflight as lf
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.pulses import fit_pulses

CODE_PS, N_CODES = 20.0, 150
STD_PS, TAIL_PS, SHARE = 60.0, 150.0, 0.3


def counts(centre_ps, n_pixels, *, photons=1000, seed=4):
    """Pulses with a tail, photon by photon, and 30 of the background."""
    rng = np.random.default_rng(seed)
    out = np.zeros((1, n_pixels, N_CODES), dtype=np.int64)
    for pixel in range(n_pixels):
        n = rng.poisson(photons)
        late_ps = np.where(rng.random(n) < SHARE, rng.exponential(TAIL_PS, n), 0.0)
        times_ps = np.concatenate(
            (
                centre_ps + rng.normal(0.0, STD_PS, n) + late_ps,
                rng.uniform(0.0, N_CODES * CODE_PS, rng.poisson(30)),
            )
        )
        codes = np.floor(times_ps / CODE_PS).astype(int)
        out[0, pixel] = np.bincount(codes[(codes >= 0) & (codes < N_CODES)], minlength=N_CODES)
    return out


@pytest.mark.parametrize("centre_ps", [300.0, 900.0, 2400.0])
def test_fits_of_a_tail_are_those_of_a_period_that_holds_no_more(centre_ps):
    """Near either end, and in the middle of the codes; 40 pixels."""
    seen = counts(centre_ps, 40)
    shape = Response.with_tail(std_ps=STD_PS, tail_ps=TAIL_PS, tail_share=SHARE)
    without, within = (
        fit_pulses(
            lf.Histograms(seen, bin_width_ps=CODE_PS, laser_period_ps=period_ps),
            response=shape,
            max_pulses=1,
        )
        for period_ps in (None, 1e6)
    )
    assert within.usable.all()
    assert without.usable.all()
    # Each as near to the top as a fit is asked to be: a thousandth of an error squared.
    apart = (without.delay_ps - within.delay_ps) / np.sqrt(within.covariance[:, 0, 0])
    assert np.abs(apart).max() < 0.05


def test_a_flat_with_a_tail_is_calibrated_without_a_period():
    """300 pixels of 1,000 photons; delays to 3.2 ps each, so 0.2 of their mean square."""
    flat = lf.Histograms(counts(900.0, 300), bin_width_ps=CODE_PS)
    with pytest.warns(lf.errors.UncalibratedWarning):
        clock = lf.calibrate_timing(flat=flat, flat_pulse="tail")
    assert clock.response is not None
    found, put_in = (
        shape.std_ps / STD_PS
        for shape in (
            clock.response,
            Response.with_tail(std_ps=STD_PS, tail_ps=TAIL_PS, tail_share=SHARE),
        )
    )
    assert found == pytest.approx(put_in, rel=0.05)
