"""Without a flat pulses with a tail were fitted as one to three Gaussians, pixel by pixel.

A board, 2,000 photons a pixel, of whose light 30 % comes late by 150 ps in mean: times were 2.9 ps
off (rms, about one common shift), where the shape that was put in gives 1.0; with a little late
light of each pixel's own 16 ps, more than the fullest code (`benchmarks/boards.py`). What all
pulses have in common tells the shape.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import exponnorm, norm

import lightflight as lf
from lightflight import flags as fl
from lightflight.timing.clock.response import Response
from lightflight.timing.pulses.common_shape import common_shape, evenly_among, explained_better

SIZE, CODES, CODE_PS, STD_PS, TAIL_PS = 16, 400, 16.0, 30.0, 150.0
ROWS, COLS = np.mgrid[:SIZE, :SIZE]
DELAYS_PS = 1800.0 + 6.2 * COLS + 3.4 * ROWS


def board(share: float, own: float = 0.0, twice: float = 0.0) -> lf.Histograms:
    """Pulses of SciPy's exponentially modified Gaussian; in mean `own` of the light of each pixel
    comes 100 to 600 ps late; a share of pixels, `twice`, sees a second pulse half as bright soon
    after, as where legs meet."""
    rng = np.random.default_rng([47, int(100 * share), int(100 * own), int(100 * twice)])
    edges = CODE_PS * np.arange(CODES + 1) - DELAYS_PS[..., np.newaxis]

    def pulse(late_ps: np.ndarray) -> np.ndarray:
        at = edges - late_ps[..., np.newaxis]
        tail = exponnorm.cdf(at, TAIL_PS / STD_PS, 0.0, STD_PS)
        return np.diff((1.0 - share) * norm.cdf(at, 0.0, STD_PS) + share * tail)

    came = pulse(np.zeros((SIZE, SIZE)))
    part = rng.exponential(1.0, (SIZE, SIZE)) * own
    came += part[..., np.newaxis] * pulse(rng.uniform(100.0, 600.0, (SIZE, SIZE)))
    again = rng.uniform(size=(SIZE, SIZE)) < twice
    came += 0.5 * again[..., np.newaxis] * pulse(rng.uniform(60.0, 150.0, (SIZE, SIZE)))
    bright = 2000.0 * rng.lognormal(0.0, 0.5, (SIZE, SIZE))
    counts = rng.poisson(bright[..., np.newaxis] * came + 0.04)
    return lf.Histograms(
        counts.astype(np.uint32), bin_width_ps=CODE_PS, laser_period_ps=CODES * CODE_PS
    )


def error_ps(arrivals: lf.Arrivals) -> np.ndarray:
    """Of the strongest pulse of each pixel, but for a common shift."""
    off = arrivals.image("arrival_ps") - DELAYS_PS
    return np.asarray(off - np.median(off))


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.fixture(scope="module")
def tailed() -> lf.Histograms:
    return board(0.3)


def test_times_are_those_of_the_shape_that_was_put_in(tailed: lf.Histograms) -> None:
    found = lf.find_arrivals(tailed)
    shape = Response.with_tail(std_ps=STD_PS, tail_ps=TAIL_PS, tail_share=0.3).anchored()
    least = rms(error_ps(lf.find_arrivals(tailed, response=shape)))
    assert rms(error_ps(found)) < 1.03 * least
    nominal = lf.find_arrivals(tailed, timing=lf.TimingCalibration.nominal(tailed))
    np.testing.assert_array_equal(nominal.arrival_ps, found.arrival_ps)
    # Gaussians, as it was: 2.9 times.
    split = lf.find_arrivals(tailed, response="clock")
    assert rms(error_ps(split)) > 2.0 * least
    # Of 256 pulls the rms is known to 4.4 %: five of that.
    assert rms(error_ps(found) / found.image("photon_std_ps")) == pytest.approx(1.0, abs=0.22)


def test_the_shape_is_the_one_that_was_put_in(tailed: lf.Histograms) -> None:
    shape = common_shape(tailed, None, lf.fit_pulses(tailed, response="clock"))
    assert shape is not None
    truth = Response.with_tail(std_ps=1.0, tail_ps=TAIL_PS / STD_PS, tail_share=0.3)
    # Told by the half million photons of 128 pixels: 0.05 % off with this seed.
    assert shape.std_ps == pytest.approx(truth.std_ps, rel=0.03)


def test_late_light_of_each_pixels_own_is_no_harm() -> None:
    hist = board(0.3, own=0.05)
    shape = Response.with_tail(std_ps=STD_PS, tail_ps=TAIL_PS, tail_share=0.3).anchored()
    least = rms(error_ps(lf.find_arrivals(hist, response=shape)))
    assert rms(error_ps(lf.find_arrivals(hist))) < 1.15 * least


@pytest.mark.parametrize("twice", [0.0, 0.4])
def test_gaussians_stay_gaussians_also_where_pixels_see_two(twice: float) -> None:
    hist = board(0.0, twice=twice)
    gaussians = lf.fit_pulses(hist, response="clock")
    assert common_shape(hist, None, gaussians) is None
    np.testing.assert_array_equal(lf.fit_pulses(hist).delay_ps, gaussians.delay_ps)


def test_tails_are_found_where_pixels_see_two_pulses() -> None:
    hist = board(0.3, twice=0.4)
    shape = common_shape(hist, None, lf.fit_pulses(hist, response="clock"))
    assert shape is not None
    truth = Response.with_tail(std_ps=1.0, tail_ps=TAIL_PS / STD_PS, tail_share=0.3)
    assert shape.std_ps == pytest.approx(truth.std_ps, rel=0.1)


def test_a_name_that_is_none_is_told(tailed: lf.Histograms) -> None:
    with pytest.raises(ValueError, match='response must be one of "clock"'):
        lf.fit_pulses(tailed, response="gauss")


def test_a_shape_that_costs_pixels_their_time_is_not_taken(tailed: lf.Histograms) -> None:
    """As a decay does that the end of the codes cuts."""
    gaussians = lf.fit_pulses(tailed, response="clock")
    shape = Response.with_tail(std_ps=STD_PS, tail_ps=TAIL_PS, tail_share=0.3).anchored()
    shaped = lf.fit_pulses(tailed, response=shape)
    some = evenly_among(gaussians)
    assert explained_better(shaped, gaussians, some)
    lost = np.where(np.arange(len(shaped.row)) % 5 == 0, fl.NEAR_GATE_EDGE, 0).astype(np.uint32)
    assert not explained_better(replace(shaped, flags=shaped.flags | lost), gaussians, some)
